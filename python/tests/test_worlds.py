"""`lanesim.Worlds`: fields, stepping, resets, saved states."""

from __future__ import annotations

import copy
import pickle

import lanesim
import numpy as np
import pytest
from conftest import MODELS

FIELDS = ["time", "qpos", "qvel", "act", "ctrl", "qacc_warmstart", "eq_active", "qfrc_applied", "xfrc_applied"]


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_fields_are_kept(ant, rng, precision) -> None:
    worlds = lanesim.Worlds(ant, 19, precision)
    for name in FIELDS:
        shape = getattr(worlds, name).shape
        assert shape[0] == 19
        values = rng.standard_normal(shape).astype(worlds.dtype)
        setattr(worlds, name, values)
        found = getattr(worlds, name)
        assert found.dtype == worlds.dtype
        np.testing.assert_array_equal(found, values)
        # A single row goes to every world; a mask chooses worlds.
        worlds.set(name, values[0])
        np.testing.assert_array_equal(getattr(worlds, name), np.broadcast_to(values[0], shape))
        mask = rng.random(19) < 0.5
        worlds.set(name, values, mask)
        np.testing.assert_array_equal(getattr(worlds, name)[mask], values[mask])
        np.testing.assert_array_equal(getattr(worlds, name)[~mask], np.broadcast_to(values[0], shape)[~mask])


def test_layouts_and_types_are_converted(ant, rng) -> None:
    worlds = lanesim.Worlds(ant, 6)
    values = rng.integers(-3, 3, (6, ant.nu)).astype(float)
    readonly = values.copy()
    readonly.flags.writeable = False
    wide = np.zeros((6, 2 * ant.nu))
    wide[:, ::2] = values
    for given in (
        values.tolist(),
        values.astype(int),
        values.astype(np.float16),
        values.astype(np.float32),
        values.astype(">f8"),
        np.asfortranarray(values),
        wide[:, ::2],
        values[::-1][::-1],
        readonly,
    ):
        worlds.ctrl = np.zeros(ant.nu)
        worlds.ctrl = given
        np.testing.assert_array_equal(worlds.ctrl, values)


@pytest.mark.parametrize(
    "values, text",
    [
        (np.zeros((4, 3)), r"array `qvel` has shape \[4, 3\]; expected \[nworld=4, nv=14\]; was it made for another"),
        (np.zeros((3, 14)), r"array `qvel` has shape \[3, 14\]; expected \[nworld=4, nv=14\]"),
        (np.zeros(()), r"shape \[\]; expected \[nworld=4, nv=14\]"),
        (np.full((4, 14), np.nan), r"array `qvel` holds NaN at \[0, 0\]; every number must be finite"),
        (np.where(np.arange(56).reshape(4, 14) == 33, -np.inf, 0), r"array `qvel` holds -inf at \[2, 5\]"),
        (np.zeros((4, 14), complex), "has type complex128; expected real numbers"),
        (np.full((4, 14), "x"), "expected real numbers"),
        ([[1.0], [1.0, 2.0]], "array of numbers"),
        (None, "expected real numbers"),
    ],
)
def test_bad_arrays(ant, values, text) -> None:
    worlds = lanesim.Worlds(ant, 4)
    before = worlds.qvel
    with pytest.raises(lanesim.InputError, match=text):
        worlds.qvel = values
    np.testing.assert_array_equal(worlds.qvel, before)


