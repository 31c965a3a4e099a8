"""`lanesim.gym.VectorEnv`, with gymnasium's own wrappers."""

from __future__ import annotations

import warnings

import gymnasium
import lanesim
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers
from lanesim.gym import VectorEnv

MODES = list(AutoresetMode)


def balance(pendulum: lanesim.Model, **options) -> VectorEnv:
    defaults = dict(
        reward=lambda worlds, action: -np.square(action).sum(axis=1),
        terminated=lambda worlds, observation: np.abs(observation[:, 1]) > 1.0,
    )
    return VectorEnv(pendulum, 6, **{**defaults, **options})


def push(env: VectorEnv, world: int) -> None:
    """Makes an environment end in the next step."""
    env.worlds.set("qvel", [2.0], ids=[world])


def test_spaces_and_steps(pendulum) -> None:
    env = balance(pendulum, frame_skip=5)
    observation, info = env.reset(seed=3)
    assert env.observation_space.contains(observation) and info == {}
    action = env.action_space.sample()
    assert action.shape == (6, 1) and (np.abs(action) <= 1).all()
    observation, reward, terminated, truncated, info = env.step(action)
    assert env.observation_space.contains(observation)
    np.testing.assert_allclose(reward, -(action[:, 0] ** 2))
    assert reward.dtype == np.float64
    assert not terminated.any() and not truncated.any() and info == {}
    np.testing.assert_allclose(env.worlds.time, 0.01)


def test_ended_environments_alone_start_again(pendulum) -> None:
    env = balance(pendulum)
    env.reset()
    push(env, 1)
    observation, _, terminated, _, info = env.step(np.zeros((6, 1)))
    np.testing.assert_array_equal(terminated, info["_final_obs"])
    assert terminated.tolist() == [False, True, False, False, False, False]
    assert abs(info["final_obs"][1, 1]) > 1.0 and observation[1, 1] == 0.0
    assert env.worlds.time[1] == 0.0 and env.worlds.time[0] > 0.0


def test_the_next_step_resets(pendulum) -> None:
    env = balance(pendulum, autoreset_mode="NEXT_STEP", reward=lambda worlds, action: 1.0 + worlds.time)
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    assert VectorEnv.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    env.reset()
    push(env, 1)
    observation, reward, terminated, _, info = env.step(np.zeros((6, 1)))
    assert terminated.tolist() == [False, True, False, False, False, False] and info == {}
    assert abs(observation[1, 1]) > 1.0 and reward[1] > 1.0
    observation, reward, terminated, truncated, _ = env.step(np.ones((6, 1)))
    assert not terminated.any() and not truncated.any()
    assert observation[1].tolist() == [0.0, 0.0] and reward[1] == 0.0 and env.worlds.time[1] == 0.0
    np.testing.assert_allclose(env.worlds.time[[0, 2, 3, 4, 5]], 0.004)
    observation, reward, _, _, _ = env.step(np.ones((6, 1)))
    np.testing.assert_allclose(env.worlds.time[1], 0.002)
    assert reward[1] > 1.0


def test_nobody_resets_but_the_user(pendulum) -> None:
    env = balance(pendulum, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=3)
    env.reset(seed=0)
    for expected in (False, False, True, True):
        *_, truncated, info = env.step(np.zeros((6, 1)))
        assert truncated.all() == expected and info == {}
    mask = np.arange(6) < 2
    options = {"reset_mask": mask}
    observation, _ = env.reset(options=options)
    assert options == {"reset_mask": mask}
    np.testing.assert_allclose(env.worlds.time, np.where(mask, 0.0, 0.008))
    np.testing.assert_array_equal(observation[:, 0], env.worlds.qpos[:, 0])
    assert env.step(np.zeros((6, 1)))[3].tolist() == (~mask).tolist()


@pytest.mark.parametrize("mask", [[1, 0, 0, 0, 0, 0], np.ones(5, bool), "all"])
def test_wrong_reset_masks(pendulum, mask) -> None:
    with pytest.raises(
        lanesim.InputError, match=r'options\["reset_mask"\] is .*; expected bool of shape \[num_envs=6\]'
    ):
        balance(pendulum).reset(options={"reset_mask": mask})


def test_episodes_are_truncated(pendulum) -> None:
    env = balance(pendulum, max_episode_steps=3, reset_noise=0.1, key="up")
    env.reset(seed=1)
    results = [env.step(np.zeros((6, 1)))[3].all() for _ in range(6)]
    assert results == [False, False, True, False, False, True]
    assert len(np.unique(env.worlds.qvel)) == 6
    env.reset(seed=1, options={"reset_mask": np.arange(6) < 2})
    np.testing.assert_allclose(env.worlds.qpos[:2], 3.14)


@pytest.mark.parametrize("mode", MODES)
def test_a_hook_sets_where_worlds_start(pendulum, mode) -> None:
    calls = []

    def start(worlds, ids, rng) -> None:
        calls.append(ids.tolist())
        worlds.set("qpos", rng.uniform(1.0, 2.0, (len(ids), 1)), ids=ids)

    def run(seed: int) -> np.ndarray:
        env = balance(pendulum, on_reset=start, autoreset_mode=mode, max_episode_steps=4)
        seen = [env.reset(seed=seed)[0]]
        for _ in range(10):
            seen.append(env.step(np.zeros((6, 1)))[0])
        return np.array(seen)

    first = run(5)
    assert calls[0] == [0, 1, 2, 3, 4, 5] and len(calls) == (1 if mode == AutoresetMode.DISABLED else 3)
    assert ((first[0, :, 0] >= 1.0) & (first[0, :, 0] < 2.0)).all() and len(np.unique(first[0, :, 0])) == 6
    np.testing.assert_array_equal(first, run(5))
    assert (first[0] != run(6)[0]).any()


