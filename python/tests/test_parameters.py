"""Parameters that differ from world to world: against models compiled with the numbers, and against MuJoCo."""

from __future__ import annotations

import copy
import pickle

import lanesim
import numpy as np
import pytest

XML = """
<mujoco>
  <option gravity="{gravity}"/>
  <worldbody>
    <geom type="plane" size="5 5 1" friction="{floor} .005 .0001"/>
    <body pos="0 0 .12">
      <freejoint/>
      <geom name="trunk" type="capsule" size=".08 .15" euler="0 90 0" friction="{trunk} .005 .0001"/>
      <body pos=".25 0 0">
        <joint name="elbow" axis="0 1 0" damping="{damping}" stiffness="{stiffness}"/>
        <geom type="capsule" size=".04 .1" pos="0 0 .1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general joint="elbow" gainprm="{gain}" biastype="affine" biasprm="0 -{gain} -.1" gear="{gear}"/>
  </actuator>
</mujoco>
"""
NOMINAL = dict(
    gravity="0 0 -9.81", floor=1.0, trunk=0.8, damping=0.3, stiffness=1.5, gain=4.0, gear=1.5,
)  # fmt: skip
NWORLD = 21
NSTEP = 150


def numbers(rng: np.random.Generator) -> dict:
    scale = lambda name: float(NOMINAL[name] * rng.uniform(0.5, 1.5))  # noqa: E731
    own = {name: scale(name) for name in NOMINAL if name != "gravity"}
    return {**own, "gravity": " ".join(map(repr, rng.normal([0, 0, -8], 1.0).tolist()))}


def compiled(own: dict) -> lanesim.Model:
    return lanesim.Model.from_xml_string(XML.format(**{k: v if k == "gravity" else repr(v) for k, v in own.items()}))


def start(worlds: lanesim.Worlds, seeds: list[int]) -> None:
    for world, seed in enumerate(seeds):
        rng = np.random.default_rng(seed)
        mask = np.arange(worlds.nworld) == world
        worlds.set("qvel", rng.normal(0, 1, worlds.model.nv), mask)
        worlds.set("ctrl", rng.normal(0, 1, worlds.model.nu), mask)


NAMES = tuple(lanesim.PARAMETERS)[:10]
"""Those of this model; `ELEMENTS` has the others."""


@pytest.fixture
def cases(rng) -> list[dict]:
    return [numbers(rng) for _ in range(4)]


def varied(cases: list[dict], precision: str) -> lanesim.Worlds:
    worlds = lanesim.Worlds(compiled(NOMINAL), NWORLD, precision, 1)
    models = [compiled(own) for own in cases]
    for name in NAMES:
        rows = np.stack([np.asarray(getattr(models[w % len(models)], name)) for w in range(NWORLD)])
        worlds.set(name, rows)
        np.testing.assert_array_equal(worlds.get(name), rows)
    return worlds


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_world_has_the_bits_of_a_model_with_its_numbers(cases, precision) -> None:
    worlds = varied(cases, precision)
    seeds = [w % len(cases) for w in range(NWORLD)]
    start(worlds, seeds)
    worlds.step(NSTEP)
    for seed, own in enumerate(cases):
        alone = lanesim.Worlds(compiled(own), 1, precision, 1)
        start(alone, [seed])
        alone.step(NSTEP)
        for name in ("qpos", "qvel"):
            expected = np.broadcast_to(getattr(alone, name), (seeds.count(seed), alone.get(name).shape[1]))
            np.testing.assert_array_equal(getattr(worlds, name)[np.array(seeds) == seed], expected)


def test_worlds_move_as_mujoco_does_with_its_fields_changed(cases) -> None:
    mujoco = pytest.importorskip("mujoco")
    worlds = varied(cases, "f64")
    start(worlds, list(range(NWORLD)))
    qpos, qvel, ctrl = (np.array(worlds.get(name)) for name in ("qpos", "qvel", "ctrl"))
    worlds.step(40)
    model = mujoco.MjModel.from_xml_string(XML.format(**NOMINAL))
    model.opt.tolerance = 1e-12
    for world in range(8):
        for name in NAMES:
            row = worlds.get(name)[world]
            if name == "gravity":
                model.opt.gravity[:] = row
            else:
                getattr(model, name)[:] = row
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos[world], qvel[world], ctrl[world]
        for _ in range(40):
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(worlds.qpos[world], data.qpos, rtol=0, atol=1e-6)