def test_bad_arguments(ant) -> None:
    for arguments in (
        {"nworld": 0},
        {"nworld": 2.5},
        {"nworld": True},
        {"nworld": 10**30},
        {"nworld": 2, "threads": 0},
        {"nworld": 2, "threads": 10**6},
        {"nworld": 2, "precision": ["f64", "f32"]},
        {"nworld": 2, "precision": "f16"},
        {"nworld": 2, "on_diverge": "explode"},
    ):
        with pytest.raises(ValueError):
            lanesim.Worlds(ant, **arguments)
    worlds = lanesim.Worlds(ant, 3)
    with pytest.raises(lanesim.InputError, match="at least 0"):
        worlds.step(-1)
    with pytest.raises(lanesim.InputError, match=r"expected \[nworld=3\]"):
        worlds.reset(np.zeros(4, bool))
    with pytest.raises(lanesim.InputError, match="expected bool"):
        worlds.reset([0, 1, 1])
    with pytest.raises(lanesim.UnknownNameError, match="there is no keyframe 3"):
        worlds.reset(key=3)
    with pytest.raises(lanesim.UnknownNameError, match='there is no output xqos; did you mean "xpos"?'):
        worlds.get("xqos")
    with pytest.raises(lanesim.UnknownNameError, match='"xpos" is computed, not set'):
        worlds.set("xpos", 0.0)
    with pytest.raises(TypeError, match="expected a lanesim.Model"):
        lanesim.Worlds("ant.xml", 3)
    with pytest.raises(MemoryError, match="bytes of memory, which the system does not give"):
        lanesim.Worlds(ant, 1 << 45)


def test_misspelt_fields_are_noticed(ant) -> None:
    with pytest.raises(AttributeError, match="qpso"):
        lanesim.Worlds(ant, 2).qpso = ant.qpos0


def test_numbers_too_large_for_single_precision(ant) -> None:
    worlds = lanesim.Worlds(ant, 2, "f32")
    for sign in (1.0, -1.0):
        with pytest.raises(lanesim.InputError, match="number of size 1.0e.300; float32 has none above 3.4e.38"):
            worlds.qvel = np.full(ant.nv, sign * 1e300)
    worlds.qvel = np.full(ant.nv, 1.0)


def test_what_is_read_cannot_be_written_by_mistake(ant) -> None:
    worlds = lanesim.Worlds(ant, 2)
    with pytest.raises(ValueError, match="read-only"):
        worlds.qpos[0] = 1.0


def test_results_do_not_depend_on_neighbours(ant, rng) -> None:
    ctrl = rng.uniform(-1, 1, (37, ant.nu))
    many = lanesim.Worlds(ant, 37, threads=2)
    many.ctrl = ctrl
    many.step(50)
    for world in (0, 7, 36):
        one = lanesim.Worlds(ant, 1, threads=1, backend="scalar")
        one.step(50, ctrl[world])
        np.testing.assert_array_equal(one.qpos[0], many.qpos[world])


def test_reset_by_mask(pendulum) -> None:
    worlds = lanesim.Worlds(pendulum, 5)
    worlds.qvel = np.ones(1)
    worlds.step(10)
    mask = np.array([True, False, True, False, False])
    kept = worlds.qpos[~mask]
    worlds.reset(mask, key="up")
    np.testing.assert_array_equal(worlds.qpos[~mask], kept)
    np.testing.assert_array_equal(worlds.qpos[mask], 3.14)
    np.testing.assert_array_equal(worlds.time[mask], 2.0)
    np.testing.assert_array_equal(worlds.ctrl[mask], 0.25)
    worlds.reset()
    np.testing.assert_array_equal(worlds.qpos, 0.0)
    np.testing.assert_array_equal(worlds.time, 0.0)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_saved_states_go_on_with_the_same_bits(ant, rng, precision, tmp_path) -> None:
    worlds = lanesim.Worlds(ant, 11, precision)
    worlds.ctrl = rng.uniform(-1, 1, (11, ant.nu))
    worlds.qfrc_applied = rng.standard_normal((11, ant.nv))
    worlds.step(30)
    np.savez(tmp_path / "state.npz", **worlds.save_state())
    worlds.step(30)
    other = lanesim.Worlds(ant, 11, precision)
    other.load_state(np.load(tmp_path / "state.npz"))
    other.step(30)
    assert other.state_hash() == worlds.state_hash()
    # Forces that the state does not have are gone after it was loaded.
    plain = lanesim.Worlds(ant, 11, precision).save_state()
    worlds.load_state(plain)
    assert not worlds.qfrc_applied.any()
    with pytest.raises(lanesim.InputError, match="no array `qvel`"):
        worlds.load_state({k: v for k, v in plain.items() if k != "qvel"})
    with pytest.raises(lanesim.InputError, match=r"expected \[nworld=11, nq=15\]"):
        worlds.load_state({**plain, "qpos": plain["qpos"][:3]})


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda worlds: pickle.loads(pickle.dumps(worlds))])
def test_copies_and_pickles_go_on_with_the_same_bits(ant, rng, again) -> None:
    worlds = lanesim.Worlds(ant, 11, "f32", 1, max_contacts=7)
    worlds.ctrl = rng.uniform(-1, 1, (11, ant.nu))
    worlds.xfrc_applied = rng.standard_normal((11, ant.nbody, 6))
    worlds.step(30)
    other = again(worlds)
    assert (other.precision, other.threads, other.time[0]) == ("f32", 1, worlds.time[0])
    worlds.step(30)
    assert other.state_hash() != worlds.state_hash(), "a copy has worlds of its own"
    other.step(30)
    assert other.state_hash() == worlds.state_hash()


