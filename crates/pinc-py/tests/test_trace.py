"""Equations from Python functions."""

from typing import Any

import numpy as np
import pytest

import pinc_nmpc as pinc

ROTATION = np.array([[0.0, 1.0], [-2.0, -0.3]])
PARAMETERS = {"k": 2.0, "w1": 0.5}


def derivatives(x: Any, u: Any, p: Any) -> list[Any]:
    decay = np.exp(-x[0] / p["k"])
    for _ in range(40):  # written once, however often it is used
        decay = 0.5 * (decay + decay)
    y = ROTATION @ x
    return [
        y[0] + decay * u[0] - np.maximum(x[1], -0.5) ** 3 + np.arctan(x[0]) / 2,
        y[1] + decay - np.sqrt(np.abs(x)).sum() + np.square(x[1]) - p["w1"] ** np.tanh(x[0]),
    ]


def test_a_traced_function_is_the_equation() -> None:
    table = pinc.expression(
        derivatives, ["a", {"name": "b", "unit": "m"}], ["u"], PARAMETERS,
        outputs=lambda x, u, p: {"load": x[0] + p["k"] * x[1], "half": 0.5},
    )
    plant = pinc.Plant({"name": "a", "preset": "ours", "seed": 1, "plant": {"expression": table}})
    assert plant.outputs == ["half", "load"] and plant.units["b"] == "m"
    assert plant.parameters == PARAMETERS
    random = np.random.default_rng(1)
    for _ in range(20):
        x, u = random.normal(size=2), random.normal(size=1)
        # Sums in another order.
        assert plant.derivative(x, u) == pytest.approx(derivatives(x, u, PARAMETERS), abs=1e-13)
        assert plant.output(x, u) == pytest.approx([0.5, x[0] + 2.0 * x[1]], abs=1e-13)


def test_operators_in_place_make_new_quantities() -> None:
    def accumulated(x: Any, u: Any) -> Any:
        total = x[0]
        total += u[0]
        rates = np.empty(2, dtype=object)
        rates[:] = [total, x[1]]
        rates[1] -= total
        return rates

    found = pinc.expression(accumulated, ["a", "b"], ["u"])
    assert found["let"] == {"w1": "(a + u)"}
    assert found["derivatives"] == {"a": "w1", "b": "(b - w1)"}


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x, u: [x[0] if x[0] > 0 else u[0], 0], "np.greater given"),
        (lambda x, u: [x[0] if x[0] else u[0], 0], "given as a condition"),
        (lambda x, u: [x[0] and u[0], 0], "given as a condition"),
        (lambda x, u: [np.floor(x[0]), 0], "np.floor given"),
        (lambda x, u: [np.maximum(x, 0).sum(), 0], "np.greater_equal given.*one by one"),
        (lambda x, u: {"a": x[0]}, "derivatives: dict given, expected a list"),
        (lambda x, u: np.zeros(2).__setitem__(0, x[0]), "lists, or made with dtype=object"),
        (lambda x, u: [x[0]], "derivatives: 1 given, expected 2, one per state: a, b"),
    ],
)
def test_what_is_no_equation_is_refused(function: Any, message: str) -> None:
    with pytest.raises(pinc.InputError, match=message):
        pinc.expression(function, ["a", "b"], ["u"])
