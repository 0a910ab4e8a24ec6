"""The directories of runs, and what is in them."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Optional

from . import _tables
from ._errors import InputError
from ._native import Model
from ._tables import Table

if TYPE_CHECKING:
    import pandas


class Run:
    """The directory of a run, made by ``run`` or by the program ``pinc``.

    Nothing is read before it is asked for; tables are dictionaries of NumPy arrays by column, in
    which an empty cell is NaN.
    """

    def __init__(self, path: "str | os.PathLike[str]") -> None:
        self.path = Path(path)
        if not (self.path / "config.toml").is_file():
            raise InputError(f"{self.path}: no run directory, it has no config.toml")

    def __repr__(self) -> str:
        return f"<pinc.Run: {self.path}>"

    @property
    def config(self) -> str:
        """The config with all values spelled out, as TOML."""
        return self._text("config.toml")

    @property
    def metrics(self) -> dict[str, Any]:
        """The content of ``metrics.json``."""
        return self._json("metrics.json")

    @property
    def provenance(self) -> dict[str, Any]:
        """The content of ``provenance.json``: where the results come from."""
        return self._json("provenance.json")

    @property
    def report(self) -> Path:
        """The report, a page for a browser."""
        return self._existing("report.html")

    @property
    def model(self) -> Model:
        """The trained net."""
        return Model.load(self._existing("model.safetensors"))

    @property
    def tables(self) -> list[str]:
        """The names of the tables that there are."""
        return sorted(path.stem for path in self.path.glob("*.csv"))

    @property
    def models(self) -> list[str]:
        """The models in the closed loops, as ``["pinc", "rk4"]``."""
        return [loop["model"] for loop in self.metrics.get("control", [])]

    @property
    def training(self) -> Table:
        """A row per iteration of the training."""
        return self.table("training")

    @property
    def prediction(self) -> Table:
        """The free run and its truth."""
        return self.table("prediction")

    def control(self, model: Optional[str] = None) -> Table:
        """The dense trace of the closed loop with a model; of the only one if none is named."""
        return self.table(self._of_loop("control", model))

    def steps(self, model: Optional[str] = None) -> Table:
        """A row per control step of the closed loop with a model."""
        return self.table(self._of_loop("steps", model))

    def estimates(self, model: Optional[str] = None) -> Table:
        """What the estimator estimated in the closed loop with a model."""
        return self.table(self._of_loop("estimates", model))

    def table(self, name: str) -> Table:
        """A table by its name, one of ``tables``."""
        return _tables.read(self._existing(f"{name}.csv"))

    def frame(self, name: str) -> "pandas.DataFrame":
        """A table as a data frame of pandas."""
        return _tables.frame(self.table(name))

    def _of_loop(self, kind: str, model: Optional[str]) -> str:
        """The name of a table of a closed loop."""
        models = self.models
        if model is None and len(models) > 1:
            given = ", ".join(models)
            raise InputError(f"{self.path}: closed loops with {given}; name one of these models")
        if model is not None and model not in models:
            given = ", ".join(models) or "no model"
            raise InputError(f"{self.path}: no closed loop with {model}, but with {given}")
        return kind if len(models) < 2 else f"{kind}-{model}"

    def _existing(self, name: str) -> Path:
        path = self.path / name
        if not path.is_file():
            raise InputError(f"{path}: the run has no such file")
        return path

    def _text(self, name: str) -> str:
        return self._existing(name).read_text(encoding="utf-8")

    def _json(self, name: str) -> dict[str, Any]:
        content: dict[str, Any] = json.loads(self._text(name))
        return content
