"""Which models are compared, and how MuJoCo is made to compute the same."""

from __future__ import annotations

import importlib.util
import pathlib
from typing import Iterator

import lanesim
import mujoco
import numpy as np
from conftest import MODELS

REASONS = ("not supported", "not built yet", "more problems are not listed")


def installed(package: str) -> list[pathlib.Path]:
    """MJCF files that a package installs, without those that are parts of others."""
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.origin is not None
    files = sorted(pathlib.Path(spec.origin).parent.rglob("*.xml"))
    return [file for file in files if "<mujoco" in file.read_text() and "common" not in file.parts]


def ours() -> list[pathlib.Path]:
    """The models of this repository."""
    return sorted(MODELS.rglob("*.xml"))


def load_mujoco(path: pathlib.Path) -> mujoco.MjModel | None:
    """MuJoCo's model, or None if the file is none (a part of another, or one that needs a program to complete it)."""
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        return None


def unsupported(error: lanesim.ModelError) -> bool:
    """Whether a model was rejected for nothing but what is not built."""
    return all(any(reason in d.message for reason in REASONS) for d in error.diagnostics)


def settle(model: mujoco.MjModel) -> None:
    """Options under which both engines have one and the same answer."""
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.iterations = 200
    model.opt.tolerance = 1e-15
    model.opt.noslip_iterations = 0
    model.opt.ccd_tolerance = 1e-10
    model.opt.ccd_iterations = 500
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER


# Accelerations are compared, not steps: the integrator, of which not all are built, has no part in them.
OPTIONS = {"solver": "Newton", "iterations": 200, "tolerance": 1e-15, "noslip_iterations": 0, "integrator": "Euler"}


def states(model: mujoco.MjModel, count: int, seed: int = 0) -> Iterator[mujoco.MjData]:
    """States that the model gets into: under random controls, from near its first keyframe or its start."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qvel[:] = 0.1 * rng.standard_normal(model.nv)
        low, high = np.where(model.actuator_ctrllimited[:, None] == 1, model.actuator_ctrlrange, [-1.0, 1.0]).T
        for _ in range(40):
            data.ctrl[:] = rng.uniform(low, high)
            mujoco.mj_step(model, data)
        mujoco.mj_normalizeQuat(model, data.qpos)
        yield data
