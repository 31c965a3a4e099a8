"""Records what MuJoCo computes for our own models, as small .npz files beside this script.

    pip install mujoco==4.0.0 numpy
    python tests/goldens/make.py            every model under models/zoo and models/unit
    python tests/goldens/make.py ant hinge  only these

One file per model. Names are MuJoCo's, behind a prefix:

    in/     qpos qvel ctrl qfrc_applied xfrc_applied, act, eq_active and mocap_pos, mocap_quat if there are any, [N, ...]: the states
    out/    what mj_forward leaves behind at each state, [N, ...], sensordata if there are sensors; contacts and constraint rows
            are padded with zeros to the largest count, `out/ncon` and `out/nefc` say how many count
    next/   qpos, qvel and act after one mj_step (Euler)
    model/  compiled quantities, once; those of sensors and tendons if there are any; those of ACTUATORS, and act_dot and
            actuator_moment, where actuators act on more than joints or have activations
    size/   nq nv nu nbody ...

The solver runs to 1e-14 in at most 200 iterations without warm start, so constrained results are the minimiser and not a
solver's path to it. With elliptic cones the solver stops when the cost does not improve, a little early; it then goes on
from where it stopped. A state is used only if it is not on a knife's edge: after moving qpos by 1e-9 it must have the same
contacts at nearly the same places and nearly the same acceleration.
"""

import io
import pathlib
import sys
import zipfile

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
MODELS = HERE.parent.parent / "models"
VERSION = "4.0.0"
INPUTS = ("qpos", "qvel", "ctrl", "qfrc_applied", "xfrc_applied")
SIZES = "nq nv nu na nbody njnt ngeom nsite nkey npair nexclude".split()
MODEL = (
    "qpos0 qpos_spring body_parentid body_mass body_inertia body_pos body_quat body_ipos body_invweight0 body_gravcomp "
    "jnt_type jnt_bodyid jnt_qposadr jnt_dofadr jnt_pos jnt_axis jnt_stiffness jnt_range jnt_limited dof_bodyid dof_parentid "
    "dof_armature dof_damping dof_invweight0 geom_type geom_bodyid geom_size geom_pos geom_quat geom_rbound site_bodyid site_pos "
    "site_quat actuator_gear actuator_gainprm actuator_biasprm actuator_ctrlrange actuator_forcerange actuator_acc0 "
    "actuator_ctrllimited actuator_forcelimited key_time key_qpos key_qvel key_ctrl eq_type eq_obj1id eq_obj2id eq_objtype "
    "eq_active0 eq_solref eq_solimp eq_data"
).split()
SENSORS = (
    "sensor_type sensor_datatype sensor_needstage sensor_objtype sensor_objid sensor_reftype sensor_refid sensor_dim sensor_adr "
    "sensor_cutoff sensor_noise"
).split()
SENSOR_SIZES = "nsensor nsensordata".split()
TENDON_MODEL = (
    "tendon_adr tendon_num tendon_limited tendon_actfrclimited tendon_range tendon_actfrcrange tendon_margin tendon_solref_lim "
    "tendon_solimp_lim tendon_solref_fri tendon_solimp_fri tendon_stiffness tendon_stiffnesspoly tendon_damping "
    "tendon_dampingpoly tendon_armature tendon_frictionloss tendon_lengthspring tendon_length0 tendon_invweight0 wrap_type "
    "wrap_objid wrap_prm"
).split()
ACTUATORS = (
    "actuator_trntype actuator_trnid actuator_cranklength actuator_length0 actuator_lengthrange actuator_dyntype actuator_dynprm "
    "actuator_gaintype actuator_biastype actuator_actadr actuator_actnum actuator_actrange actuator_actlimited actuator_actearly "
    "key_act"
).split()
FIELDS = (
    "xpos xquat xipos subtree_com geom_xpos geom_xmat site_xpos site_xmat cdof actuator_length actuator_velocity qfrc_bias "
    "qfrc_passive actuator_force qfrc_actuator qacc_smooth energy qfrc_constraint qacc"
).split()
CONTACT = {"geom": 2, "dim": 0, "dist": 0, "pos": 3, "frame": 9, "friction": 5, "includemargin": 0, "efc_address": 0}
ROWS = "efc_type efc_id efc_pos efc_D efc_R efc_aref efc_force".split()
NAMES = {"includemargin": "margin", "efc_address": "efc"}
SETTLE = 500  # steps under control noise before a state in contact is taken
CHOICES = 4  # states of a kind from which one is chosen
AGAIN = 3  # runs of the solver for elliptic cones, each from the last one's result
TRIES = 40  # states tried before a kind of state is given up


