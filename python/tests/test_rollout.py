"""`lanesim.rollout` beside ``mujoco.rollout``."""

from __future__ import annotations

import corpus
import lanesim
import mujoco
import numpy as np
import pytest
from mujoco import rollout as mujoco_rollout
from test_conformance import EDGE, iterates

NSTEP = 100
NBATCH = 3
OPTIONS = {**corpus.OPTIONS, "integrator": "Euler"}
CHAOS = 0.3


def candidates():
    """Models that both load, with the integrator that is built and without anything that iterates on shapes."""
    for package in ("dm_control", "gymnasium"):
        for path in corpus.installed(package):
            exact = corpus.load_mujoco(path)
            if exact is None or exact.nv == 0:
                continue
            try:
                model = lanesim.Model.from_xml_path(path, options=corpus.OPTIONS)
            except lanesim.ModelError as error:
                assert corpus.unsupported(error), error
                continue
            if iterates(model):
                continue
            corpus.settle(exact)
            exact.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
            yield f"{package}/{path.parent.name}/{path.name}", exact, model.replace(**OPTIONS)


def theirs(exact, state, control):
    """MuJoCo's trajectories."""
    return mujoco_rollout.rollout(exact, mujoco.MjData(exact), state, control)


def test_trajectories_are_those_of_mujoco(rng) -> None:
    followed, wrong = 0, []
    for name, exact, model in candidates():
        size = mujoco.mj_stateSize(exact, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
        start = np.empty((NBATCH, size))
        edge = np.inf  # A contact that starts on the edge of its margin is there or not, and either is right.
        for row, data in zip(start, corpus.states(exact, NBATCH)):
            mujoco.mj_getState(exact, data, row, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
            mujoco.mj_forward(exact, data)
            edge = min(edge, np.abs(data.contact.dist - data.contact.includemargin).min(initial=np.inf))
        control = rng.uniform(-0.5, 0.5, (NBATCH, NSTEP, exact.nu))
        state, sensordata = lanesim.rollout(model, start, control)
        wanted, wanted_sensordata = theirs(exact, start, control)
        assert state.shape == wanted.shape and state.dtype == wanted.dtype
        assert sensordata.shape[:2] == wanted_sensordata.shape[:2]
        # What rounding alone does: the divergence of MuJoCo from itself after a change in the last digits.
        disturbed, _ = theirs(exact, start * (1 + 1e-15 * rng.choice([-1.0, 1.0], start.shape)), control)
        scale = np.maximum(np.abs(wanted).max(axis=(0, 1)), 1e-3)
        error = (np.abs(state - wanted) / scale).max(axis=2)
        rounding = np.maximum.accumulate((np.abs(disturbed - wanted) / scale).max(axis=2), axis=1)
        allowed = 1e-6 + 100 * rounding
        judged = allowed < CHAOS
        if edge < EDGE:
            continue
        followed += judged.all()
        if (error > allowed)[judged].any():
            wrong.append(f"{name}: {error[judged].max():.1e} at step {np.argwhere((error > allowed) & judged)[0]}")
    assert not wrong, "\n".join(wrong)
    print(f"{followed} models followed for {NSTEP} steps")
    assert followed >= 10


@pytest.mark.parametrize("state_dims, control_dims, nstep", [(1, 1, 5), (2, 3, None), (1, 3, None), (2, 2, None)])
def test_shapes_are_inferred_as_by_mujoco(pendulum, state_dims, control_dims, nstep) -> None:
    exact = mujoco.MjModel.from_xml_string(pendulum.__reduce__()[1][1])
    start = np.zeros((4, 3))[(0,) * (2 - state_dims)]
    control = np.zeros((4, 7, 1))[(0,) * (3 - control_dims)]
    state, _ = lanesim.rollout(pendulum, start, control, nstep=nstep)
    wanted, _ = mujoco_rollout.rollout(exact, mujoco.MjData(exact), start, control, nstep=nstep)
    assert state.shape == wanted.shape
    np.testing.assert_allclose(state, wanted, rtol=1e-9, atol=1e-12)


def test_singletons_are_repeated(ant, rng) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    control = rng.uniform(-1, 1, (5, 1, ant.nu))
    state, _ = lanesim.rollout(ant, start, control, nstep=9)
    full, _ = lanesim.rollout(ant, np.tile(start, (5, 1)), np.tile(control, (1, 9, 1)))
    assert state.shape == (5, 9, 1 + ant.nq + ant.nv)
    np.testing.assert_array_equal(state, full)


def test_results_go_to_given_arrays(ant) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    wanted, _ = lanesim.rollout(ant, start, nstep=4)
    for dtype in (np.float64, np.float32):
        out = np.full((1, 4, start.size), np.nan, dtype=dtype)
        state, _ = lanesim.rollout(ant, start, state=out)
        assert state is out
        np.testing.assert_array_equal(out, wanted.astype(dtype))
    readonly = np.empty((1, 4, start.size))
    readonly.flags.writeable = False
    with pytest.raises(lanesim.InputError, match="read-only"):
        lanesim.rollout(ant, start, state=readonly)
    with pytest.raises(lanesim.InputError, match="contiguous"):
        lanesim.rollout(ant, start, state=np.empty((1, 4, start.size), order="F"))


def test_outputs_are_recorded(ant) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    state, _, extra = lanesim.rollout(ant, start, nstep=6, outputs=["qpos", "xpos", "ncon"])
    np.testing.assert_array_equal(extra["qpos"], state[:, :, 1 : 1 + ant.nq])
    assert extra["xpos"].shape == (1, 6, ant.nbody, 3) and extra["ncon"].dtype == np.int32
    with pytest.raises(lanesim.InputError, match="differs in length"):
        lanesim.rollout(ant, start, nstep=6, outputs=["contact_dist"])


def test_a_pool_is_used_again(ant, pendulum, rng) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    control = rng.uniform(-1, 1, (20, 10, ant.nu))
    with lanesim.Rollout(nthread=2) as pool:
        first, _ = pool.rollout(ant, start, control)
        pool.rollout(pendulum, np.zeros(3), nstep=3)
        again, _ = pool.rollout(ant, start, control)
        third, _ = pool.rollout(ant, start, control)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, third)
    with pytest.raises(RuntimeError, match="shutdown"):
        pool.rollout(ant, start, control)
    persistent, _ = lanesim.rollout(ant, start, control, persistent_pool=True)
    np.testing.assert_array_equal(first, persistent)
    lanesim.shutdown_persistent_pool()


def test_warm_start_is_used(ant) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    warm = np.full(ant.nv, 0.1)
    state, _ = lanesim.rollout(ant, start, nstep=2, initial_warmstart=warm)
    plain, _ = lanesim.rollout(ant, start, nstep=2)
    np.testing.assert_allclose(state, plain, atol=1e-6)


def test_a_warm_start_is_an_acceleration_as_in_mujoco(rng) -> None:
    """With one iteration, only a start at the solution ends there: which array that is shows what it means."""
    xml = "<mujoco><worldbody><geom type='plane' size='5 5 .1'/>"
    for i in range(4):
        xml += f"<body pos='{i * 0.15} 0 .1'><freejoint/><geom size='.1'/></body>"
    xml += "</worldbody><actuator/></mujoco>"
    exact, model = mujoco.MjModel.from_xml_string(xml), lanesim.Model.from_xml_string(xml)
    data = mujoco.MjData(exact)
    data.qvel[:] = rng.standard_normal(exact.nv)
    mujoco.mj_forward(exact, data)
    start = np.concatenate([[0.0], data.qpos, data.qvel])
    solved, _ = lanesim.rollout(model, start, nstep=1)
    hasty = model.replace(iterations=1)
    warm, _ = lanesim.rollout(hasty, np.tile(start, (3, 1)), nstep=1, initial_warmstart=data.qacc)
    cold, _ = lanesim.rollout(hasty, start, nstep=1)
    np.testing.assert_allclose(warm, np.broadcast_to(solved, warm.shape), atol=1e-9)
    assert np.abs(cold - solved).max() > 1e-4
    off, _ = lanesim.rollout(model, start, nstep=1, initial_warmstart=rng.standard_normal(exact.nv))
    np.testing.assert_allclose(off, solved, atol=1e-6)


def test_memory_of_results_is_used_again(ant) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])

    def run() -> np.ndarray:
        return lanesim.rollout(ant, start, np.zeros((200, 40, ant.nu)))[0]

    lanesim.shutdown_persistent_pool()
    first = run()
    kept, view = first.copy(), first[3:5]
    address = first.ctypes.data
    del first
    second = run()
    assert second.ctypes.data != address, "a view of the first result is still in use"
    np.testing.assert_array_equal(view, kept[3:5])
    del view
    assert run().ctypes.data == address
    assert second.flags.writeable and second.flags.c_contiguous
    lanesim.shutdown_persistent_pool()
    assert not lanesim._reuse._kept