@pytest.mark.parametrize(
    "options, text",
    [
        (
            {"reward": lambda worlds, action: -np.square(action)},
            r"reward returned float64 of shape \[6, 1\]; expected real",
        ),
        ({"reward": lambda worlds, action: 1.0}, r"reward returned float64 of shape \[\]"),
        ({"reward": lambda worlds, action: np.ones(6, complex)}, "reward returned complex128"),
        ({"reward": lambda worlds, action: np.ones(6, bool)}, "reward returned bool"),
        ({"terminated": lambda worlds, seen: seen > 1}, r"terminated returned bool of shape \[6, 2\]; expected bool"),
        ({"terminated": lambda worlds, seen: np.zeros(6)}, "terminated returned float64"),
        ({"observe": lambda worlds: worlds.qpos[0]}, r"observe returned float64 of shape \[1\]; expected .*num_envs=6"),
        ({"observe": lambda worlds: np.full(6, "x")}, "observe returned <U1"),
        (
            {"observe": lambda worlds: worlds.qpos.astype(np.float32 if worlds.time[0] else np.float64)},
            "observe returned float32 of shape .* expected float64 .* as it did when the environment was made",
        ),
        ({"observe": lambda worlds: np.zeros((6, 2 if worlds.time[0] else 1))}, r"shape \[6, 2\]; expected float64"),
        ({"autoreset_mode": "SAME_STP"}, 'did you mean "SAME_STEP"'),
        ({"precision": "f46"}, 'precision is .f46.; expected one of f64, f32; did you mean "f64"'),
        ({"backend": "wid"}, 'did you mean "wide"'),
        ({"frame_skip": 0}, "frame_skip is 0; expected at least 1"),
        ({"max_episode_steps": 2.5}, "whole number"),
        ({"reset_noise": -1.0}, "reset_noise"),
    ],
)
def test_what_functions_return_is_checked(pendulum, options, text) -> None:
    with pytest.raises(lanesim.LanesimError, match=text):
        env = balance(pendulum, **options)
        env.reset()
        env.step(np.zeros((6, 1)))


@pytest.mark.parametrize("action", [np.zeros(1), np.zeros((6, 2)), np.zeros((5, 1)), np.full((6, 1), np.nan)])
def test_wrong_actions(pendulum, action) -> None:
    env = balance(pendulum)
    env.reset()
    with pytest.raises(lanesim.InputError, match="actions have shape|holds NaN"):
        env.step(action)


def test_observations_are_copies(pendulum) -> None:
    buffer = np.zeros((6, 2))

    def observe(worlds) -> np.ndarray:
        buffer[:, :1], buffer[:, 1:] = worlds.qpos, worlds.qvel
        return buffer

    env = balance(pendulum, observe=observe)
    first, _ = env.reset()
    push(env, 1)
    second, *_, info = env.step(np.ones((6, 1)))
    assert not first.any() and abs(info["final_obs"][1, 1]) > 1.0 and second[1, 1] == 0.0


def episodes(env, steps: int = 20) -> list[tuple]:
    env.reset(seed=0)
    return [env.step(np.zeros((6, 1))) for _ in range(steps)]


@pytest.mark.parametrize("mode", MODES)
def test_statistics_of_episodes(pendulum, mode) -> None:
    env = balance(pendulum, autoreset_mode=mode, max_episode_steps=4, reward=lambda worlds, action: np.full(6, 2.0))
    recorded = wrappers.RecordEpisodeStatistics(env)
    recorded.reset(seed=0)
    found = []
    for _ in range(12):
        *_, truncated, info = recorded.step(np.zeros((6, 1)))
        if truncated.any():
            found.append((info["episode"]["r"].tolist(), info["episode"]["l"].tolist()))
            if mode == AutoresetMode.DISABLED:
                recorded.reset(options={"reset_mask": truncated})
    assert len(found) >= 2 and all(entry == ([8.0] * 6, [4] * 6) for entry in found)


def test_wrappers_of_observations(pendulum) -> None:
    make = lambda: balance(pendulum, autoreset_mode="NEXT_STEP", max_episode_steps=5, reset_noise=0.3)  # noqa: E731
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        normal = wrappers.NormalizeObservation(make())
        plain = episodes(make())
        seen = np.array([step[0] for step in episodes(normal)])
        assert seen.dtype == np.float32 and np.isfinite(seen).all() and np.abs(seen).max() < 10
        doubled = wrappers.TransformObservation(make(), lambda observation: 2 * observation)
        np.testing.assert_allclose([step[0] for step in episodes(doubled)], [2 * step[0] for step in plain])
        scaled = wrappers.NormalizeReward(make())
        assert np.isfinite([step[1] for step in episodes(scaled)]).all()
        clipped = wrappers.ClipAction(make())
        clipped.reset(seed=0)
        clipped.step(np.full((6, 1), 5.0))
        np.testing.assert_array_equal(clipped.unwrapped.worlds.ctrl, 1.0)


@pytest.mark.parametrize("mode", MODES)
def test_what_gymnasium_asks_of_a_vector_environment(pendulum, mode) -> None:
    env = balance(pendulum, autoreset_mode=mode, max_episode_steps=3)
    assert isinstance(env, gymnasium.vector.VectorEnv) and env.metadata["autoreset_mode"] is mode
    assert env.observation_space == gymnasium.vector.utils.batch_space(env.single_observation_space, 6)
    for observation, reward, terminated, truncated, info in episodes(env, 8):
        assert env.observation_space.contains(observation)
        assert reward.shape == terminated.shape == truncated.shape == (6,)
        assert terminated.dtype == truncated.dtype == np.bool_ and isinstance(info, dict)
    assert env.np_random_seed == 0
    env.close()
