"""Some worlds of a batch, whole states, and rollouts of a batch."""

from __future__ import annotations

import lanesim
import numpy as np
import pytest

NWORLD = 37
IDS = np.array([33, 2, 16, 17, 0, 36])
KINDS = [("f64", "auto"), ("f32", "auto"), ("f64", "wide"), ("f32", "scalar")]


def batch(model: lanesim.Model, precision: str = "f64", backend: str = "auto") -> lanesim.Worlds:
    """Worlds that differ in state, controls and a parameter."""
    rng = np.random.default_rng(5)
    worlds = lanesim.Worlds(model, NWORLD, precision, threads=2, backend=backend)
    worlds.qvel = 0.1 * rng.standard_normal((NWORLD, model.nv))
    worlds.ctrl = rng.uniform(-1, 1, (NWORLD, model.nu))
    worlds.set("gravity", np.array([0.0, 0.0, -9.0]) - 0.02 * np.arange(NWORLD)[:, None])
    return worlds


def kept(worlds: lanesim.Worlds) -> dict[str, np.ndarray]:
    return worlds.save_state()


def others(ids) -> np.ndarray:
    return np.setdiff1d(np.arange(NWORLD), np.arange(NWORLD)[ids])


@pytest.mark.parametrize("precision, backend", KINDS)
@pytest.mark.parametrize(
    "ids", [IDS, IDS.tolist(), np.isin(np.arange(NWORLD), IDS), slice(3, 30, 4), slice(None, None, -2)]
)
def test_chosen_worlds_step_alone(ant, precision, backend, ids) -> None:
    whole, some = batch(ant, precision, backend), batch(ant, precision, backend)
    before = kept(some)
    whole.step(30)
    some.step(30, ids=ids)
    after, full = kept(some), kept(whole)
    chosen = np.arange(NWORLD)[ids]
    for name in after:
        np.testing.assert_array_equal(after[name][chosen], full[name][chosen], err_msg=name)
        np.testing.assert_array_equal(after[name][others(ids)], before[name][others(ids)], err_msg=name)


@pytest.mark.parametrize("precision, backend", KINDS)
def test_rows_are_those_of_ids_in_their_order(ant, precision, backend) -> None:
    worlds = batch(ant, precision, backend)
    worlds.step(20)
    for name in ("qpos", "state", "xpos", "qacc", "status", "gravity"):
        whole, some = worlds.get(name), worlds.get(name, ids=IDS)
        np.testing.assert_array_equal(some, whole[IDS], err_msg=name)
        out = np.full_like(some, 77)
        assert worlds.get(name, out, ids=IDS) is out
        np.testing.assert_array_equal(out, some)
    ragged = worlds.get("contact_dist", ids=IDS)
    np.testing.assert_array_equal(ragged, worlds.get("contact_dist")[IDS][:, : ragged.shape[1]])
    both = worlds.get(["qpos", "gravity"], ids=[4])
    assert both["qpos"].shape == (1, ant.nq) and both["gravity"].shape == (1, 3)
    assert worlds.get("qpos", ids=[]).shape == (0, ant.nq)


