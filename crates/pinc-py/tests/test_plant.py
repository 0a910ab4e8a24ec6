"""The plant of a config, its simulator, and integrators as models of it."""

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinc_nmpc as pinc

# x' = -a x + b u, of which all is known.
LAG = {
    "name": "lag",
    "preset": "ours",
    "seed": 1,
    "plant": {
        "expression": {
            "states": [{"name": "x", "unit": "m"}],
            "inputs": [{"name": "u", "unit": "N"}],
            "parameters": {"a": 2.0, "b": 3.0},
            "derivatives": {"x": "-a*x + b*u"},
            "outputs": {"y": "5*x + u"},
        }
    },
}


def lag(x: float, u: float, t: float, a: float = 2.0, b: float = 3.0) -> float:
    return float(b / a * u + (x - b / a * u) * np.exp(-a * t))


def test_a_plant_is_written_down_in_python() -> None:
    plant = pinc.Plant(LAG)
    assert (plant.states, plant.inputs, plant.outputs) == (["x"], ["u"], ["y"])
    assert plant.units == {"x": "m", "u": "N", "y": ""}
    assert plant.parameters == {"a": 2.0, "b": 3.0} and plant.sample_time_s is None
    assert plant.derivative([0.5], 0.2) == pytest.approx([-2 * 0.5 + 3 * 0.2])
    assert plant.jacobian([0.5], 0.2) == pytest.approx(np.array([[-2.0, 3.0]]))
    assert plant.output([[0.5], [1.0]], 0.2) == pytest.approx(np.array([[2.7], [5.2]]))
    assert "states x" in repr(plant)


def test_simulations_are_exact() -> None:
    inputs = [0.2, -0.4, 0.0, 1.0]
    expected = [0.5]
    for u in inputs:
        expected.append(lag(expected[-1], u, 0.3))
    for plant in (pinc.Plant(LAG), pickle.loads(pickle.dumps(pinc.Plant(LAG)))):
        states = plant.simulate(0.5, [[u] for u in inputs], step_s=0.3)
        assert states.shape == (5, 1)
        assert np.abs(states[:, 0] - expected).max() < 1e-9
    other = pinc.Plant(LAG, {"plant.expression.parameters.a": 1.0})
    assert other.simulate(0.5, 0.2, 0.3)[1, 0] == pytest.approx(lag(0.5, 0.2, 0.3, a=1.0))


def test_integrators_are_models() -> None:
    plant = pinc.Plant(LAG)
    for method, substeps, most in (("rk4", 8, 1e-6), ("rk5", 8, 1e-8), ("rosenbrock", 8, 1e-4)):
        made = plant.model(method, step_s=0.3, substeps=substeps)
        for model in (made, copy.copy(made), pickle.loads(pickle.dumps(made))):
            assert (model.sample_time_s, model.substeps) == (0.3, substeps)
            assert abs(model.step([0.5], 0.2)[0] - lag(0.5, 0.2, 0.3)) < most
            _, a, b = model.linearize([0.5], [0.2])
            assert abs(a[0, 0] - np.exp(-0.6)) < 10 * most
            assert abs(b[0, 0] - 1.5 * (1 - np.exp(-0.6))) < 10 * most
            run = model.predict([0.5], [[0.2], [-0.4]])
            assert run[2] == model.step(model.step([0.5], [0.2]), [-0.4])


def test_many_points_are_the_same_as_one_by_one(smoke: Path) -> None:
    model = pinc.Plant(smoke).model("rk4")
    rng = np.random.default_rng(1)
    x, u = rng.uniform(-1, 1, (1000, 2)), rng.uniform(-1, 1, (1000, 1))
    together = model.step(x, u)
    assert all(np.array_equal(together[k], model.step(x[k], u[k])) for k in range(0, 1000, 37))


def test_wrong_arguments_are_refused(smoke: Path) -> None:
    plant = pinc.Plant(smoke)
    for call, message in [
        (lambda: plant.derivative([1.0], 0.0), r"expected 2 numbers \(x1, x2\)"),
        (lambda: plant.simulate([[1.0, 0.0]], 0.0), "expected one state"),
        (lambda: plant.simulate([1.0, 0.0], 0.0, -1.0), "step_s: -1 given"),
        (lambda: pinc.Plant(LAG).simulate(1.0, 0.0), "step_s: missing"),
        (lambda: plant.model("euler"), "euler"),
        (lambda: plant.model("pinc"), "method"),
        (lambda: plant.model("rk4", substeps=0), "substeps"),
        (lambda: plant.derivative([[1.0, 0.0]] * 2, [[0.0]] * 3), "u: 3 rows given, expected 2"),
    ]:
        with pytest.raises(pinc.InputError, match=message):
            call()  # type: ignore[no-untyped-call]


def test_arguments_that_are_no_numbers_of_the_kind_are_named(smoke: Path) -> None:
    plant = pinc.Plant(smoke)
    with pytest.raises(pinc.InputError, match="substeps: -1 given, expected 1 to 10000"):
        plant.model(substeps=-1)
    with pytest.raises(pinc.InputError, match="method: \"foo\" given, expected one of rk4"):
        plant.model("foo")
    with pytest.raises(pinc.InputError, match="threads: -1 given, expected 0 to"):
        pinc.NmpcBatch(smoke, only="rk4", threads=-1)
    ragged: Any = [[1.0, 2.0], [1.0]]
    for given, message in ((ragged, "inhomogeneous"), (np.array([1.0, 2j]), "complex"), ("no", "could not")):
        with pytest.raises(pinc.InputError, match=message) as raised:
            plant.derivative(given, [0.0])
        # Python has notes from 3.11 on.
        assert getattr(raised.value, "__notes__", ["'x'"])[0].endswith("'x'")
    # A masked number is missing.
    masked = np.ma.array([1.0, 2.0], mask=[False, True])
    assert np.isnan(plant.derivative(masked, [0.0])).any()
