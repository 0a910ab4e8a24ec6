"""What the program does, as functions."""

import csv
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
RECORDED = CONFIGS / "estimation" / "recorded-batch.toml"
TANKS = CONFIGS / "identification" / "tanks.toml"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path) -> Iterator[None]:
    """In a directory of its own, in which default places are."""
    before = os.getcwd()
    os.chdir(tmp_path)
    yield
    os.chdir(before)


def columns(path: Path) -> dict[str, np.ndarray]:
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    numbers = {name: [float(row[name] or "nan") for row in rows] for name in rows[0]}
    return {name: np.array(values) for name, values in numbers.items()}


def test_findings(smoke: Path) -> None:
    found = pinc.check(smoke)
    assert found.ok and len(found) == len(list(found)) > 3
    assert {finding.severity for finding in found} <= {"fact", "warning", "error"}
    assert list(found.table) == ["severity", "place", "what", "why", "change"]
    assert str(found[0]) in str(found)
    unreachable = {"control.references": [{"start_s": 0.0, "value": [0.0, 5.0]}]}
    assert any("x2" in f.what for f in pinc.check(smoke, unreachable).of("warning"))


def test_loops_alone(smoke: Path, model: pinc.Model, done: pinc.Run) -> None:
    run = pinc.control(smoke, model, only="pinc", out="loop")
    assert run.path == Path("loop") and run.models == ["pinc"]
    for name, column in run.control().items():
        assert np.array_equal(column, done.control("pinc")[name])


def test_parameters_are_identified_from_files_and_tables() -> None:
    file = TANKS.with_suffix(".csv")
    found = pinc.identify(TANKS, file, starts=1)
    assert found.directory == Path("runs/identification-tanks-identify") and found.config.is_file()
    # Values and intervals of SciPy's least_squares.
    for name, value, half in [
        ("k1", 3.203255, 0.0129), ("k2", 3.480243, 0.0124), ("a4", 0.059779, 0.0003)
    ]:
        of = found.parameters[name]
        assert of.value == pytest.approx(value, abs=1e-5) == found.values[name]
        assert of.half_width_95 == pytest.approx(half, abs=1e-4)
    assert list(found.table["name"]) == list(found.parameters)
    assert found.table["value"].tolist() == list(found.values.values())
    assert len(found.residuals) > 4
    again = pinc.identify(TANKS, columns(file), out="again", starts=1)
    assert again.values == found.values
    two = pinc.identify(TANKS, [columns(file), file], out="two", validate=columns(file), starts=1)
    halves = [of.parameters["k1"].half_width_95 for of in (two, found)]
    assert halves[0] == pytest.approx(halves[1] / np.sqrt(2), rel=0.05)
    pytest.importorskip("pandas")
    assert found.frame.shape == (8, 7)


def test_errors_name_tables_and_not_their_files() -> None:
    short = {"t": [0.0, 12.0]}
    with pytest.raises(pinc.InputError, match=r"^data:1: column `\w+` is missing"):
        pinc.identify(TANKS, short)
    file = TANKS.with_suffix(".csv")
    with pytest.raises(pinc.InputError, match=r"^data\[1\]:1: column"):
        pinc.identify(TANKS, [file, short])
    with pytest.raises(pinc.InputError, match=r"^validate:1: column"):
        pinc.identify(TANKS, file, validate=short)
    with pytest.raises(pinc.InputError, match="data: NoneType given, expected a path, a table"):
        pinc.identify(TANKS, None)  # type: ignore[arg-type]
    with pytest.raises(pinc.InputError, match="data: columns of the shapes"):
        pinc.estimate(RECORDED, {"t": [0.0, 1.0], "u": [0.0]})


def test_estimates_match_the_estimator() -> None:
    data = columns(RECORDED.with_suffix(".csv"))
    found = pinc.estimate(RECORDED, data)
    assert set(found.rmse) == {"pA", "pB"} and found.rmse["pA"] < 0.5
    assert found.notes == []
    sure = pinc.estimate(RECORDED, data, overrides={"control.estimator.measurement_sd": [1e-3]})
    assert any("the estimator is inconsistent" in note for note in sure.notes)
    estimator = pinc.Estimator(RECORDED)
    assert (estimator.measured, estimator.names) == (["total"], ["pA", "pB"])
    for k, y in enumerate(data["y_total"]):
        if k > 0:
            estimator.predict(data["none"][k - 1])
        if k == 20:
            state = estimator.state()
        correction = estimator.correct(y)
        assert correction.status == "updated"
        for i, name in enumerate(estimator.names):
            assert estimator.estimate[i] == pytest.approx(found.table[name][k], abs=1e-12)
            assert estimator.sd[i] == pytest.approx(found.table[f"{name}_sd"][k], abs=1e-12)
    other = pinc.Estimator(RECORDED)
    other.set_state(state)
    other.correct(data["y_total"][20])
    assert other.estimate[0] == pytest.approx(found.table["pA"][20], abs=1e-12)
    with pytest.raises(pinc.InputError, match="state"):
        other.set_state([1.0])
    with pytest.raises(pinc.InputError, match="expected 1"):
        other.correct([1.0, 2.0])
    with pytest.raises(pinc.InputError, match="u: expected finite numbers"):
        other.reset([np.nan])
    masked = np.ma.masked_greater(data["y_total"], np.sort(data["y_total"])[-3])
    missing = pinc.estimate(RECORDED, {**data, "y_total": masked})
    filled = pinc.estimate(RECORDED, {**data, "y_total": masked.filled(np.nan)})
    assert np.array_equal(missing.table["pA"], filled.table["pA"])
    assert not np.array_equal(missing.table["pA"], found.table["pA"])