def converge(model):
    """Solver settings under which results are the minimiser."""
    model.opt.tolerance, model.opt.ls_tolerance, model.opt.iterations = 1e-14, 1e-6, 200
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)


def control_range(model):
    limited = model.actuator_ctrllimited.astype(bool)
    return (np.where(limited, model.actuator_ctrlrange[:, 0], -1.0),
            np.where(limited, model.actuator_ctrlrange[:, 1], 1.0))


def stable(model, rng):
    """A thousand steps under control noise raise no warning."""
    data = mujoco.MjData(model)
    lo, hi = control_range(model)
    for _ in range(1000):
        data.ctrl[:] = rng.uniform(lo, hi)
        mujoco.mj_step(model, data)
    return not any(w.number for w in data.warning)


# ---- states ---------------------------------------------------------------------------------------------------------------

def at_rest(model, rng):
    """The first keyframe, or the defining configuration, slightly moved."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    move(model, data.qpos, 1e-3 * rng.standard_normal(model.nv))
    return data


def anywhere(model, rng):
    """Random joints (within limits if there are any), random velocity, random forces."""
    data = mujoco.MjData(model)
    for j in range(model.njnt):
        a, kind = model.jnt_qposadr[j], model.jnt_type[j]
        if kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            wide = 1.0 if kind == mujoco.mjtJoint.mjJNT_HINGE else 0.1
            lo, hi = model.jnt_range[j] if model.jnt_limited[j] else data.qpos[a] + wide * np.array([-1, 1])
            data.qpos[a] = rng.uniform(lo, hi) + 0.05 * (hi - lo) * rng.standard_normal()
    move(model, data.qpos, 0.1 * rng.standard_normal(model.nv) * (~scalar_dofs(model)))
    data.qvel[:] = rng.standard_normal(model.nv)
    data.qfrc_applied[:] = 0.3 * rng.standard_normal(model.nv)
    data.xfrc_applied[1:] = 0.3 * rng.standard_normal((model.nbody - 1, 6))
    carry(model, data, rng)
    return data


def carry(model, data, rng):
    """Moves mocap bodies a little."""
    if model.nmocap:
        data.mocap_pos += 0.1 * rng.standard_normal((model.nmocap, 3))
        data.mocap_quat += 0.3 * rng.standard_normal((model.nmocap, 4))
        data.mocap_quat /= np.linalg.norm(data.mocap_quat, axis=1, keepdims=True)


def toggled(model, rng):
    """Anywhere, and of the equality constraints about half active."""
    data = anywhere(model, rng)
    data.eq_active[:] = rng.integers(0, 2, model.neq)
    return data


def settled(model, rng):
    """After a while under control noise."""
    data = mujoco.MjData(model)
    data.qvel[:] = 0.05 * rng.uniform(-1, 1, model.nv)
    carry(model, data, rng)
    lo, hi = control_range(model)
    for _ in range(SETTLE + int(rng.integers(200))):
        data.ctrl[:] = rng.uniform(lo, hi)
        mujoco.mj_step(model, data)
    return data


def scalar_dofs(model):
    return np.isin(model.jnt_type[model.dof_jntid], (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))


def move(model, qpos, by):
    if model.nv:
        mujoco.mj_integratePos(model, qpos, by, 1.0)


def inputs(model):
    """What makes up a state."""
    mocap = ("mocap_pos", "mocap_quat") * (model.nmocap > 0)
    past = ("time", "history") * (model.nhistory > 0) + ("plastic",) * (model.nplastic > 0)
    return INPUTS + past + ("act",) * (model.na > 0) + ("eq_active",) * (model.neq > 0) + mocap


def more_than_joints(model):
    """Whether actuators have more than the plain ones, which act on joints without activations."""
    return model.na > 0 or (model.actuator_trntype > int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)).any()


def collect(model, rng):
    """Up to four states: at rest, random with applied forces, two settled; of several each, the one with most contacts. Where
    there are equality constraints, a fifth: random, with others active."""
    lo, hi = control_range(model)
    states = []
    for kind in (at_rest, anywhere, settled, settled) + (toggled,) * (model.neq > 0):
        found = []
        for _ in range(TRIES):
            data = kind(model, rng)
            data.ctrl[:] = rng.uniform(lo, hi) * 1.2
            if model.na:
                data.act[:] = rng.uniform(-0.1, 1.1, model.na)
            state = {k: np.array(getattr(data, k)) for k in inputs(model)}
            if steady(model, state):
                found.append(state)
            if len(found) == CHOICES:
                break
        if found:
            states.append(max(found, key=lambda s: richness(model, s)))
        else:
            print(f"  no steady state of kind {kind.__name__}")
    return states


def richness(model, state):
    """Contacts between moving bodies first, then constraint rows."""
    data = forward(model, state)
    moving = model.body_weldid[model.geom_bodyid[data.contact.geom.reshape(-1, 2)]] != 0
    return int(moving.all(axis=1).sum()), data.nefc


def start(model, state):
    data = mujoco.MjData(model)
    for k, v in state.items():
        if k == "time":
            data.time = v
        else:
            getattr(data, k)[:] = v
    return data


def forward(model, state):
    data = start(model, state)
    mujoco.mj_forward(model, data)
    if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC:
        for _ in range(AGAIN):
            data.qacc_warmstart[:] = data.qacc
            mujoco.mj_forward(model, data)
    return data


def steady(model, state):
    """Whether a slightly moved state gives nearly the same results."""
    rng = np.random.default_rng(1)
    a = forward(model, state)
    if any(w.number for w in a.warning):
        return False
    for _ in range(3):
        near = dict(state, qpos=state["qpos"].copy())
        move(model, near["qpos"], 1e-9 * rng.standard_normal(model.nv))
        b = forward(model, near)
        if a.ncon != b.ncon or a.nefc != b.nefc or not np.array_equal(a.contact.geom, b.contact.geom):
            return False
        if a.ncon and (np.abs(a.contact.pos - b.contact.pos).max() > 1e-6
                       or np.abs(a.contact.frame - b.contact.frame).max() > 1e-6):
            return False
        if model.nv and np.abs(a.qacc - b.qacc).max() > 1e-5 * (1 + np.abs(a.qacc).max()):
            return False
    return True


# ---- results --------------------------------------------------------------------------------------------------------------

def results(model, data):
    """Everything recorded about one state, contacts and rows unpadded."""
    out = {k: np.array(getattr(data, k)) for k in FIELDS + ["sensordata"] * (model.nsensor > 0)}
    if more_than_joints(model):
        moment = np.zeros((model.nout, model.nv))
        mujoco.mju_sparse2dense(moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        out["actuator_moment"], out["act_dot"] = moment, np.array(data.act_dot)
    out["qM"] = np.zeros((model.nv, model.nv))
    if model.nv:
        mujoco.mj_fullM(model, data, out["qM"])
    if model.ntendon:
        out["ten_length"], out["ten_velocity"] = np.array(data.ten_length), np.array(data.ten_velocity)
        out["ten_J"] = tendon_jacobian(model, data)
    out["efc_J"] = jacobian(model, data)
    out.update({k: np.array(getattr(data, k)) for k in ROWS})
    for k, width in CONTACT.items():
        shape = (data.ncon, width) if width else (data.ncon,)
        out["contact_" + NAMES.get(k, k)] = np.array(getattr(data.contact, k)).reshape(shape)
    out["ncon"], out["nefc"] = np.array(data.ncon), np.array(data.nefc)
    return out


def jacobian(model, data):
    dense = np.zeros((data.nefc, model.nv))
    if not mujoco.mj_isSparse(model):
        dense[:] = np.array(data.efc_J).reshape(-1)[:dense.size].reshape(dense.shape)
        return dense
    for i in range(data.nefc):
        start, count = data.efc_J_rowadr[i], data.efc_J_rownnz[i]
        dense[i, data.efc_J_colind[start:start + count]] = data.efc_J[start:start + count]
    return dense


def tendon_jacobian(model, data):
    dense = np.zeros((model.ntendon, model.nv))
    for t in range(model.ntendon):
        start, count = model.ten_J_rowadr[t], model.ten_J_rownnz[t]
        dense[t, model.ten_J_colind[start:start + count]] = data.ten_J[start:start + count]
    return dense


def pad(rows):
    """Arrays of one field, one per state, as one array padded with zeros."""
    shape = np.max([r.shape for r in rows], axis=0).astype(int) if rows[0].ndim else ()
    out = np.zeros((len(rows), *shape), rows[0].dtype)
    for i, r in enumerate(rows):
        out[(i, *(slice(n) for n in r.shape))] = r
    return out


def record(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    rng = np.random.default_rng(sum(path.stem.encode()))
    if not stable(model, rng):
        raise SystemExit(f"{path}: not stable under control noise")
    converge(model)
    states = collect(model, rng)
    sizes = SIZES + ["neq"] * (model.neq > 0) + ["ntendon"] * (model.ntendon > 0) + SENSOR_SIZES * (model.nsensor > 0)
    compiled = MODEL + TENDON_MODEL * (model.ntendon > 0) + SENSORS * (model.nsensor > 0)
    arrays = {"size/" + k: np.array(getattr(model, k)) for k in sizes}
    arrays.update({"model/" + k: np.array(getattr(model, k)) for k in compiled})
    arrays.update({"in/" + k: np.array([s[k] for s in states]) for k in inputs(model)})
    if more_than_joints(model):
        arrays.update({"model/" + k: np.array(getattr(model, k)) for k in ACTUATORS})
    outs, after = [], {k: [] for k in ("qpos", "qvel") + ("act",) * (model.na > 0)}
    for state in states:
        data = forward(model, state)
        outs.append(results(model, data))
        warm = np.array(data.qacc)
        data = start(model, state)
        if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC:
            data.qacc_warmstart[:] = warm
        mujoco.mj_step(model, data)
        for k, v in after.items():
            v.append(np.array(getattr(data, k)))
    arrays.update({"out/" + k: pad([o[k] for o in outs]) for k in outs[0]})
    arrays.update({"next/" + k: np.array(v) for k, v in after.items()})
    size = save(HERE / (path.stem + ".npz"), arrays)
    print(f"{path.stem:22s} {len(states)} states, ncon {[int(o['ncon']) for o in outs]}, "
          f"nefc {[int(o['nefc']) for o in outs]}, {size / 1e3:.1f} kB", flush=True)


def save(path, arrays):
    """Like numpy.savez_compressed, but the same arrays always give the same bytes; arrays without entries are left out."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, array in sorted(arrays.items()):
            if not array.size:
                continue
            if array.dtype.kind in "iub":
                array = array.astype("<i4")
            raw = io.BytesIO()
            np.save(raw, array, allow_pickle=False)
            entry = zipfile.ZipInfo(name + ".npy", (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, raw.getvalue())
    return path.stat().st_size


def main():
    if mujoco.__version__ != VERSION:
        raise SystemExit(f"MuJoCo {VERSION} is needed, this is {mujoco.__version__}")
    wanted = set(sys.argv[1:])
    paths = [p for folder in ("zoo", "unit") for p in sorted((MODELS / folder).glob("*.xml"))]
    for path in paths:
        if not wanted or path.stem in wanted:
            record(path)


if __name__ == "__main__":
    main()