def test_fields_and_parameters_are_set_by_ids(ant, rng) -> None:
    worlds = batch(ant)
    for name in ("qvel", "ctrl", "xfrc_applied", "gravity", "state"):
        before = worlds.get(name)
        rows = rng.uniform(0.1, 0.2, (len(IDS), *before.shape[1:]))
        worlds.set(name, rows, ids=IDS)
        after = worlds.get(name)
        np.testing.assert_array_equal(after[IDS], rows)
        np.testing.assert_array_equal(after[others(IDS)], before[others(IDS)])
        worlds.set(name, rows[0], ids=IDS[:3])
        np.testing.assert_array_equal(worlds.get(name, ids=IDS[:3]), np.broadcast_to(rows[0], (3, *rows.shape[1:])))


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_states_come_back_as_they_were_read(ant, precision) -> None:
    worlds, fresh = batch(ant, precision), batch(ant, precision)
    worlds.step(25)
    state = worlds.get("state")
    assert state.shape == (NWORLD, 1 + ant.nq + ant.nv + ant.na) and state.dtype == np.float64
    fresh.set_state(state)
    assert fresh.state_hash() == worlds.state_hash()
    np.testing.assert_array_equal(fresh.time, worlds.time)
    mask = np.arange(NWORLD) % 3 == 0
    fresh.set_state(np.zeros_like(state) + state[5], mask)
    np.testing.assert_array_equal(fresh.get("state")[mask], np.broadcast_to(state[5], (mask.sum(), state.shape[1])))
    np.testing.assert_array_equal(fresh.get("state")[~mask], state[~mask])
    fresh.set_state(state[[7]], ids=[1])
    np.testing.assert_array_equal(fresh.get("state", ids=[1]), state[[7]])
    with pytest.raises(
        lanesim.InputError, match=r"array `state` has shape \[37, 3\]; expected \[nworld=37, nstate=30\]"
    ):
        fresh.set_state(np.zeros((NWORLD, 3)))
    with pytest.raises(lanesim.InputError, match="array `state` holds NaN"):
        fresh.set_state(np.full_like(state, np.nan))


def test_resets_by_ids(ant) -> None:
    worlds = batch(ant)
    worlds.step(5)
    before = worlds.get("state")
    worlds.reset(ids=IDS)
    np.testing.assert_array_equal(worlds.get("qvel", ids=IDS), 0.0)
    np.testing.assert_array_equal(worlds.get("state", ids=others(IDS)), before[others(IDS)])


@pytest.mark.parametrize(
    "ids, text",
    [
        ([3, 3], "world 3 is named twice in ids"),
        ([0, NWORLD], "there is no world 37 that ids could name: the batch has 37, counted from 0"),
        ([-1], "there is no world -1"),
        ([0.0, 1.0], "array `ids` has type float64; expected whole numbers, a mask of bool, or a slice"),
        (np.ones(5, bool), r"array `ids` has shape \[5\]; expected \[nworld=37\]"),
        (4, r"ids is 4; expected an array of worlds' numbers, such as \[4\]"),
        ([[1, 2]], "expected one dimension"),
        (["one"], "array `ids` has type <U3"),
    ],
)
def test_wrong_ids(ant, ids, text) -> None:
    worlds = batch(ant)
    before = worlds.state_hash()
    for call in (
        lambda: worlds.step(2, ids=ids),
        lambda: worlds.get("qpos", ids=ids),
        lambda: worlds.set("qvel", np.zeros(ant.nv), ids=ids),
        lambda: worlds.reset(ids=ids),
        lambda: worlds.rollout(nstep=2, ids=ids),
        lambda: worlds.set_state(np.zeros(30), ids=ids),
    ):
        with pytest.raises(lanesim.InputError, match=text):
            call()
    assert worlds.state_hash() == before


def test_mask_and_ids_exclude_each_other(ant) -> None:
    worlds = batch(ant)
    with pytest.raises(lanesim.InputError, match="mask and ids both choose worlds"):
        worlds.set("qvel", np.zeros(ant.nv), np.ones(NWORLD, bool), ids=[1])
    with pytest.raises(lanesim.InputError, match=r"shape \[2, 14\]; expected \[ids=3, nv=14\]"):
        worlds.set("qvel", np.zeros((2, 14)), ids=[1, 2, 3])