def test_masses_do_what_mujoco_does_when_it_derives_its_constants_again(rng) -> None:
    mujoco = pytest.importorskip("mujoco")
    worlds = lanesim.Worlds(compiled(NOMINAL), NWORLD, "f64", 1)
    scale = rng.uniform(0.5, 2.0, (NWORLD, worlds.model.nbody))
    worlds.set("body_mass", worlds.model.body_mass * scale)
    worlds.set("body_inertia", worlds.model.body_inertia * scale[..., None])
    worlds.set("dof_armature", rng.uniform(0.0, 0.05, (NWORLD, worlds.model.nv)))
    start(worlds, list(range(NWORLD)))
    qvel, ctrl = np.array(worlds.qvel), np.array(worlds.ctrl)
    worlds.step(40)
    for world in range(8):
        model = mujoco.MjModel.from_xml_string(XML.format(**NOMINAL))
        model.opt.tolerance = 1e-12
        data = mujoco.MjData(model)
        for name in ("body_mass", "body_inertia", "dof_armature"):
            getattr(model, name)[:] = worlds.get(name)[world]
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        data.qvel[:], data.ctrl[:] = qvel[world], ctrl[world]
        for _ in range(40):
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(worlds.qpos[world], data.qpos, rtol=0, atol=1e-6)


def test_parameters_survive_resets_copies_and_saves(cases) -> None:
    worlds = varied(cases, "f32")
    start(worlds, list(range(NWORLD)))
    worlds.reset()
    for twin in (copy.deepcopy(worlds), pickle.loads(pickle.dumps(worlds))):
        assert twin.varying == worlds.varying == NAMES
        for name in NAMES:
            np.testing.assert_array_equal(twin.get(name), worlds.get(name))
        twin.step(20)
    worlds.step(20)
    assert twin.state_hash() == worlds.state_hash()
    plain = lanesim.Worlds(worlds.model, NWORLD, "f32", 1)
    saved = plain.save_state()
    assert "gravity" not in saved
    worlds.load_state(saved)
    np.testing.assert_array_equal(worlds.get("gravity"), np.broadcast_to([0, 0, -9.81], (NWORLD, 3)))
    for each in (plain, worlds):
        each.step(20)
    assert plain.state_hash() == worlds.state_hash()


def test_rows_masks_and_targets(ant) -> None:
    worlds = lanesim.Worlds(ant, 4)
    assert worlds.varying == ()
    np.testing.assert_array_equal(worlds.get("gravity"), np.tile([0, 0, -9.81], (4, 1)))
    before = worlds.nbytes
    worlds.set("gravity", [0, 0, -1], mask=[True, False, False, True])
    assert worlds.varying == ("gravity",) and worlds.nbytes > before
    out = np.empty((4, 3), np.float32)
    assert worlds.get("gravity", out) is out
    np.testing.assert_array_equal(out[:, 2], np.float32([-1, -9.81, -9.81, -1]))
    both = worlds.get(["gravity", "qpos"])
    assert list(both) == ["gravity", "qpos"] and both["qpos"].shape == (4, ant.nq)
    worlds.set("geom_friction", ant.geom_friction * np.full((4, 1, 1), 0.5))
    assert worlds.get("geom_friction").shape == (4, ant.ngeom, 3)


def test_errors_say_what_is_wrong(ant) -> None:
    worlds = lanesim.Worlds(ant, 4, "f32")
    with pytest.raises(lanesim.UnknownNameError, match=r"there is no field body_color; help\(Worlds.set\)"):
        worlds.set("body_color", 1.0)
    with pytest.raises(
        lanesim.UnknownNameError, match="body_ipos cannot differ .* would be stale.*; did you mean .body_mass."
    ):
        worlds.set("body_ipos", ant.body_ipos)
    with pytest.raises(lanesim.InputError, match=r"`dof_damping` has shape \[4, 3\]; expected \[nworld=4, nv=14\]"):
        worlds.set("dof_damping", np.zeros((4, 3)))
    with pytest.raises(lanesim.InputError, match=r"`gravity` holds nan at \[2\]|`gravity` holds NaN at \[2\]"):
        worlds.set("gravity", [0.0, 0.0, np.nan])
    with pytest.raises(lanesim.InputError, match="is -1; expected a number that is not negative"):
        worlds.set("dof_damping", -np.ones(ant.nv))
    with pytest.raises(lanesim.InputError, match="float32 has none above"):
        worlds.set("gravity", [0.0, 0.0, 1e39])
    with pytest.raises(lanesim.InputError, match="actuator_biasprm cannot differ .* no actuator has a bias"):
        worlds.set("actuator_biasprm", ant.actuator_biasprm)
    assert worlds.varying == ()