def test_certificates(smoke: Path, model: pinc.Model, done: pinc.Run) -> None:
    found = pinc.certify(smoke, model, points=50, run=done)
    table = found.table
    assert len(table["x1_err"]) > 50 and found.proven is None
    assert (np.abs(table["x1_err"]) <= table["x1_bound"]).all()
    integrator = pinc.certify(smoke, only="rk4", points=20, out="rk4").table
    assert np.abs(integrator["x1_err"]).max() < 0.1 * np.abs(table["x1_err"]).max()
    assert (np.abs(integrator["x1_err"]) <= integrator["x1_bound"]).all()


def test_exports(smoke: Path, model: pinc.Model) -> None:
    net = pinc.export_net(model, "c", "net", name="osc")
    compiler = ["cc", "-std=c99", "-o", "net/selftest", "net/osc_net.c", "net/osc_selftest.c", "-lm"]
    subprocess.run(compiler, check=True)
    subprocess.run(["net/selftest"], check=True)
    assert (pinc.export(smoke, "c", only="rk4", out="mpc", name="osc") / "osc_mpc.c").is_file()
    assert net == Path("net")
    assert (pinc.export_plant(smoke, "fmu3", "plant") / "smoke_van_der_pol.fmu").is_file()
    assert pinc.export_net(model, "onnx", "onnx").is_dir()
    with pytest.raises(pinc.InputError, match="expected one of c, casadi, fmu"):
        pinc.export_net(model, "matlab")


def test_a_model_is_chosen() -> None:
    tank = CONFIGS / "smoke" / "rk4-only.toml"
    choice = pinc.choose(tank, "chosen", budget_s=5.0)
    assert choice.config.is_file() and choice.report.is_file()
    assert "RK4" in str(choice) and len(choice.table["case"]) > 1
    assert pinc.control(choice.config, choice.model, out="loop").models != []
    with pytest.raises(pinc.InputError, match="within: 2 given"):
        pinc.choose(tank, within=2.0)


def test_a_controller_is_tuned() -> None:
    config = (CONFIGS / "gallery" / "cart-pole.toml").read_text(encoding="utf-8")
    few = {"tune.candidates": 6, "tune.loops": 2, "tune.held_out": 2, "control.duration_s": 3.0}
    tuned = pinc.tune(config, "tuned", few, only="rk4")
    written, found = tuned.cost
    assert 0 < found <= 1.5 * written and "held-out" in str(tuned)
    assert len(tuned.table["cost"]) == 7 and tuned.report.is_file()
    assert pinc.control(tuned.config, only="rk4", out="loop-tuned").models == ["rk4"]
    with pytest.raises(pinc.InputError, match="tune"):
        pinc.tune(CONFIGS / "smoke" / "van-der-pol.toml")


def test_a_net_replaces_a_controller(smoke: Path) -> None:
    shrunk = pinc.shrink(
        smoke, out="shrunk", only="rk4", neurons=8, samples=300, iterations=40, loops=4
    )
    assert list(shrunk.table["driver"]) == ["controller", "net", "checked", "backed"]
    assert shrunk.no_c is None and (shrunk.directory / "smoke_van_der_pol_policy.c").is_file()
    policy = str(shrunk.directory / "policy.json")
    sets = {"control.models": ["rk4", "policy"], "control.policy": policy}
    controller = pinc.Nmpc(smoke, only="policy", overrides=sets)
    assert controller.step([0.5, 0.1]).status in ("kept", "replaced")
    with pytest.raises(pinc.InputError, match="neurons: 0 given"):
        pinc.shrink(smoke, only="rk4", neurons=0)


def test_ctrl_c_ends_the_training_of_a_net_for_a_controller(smoke: Path) -> None:
    main = threading.main_thread().ident
    assert main is not None
    thread = threading.Timer(2.0, lambda: signal.pthread_kill(main, signal.SIGINT))
    thread.start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        pinc.shrink(smoke, out="stopped", only="rk4", iterations=10_000_000)
    thread.join()
    assert time.monotonic() - begin < 2.0 + 1.0


def test_messages_name_arguments_of_python(smoke: Path) -> None:
    with pytest.raises(pinc.InputError, match="overrides, ") as told:
        pinc.check(smoke, {"control.n2": "many"})
    assert "--" not in str(told.value)
    with pytest.raises(pinc.InputError, match="give model=") as told:
        pinc.Nmpc(smoke)
    assert "--" not in str(told.value)
    process = {"plant": None, "plant.process": {"command": ["x"], "states": [], "inputs": []}}
    with pytest.raises(pinc.InputError) as told:
        pinc.Plant(smoke, process)
    assert "--" not in str(told.value)


def test_tables_have_columns_of_one_length() -> None:
    with pytest.raises(pinc.InputError, match="one length"):
        pinc.estimate(RECORDED, {"t": [0.0, 0.1], "none": [0.0], "y_total": [1.0, 2.0]})
