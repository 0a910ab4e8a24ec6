"""Results of the native module in pickles and copies, by their fields."""

import copyreg
from types import SimpleNamespace
from typing import Any

from . import _native

_RESULTS = (
    _native.ControlStep,
    _native.Correction,
    _native.GradientBatch,
    _native.LoopBatch,
    _native.PlanChange,
    _native.PlanGradient,
    _native.StepBatch,
    _native.Trained,
    _native.TrainingProgress,
)


def _reduce(result: object) -> tuple[Any, ...]:
    kind = type(result)
    fields = {name: getattr(result, name) for name in vars(kind) if not name.startswith("_")}
    return _native.restore_result, (kind.__name__, SimpleNamespace(**fields))


def register() -> None:
    """Lets all results be pickled and copied."""
    for kind in _RESULTS:
        copyreg.pickle(kind, _reduce)
