"""`lanesim.optimise`: motions of tasks and of models, and what is refused."""

from __future__ import annotations

import lanesim
import numpy as np
import pytest

from conftest import MODELS


def test_the_cart_pole_swings_up():
    calls = []
    motion = lanesim.optimise("cartpole", iterations=120, progress=lambda done, most: calls.append((done, most)))
    assert motion.goals and all(goal.reached for goal in motion.goals), motion.goals
    assert motion.qpos.shape == (151, 2) and motion.ctrl.shape == (150, 1) and motion.gains.shape == (150, 1, 4)
    assert np.abs(motion.ctrl).max() == 1
    assert (np.diff(motion.costs) <= 0).all() and motion.cost == motion.costs[-1]
    assert len(motion.costs) == len(motion.seconds) == len(motion.regularisation) == len(motion.steps)
    assert calls[-1] == (120, 120)
    assert set(lanesim.TASKS) == {"cartpole", "hopper", "humanoid"}


def test_the_motion_is_mujocos():
    mujoco = pytest.importorskip("mujoco")
    motion = lanesim.optimise("cartpole", seconds=1.0, iterations=10)
    model = mujoco.MjModel.from_xml_path(str(MODELS / "tasks" / "cartpole.xml"))
    data = mujoco.MjData(model)
    data.qpos, data.qvel = motion.qpos[0], motion.qvel[0]
    for t, ctrl in enumerate(motion.ctrl):
        data.ctrl = ctrl
        mujoco.mj_step(model, data)
        np.testing.assert_allclose(data.qpos, motion.qpos[t + 1], rtol=0, atol=1e-9)


def test_models_have_terms(pendulum):
    terms = [
        lanesim.Term("site:tip", [0.4, 0, 0.7], terminal=1e3),
        lanesim.Term("qvel", terminal=10, smooth=0.1),
        lanesim.Term("ctrl", running=0.01),
    ]
    motion = lanesim.optimise(pendulum, terms, seconds=1.0, qpos=[0.1])
    angle = motion.qpos[-1, 0]
    np.testing.assert_allclose([-0.5 * np.sin(angle), 1 - 0.5 * np.cos(angle)], [0.4, 0.7], atol=0.02)
    assert motion.qpos[0] == 0.1 and motion.goals == []
    again = lanesim.optimise(pendulum, terms, seconds=1.0, qpos=[0.1], ctrl=motion.ctrl)
    assert again.costs[0] == motion.cost
    other = lanesim.optimise(pendulum, terms, seconds=1.0, qpos=[0.1], method="gauss-newton")
    assert abs(other.cost / motion.cost - 1) < 1e-2, (other.cost, motion.cost)


def test_what_is_wrong_is_named(pendulum):
    term = lanesim.Term("qpos", running=1.0)
    for error, words, call in [
        (lanesim.UnknownNameError, "did you mean", lambda: lanesim.optimise("cartpol")),
        (lanesim.InputError, "leave out terms", lambda: lanesim.optimise("cartpole", [term])),
        (lanesim.InputError, "give seconds", lambda: lanesim.optimise(pendulum, [term])),
        (lanesim.InputError, "needs terms", lambda: lanesim.optimise(pendulum, seconds=1)),
        (lanesim.OptionError, "no step", lambda: lanesim.optimise(pendulum, [term], seconds=0)),
        (lanesim.InputError, "seconds is -1", lambda: lanesim.optimise(pendulum, [term], seconds=-1)),
        (lanesim.InputError, "expected Term", lambda: lanesim.optimise(pendulum, ["qpos"], seconds=1)),
        (lanesim.InputError, "holds NaN", lambda: lanesim.optimise(pendulum, [term], seconds=1, qpos=[np.nan])),
        (lanesim.InputError, "qpos", lambda: lanesim.optimise(pendulum, [term], seconds=1, qpos=[0, 0])),
        (lanesim.InputError, "iterations is 0", lambda: lanesim.optimise("cartpole", iterations=0)),
        (lanesim.OptionError, "eps is 0", lambda: lanesim.optimise("cartpole", eps=0.0)),
        (lanesim.UnknownNameError, "method", lambda: lanesim.optimise("cartpole", method="ddp")),
        (lanesim.UnknownNameError, "no joint", lambda: lanesim.optimise(pendulum, [term._replace(of="qpos:x")], seconds=1)),
    ]:
        with pytest.raises(error, match=words):
            call()
