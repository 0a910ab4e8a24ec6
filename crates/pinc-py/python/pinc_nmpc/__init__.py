"""Physics-informed neural nets as models in nonlinear model predictive control (PINC).

- ``train`` trains the net of a config, until its function ``progress`` returns ``STOP``; ``Model``
  is a trained net: steps, Jacobians, free runs, layers, a CasADi function.
- ``Nmpc`` is the controller of a config, with its estimator, one step at a time; ``NmpcBatch``
  takes many steps and runs many closed loops on all cores. Both give derivatives, and
  ``torch_policy`` and ``jax_policy`` make functions of PyTorch and JAX of the latter.
- ``Plant`` is the plant of a config with its simulator, and ``Plant.model`` an integrator as a model
  of it; ``expression`` makes equations of Python functions; ``Estimator`` is the config's estimator, one step at a time.
- ``resolved`` spells a config out. ``pinc_nmpc.environment`` is the loop as an environment of
  Gymnasium, and controllers as policies; ``pinc_nmpc.qp`` the controllers' solver of quadratic programs,
  also for qpsolvers.
- ``check``, ``choose``, ``run``, ``control``, ``identify``, ``estimate``, ``certify``, ``tune``,
  ``shrink``, ``export``, ``export_plant`` and ``export_net`` do what the commands of the program
  ``pinc`` do; their results have ``table``, a dictionary of arrays by column, and ``frame``, the same
  for pandas. ``Run`` reads what is in a run's directory.

A config is a path, a text in TOML (a ``str`` with a line break in it), or a dictionary;
``overrides`` are values over its own, as ``{"seed": 3, "training.lambda": 0.5}``, of which ``None``
takes a key away. All numbers are NumPy arrays or what NumPy makes arrays of. What cannot be used
raises ``InputError``, a ``ValueError``; a run that fails raises ``RunError``; Ctrl-C raises
``KeyboardInterrupt``.
"""

from importlib.metadata import version as _version

from ._commands import (
    certify,
    check,
    choose,
    control,
    estimate,
    export,
    export_net,
    export_plant,
    identify,
    run,
    shrink,
    tune,
)
from ._errors import InputError, PincError, RunError
from ._learning import jax_policy, torch_policy
from ._native import (
    ControlStep,
    Correction,
    Estimator,
    GradientBatch,
    IntegratorModel,
    LoopBatch,
    Model,
    Nmpc,
    NmpcBatch,
    PlanChange,
    PlanGradient,
    Plant,
    StepBatch,
    Trained,
    TrainingProgress,
    allow_processes,
    resolved,
    train,
)
from ._pickles import register as _register
from ._results import (
    Certificate,
    Choice,
    Estimates,
    Finding,
    Findings,
    Identification,
    Parameter,
    Shrunk,
    Tuning,
)
from ._runs import Run
from ._stop import STOP
from ._trace import expression

__version__ = _version("pinc-nmpc")
_register()

__all__ = [
    "STOP",
    "Certificate",
    "Choice",
    "ControlStep",
    "Correction",
    "Estimates",
    "Estimator",
    "Finding",
    "Findings",
    "GradientBatch",
    "Identification",
    "InputError",
    "IntegratorModel",
    "LoopBatch",
    "Model",
    "Nmpc",
    "NmpcBatch",
    "Parameter",
    "PincError",
    "PlanChange",
    "PlanGradient",
    "Plant",
    "Run",
    "RunError",
    "Shrunk",
    "StepBatch",
    "Trained",
    "TrainingProgress",
    "Tuning",
    "__version__",
    "allow_processes",
    "certify",
    "check",
    "choose",
    "control",
    "estimate",
    "export",
    "export_net",
    "export_plant",
    "expression",
    "identify",
    "jax_policy",
    "resolved",
    "run",
    "shrink",
    "torch_policy",
    "train",
    "tune",
]
