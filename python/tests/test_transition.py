"""Derivatives of steps, `lanesim.transition`: against MuJoCo's ``mjd_transitionFD``, and what callers may do wrong."""

from __future__ import annotations

import lanesim
import numpy as np
import pytest

from conftest import MODELS

CONVERGED = dict(tolerance=1e-18, iterations=200, ls_tolerance=1e-9, ls_iterations=100)
MODELS_OF_ALL_KINDS = (
    "zoo/ant zoo/hopper zoo/cartpole zoo/humanoid18 zoo/four_bar zoo/quadruped unit/muscle unit/activation unit/ball "
    "unit/sensors unit/actuator_limits unit/tendon_spatial unit/equality_weld unit/mocap unit/condim_elliptic"
).split()
NOT_DISCRETE = ("unit/tendon_spatial",)


def mujocos(mujoco, name, integrator, eps=1e-6, centred=True, nstate=4):
    """A model with states along a motion, and their derivatives."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))
    data = mujoco.MjData(model)
    for option, value in CONVERGED.items():
        setattr(model.opt, option, value)
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    random = np.random.default_rng(5)
    n, nu, ns = 2 * model.nv + model.na, model.nu, model.nsensordata
    rows = {key: [] for key in ("qpos", "qvel", "act", "ctrl", "qfrc_applied", "xfrc_applied", *"ABCD")}
    for _ in range(nstate):
        for _ in range(25):
            data.ctrl = random.uniform(-0.9, 0.9, nu)
            mujoco.mj_step(model, data)
        data.qfrc_applied, data.xfrc_applied = random.normal(size=model.nv), random.normal(size=(model.nbody, 6))
        for key in ("qpos", "qvel", "act", "ctrl", "qfrc_applied", "xfrc_applied"):
            rows[key].append(getattr(data, key).copy())
        sizes = dict(A=(n, n), B=(n, nu), C=(ns, n), D=(ns, nu))
        found = {key: np.zeros(shape) for key, shape in sizes.items()}
        mujoco.mjd_transitionFD(model, data, eps, centred, *(array if array.size else None for array in found.values()))
        for key, array in found.items():
            rows[key].append(array)
    # Columns of velocities do not come to where MuJoCo measures kinetic energy, and leave zeros.
    kinetic = model.sensor_adr[model.sensor_type == mujoco.mjtSensor.mjSENS_E_KINETIC]
    found = {key: np.array(values) for key, values in rows.items()}
    found["C"][:, kinetic] = np.nan
    return found


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "discrete"])
@pytest.mark.parametrize("name", MODELS_OF_ALL_KINDS)
def test_derivatives_are_mujocos(name, integrator):
    mujoco = pytest.importorskip("mujoco")
    if integrator == "discrete" and name in NOT_DISCRETE:
        pytest.skip("the model does not load with it")
    rows = mujocos(mujoco, name, integrator)
    expected = {key: rows.pop(key) for key in "ABCD"}
    model = lanesim.Model.from_xml_path(MODELS / f"{name}.xml", options={"integrator": integrator})
    found = lanesim.transition(model, **rows, sensors=True)
    for key in "ABCD":
        ours, theirs = getattr(found, key), expected[key]
        assert ours.shape == theirs.shape
        for i, (a, b) in enumerate(zip(ours, theirs)):
            known = np.isfinite(b)
            if known.any():
                np.testing.assert_allclose(a[known], b[known], rtol=0, atol=1e-6 * max(1, np.abs(b[known]).max()), err_msg=f"{key} of state {i}")


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
@pytest.mark.parametrize("name", MODELS_OF_ALL_KINDS)
def test_exact_derivatives_are_mujocos(name, integrator):
    mujoco = pytest.importorskip("mujoco")
    rows = mujocos(mujoco, name, integrator)
    expected = {key: rows.pop(key) for key in "ABCD"}
    model = lanesim.Model.from_xml_path(MODELS / f"{name}.xml", options={"integrator": integrator})
    found = lanesim.transition(model, **rows, method="exact")
    assert not found.sides.any() and found.C is None
    near, count = 0, 0
    for ours, theirs in [(found.A, expected["A"]), (found.B, expected["B"])]:
        for column in range(theirs.shape[2]):
            size = np.maximum(1, np.abs(theirs[:, :, column]).max(axis=1))
            error = np.abs(ours[:, :, column] - theirs[:, :, column]).max(axis=1) / size
            near, count = near + (error < 2e-6).sum(), count + error.size
    # Others go across a kink, in MuJoCo's differences: friction that is about to slide, a contact about to begin.
    assert near >= 0.97 * count, f"{near} of {count} columns"


def test_exact_derivatives_say_what_they_cannot(ant):
    qpos, qvel = np.tile(ant.qpos0, (2, 1)), np.zeros((2, ant.nv))
    for options, error, message in [
        (dict(eps=1e-6), lanesim.OptionError, "leave it out, or take them by differences"),
        (dict(sensors=True), lanesim.OptionError, "sensors have no exact derivatives yet"),
        (dict(precision="f32"), lanesim.OptionError, "ask for precision f64"),
    ]:
        with pytest.raises(error, match=message):
            lanesim.transition(ant, qpos, qvel, method="exact", **options)
    with pytest.raises(lanesim.UnknownNameError, match="expected one of fd, exact"):
        lanesim.transition(ant, qpos, qvel, method="exakt")
    with pytest.raises(lanesim.InputError, match="Runge-Kutta steps have no exact derivatives yet"):
        lanesim.transition(ant.replace(integrator="RK4"), qpos, qvel, method="exact")


def test_forward_differences_are_mujocos(ant):
    mujoco = pytest.importorskip("mujoco")
    rows = mujocos(mujoco, "zoo/ant", "Euler", eps=1e-5, centred=False)
    expected = {key: rows.pop(key) for key in "ABCD"}
    found = lanesim.transition(ant, **rows, eps=1e-5, centred=False)
    np.testing.assert_allclose(found.A, expected["A"], rtol=0, atol=1e-6 * np.abs(expected["A"]).max())
    np.testing.assert_allclose(found.B, expected["B"], rtol=0, atol=1e-6 * np.abs(expected["B"]).max())
    assert (found.sides == 1).all() and (found.status == 0).all() and found.C is None


def test_runge_kutta_is_its_own_limit():
    """MuJoCo's differences know no RK4: those of half the distance do."""
    model = lanesim.Model.from_xml_path(MODELS / "zoo" / "arm.xml", options={"integrator": "RK4"})
    random = np.random.default_rng(2)
    qpos, qvel = random.normal(size=(3, model.nq)), random.normal(size=(3, model.nv))
    coarse, fine = (lanesim.transition(model, qpos, qvel, eps=eps) for eps in (1e-4, 5e-5))
    np.testing.assert_allclose(coarse.A, fine.A, atol=1e-6 * np.abs(fine.A).max())
    euler = lanesim.transition(model.replace(integrator="Euler"), qpos, qvel)
    assert np.abs(euler.A - fine.A).max() > 1e-6


