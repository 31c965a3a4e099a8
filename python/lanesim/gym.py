"""A vector environment for gymnasium: thousands of worlds behind ``gymnasium.vector.VectorEnv``.

What a task is made of - what is observed, what is rewarded, when it ends - are functions over all worlds at once.
"""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .model import Model
from .worlds import Status, Worlds

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise ImportError("lanesim.gym needs gymnasium: pip install gymnasium") from None

__all__ = ["VectorEnv"]

Observe = Callable[[Worlds], NDArray[Any]]
Reward = Callable[[Worlds, NDArray[Any]], NDArray[Any]]
Terminated = Callable[[Worlds, NDArray[Any]], NDArray[np.bool_]]


def observe_state(worlds: Worlds) -> NDArray[Any]:
    """Positions and velocities, [nworld, nq + nv]."""
    return np.concatenate([worlds.get("qpos"), worlds.get("qvel")], axis=1)


class VectorEnv(gymnasium.vector.VectorEnv):
    """`num_envs` worlds of a model as environments.

    Actions are controls, [num_envs, nu], in the actuators' ranges. Each is applied for `frame_skip` steps. An environment
    that ended is reset in the same step, by mask (gymnasium's ``SAME_STEP`` mode): the observation returned is the first
    of the new episode, ``info["final_obs"]`` holds the last of the old one, and ``info["_final_obs"]`` says where.

    observe: function of the worlds, [num_envs, n]; the default is positions and velocities.
    reward: function of (worlds, action), [num_envs].
    terminated: function of (worlds, observation), [num_envs] bool; diverged worlds terminate in any case.
    max_episode_steps: after as many actions an environment is truncated; None: never.
    reset_noise: half width of what is added to velocities, uniformly, at every reset.
    key: keyframe to start from; None: the reference configuration.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self,
        model: Model,
        num_envs: int,
        *,
        reward: Reward,
        observe: Observe = observe_state,
        terminated: Terminated | None = None,
        frame_skip: int = 1,
        max_episode_steps: int | None = None,
        reset_noise: float = 0.0,
        key: int | str | None = None,
        precision: str = "f64",
        threads: int | None = None,
    ) -> None:
        self.worlds = Worlds(model, num_envs, precision, threads)
        self.num_envs = num_envs
        self._observe, self._reward, self._terminated = observe, reward, terminated
        self._frame_skip = frame_skip
        self._limit = max_episode_steps
        self._noise = reset_noise
        self._key = key
        self._age = np.zeros(num_envs, dtype=np.int64)
        self._rng = np.random.default_rng()
        low, high = model.actuator_noiserange.T
        dtype = self.worlds.dtype.type
        self.single_action_space = gymnasium.spaces.Box(low.astype(dtype), high.astype(dtype), dtype=dtype)
        observation = observe(self.worlds)
        if observation.ndim < 1 or observation.shape[0] != num_envs:
            raise InputError(f"observe returned shape {list(observation.shape)}; expected [num_envs={num_envs}, ...]")
        self.single_observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, observation.shape[1:], dtype=observation.dtype.type
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Resets every environment, or those where ``options["reset_mask"]`` is true."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self._restart((options or {}).get("reset_mask"))
        return self._observe(self.worlds), {}

    def _restart(self, mask: NDArray[np.bool_] | None) -> None:
        self.worlds.reset(mask, self._key)
        self._age[slice(None) if mask is None else mask] = 0
        if self._noise:
            qvel = self.worlds.get("qvel")
            qvel += self._rng.uniform(-self._noise, self._noise, qvel.shape)
            self.worlds.set("qvel", qvel, mask)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Applies an action in every environment: observation, reward, terminated, truncated, info."""
        self.worlds.step(self._frame_skip, actions)
        self._age += 1
        observation = self._observe(self.worlds)
        reward = self._reward(self.worlds, actions)
        ended = (self.worlds.status & Status.Frozen) != 0
        if self._terminated is not None:
            ended |= self._terminated(self.worlds, observation)
        truncated = np.zeros(self.num_envs, dtype=bool)
        if self._limit is not None:
            truncated = (self._age >= self._limit) & ~ended
        info: dict[str, Any] = {}
        over = ended | truncated
        if over.any():
            info = {"final_obs": observation, "_final_obs": over}
            self._restart(over)
            observation = self._observe(self.worlds)
        return observation, reward, ended, truncated, info
