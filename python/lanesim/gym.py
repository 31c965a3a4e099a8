"""A vector environment for gymnasium: thousands of worlds behind ``gymnasium.vector.VectorEnv``.

What a task is made of - what is observed, what is rewarded, when it ends - are functions over all worlds at once.
"""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
from numpy.typing import NDArray

from . import _arrays
from .errors import InputError
from .model import Model
from .status import Status
from .worlds import Worlds

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
OnReset = Callable[[Worlds, NDArray[np.intp], np.random.Generator], object]


def observe_state(worlds: Worlds) -> NDArray[Any]:
    """Positions and velocities, [nworld, nq + nv]."""
    return np.concatenate([worlds.get("qpos"), worlds.get("qvel")], axis=1)


class VectorEnv(gymnasium.vector.VectorEnv):
    """`num_envs` worlds of a model as environments.

    Actions are controls, [num_envs, nu], in the actuators' ranges. Each is applied for `frame_skip` steps.

    What happens to an environment that ended is gymnasium's `autoreset_mode`, a member of
    ``gymnasium.vector.AutoresetMode`` or its name:

    * "SAME_STEP": it is reset in the same step. The observation returned is the first of the new episode,
      ``info["final_obs"]`` holds the last of the old one, and ``info["_final_obs"]`` says where.
    * "NEXT_STEP": its next step resets it instead: the action is passed over, and the reward is 0. This is what gymnasium's
      wrappers that change observations, such as ``NormalizeObservation``, ask for.
    * "DISABLED": it goes on until ``reset(options={"reset_mask": mask})`` resets it.

    observe: function of the worlds, [num_envs, ...]; the default is positions and velocities.
    reward: function of (worlds, action), real numbers [num_envs].
    terminated: function of (worlds, observation), [num_envs] bool; diverged worlds terminate in any case.
    max_episode_steps: after as many actions an environment is truncated; None: never.
    reset_noise: half width of what is added to velocities, uniformly, at every reset.
    key: keyframe to start from; None: the reference configuration.
    on_reset: function of (worlds, ids, rng), called after worlds have been reset, to set where they start:
        ``lambda worlds, ids, rng: worlds.set("qpos", rng.uniform(-1, 1, (len(ids), nq)), ids=ids)``. `ids` are the numbers of
        the worlds; `rng` is the environment's generator, which ``reset(seed=...)`` seeds.
    precision, backend, threads: as for `lanesim.Worlds`.
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
        on_reset: OnReset | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        precision: str = "f64",
        backend: str = "auto",
        threads: int | None = None,
    ) -> None:
        self._mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.num_envs = _arrays.count("num_envs", num_envs, 1)
        self._frame_skip = _arrays.count("frame_skip", frame_skip, 1)
        self._limit = None if max_episode_steps is None else _arrays.count("max_episode_steps", max_episode_steps, 1)
        if not (np.isfinite(reset_noise) and reset_noise >= 0):
            raise InputError(f"reset_noise is {reset_noise!r}; expected a number that is not negative")
        for name, function in [
            ("reward", reward),
            ("observe", observe),
            ("terminated", terminated),
            ("on_reset", on_reset),
        ]:
            if function is not None and not callable(function):
                raise TypeError(f"{name} is a {type(function).__name__}; expected a function")
        self.worlds = Worlds(model, self.num_envs, precision, threads, backend=backend)
        self._observe, self._reward, self._terminated = observe, reward, terminated
        self._noise, self._key, self._on_reset = reset_noise, key, on_reset
        self._age = np.zeros(num_envs, dtype=np.int64)
        self._over = np.zeros(num_envs, dtype=bool)
        low, high = model.actuator_noiserange.T
        dtype = self.worlds.dtype.type
        self.single_action_space = gymnasium.spaces.Box(low.astype(dtype), high.astype(dtype), dtype=dtype)
        observation = np.asarray(observe(self.worlds))
        if observation.ndim < 1 or observation.shape[0] != num_envs or observation.dtype.kind not in "fiub":
            raise InputError(
                f"observe returned {_kind(observation)}; expected real numbers of shape [num_envs={num_envs}, ...]"
            )
        self.single_observation_space = _space(observation)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Resets every environment, or those where ``options["reset_mask"]``, [num_envs] bool, is true: observation, info."""
        super().reset(seed=seed)
        mask = (options or {}).get("reset_mask")
        if mask is not None:
            mask = np.asarray(mask)
            if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
                raise InputError(
                    f'options["reset_mask"] is {_kind(mask)}; expected bool of shape [num_envs={self.num_envs}]'
                )
        self._restart(np.ones(self.num_envs, dtype=bool) if mask is None else mask)
        return self._observation(), {}

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        ids = np.flatnonzero(mask)
        if not ids.size:
            return
        self.worlds.reset(key=self._key, ids=ids)
        self._age[ids], self._over[ids] = 0, False
        if self._noise:
            qvel = self.worlds.get("qvel", ids=ids)
            qvel += self.np_random.uniform(-self._noise, self._noise, qvel.shape)
            self.worlds.set("qvel", qvel, ids=ids)
        if self._on_reset is not None:
            self._on_reset(self.worlds, ids, self.np_random)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Applies an action in every environment: observation, reward, terminated, truncated, info."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            shape, nu = list(actions.shape), self.worlds.model.nu
            raise InputError(f"actions have shape {shape}; expected [num_envs={self.num_envs}, nu={nu}]")
        starting = self._over.copy() if self._mode == AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, dtype=bool)
        if starting.any():
            running = np.flatnonzero(~starting)
            self.worlds.step(self._frame_skip, actions[running], ids=running)
            self._restart(starting)
        else:
            self.worlds.step(self._frame_skip, actions)
        self._age[~starting] += 1
        observation = self._observation()
        reward = self._rewards(actions)
        ended = (self.worlds.status & Status.Frozen) != 0
        if self._terminated is not None:
            ended |= self._ends(observation)
        truncated = np.zeros(self.num_envs, dtype=bool)
        if self._limit is not None:
            truncated = (self._age >= self._limit) & ~ended
        reward[starting], ended[starting], truncated[starting] = 0, False, False
        self._over = ended | truncated
        info: dict[str, Any] = {}
        if self._mode == AutoresetMode.SAME_STEP and self._over.any():
            over = self._over.copy()
            info = {"final_obs": observation, "_final_obs": over, "final_info": {}, "_final_info": over.copy()}
            self._restart(over)
            observation = self._observation()
        return observation, reward, ended, truncated, info

    def _observation(self) -> NDArray[Any]:
        """A copy of what is observed now: functions may use the same array again and again."""
        observation = np.array(self._observe(self.worlds))
        space = self.observation_space
        if observation.shape != space.shape or observation.dtype != space.dtype:
            raise InputError(
                f"observe returned {_kind(observation)}; expected {space.dtype} of shape {list(space.shape or ())}, as it "
                "did when the environment was made"
            )
        return observation

    def _rewards(self, actions: NDArray[Any]) -> NDArray[np.float64]:
        reward = np.asarray(self._reward(self.worlds, actions))
        if reward.shape != (self.num_envs,) or reward.dtype.kind not in "fiu":
            raise InputError(
                f"reward returned {_kind(reward)}; expected real numbers of shape [num_envs={self.num_envs}]"
            )
        return reward.astype(np.float64)

    def _ends(self, observation: NDArray[Any]) -> NDArray[np.bool_]:
        assert self._terminated is not None
        ends = np.asarray(self._terminated(self.worlds, observation))
        if ends.shape != (self.num_envs,) or ends.dtype != np.bool_:
            raise InputError(f"terminated returned {_kind(ends)}; expected bool of shape [num_envs={self.num_envs}]")
        return ends


def _kind(array: NDArray[Any]) -> str:
    return f"{array.dtype} of shape {list(array.shape)}"


def _mode(mode: Any) -> AutoresetMode:
    if isinstance(mode, AutoresetMode):
        return mode
    names = {known.name: known for known in AutoresetMode}
    names.update({known.value: known for known in AutoresetMode})
    found = names.get(mode) or names.get(mode.upper()) if isinstance(mode, str) else None
    if found is None:
        _arrays.choice("autoreset_mode", mode, [known.name for known in AutoresetMode])
    return found  # type: ignore[return-value]


def _space(observation: NDArray[Any]) -> gymnasium.spaces.Box:
    """What an observation like this can be: any number of its type."""
    kind, dtype = observation.dtype.kind, observation.dtype
    low, high = (
        (-np.inf, np.inf) if kind == "f" else (0, 1) if kind == "b" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
    )
    return gymnasium.spaces.Box(low, high, observation.shape[1:], dtype=dtype.type)