@pytest.mark.parametrize("status", ["abc", [0.5, 0.0, 0.0], None])
def test_bad_statuses_are_not_loaded(ant, status) -> None:
    worlds = lanesim.Worlds(ant, 3)
    with pytest.raises(lanesim.InputError, match="array `status` has type"):
        worlds.load_state({**worlds.save_state(), "status": status})


def test_get_writes_to_given_arrays(ant) -> None:
    worlds = lanesim.Worlds(ant, 9)
    out = np.empty((9, ant.nbody, 3), dtype=np.float32)
    assert worlds.get("xpos", out=out) is out
    np.testing.assert_allclose(out, worlds.get("xpos"), rtol=1e-6)
    with pytest.raises(lanesim.InputError, match="array `xpos` has shape"):
        worlds.get("xpos", out=np.empty((9, 3)))
    with pytest.raises(lanesim.InputError, match="differs in length"):
        worlds.get("contact_dist", out=np.empty((9, 4)))
    with pytest.raises(lanesim.InputError, match="expected int32"):
        worlds.get("ncon", out=np.empty(9))


def test_every_output_can_be_read(ant) -> None:
    worlds = lanesim.Worlds(ant, 3)
    worlds.step(20)
    values = worlds.get([name.replace("NAME", "1") for name in lanesim.OUTPUTS if name != "jac_site:NAME"])
    for name, array in values.items():
        assert array.shape[0] == 3, name
    assert values["contact_frame"].shape[1:] == (values["ncon"].max(), 9)
    assert values["efc_J"].shape[1:] == (values["nefc"].max(), ant.nv)
    np.testing.assert_array_equal(values["state"][:, 1 : 1 + ant.nq], values["qpos"])


def diverging(**options) -> lanesim.Worlds:
    """Two worlds, of which the second is lost at the first step."""
    xml = "<mujoco><worldbody><body><joint type='slide'/><geom size='.1'/></body></worldbody></mujoco>"
    worlds = lanesim.Worlds(lanesim.Model.from_xml_string(xml), 2, **options)
    worlds.qfrc_applied = [[0.0], [1e200]]
    return worlds


def test_diverged_worlds_freeze() -> None:
    worlds = diverging()
    worlds.step(3)
    assert worlds.lost == 1
    assert lanesim.Status(int(worlds.status[1])) & lanesim.Status.Frozen
    assert worlds.status[0] == 0 and worlds.status_detail(0) == []
    assert any(event.status == lanesim.Status.Frozen for event in worlds.status_detail(1))
    assert np.isfinite(worlds.qpos).all()


