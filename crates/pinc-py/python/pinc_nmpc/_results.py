"""What the functions of the package give."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Optional

import numpy as np

from . import _tables
from ._tables import Table

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Finding:
    """One thing that ``check`` found."""

    severity: str
    """``"fact"``, ``"warning"``, or ``"error"``: a run cannot succeed."""
    place: str
    """The key of the config, or a place in the plant; empty for the plant as a whole."""
    what: str
    """The finding in words."""
    why: str
    """Why it matters; empty for a fact."""
    change: str
    """The advised change; empty for a fact."""

    def __str__(self) -> str:
        text = f"{self.severity}: {self.place + ': ' if self.place else ''}{self.what}"
        for name, words in (("why", self.why), ("change", self.change)):
            text += f"\n    {name}: {words}" if words else ""
        return text


@dataclass(frozen=True)
class Findings:
    """What ``check`` found; printed as text, iterated one by one."""

    all: tuple[Finding, ...]
    """All findings."""

    def __iter__(self) -> Any:
        return iter(self.all)

    def __len__(self) -> int:
        return len(self.all)

    def __getitem__(self, place: int) -> Finding:
        return self.all[place]

    def __str__(self) -> str:
        return "\n".join(map(str, self.all))

    def of(self, severity: str) -> list[Finding]:
        """The findings of a severity."""
        return [finding for finding in self.all if finding.severity == severity]

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not self.of("error")

    @property
    def table(self) -> Table:
        """A row per finding."""
        names = ("severity", "place", "what", "why", "change")
        return {name: np.array([getattr(one, name) for one in self.all]) for name in names}

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


@dataclass(frozen=True)
class Parameter:
    """An identified parameter."""

    value: float
    """The estimate."""
    half_width_95: Optional[float]
    """Half the width of its interval of 95 %; None where the data do not determine it."""
    initial: float
    """Where the fit started."""
    low: Optional[float]
    """The lower bound that it had."""
    high: Optional[float]
    """The upper bound that it had."""
    at_bound: Optional[str]
    """The bound that it is at, ``"low"`` or ``"high"``."""


@dataclass(frozen=True)
class Identification:
    """What ``identify`` found."""

    directory: Path
    """The directory of the results, with ``report.html`` and ``identified.toml``."""
    parameters: dict[str, Parameter]
    """The parameters by their names."""
    cost: float
    """Half the sum of the squared residuals, each divided by its noise."""
    status: str
    """How the fit ended."""
    findings: list[str]
    """What there is to say of data and fit."""
    metrics: dict[str, Any] = field(repr=False)
    """The content of ``identify.json``."""

    @classmethod
    def _of(cls, directory: Path, metrics: dict[str, Any]) -> "Identification":
        parameters = {name: Parameter(**of) for name, of in metrics["parameters"].items()}
        cost, status, findings = (metrics[key] for key in ("cost", "status", "findings"))
        return cls(directory, parameters, cost, status, findings, metrics)

    @property
    def values(self) -> dict[str, float]:
        """The values of the parameters by their names."""
        return {name: of.value for name, of in self.parameters.items()}

    @property
    def config(self) -> Path:
        """The config with the identified parameters."""
        return self.directory / "identified.toml"

    @property
    def residuals(self) -> Table:
        """What was measured and what the model gives, a row per measurement."""
        return _tables.read(self.directory / "residuals.csv")

    @property
    def table(self) -> Table:
        """A row per parameter."""
        rows = self.parameters.values()
        numbers = ("value", "half_width_95", "initial", "low", "high")
        columns = {"name": np.array(list(self.parameters))}
        for name in numbers:
            columns[name] = np.array([getattr(one, name) for one in rows], dtype=np.float64)
        columns["at_bound"] = np.array([one.at_bound or "" for one in rows])
        return columns

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


@dataclass(frozen=True)
class Estimates:
    """What ``estimate`` made of recorded data."""

    table: Table
    """``t``, the estimates by name, then ``<name>_sd``; a row per row of the data."""
    nis_mean: float
    """The mean of the normalized innovations squared."""
    nis_expected: float
    """Its value for a consistent estimator."""
    failed: int
    """How many corrections did not succeed."""
    rejected: int
    """How many measurements the gate rejected."""
    rmse: dict[str, float]
    """The root mean square error by state, where the data have all true states."""
    notes: list[str]
    """What to know of the estimator: whether it is inconsistent, or rejected measurements."""

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


@dataclass(frozen=True)
class Certificate:
    """What ``certify`` found of the errors of one step of a model, in the states' units."""

    directory: Path
    """The directory of the results."""
    quantiles: dict[str, dict[str, Optional[float]]]
    """Upper bounds of quantiles of the error, by quantile and state; statistical."""
    proven: Optional[dict[str, float]]
    """Proven bounds over the whole domain by state, or None without ``domain=True``."""
    refused: Optional[str]
    """Why nothing is proven, where that is so."""
    metrics: dict[str, Any] = field(repr=False)
    """The content of ``certify.json``."""

    @classmethod
    def _of(cls, directory: Path, metrics: dict[str, Any]) -> "Certificate":
        proven = (metrics["domain"] or {}).get("proven")
        return cls(directory, metrics["quantiles"], proven, metrics["refused"], metrics)

    @property
    def table(self) -> Table:
        """A row per prediction: its point, then ``<state>_err`` and ``<state>_bound``."""
        return _tables.read(self.directory / "certify.csv")

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


@dataclass(frozen=True)
class Choice:
    """What ``choose`` advises; printed as the table and the advice in words."""

    directory: Path
    """The directory of the results."""
    config: Path
    """The config with the model to use."""
    report: Path
    """Charts of all that was tried."""
    text: str = field(repr=False)
    """The table of all models tried, and the advice."""

    def __str__(self) -> str:
        return self.text

    @property
    def model(self) -> Optional[Path]:
        """The file of the net to use, or None where an integrator is advised."""
        path = self.directory / "recommended.safetensors"
        return path if path.is_file() else None

    @property
    def table(self) -> Table:
        """A row per model tried."""
        return _tables.read(self.directory / "tried" / "sweep.csv")

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


@dataclass(frozen=True)
class Tuning:
    """The tuned controller of ``tune``; printed as both configs side by side."""

    directory: Path
    """The directory of the results."""
    config: Path
    """The config with the best values found."""
    report: Path
    """Charts of the loops that were held out."""
    cost: tuple[float, float]
    """The cost of these loops with the config as it is written, and tuned."""
    text: str = field(repr=False)
    """Values and costs of both."""

    def __str__(self) -> str:
        return self.text

    @property
    def table(self) -> Table:
        """A row per candidate, the config as it is written first."""
        return _tables.read(self.directory / "tune.csv")

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


@dataclass(frozen=True)
class Shrunk:
    """The net of ``shrink`` in place of a controller; printed as its judgement in words."""

    directory: Path
    """The directory of the results, with the net and its check as C."""
    text: str = field(repr=False)
    """The judgement in words."""
    no_c: Optional[str]
    """Why there is no C, if the controller cannot be exported."""

    def __str__(self) -> str:
        return self.text

    @property
    def table(self) -> Table:
        """The judgement: a row each for the controller, the net, the net with the check, and this with the
        controller where no plan stays within the bounds."""
        return _tables.read(self.directory / "shrink.csv")

    @property
    def frame(self) -> "pandas.DataFrame":
        """The table as a data frame of pandas."""
        return _tables.frame(self.table)


def findings(all_of_them: list[Mapping[str, str]]) -> Findings:
    """The findings in what ``pinc check --json`` prints."""
    return Findings(tuple(Finding(**one) for one in all_of_them))