def test_results_too_large_for_memory_are_refused(ant) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    for nstep in (10**13, 2**62):
        with pytest.raises(lanesim.WorldMemoryError, match="the results would take"):
            lanesim.rollout(ant, start, nstep=nstep)


def test_calls_meant_for_mujoco_say_what_to_change(pendulum) -> None:
    exact = mujoco.MjModel.from_xml_string(pendulum.__reduce__()[1][1])
    data = mujoco.MjData(exact)
    with pytest.raises(TypeError, match="from_mjmodel.model. makes one"):
        lanesim.rollout(exact, np.zeros(3))
    for given in (data, [data, data]):
        with pytest.raises(TypeError, match="leave out the second argument"):
            lanesim.rollout(pendulum, given, np.zeros((1, 3)))


def test_results_cannot_overwrite_the_controls(pendulum) -> None:
    memory = np.zeros(60)
    with pytest.raises(lanesim.InputError, match="overlaps `control`"):
        lanesim.rollout(pendulum, np.zeros(3), memory[:20].reshape(2, 10, 1), state=memory.reshape(2, 10, 3))


def test_single_precision(ant) -> None:
    start = np.concatenate([[0.0], ant.qpos0, np.zeros(ant.nv)])
    exact, _ = lanesim.rollout(ant, start, nstep=20)
    state, _ = lanesim.rollout(ant, start, nstep=20, precision="f32")
    assert state.dtype == np.float32
    np.testing.assert_allclose(state, exact, atol=1e-3)