ELEMENTS = """<mujoco><compiler angle="radian"/><option timestep="0.004"/><worldbody>
  <geom type="plane" size="5 5 1" solref=".02 1" solimp=".9 .95 .001 .5 2" margin=".002" gap=".01"/>
  <body pos="0 0 .12"><joint type="free" stiffness=".4"/><geom size=".1" mass="1" gap=".01"/>
    <body pos=".15 0 0"><joint name="hinge" axis="0 1 0" stiffness="1.5" springref=".2" frictionloss=".05" range="-.1 .2"/>
      <geom type="capsule" size=".03 .1" pos="0 0 -.05" mass=".4" solref="-2000 -60" gap=".01"/>
      <body pos=".1 0 0"><joint name="slide" type="slide" axis="0 0 1" stiffness="30" frictionloss=".3" range="-.03 .04"/>
        <geom size=".05" mass=".3" gap=".01"/></body></body></body></worldbody>
  <tendon><fixed stiffness="40" damping=".7" springlength=".02 .05" frictionloss=".2" range="-.02 .03">
    <joint joint="hinge" coef=".1"/><joint joint="slide" coef=".9"/></fixed></tendon>
  <actuator><general joint="hinge" ctrlrange="-.7 .8" forcerange="-.5 .6"/>
    <general joint="slide" dyntype="filter" dynprm=".05" gainprm="30" biastype="affine" biasprm="0 -30 -1" ctrlrange="-.3 .2"
      forcerange="-2 3"/></actuator></mujoco>"""


def test_elements_move_as_mujoco_does_with_its_fields_changed(rng) -> None:
    mujoco = pytest.importorskip("mujoco")
    worlds = lanesim.Worlds(lanesim.Model.from_xml_string(ELEMENTS), NWORLD, "f64", 1)
    names = [name for name in lanesim.PARAMETERS if name not in NAMES]
    for name in names:
        own = np.asarray(getattr(worlds.model, name))
        rows = own * rng.uniform(0.7, 1.3, (NWORLD, *own.shape))
        if "solimp" in name:  # Shares, and the power that the model has.
            rows = own + (rows - own) * [0.1, 0.1, 1, 1, 0]
        if name == "qpos_spring":  # A quaternion.
            rows[:, 3:7] = own[3:7]
        for fixed in [name == "jnt_range", name in ("jnt_solref", "jnt_solimp")]:  # A free joint has no limit.
            rows[:, : int(fixed)] = own[: int(fixed)]
        if name == "actuator_dynprm":
            rows[:, 0] = own[0]
        worlds.set(name, rows)
    start(worlds, list(range(NWORLD)))
    qvel, ctrl = np.array(worlds.qvel), np.array(worlds.ctrl)
    worlds.step(40)
    apart = 0.0
    for world in range(8):
        model = mujoco.MjModel.from_xml_string(ELEMENTS)
        model.opt.tolerance = 1e-12
        for name in names:
            getattr(model, name)[:] = worlds.get(name)[world]
        # Contacts are listed where the model's are: the gap makes up for the margin.
        model.geom_gap[:] = worlds.model.geom_margin + worlds.model.geom_gap - worlds.get("geom_margin")[world]
        data = mujoco.MjData(model)
        data.qvel[:], data.ctrl[:] = qvel[world], ctrl[world]
        for _ in range(40):
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(worlds.qpos[world], data.qpos, rtol=0, atol=1e-6)
        apart = max(apart, np.abs(worlds.qpos[world] - worlds.qpos[0]).max())
    assert apart > 1e-3
