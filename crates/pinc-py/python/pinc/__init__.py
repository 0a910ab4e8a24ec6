"""Physics-informed neural nets as models in nonlinear model predictive control (PINC).

- ``train`` trains the net of a config, until its function ``progress`` returns ``STOP``; ``Model`` is a trained net: steps, Jacobians, free runs,
  layers, a CasADi function.
- ``Nmpc`` is the controller of a config, with its estimator, one step at a time; ``NmpcBatch``
  takes many steps and runs many closed loops on all cores. Both give derivatives, and
  ``torch_policy`` and ``jax_policy`` make functions of PyTorch and JAX of the latter.
- ``run`` runs a whole experiment; ``Run`` reads what is in its directory.

A config is a path, or a text in TOML (a ``str`` with a line break in it); ``overrides`` are values
over its own, as ``{"seed": 3, "training.lambda": 0.5}``, of which ``None`` takes a key away. All
arguments and results are NumPy arrays or what NumPy makes arrays of. What cannot be used raises ``InputError``, a ``ValueError``; a run
that fails raises ``RunError``; Ctrl-C raises ``KeyboardInterrupt``.
"""

from importlib.metadata import version as _version

from ._errors import InputError, PincError, RunError
from ._learning import jax_policy, torch_policy
from ._native import (
    ControlStep,
    GradientBatch,
    LoopBatch,
    Model,
    Nmpc,
    NmpcBatch,
    PlanChange,
    PlanGradient,
    StepBatch,
    Trained,
    TrainingProgress,
    train,
)
from ._runs import Run, run
from ._stop import STOP

__version__ = _version("pinc")

__all__ = [
    "STOP",
    "ControlStep",
    "GradientBatch",
    "InputError",
    "LoopBatch",
    "Model",
    "Nmpc",
    "NmpcBatch",
    "PincError",
    "PlanChange",
    "PlanGradient",
    "Run",
    "RunError",
    "StepBatch",
    "Trained",
    "TrainingProgress",
    "__version__",
    "jax_policy",
    "run",
    "torch_policy",
    "train",
]
