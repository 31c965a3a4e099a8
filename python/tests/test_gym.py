"""`lanesim.gym.VectorEnv`."""

from __future__ import annotations

import lanesim
import numpy as np
from lanesim.gym import VectorEnv


def balance(pendulum: lanesim.Model, **options) -> VectorEnv:
    return VectorEnv(
        pendulum,
        6,
        reward=lambda worlds, action: -np.square(action).sum(axis=1),
        terminated=lambda worlds, observation: np.abs(observation[:, 1]) > 1.0,
        **options,
    )


def test_spaces_and_steps(pendulum) -> None:
    env = balance(pendulum, frame_skip=5)
    observation, info = env.reset(seed=3)
    assert env.observation_space.contains(observation) and info == {}
    action = env.action_space.sample()
    assert action.shape == (6, 1) and (np.abs(action) <= 1).all()
    observation, reward, terminated, truncated, info = env.step(action)
    assert env.observation_space.contains(observation)
    np.testing.assert_allclose(reward, -(action[:, 0] ** 2))
    assert not terminated.any() and not truncated.any() and info == {}
    np.testing.assert_allclose(env.worlds.time, 0.01)


def test_ended_environments_alone_start_again(pendulum) -> None:
    env = balance(pendulum)
    env.reset()
    env.worlds.set("qvel", [2.0], np.array([False, True, False, False, False, False]))
    observation, _, terminated, _, info = env.step(np.zeros((6, 1)))
    np.testing.assert_array_equal(terminated, info["_final_obs"])
    assert terminated.tolist() == [False, True, False, False, False, False]
    assert abs(info["final_obs"][1, 1]) > 1.0 and observation[1, 1] == 0.0
    assert env.worlds.time[1] == 0.0 and env.worlds.time[0] > 0.0


def test_episodes_are_truncated(pendulum) -> None:
    env = balance(pendulum, max_episode_steps=3, reset_noise=0.1, key="up")
    env.reset(seed=1)
    results = [env.step(np.zeros((6, 1)))[3].all() for _ in range(6)]
    assert results == [False, False, True, False, False, True]
    assert len(np.unique(env.worlds.qvel)) == 6
    env.reset(seed=1, options={"reset_mask": np.arange(6) < 2})
    np.testing.assert_allclose(env.worlds.qpos[:2], 3.14)
