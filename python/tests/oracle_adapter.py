"""States through the Python package, one model and one world at a time, for comparing with recorded results.

Environment: LANESIM_PRECISION, f64 (default) or f32; LANESIM_LENIENT=1 leaves out what is not supported.
"""

import os

import lanesim
import numpy as np

PRECISION = os.environ.get("LANESIM_PRECISION", "f64")
LENIENT = os.environ.get("LANESIM_LENIENT", "") not in ("", "0")

MODEL_FIELDS = (
    "body_parentid jnt_type jnt_bodyid geom_type geom_bodyid qpos0 body_mass body_inertia body_ipos body_iquat "
    "body_pos body_quat jnt_pos jnt_axis gravity geom_size dof_armature dof_damping dof_invweight0 "
    "body_invweight0 tendon_length0 actuator_acc0 actuator_lengthrange"
).split()
STATE_FIELDS = (
    "xpos xquat xipos subtree_com geom_xpos geom_xquat site_xpos site_xquat cdof xvel ten_length ten_velocity "
    "actuator_length actuator_velocity qM qfrc_bias qfrc_passive actuator_force qfrc_actuator act_dot qacc_smooth "
    "energy qfrc_constraint qacc sensordata"
).split()
CONTACT_FIELDS = "dim dist pos frame friction margin efc".split()
ROW_FIELDS = "efc_type efc_id efc_J efc_pos efc_D efc_R efc_aref efc_force".split()
INPUTS = "time qpos qvel act ctrl qfrc_applied xfrc_applied mocap_pos mocap_quat eq_active".split()


def known(names):
    """Those that the engine has."""
    return [name for name in names if name in lanesim.OUTPUTS]


class Adapter:
    """One model at a time, one world of it."""

    name = "lanesim"
    precision = PRECISION

    def load(self, path, opts):
        """Load an MJCF file with other options."""
        return lanesim.Model.from_xml_path(path, lenient=LENIENT, options=opts)

    def info(self, model):
        """Sizes by MuJoCo's names."""
        return model.sizes()

    def model_fields(self, model):
        """Compile-time arrays."""
        fields = {name: getattr(model, name) for name in MODEL_FIELDS if name in model.array_names}
        # That which acts is asked for.
        return {**fields, "gravity": fields["gravity"] * model.opt.flags["gravity"]}

    def worlds(self, model, state):
        """One world in a state."""
        worlds = lanesim.Worlds(model, 1, PRECISION, threads=1)
        for name in INPUTS:
            if name in state and np.size(state[name]):
                setattr(worlds, name, np.asarray(state[name])[None])
        return worlds

    def forward(self, model, state):
        """Everything that there is to a state."""
        contacts = ["contact_geom", *("contact_" + name for name in CONTACT_FIELDS)]
        names = [*known(STATE_FIELDS), *contacts, *ROW_FIELDS]
        values = {name: array[0] for name, array in self.worlds(model, state).get(names).items()}
        out = {name: values[name] for name in (*known(STATE_FIELDS), *ROW_FIELDS)}
        out.update({"con_" + name: values["contact_" + name] for name in CONTACT_FIELDS})
        geoms = values["contact_geom"]
        out["con_id"] = np.concatenate([geoms, np.full((len(geoms), 6), -1, np.int32)], axis=1)
        return out

    def step(self, model, state, integrator, record):
        """States after the step numbers in `record`, with constant inputs."""
        if integrator:
            model = model.replace(integrator=integrator)
        worlds = self.worlds(model, state)
        rows = {"qpos": [], "qvel": [], "act": []}
        done = 0
        for number in record:
            worlds.step(number - done)
            done = number
            for name, array in worlds.get(list(rows)).items():
                rows[name].append(array[0])
        return {name: np.array(arrays) for name, arrays in rows.items()}

    def inverse(self, model, state, qacc):
        """The force for which a state has an acceleration."""
        return self.worlds(model, state).inverse(np.asarray(qacc)[None])[0]

    def fd(self, model, state, eps, integrator):
        """Derivatives of a step by state and controls: in double precision, which differences of 1e-6 need."""
        if integrator:
            model = model.replace(integrator=integrator)
        given = {name: np.asarray(state[name]) for name in INPUTS if name in state and np.size(state[name])}
        given.pop("time", None)
        given.setdefault("qvel", np.zeros(model.nv))
        found = lanesim.transition(model, **given, eps=eps, threads=1)
        return found.A, found.B