def test_one_state_many_and_trajectories_agree(ant):
    worlds = lanesim.Worlds(ant, 3)
    control = np.random.default_rng(1).uniform(-1, 1, (3, 20, ant.nu))
    rows = worlds.rollout(control, outputs=["qpos", "qvel"])
    whole = lanesim.transition(ant, rows["qpos"], rows["qvel"], ctrl=control)
    assert whole.A.shape == (3, 20, 28, 28) and whole.B.shape == (3, 20, 28, 8)
    one = lanesim.transition(ant, rows["qpos"][1, 7], rows["qvel"][1, 7], ctrl=control[1, 7], backend="scalar", threads=1)
    np.testing.assert_array_equal(one.A, whole.A[1, 7])
    np.testing.assert_array_equal(one.B, whole.B[1, 7])
    assert one.status.shape == () and one.sides.shape == (36,)
    assert lanesim.transition(ant, rows["qpos"][:0], rows["qvel"][:0]).A.shape == (0, 20, 28, 28)
    single = lanesim.transition(ant, rows["qpos"], rows["qvel"], ctrl=control, precision="f32")
    assert single.A.dtype == np.float32
    seen = []
    lanesim.transition(ant, rows["qpos"], rows["qvel"], progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (60, 60)


def test_bad_input_is_named(ant):
    qpos, qvel = np.tile(ant.qpos0, (3, 1)), np.zeros((3, ant.nv))
    with pytest.raises(lanesim.InputError, match=r"array `qvel` has shape \[2, 14\]; expected \[3, nv=14\]"):
        lanesim.transition(ant, qpos, qvel[1:])
    with pytest.raises(lanesim.InputError, match=r"array `xfrc_applied` has shape \[3, 6\]; expected \[3, nbody=10, 6\]"):
        lanesim.transition(ant, qpos, qvel, xfrc_applied=np.zeros((3, 6)))
    bad = qpos.copy()
    bad[1, 3:7] = 0
    with pytest.raises(lanesim.InputError, match=r"array `qpos` holds a quaternion of length zero at \[1, 3\]"):
        lanesim.transition(ant, bad, qvel)
    bad[1, 2] = np.nan
    with pytest.raises(lanesim.InputError, match=r"array `qpos` holds NaN at \[1, 2\]"):
        lanesim.transition(ant, bad, qvel)
    for eps in (0, -1e-6, np.nan):
        with pytest.raises(lanesim.OptionError, match="expected a number from 1e-12 to 1"):
            lanesim.transition(ant, qpos, qvel, eps=eps)
    with pytest.raises(lanesim.OptionError, match="in single precision"):
        lanesim.transition(ant, qpos, qvel, eps=1e-6, precision="f32")
    with pytest.raises(lanesim.UnknownNameError, match="solving is 'exact'; expected one of accurate, fixed_work"):
        lanesim.transition(ant, qpos, qvel, solving="exact")


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "discrete"])
def test_accelerations_lead_to_steps(ant, integrator):
    """Of a step that is explicit but for what it adds to velocities, A's velocity rows are those of qacc, times the time step."""
    worlds = lanesim.Worlds(ant, 3)
    rows = worlds.rollout(np.random.default_rng(1).uniform(-1, 1, (3, 40, ant.nu)), outputs=["qpos", "qvel"])
    model = ant.replace(integrator=integrator, eulerdamp=False)
    given = rows["qpos"][:, -1], rows["qvel"][:, -1]
    ctrl = np.full((3, ant.nu), 0.3)
    steps, found = lanesim.transition(model, *given, ctrl=ctrl), lanesim.acceleration_derivatives(model, *given, ctrl=ctrl)
    assert found.A.shape == (3, 14, 28) and found.B.shape == (3, 14, 8)
    if integrator == "implicitfast":  # Its steps have another matrix than its accelerations.
        return
    h, nv = model.opt.timestep, model.nv
    still = np.concatenate([np.zeros((nv, nv)), np.eye(nv)], axis=1)
    np.testing.assert_allclose(still + h * found.A, steps.A[:, nv:], atol=1e-7 * np.abs(steps.A).max())
    np.testing.assert_allclose(h * found.B, steps.B[:, nv:], atol=1e-7 * np.abs(steps.B).max())


