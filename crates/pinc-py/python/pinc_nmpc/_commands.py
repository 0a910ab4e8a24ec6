"""What the program ``pinc`` does, as functions."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Optional, Union

from . import _native, _results, _tables
from ._config import Config
from ._errors import InputError, PincError
from ._results import Certificate, Choice, Estimates, Findings, Identification, Shrunk, Tuning
from ._runs import Run
from ._tables import FilePath

Overrides = Optional[Mapping[str, object]]
GivenModel = Union[_native.Model, FilePath, None]
Data = Union[FilePath, Mapping[str, Any]]


@dataclass
class _Common:
    """What nearly every command takes, for ``_native``."""

    config: Config
    overrides: Overrides = None
    model: Optional[FilePath] = None
    only: Optional[str] = None
    out: Optional[FilePath] = None
    resume: bool = False
    verbose: bool = False


@contextmanager
def _files(
    model: GivenModel = None, data: Optional[Mapping[str, Any]] = None
) -> Iterator[tuple[Any, list[Any]]]:
    """Files of a model and of tables by their names, where they are not files already; errors have
    these names in place of the files."""
    names = {}
    with TemporaryDirectory(prefix="pinc-") as directory:
        if isinstance(model, _native.Model):
            path = Path(directory) / "model.safetensors"
            model.save(path)
            model, names[str(path)] = path, "model"
        paths = []
        for number, (name, one) in enumerate((data or {}).items()):
            if hasattr(one, "keys"):
                path = Path(directory) / f"data-{number}.csv"
                _tables.write(one, path, name)
                one, names[str(path)] = path, name
            elif not isinstance(one, (str, os.PathLike)):
                found = type(one).__name__
                raise InputError(f"{name}: {found} given, expected a path, a table or a data frame")
            paths.append(one)
        try:
            yield model, paths
        except PincError as error:
            text = str(error)
            for file, told in names.items():
                text = text.replace(file, told)
            if text == str(error):
                raise
            raise type(error)(text) from None


def _listed(data: Any, name: str) -> dict[str, Any]:
    """Recordings by their names; there may be one."""
    is_one = isinstance(data, str) or hasattr(data, "keys")
    if is_one or not isinstance(data, Sequence):
        return {name: data}
    return {f"{name}[{number}]": one for number, one in enumerate(data)}


def run(
    config: Config,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    resume: bool = False,
    verbose: bool = False,
) -> Run:
    """Runs the whole experiment of a config, as ``pinc run`` does.

    The results are in the directory ``out``, by default ``runs/`` and the experiment's name. With
    ``verbose`` its progress is shown on standard error. Ctrl-C stops it in a state from which the
    same call with ``resume=True`` goes on. If more control steps failed than the config allows,
    ``RunError`` is raised; the results are there all the same, for ``Run``.
    """
    common = _Common(config, overrides, out=out, resume=resume, verbose=verbose)
    return Run(_native.run_into(common))


def control(
    config: Config,
    model: GivenModel = None,
    only: Optional[str] = None,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    resume: bool = False,
    verbose: bool = False,
) -> Run:
    """Runs the closed loops of a config only, as ``pinc control`` does: with all its models, or
    ``only`` one of them. Without a ``model``, a net that is needed is trained first.

    The other arguments and the results are as of ``run``.
    """
    with _files(model) as (path, _):
        common = _Common(config, overrides, path, only, out, resume, verbose)
        return Run(_native.control_into(common))


def check(config: Config, overrides: Overrides = None, *, verbose: bool = False) -> Findings:
    """Examines a config and its plant before anything is trained, as ``pinc check`` does.

    Example: ``print(pinc.check("plant.toml"))``; ``pinc.check(..).ok`` is False where a run cannot
    succeed. With ``verbose`` its progress is shown on standard error.
    """
    found = _native.findings(_Common(config, overrides, verbose=verbose))
    return _results.findings(json.loads(found))


def choose(
    config: Config,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    within: float = 0.01,
    budget_s: float = 120.0,
    target: str = "program",
    resume: bool = False,
    verbose: bool = False,
) -> Choice:
    """Chooses the model of a config's controller, as ``pinc choose`` does: tries integrators by
    substeps and nets by size, and takes the cheapest whose loop has an IAE of at most ``1 + within``
    times the most exact model's.

    ``target="c"`` times the steps of exported C instead of the program's, which needs a compiler ``cc``.
    ``budget_s`` limits the time, in s. Results are in ``out``, by default ``runs/<name>-choose``;
    ``resume=True`` reuses what it holds.
    """
    common = _Common(config, overrides, out=out, resume=resume, verbose=verbose)
    return Choice(*_native.choose_into(common, within, budget_s, target))


def tune(
    config: Config,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    only: Optional[str] = None,
    resume: bool = False,
    verbose: bool = False,
) -> Tuning:
    """Tunes the controller of a config with a section ``[tune]``, as ``pinc tune`` does: looks for the
    values of its keys with which closed loops cost least, over drawn plants and references.

    ``only`` names the model, instead of the config's first. Results are in ``out``, by default
    ``runs/<name>-tune``; ``resume=True`` reuses what it holds.
    """
    common = _Common(config, overrides, only=only, out=out, resume=resume, verbose=verbose)
    return Tuning(*_native.tune_into(common))


def shrink(
    config: Config,
    model: GivenModel = None,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    only: Optional[str] = None,
    neurons: Optional[int] = None,
    samples: Optional[int] = None,
    iterations: Optional[int] = None,
    loops: Optional[int] = None,
    verbose: bool = False,
) -> Shrunk:
    """Trains a net in place of a config's controller, judges its closed loops beside the controller's,
    and writes it as C with a check of its plans, and as ``policy.json``, as ``pinc shrink`` does.

    The net has two layers of ``neurons``, is trained on ``samples`` plans for at most ``iterations``,
    and judged by ``loops`` it was not trained on; each is the command's default if left out. Results
    are in ``out``, by default ``runs/<name>-shrink``.
    """
    with _files(model) as (path, _):
        common = _Common(config, overrides, path, only, out, verbose=verbose)
        return Shrunk(*_native.shrink_into(common, neurons, samples, iterations, loops))


def identify(
    config: Config,
    data: Union[Data, Sequence[Data]],
    model: GivenModel = None,
    only: Optional[str] = None,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    validate: Union[Data, Sequence[Data]] = (),
    starts: Optional[int] = None,
    verbose: bool = False,
) -> Identification:
    """Identifies what ``[identify]`` of a config asks for, as ``pinc identify`` does.

    ``data`` is a recording or several: CSV files, tables (a dictionary of columns) or data frames
    with the columns ``t`` in s, the inputs, and ``y_<name>`` of each measured quantity, NaN where
    it is missing. The fit has so many ``starts`` within the parameters' bounds; by default 16 if
    all have bounds, otherwise 1. Recordings of ``validate`` are not fitted to: the result says how
    well it predicts them. Results are in ``out``, by default ``runs/<name>-identify``.
    """
    listed, held_out = _listed(data, "data"), _listed(validate, "validate")
    with _files(model, {**listed, **held_out}) as (path, files):
        common = _Common(config, overrides, path, only, out, verbose=verbose)
        count = len(listed)
        directory, found = _native.identify_into(common, files[:count], files[count:], starts)
    return Identification._of(directory, json.loads(found))


def estimate(
    config: Config,
    data: Data,
    model: GivenModel = None,
    only: Optional[str] = None,
    overrides: Overrides = None,
) -> Estimates:
    """Runs the estimator of a config over recorded data, as ``pinc estimate`` does.

    ``data`` is as of ``identify``, with a row per step of T. ``Estimator`` is the same step by step.
    """
    with TemporaryDirectory(prefix="pinc-") as directory, _files(model, {"data": data}) as (path, files):
        out = Path(directory) / "estimates.csv"
        found = _native.estimate_into(_Common(config, overrides, path, only, out), files[0])
        return Estimates(_tables.read(out), **found)


def certify(
    config: Config,
    model: GivenModel = None,
    only: Optional[str] = None,
    out: Optional[FilePath] = None,
    overrides: Overrides = None,
    *,
    points: Optional[int] = None,
    data: Optional[Data] = None,
    run: Union[Run, FilePath, None] = None,
    domain: bool = False,
    budget_s: Optional[float] = None,
    resume: bool = False,
    verbose: bool = False,
) -> Certificate:
    """Judges one step of a net, or of the integrator ``only``, as ``pinc certify`` does.

    Judged are random ``points`` of the domain (by default 1000, or 0 with other points), the rows of
    ``data`` with columns of the states and inputs, and the closed loop of a ``run``. With
    ``domain=True`` bounds are proven over the whole domain, within ``budget_s`` seconds; ``resume``
    goes on with an earlier proof. Results are in ``out``, by default ``runs/<name>-certify``.
    """
    judged = run.path if isinstance(run, Run) else run
    with _files(model, {} if data is None else {"data": data}) as (path, files):
        common = _Common(config, overrides, path, only, out, resume, verbose)
        table = files[0] if files else None
        found = _native.certify_into(common, points, table, judged, domain, budget_s)
    return Certificate._of(found[0], json.loads(found[1]))


def export(
    config: Config,
    to: str,
    model: GivenModel = None,
    only: Optional[str] = None,
    out: Optional[FilePath] = None,
    name: Optional[str] = None,
    overrides: Overrides = None,
    *,
    errors: bool = False,
) -> Path:
    """Exports the whole controller of a config, with its estimator if it has one, to ``"c"``,
    ``"fmu"`` (FMI 2.0) or ``"fmu3"`` (FMI 3.0). Returns the directory of the files.

    ``name`` is the prefix of all names, by default the experiment's. With ``errors`` C has a
    function for the estimated error of the net.
    """
    with _files(model) as (path, _):
        common = _Common(config, overrides, path, only, out)
        return _native.export_controller(common, to, name, errors)


def export_plant(
    config: Config,
    to: str = "fmu",
    out: Optional[FilePath] = None,
    name: Optional[str] = None,
    overrides: Overrides = None,
) -> Path:
    """Exports the plant in the closed loop of a config as an FMU, ``"fmu"`` (FMI 2.0) or ``"fmu3"``,
    on which a controller can be tried. Returns the directory of the file."""
    return _native.export_plant(_Common(config, overrides, out=out), to, name)


def export_net(
    model: Union[_native.Model, FilePath],
    to: str,
    out: Optional[FilePath] = None,
    name: Optional[str] = None,
    errors: Optional[Config] = None,
) -> Path:
    """Exports a net alone, to ``"c"``, ``"fmu"``, ``"fmu3"``, ``"casadi"``, ``"onnx"`` or
    ``"onnx-double"``. Returns the directory of the files.

    ``name`` is the prefix of all names, by default the model file's. ``errors`` is the config
    against whose plant C estimates the net's error.
    """
    with _files(model) as (path, _):
        return _native.export_net(path, to, name, out, errors)