@pytest.mark.parametrize(
    "arguments, text",
    [
        ({"initial_state": np.zeros(4)}, r"expected \[nbatch=1, nstate=3\]"),
        ({"control": np.zeros((2, 5, 3))}, r"shape \[2, 5, 3\]; expected \[nbatch=2, nstep=5, nu=1\]"),
        ({"control": np.zeros((2, 5, 1)), "nstep": 7}, "nstep inferred as 7 but control has 5"),
        ({"control": np.full((1, 2, 1), np.nan)}, r"array `control` holds NaN at \[0, 0, 0\]"),
        ({"initial_state": [0.0, np.inf, 0.0]}, r"array `initial_state` holds inf at \[0, 1\]"),
        ({"nstep": -1}, "nstep is -1"),
        ({"nstep": 2.0}, "whole number"),
        ({"control_spec": 1}, "not built yet"),
        ({"control": np.zeros((1, 1, 1, 1))}, "at most 3 dimensions"),
        ({"outputs": ["xqos"]}, 'there is no output xqos; did you mean "xpos"'),
        ({"outputs": "qpos"}, "outputs is a str; expected a list of names"),
        ({"initial_state": np.zeros((0, 3))}, "nbatch is 0; expected at least 1"),
        ({"nthread": [1], "persistent_pool": True}, "nthread is .1.; expected a whole number"),
        ({"nthread": 10**6}, "threads is 1000000; expected at most 1024"),
        ({"precision": ["f64"], "persistent_pool": True}, "precision is"),
    ],
)
def test_bad_input(pendulum, arguments, text) -> None:
    with pytest.raises(lanesim.LanesimError, match=text):
        lanesim.rollout(pendulum, arguments.pop("initial_state", np.zeros(3)), **arguments)


def test_what_is_not_finite_freezes_its_world_alone(pendulum) -> None:
    control = np.zeros((20, 10, 1))
    control[7, 4:] = np.nan
    state, _ = lanesim.rollout(pendulum, [0.0, 0.1, 0.0], control, skip_checks=True)
    assert np.isfinite(state).all()
    np.testing.assert_array_equal(state[6], state[8])