def test_diverged_worlds_are_reset() -> None:
    worlds = diverging(on_diverge="reset")
    worlds.step(3)
    assert worlds.lost == 0
    # A force that cannot be stepped with is found before the first step, which is then taken from the start.
    np.testing.assert_array_equal(worlds.time, 3 * 0.002)
    assert worlds.status[1] != 0 and worlds.qfrc_applied[1] == 0.0

    # A state that a step makes too large starts again after it.
    worlds.qpos, worlds.qvel = [[0.0], [9.99e9]], [[0.0], [9e9]]
    worlds.step(3)
    assert worlds.lost == 0 and worlds.time[1] < worlds.time[0]


def test_diverged_worlds_raise() -> None:
    with pytest.raises(lanesim.DivergedError, match="world 1 diverged: .* at step 0"):
        diverging(on_diverge="raise").step(3)


def test_status_bits_are_those_of_the_engine() -> None:
    assert {bit.name: bit.value for bit in lanesim.Status} == dict(lanesim._lanesim.STATUS)


def test_forward_changes_no_state(ant) -> None:
    worlds = lanesim.Worlds(ant, 4)
    before = worlds.save_state()
    worlds.forward()
    for name, array in worlds.save_state().items():
        np.testing.assert_array_equal(array, before[name])


MOCAP = """<mujoco><worldbody>
  <body name="hand" mocap="true" pos="1 2 3"><geom name="hand" size=".1"/><body pos="0 .2 0"><site name="tip"/></body></body>
  <body name="ball" pos="1 2 3.5"><freejoint/><geom size=".1"/></body></worldbody>
  <keyframe><key/><key mpos="1 2 4" mquat="0 0 0 2"/></keyframe></mujoco>"""


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_mocap_bodies_are_moved_per_world(precision) -> None:
    worlds = lanesim.Worlds(lanesim.Model.from_xml_string(MOCAP), 3, precision)
    np.testing.assert_array_equal(worlds.mocap_pos, np.broadcast_to([1.0, 2.0, 3.0], (3, 1, 3)))
    worlds.mocap_pos = [[[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]], [[1.0, 2.0, 3.31]]]
    worlds.mocap_quat = [[[1.0, 0.0, 0.0, 0.0]], [[3.0, 0.0, 0.0, 3.0]], [[1.0, 0.0, 0.0, 0.0]]]
    worlds.step(nstep=2)
    seen = worlds.get(["xpos", "xquat", "site_xpos", "ncon"])
    np.testing.assert_allclose(seen["xpos"][1, 1], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(seen["xquat"][1, 1], [0.5**0.5, 0.0, 0.0, 0.5**0.5], rtol=1e-6)
    np.testing.assert_allclose(seen["site_xpos"][:, 0], [[1.0, 2.2, 3.0], [-0.2, 0.0, 1.0], [1.0, 2.2, 3.31]], atol=1e-6)
    assert seen["ncon"].ravel().tolist() == [0, 0, 1]
    assert worlds.qvel[2, 2] > 0.0 > worlds.qvel[0, 2]
    worlds.reset(key=1)
    np.testing.assert_array_equal(worlds.mocap_pos[:, 0], np.broadcast_to([1.0, 2.0, 4.0], (3, 3)))
    np.testing.assert_array_equal(worlds.mocap_quat[:, 0], np.broadcast_to([0.0, 0.0, 0.0, 1.0], (3, 4)))
    worlds.reset()
    np.testing.assert_array_equal(worlds.mocap_pos[:, 0], np.broadcast_to([1.0, 2.0, 3.0], (3, 3)))


def test_a_mocap_body_that_jumps_onto_another_is_not_missed() -> None:
    worlds = lanesim.Worlds(lanesim.Model.from_xml_string(MOCAP), 1)
    worlds.mocap_pos = [[[50.0, 0.0, 0.0]]]
    worlds.step(nstep=5)
    worlds.mocap_pos = worlds.get("xpos")[:, 3:] + [0.0, 0.0, -0.15]
    worlds.step()
    assert len(worlds.get("contact_dist")[0]) == 1
    assert worlds.qvel[0, 2] > 0.0


def test_the_surface_of_a_mocap_body_turns_about_the_body() -> None:
    def speeds(mocap: str) -> np.ndarray:
        xml = f"""<mujoco><worldbody>
          <body {mocap} pos="1 2 .5"><geom type="box" size=".5 .5 .1" surfacevel=".1 0 0 0 0 3"/></body>
          <body pos="1.3 2 .69"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
        worlds = lanesim.Worlds(lanesim.Model.from_xml_string(xml), 1)
        worlds.step(nstep=20)
        return worlds.qvel[0]

    still, moved = speeds(""), speeds("mocap='true'")
    assert abs(still[1]) > 0.01
    np.testing.assert_allclose(moved, still, rtol=1e-9, atol=1e-12)


def test_impossible_mocap_poses_are_refused_or_flagged() -> None:
    worlds = lanesim.Worlds(lanesim.Model.from_xml_string(MOCAP), 2)
    with pytest.raises(lanesim.InputError, match="mocap_pos"):
        worlds.mocap_pos = [[[1.0, np.nan, 3.0]]]
    worlds.mocap_quat = [[[1.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0, 0.0]]]
    worlds.step()
    assert [lanesim.Status(int(bits)) for bits in worlds.status] == [lanesim.Status(0), lanesim.Status.QuatZero]
    assert "hand" in str(worlds.status_detail(1))
    np.testing.assert_array_equal(worlds.get("xquat")[1, 1], [1.0, 0.0, 0.0, 0.0])


def test_saved_states_have_mocap_poses() -> None:
    worlds = lanesim.Worlds(lanesim.Model.from_xml_string(MOCAP), 2)
    worlds.mocap_pos = [[[1.0, 2.0, 3.0]], [[4.0, 5.0, 6.0]]]
    kept = worlds.save_state()
    other = lanesim.Worlds(lanesim.Model.from_xml_string(MOCAP), 2)
    other.load_state(kept)
    np.testing.assert_array_equal(other.mocap_pos, worlds.mocap_pos)


def test_absent_quantities_have_no_columns(ant) -> None:
    worlds = lanesim.Worlds(ant, 3)
    assert (worlds.act.shape, worlds.mocap_pos.shape, worlds.mocap_quat.shape) == ((3, 0), (3, 0, 3), (3, 0, 4))
    worlds.act, worlds.mocap_pos, worlds.mocap_quat = worlds.act, worlds.mocap_pos, worlds.mocap_quat


def test_unsupported_options_say_so(pendulum) -> None:
    with pytest.raises(lanesim.errors.ModelError, match="ipc: incremental potential contact is not supported"):
        pendulum.replace(ipc=True)


def test_equality_constraints_are_switched_world_by_world() -> None:
    model = lanesim.Model.from_xml_path(MODELS / "unit" / "equality_connect.xml")
    assert (model.neq, model.names("equality")[0]) == (5, "end")
    worlds = lanesim.Worlds(model, 4)
    np.testing.assert_array_equal(worlds.eq_active, np.broadcast_to(model.eq_active0, (4, 5)))
    worlds.eq_active = [[0] * 5, [1] * 5, [1, 0, 0, 0, 0], [0, 1, 1, 0, 0]]
    assert worlds.get("nefc").tolist() == [0, 15, 3, 6]
    worlds.step(5)
    saved, other = worlds.save_state(), lanesim.Worlds(model, 4)
    other.load_state(saved)
    np.testing.assert_array_equal(other.eq_active, worlds.eq_active)
    other.step(5)
    worlds.step(5)
    assert other.state_hash() == worlds.state_hash()
    worlds.reset(ids=[0])
    assert worlds.eq_active[0].tolist() == model.eq_active0.tolist()
    with pytest.raises(lanesim.InputError, match="eq_active has the entry 0.5; expected 0 or 1"):
        worlds.set("eq_active", [0.5] * 5)
    del saved["eq_active"]
    with pytest.raises(lanesim.InputError, match="no array `eq_active`"):
        other.load_state(saved)