@pytest.mark.parametrize("precision, backend", KINDS)
def test_rollouts_of_a_batch_are_its_steps(ant, rng, precision, backend) -> None:
    control = rng.uniform(-1, 1, (NWORLD, 12, ant.nu)).astype(np.float32)
    names = ["state", "qpos", "xpos", "ncon"]
    recorded, stepped = batch(ant, precision, backend), batch(ant, precision, backend)
    recorded.step(3)
    stepped.step(3)
    rows = recorded.rollout(control, outputs=names)
    assert list(rows) == names and rows["xpos"].shape == (NWORLD, 12, ant.nbody, 3) and rows["ncon"].dtype == np.int32
    for t in range(12):
        stepped.step(1, control[:, t])
        np.testing.assert_array_equal(rows["state"][:, t], stepped.get("state"))
        np.testing.assert_array_equal(rows["qpos"][:, t], stepped.qpos)
    assert recorded.state_hash() == stepped.state_hash()
    np.testing.assert_array_equal(recorded.ctrl, control[:, -1].astype(recorded.dtype))


def test_controls_are_repeated_or_kept(ant, rng) -> None:
    row = rng.uniform(-1, 1, (9, ant.nu))
    wanted = batch(ant).rollout(np.tile(row, (NWORLD, 1, 1)))["state"]
    np.testing.assert_array_equal(batch(ant).rollout(row)["state"], wanted)
    held = batch(ant)
    ctrl = held.ctrl.copy()
    kept_on = batch(ant).rollout(np.repeat(ctrl[:, None], 9, axis=1))["state"]
    np.testing.assert_array_equal(held.rollout(nstep=9)["state"], kept_on)
    np.testing.assert_array_equal(batch(ant).rollout(ctrl[:, None], nstep=9)["state"], kept_on)
    some = batch(ant).rollout(row, ids=IDS)["state"]
    np.testing.assert_array_equal(some, wanted[IDS])
    assert batch(ant).rollout()["state"].shape == (NWORLD, 1, 30)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_rollouts_write_to_given_arrays(ant, rng, dtype) -> None:
    control = rng.uniform(-1, 1, (5, ant.nu))
    wanted = batch(ant).rollout(control, outputs=["qpos", "ncon"], ids=IDS)
    out = {"qpos": np.full((len(IDS), 5, ant.nq), np.nan, dtype), "ncon": np.full((len(IDS), 5), -1, np.int32)}
    rows = batch(ant).rollout(control, outputs=["qpos", "ncon"], ids=IDS, out=out)
    assert rows["qpos"] is out["qpos"] and rows["ncon"] is out["ncon"]
    np.testing.assert_array_equal(out["qpos"], wanted["qpos"].astype(dtype))
    np.testing.assert_array_equal(out["ncon"], wanted["ncon"])


@pytest.mark.parametrize(
    "arguments, text",
    [
        (
            {"control": np.zeros((NWORLD, 5, 3))},
            r"array `control` has shape \[37, 5, 3\]; expected \[nworld=37, nstep=5, nu=8\]",
        ),
        ({"control": np.zeros((4, 5, 8))}, r"expected \[nworld=37, nstep=5, nu=8\]"),
        ({"control": np.zeros((5, 8)), "nstep": 7}, "nstep inferred as 7 but control has 5"),
        ({"control": np.full((5, 8), np.nan)}, "array `control` holds NaN"),
        ({"outputs": "qpos"}, r"outputs is a str; expected a list of names, such as \['qpos'\]"),
        ({"outputs": ["qpso"]}, 'there is no output qpso; did you mean "qpos"?'),
        ({"outputs": ["utterly_unknown"]}, "lanesim.OUTPUTS lists what there is"),
        ({"outputs": ["contact_dist"]}, "differs in length between worlds"),
        ({"outputs": ["qpos"], "out": {"qvel": np.zeros(3)}}, "which is not among the outputs"),
        ({"outputs": ["qpos"], "out": {"qpos": np.zeros((NWORLD, 1, 3))}}, r"expected \[nworld=37, nstep=1, 15\]"),
        ({"nstep": -1}, "nstep is -1; expected at least 0"),
    ],
)
def test_wrong_rollouts_of_a_batch(ant, arguments, text) -> None:
    worlds = batch(ant)
    before = worlds.state_hash()
    with pytest.raises(lanesim.LanesimError, match=text):
        worlds.rollout(**arguments)
    assert worlds.state_hash() == before
