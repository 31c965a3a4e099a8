"""Inverse dynamics: states and accelerations in, forces out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._states import States
from .model import Model, check_model

__all__ = ["inverse"]


def inverse(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    qacc: ArrayLike,
    *,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    discrete: bool | None = None,
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
) -> NDArray[Any]:
    """The generalised forces for which states have given accelerations: of one state, of many, or of whole trajectories.

    >>> model = lanesim.Model.from_xml_path("models/zoo/arm.xml")
    >>> force = lanesim.inverse(model, qpos, qvel, qacc)     # [nworld, nstep, nq], [nworld, nstep, nv] twice

    Args:
        model: The model.
        qpos: Positions, [..., nq], with any leading dimensions: none, [N], [nworld, nstep].
        qvel: Velocities, [..., nv].
        qacc: Accelerations, [..., nv] (m/s^2, rad/s^2).
        act: Activations, [..., na]; None: zero.
        ctrl: Controls, [..., nu]; None: zero. They have no force here; with `discrete` they decide what actuators gain with
            velocity.
        mocap_pos: Positions of mocap bodies, [..., nmocap, 3]; None: as the model has them.
        mocap_quat: Orientations of mocap bodies, [..., nmocap, 4]; None: as the model has them.
        eq_active: Which equality constraints are active, [..., neq], 1 or 0; None: as the model has it.
        discrete: Whether `qacc` is what qvel gains over a step, divided by the time step, so that a step with the force
            returned gives it back; otherwise it is the derivative of qvel. None: as the model's flag ``invdiscrete`` says. With the
            integrator ``discrete`` it always is.
        threads: Worker threads; None: as many as there are processors.
        precision: "f64" or "f32"; the result has that type.
        backend: As for `Worlds`; the same bits.

    Returns:
        [..., nv]: what must come from actuators and from outside, MuJoCo's ``qfrc_inverse`` (N, N m). NaN for states that
        cannot be stepped, such as those with numbers beyond all bounds.

    Raises:
        InputError: Arrays have other shapes, or hold numbers that are not finite.
        OptionError: `discrete` with the integrator RK4, which evaluates several states in a step.
    """
    check_model(model)
    if discrete is not None and bool(discrete) != model.opt.flags["invdiscrete"]:
        model = model.replace(invdiscrete=bool(discrete))
    others = {
        "qpos": qpos,
        "qvel": qvel,
        "act": act,
        "ctrl": ctrl,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    states = States(model, ("qacc", qacc, "nv"), others)
    out = np.empty((states.count, model.nv), np.float32 if precision == "f32" else np.float64)
    for worlds, here in states.worlds(threads, precision, backend):
        worlds.inverse(states.rows["qacc"][here], out[here])
    return out.reshape(*states.leading, model.nv)
