"""Inverse dynamics: `Worlds.inverse` and `lanesim.inverse`, against MuJoCo and against the forward dynamics."""

from __future__ import annotations

import lanesim
import numpy as np
import pytest

from conftest import MODELS


def motion(model, nworld=3, nstep=20):
    """States and accelerations of a rollout."""
    worlds = lanesim.Worlds(model, nworld)
    control = np.random.default_rng(1).uniform(-1, 1, (nworld, nstep, model.nu))
    rows = worlds.rollout(control, outputs=["qpos", "qvel"])
    qacc = np.random.default_rng(2).normal(size=rows["qvel"].shape)
    return rows["qpos"], rows["qvel"], qacc


def test_forces_are_mujocos(ant):
    mujoco = pytest.importorskip("mujoco")
    qpos, qvel, qacc = motion(ant)
    found = lanesim.inverse(ant, qpos, qvel, qacc)
    assert found.shape == qacc.shape
    model = mujoco.MjModel.from_xml_path(str(MODELS / "zoo" / "ant.xml"))
    data = mujoco.MjData(model)
    for place in np.ndindex(qacc.shape[:2]):
        data.qpos, data.qvel, data.qacc = qpos[place], qvel[place], qacc[place]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(found[place], data.qfrc_inverse, rtol=0, atol=1e-9 * (1 + np.abs(data.qfrc_inverse).max()))


def test_one_state_many_and_trajectories_agree(ant):
    qpos, qvel, qacc = motion(ant)
    whole = lanesim.inverse(ant, qpos, qvel, qacc)
    flat = lanesim.inverse(ant, qpos.reshape(-1, ant.nq), qvel.reshape(-1, ant.nv), qacc.reshape(-1, ant.nv))
    np.testing.assert_array_equal(whole.reshape(flat.shape), flat)
    np.testing.assert_array_equal(lanesim.inverse(ant, qpos[1, 7], qvel[1, 7], qacc[1, 7]), whole[1, 7])
    assert lanesim.inverse(ant, qpos, qvel, qacc, precision="f32").dtype == np.float32
    worlds = lanesim.Worlds(ant, 20)
    worlds.qpos, worlds.qvel = qpos[2], qvel[2]
    out = np.empty((20, ant.nv))
    assert worlds.inverse(qacc[2], out) is out
    np.testing.assert_array_equal(out, whole[2])
    assert lanesim.inverse(ant, qpos[:0], qvel[:0], qacc[:0]).shape == (0, 20, ant.nv)


def test_mocap_bodies_are_where_they_are_said_to_be():
    mujoco = pytest.importorskip("mujoco")
    path = str(MODELS / "unit" / "mocap.xml")
    ours, model = lanesim.Model.from_xml_path(path), mujoco.MjModel.from_xml_path(path)
    data, random = mujoco.MjData(model), np.random.default_rng(3)
    pos = data.mocap_pos + random.uniform(-0.02, 0.02, data.mocap_pos.shape)
    quat = data.mocap_quat + random.uniform(-0.02, 0.02, data.mocap_quat.shape)
    qvel, qacc = random.normal(size=(2, model.nv))
    data.mocap_pos, data.mocap_quat, data.qvel, data.qacc = pos, quat, qvel, qacc
    mujoco.mj_inverse(model, data)
    found = lanesim.inverse(ours, data.qpos, qvel, qacc, mocap_pos=pos, mocap_quat=quat)
    scale = np.abs(data.qfrc_inverse).max()
    np.testing.assert_allclose(found, data.qfrc_inverse, rtol=0, atol=1e-8 * scale)
    assert np.abs(lanesim.inverse(ours, data.qpos, qvel, qacc) - found).max() > 1e-3 * scale


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
def test_a_step_with_the_force_gives_the_acceleration_back(ant, integrator):
    model = ant.replace(integrator=integrator, tolerance=1e-14, iterations=200)
    qpos, qvel, qacc = motion(model)
    force = lanesim.inverse(model, qpos[:, -1], qvel[:, -1], qacc[:, -1], discrete=True)
    worlds = lanesim.Worlds(model, 3)
    worlds.qpos, worlds.qvel, worlds.qfrc_applied = qpos[:, -1], qvel[:, -1], force
    worlds.step()
    found = (worlds.qvel - qvel[:, -1]) / model.opt.timestep
    np.testing.assert_allclose(found, qacc[:, -1], atol=1e-8)


def test_bad_input_is_named(ant):
    qpos, qvel, qacc = motion(ant)
    with pytest.raises(lanesim.InputError, match=r"array `qvel` has shape \[3, 19, 14\]; expected \[3, 20, nv=14\]"):
        lanesim.inverse(ant, qpos, qvel[:, 1:], qacc)
    with pytest.raises(lanesim.InputError, match=r"array `qacc` has shape \[3, 20, 13\]; expected \[..., nv=14\]"):
        lanesim.inverse(ant, qpos, qvel, qacc[..., 1:])
    bad = qacc.copy()
    bad[1, 2, 3] = np.nan
    with pytest.raises(lanesim.InputError, match=r"array `qacc` holds NaN at \[1, 2, 3\]"):
        lanesim.inverse(ant, qpos, qvel, bad)
    with pytest.raises(lanesim.InputError, match=r"array `qacc` holds NaN at \[1, 3\]"):
        lanesim.Worlds(ant, 3).inverse(bad[:, 2])
    with pytest.raises(lanesim.InputError, match=r"array `qpos` has shape \[3, 20, 15\]; expected \[3, 19, nq=15\]"):
        lanesim.inverse(ant, qpos, qvel[:, 1:], qacc[:, 1:])
    worlds = lanesim.Worlds(ant, 2)
    with pytest.raises(lanesim.InputError, match=r"array `qacc` has shape \[3, 14\]; expected \[nworld=2, nv=14\]"):
        worlds.inverse(np.zeros((3, ant.nv)))
    with pytest.raises(lanesim.OptionError, match="do not go with integrator RK4"):
        lanesim.inverse(ant.replace(integrator="RK4"), qpos, qvel, qacc, discrete=True)


def test_active_constraints_are_an_input():
    model = lanesim.Model.from_xml_path(MODELS / "zoo/four_bar.xml")
    state = [np.full((2, n), 0.2) for n in (model.nq, model.nv, model.nv)]
    force = lanesim.inverse(model, *state, eq_active=[[1] * model.neq, [0] * model.neq])
    np.testing.assert_array_equal(force[0], lanesim.inverse(model, *state)[0])
    assert np.abs(force[1] - force[0]).max() > 1e-3
    with pytest.raises(lanesim.InputError, match="eq_active"):
        lanesim.inverse(model, *state, eq_active=np.full((2, model.neq), 0.5))


@pytest.mark.parametrize(
    "equality, message",
    [
        ("<connect body1='q' anchor='0 0 0'/>", "body1 names an unknown body"),
        ("<weld body1='a' body2='a'/>", "is held to itself"),
        ("<joint joint1='x' polycoef='1 2 3 4 5 6'/>", "expected at most 5 numbers, found 6"),
        ("<joint joint1='x' joint2='y'/><joint joint1='y' joint2='x'/>", "in a circle"),
    ],
)
def test_bad_equality_constraints_are_named(equality, message):
    xml = (
        "<mujoco><worldbody><body name='a'><joint name='x'/><joint name='y'/><geom size='.1'/></body></worldbody>"
        f"<equality>{equality}</equality></mujoco>"
    )
    with pytest.raises(lanesim.ModelError, match=message):
        lanesim.Model.from_xml_string(xml)
