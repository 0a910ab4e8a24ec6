"""Physics-informed neural nets as models in nonlinear model predictive control (PINC).

- ``train`` trains the net of a config, until its function ``progress`` returns ``STOP``; ``Model`` is a trained net: steps, Jacobians, free runs,
  layers, a CasADi function.
- ``Nmpc`` is the controller of a config, with its estimator, one step at a time.
- ``run`` runs a whole experiment; ``Run`` reads what is in its directory.

A config is a path, or a text in TOML (a ``str`` with a line break in it); ``overrides`` are values
over its own, as ``{"seed": 3, "training.lambda": 0.5}``, of which ``None`` takes a key away. All
arguments and results are NumPy arrays or what NumPy makes arrays of. What cannot be used raises ``InputError``, a ``ValueError``; a run
that fails raises ``RunError``; Ctrl-C raises ``KeyboardInterrupt``.
"""

from importlib.metadata import version as _version

from ._errors import InputError, PincError, RunError
from ._native import ControlStep, Model, Nmpc, Trained, TrainingProgress, train
from ._runs import Run, run
from ._stop import STOP

__version__ = _version("pinc")

__all__ = [
    "STOP",
    "ControlStep",
    "InputError",
    "Model",
    "Nmpc",
    "PincError",
    "Run",
    "RunError",
    "Trained",
    "TrainingProgress",
    "__version__",
    "run",
    "train",
]