@pytest.mark.parametrize("name", ["zoo/ant", "zoo/hopper", "zoo/four_bar", "unit/ball", "unit/fluid_ellipsoid", "unit/condim_elliptic"])
def test_inverse_derivatives_are_mujocos(name):
    mujoco = pytest.importorskip("mujoco")
    reference = mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))
    data, random = mujoco.MjData(reference), np.random.default_rng(3)
    model = lanesim.Model.from_xml_path(MODELS / f"{name}.xml")
    nv = reference.nv
    for _ in range(3):
        for _ in range(40):
            data.ctrl = random.uniform(-0.5, 0.5, reference.nu)
            mujoco.mj_step(reference, data)
        data.qacc = random.normal(size=nv)
        state = data.qpos.copy(), data.qvel.copy(), data.qacc.copy()
        expected = [np.zeros((nv, nv)) for _ in range(3)]
        mujoco.mjd_inverseFD(reference, data, 1e-6, False, *expected, None, None, None, None)
        found = lanesim.inverse_derivatives(model, *state, act=data.act, centred=False)
        for ours, theirs in zip(found, expected):
            np.testing.assert_allclose(ours, theirs.T, rtol=0, atol=1e-6 * max(1, np.abs(theirs).max()))
        centred = lanesim.inverse_derivatives(model, *state, act=data.act)
        mass = np.zeros((nv, nv))
        mujoco.mj_forward(reference, data)  # Differences leave the inertia of another state.
        mujoco.mj_fullM(reference, data, mass)
        if data.nefc == 0:
            np.testing.assert_allclose(centred.da, mass, rtol=0, atol=1e-7 * np.abs(mass).max())


def test_rows_that_begin_to_act_are_counted():
    xml = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .1"><freejoint/><geom size=".1"/>
        </body></worldbody></mujoco>"""
    model = lanesim.Model.from_xml_string(xml)
    rows = np.tile(model.qpos0, (3, 1))
    rows[:, 2] = 0.2, 0.1 + 1e-7, 0.0999  # in the air, within eps, in contact
    found = lanesim.transition(model, rows, np.zeros((3, 6)))
    assert found.changed[:, 2].tolist() == [0, 1, 0]
    assert not found.changed[:, [0, 1, 3, 4, 5]].any()
