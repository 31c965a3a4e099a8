"""A batch simulator for articulated bodies with contact: MuJoCo's models and names, thousands of worlds at a time.

>>> import lanesim, numpy as np
>>> model = lanesim.Model.from_xml_path("models/zoo/ant.xml")
>>> worlds = lanesim.Worlds(model, 1024)
>>> worlds.ctrl = np.random.uniform(-1, 1, (1024, model.nu))
>>> worlds.step(100)
>>> worlds.get("xpos").shape
(1024, 10, 3)

`Model` compiles MJCF, and takes over ``mujoco.MjSpec`` and ``mujoco.MjModel``. `Worlds` holds many worlds of a model:
``step``, ``rollout``, ``get``, ``set``, ``set_state`` and ``reset`` act on all of them, or on those that ``ids`` names.
`rollout` has the shapes of ``mujoco.rollout``; `inverse` finds the forces behind a motion, `transition` the derivatives
of steps, `acceleration_derivatives` and `inverse_derivatives` those of either, `hessian` second ones of costs,
`parameter_derivatives` those by masses, frictions and the like, `smoothed` means over noise; `optimise` searches the controls of
an optimal motion. `OUTPUTS` describes every quantity that ``Worlds.get`` and ``rollout(outputs=...)`` know, `PARAMETERS` what
``Worlds.set`` can make differ between worlds. `lanesim.gym` has a vector environment.
"""

from . import _lanesim
from ._lanesim import __version__
from .clouds import Hessian, ParameterDerivatives, Smoothed, hessian, parameter_derivatives, smoothed
from .derivatives import Transition, acceleration_derivatives, inverse_derivatives, transition
from .errors import (
    Diagnostic,
    DivergedError,
    InputError,
    LanesimError,
    LossWarning,
    ModelError,
    OptionError,
    UnknownNameError,
    UnsupportedError,
    WorldMemoryError,
)
from .inverse import inverse
from .model import Cone, Integrator, Key, Model, Options, Report, Solver
from .optimise import TASKS, Motion, Term, optimise
from .rollout import Rollout, rollout, shutdown_persistent_pool
from .spec import Element, Spec
from .status import Status, StatusEvent
from .worlds import PARAMETERS, Worlds

OUTPUTS: dict[str, str] = dict(_lanesim.OUTPUTS)
"""Names and meanings of everything that can be read or recorded."""

__all__ = [
    "Cone",
    "Diagnostic",
    "DivergedError",
    "Element",
    "Hessian",
    "InputError",
    "Integrator",
    "Key",
    "LanesimError",
    "LossWarning",
    "Model",
    "ModelError",
    "Motion",
    "OUTPUTS",
    "OptionError",
    "Options",
    "PARAMETERS",
    "ParameterDerivatives",
    "Report",
    "Rollout",
    "Smoothed",
    "Solver",
    "Spec",
    "Status",
    "StatusEvent",
    "TASKS",
    "Term",
    "Transition",
    "UnknownNameError",
    "UnsupportedError",
    "WorldMemoryError",
    "Worlds",
    "__version__",
    "acceleration_derivatives",
    "hessian",
    "inverse",
    "inverse_derivatives",
    "optimise",
    "parameter_derivatives",
    "rollout",
    "shutdown_persistent_pool",
    "smoothed",
    "transition",
]
