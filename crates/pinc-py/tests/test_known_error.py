"""What a net knows of its error: the estimate, the guard of a controller, and the certificate."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc

SMALL = {
    "domain.state_low": [-1.0, -1.0],
    "domain.state_high": [1.0, 1.0],
}


def rk4(x: np.ndarray, u: float, t: float) -> np.ndarray:
    """The oscillator after t, by many small steps."""

    def f(x: np.ndarray) -> np.ndarray:
        return np.array([x[1], (1.0 - x[0] ** 2) * x[1] - x[0] + u])

    h = t / 200
    for _ in range(200):
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        k4 = f(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def test_the_estimate_is_near_the_error(smoke: Path, tmp_path: Path) -> None:
    model = pinc.run(smoke, tmp_path, {**SMALL, "control.repetitions": 1}).model
    x = np.array([[0.5, -0.4], [-0.8, 0.3], [0.1, 0.9]])
    u = np.array([[0.3], [-0.6], [0.9]])
    found = model.error_estimate(smoke, x, u)
    exact = model.step(x, u) - [rk4(row, v, model.sample_time_s) for row, (v,) in zip(x, u)]
    assert found.shape == x.shape
    for estimate, error in zip(found, exact):
        assert np.linalg.norm(estimate - error) < 0.1 * np.linalg.norm(error)
    assert np.array_equal(model.error_estimate(smoke, x[1], u[1]), found[1])
    assert model.proven_error is None
    # A config is read once, and another one for itself.
    copy = tmp_path / "copy.toml"
    copy.write_text(smoke.read_text())
    again = model.error_estimate(copy, x, u)
    copy.unlink()
    assert np.array_equal(again, found)
    assert np.array_equal(model.error_estimate(copy, x, u), found)
    with pytest.raises(pinc.PincError, match="absent.toml"):
        model.error_estimate(tmp_path / "absent.toml", x, u)
    assert np.array_equal(model.error_estimate(smoke, x, u), found)
    with pytest.raises(pinc.InputError, match="states of the model: x1, x2; of the config: "):
        model.error_estimate(smoke.parent / "one-tank.toml", x, u)


def test_a_controller_doubts_its_net(smoke: Path, model: pinc.Model) -> None:
    doubting = {"control.error_tolerance": {"x1": 1e-9}, "control.on_error": "integrator"}
    step = pinc.Nmpc(smoke, model, overrides=doubting).step([0.4, 0.1])
    assert step.trust == "substituted"
    assert np.allclose(step.model_error, model.error_estimate(smoke, [0.4, 0.1], step.u), atol=1e-2)
    plain = pinc.Nmpc(smoke, model).step([0.4, 0.1])
    assert plain.trust is None and plain.model_error.size == 0


def test_a_certificate_stays_with_its_net(smoke: Path, tmp_path: Path) -> None:
    proven = {**SMALL, "training.proven_tolerance": {"x1": 0.06, "x2": 0.06}}
    model = pinc.run(smoke, tmp_path, {**proven, "control.repetitions": 1}).model
    bounds = model.proven_error
    assert bounds is not None and set(bounds) == {"x1", "x2"}
    assert all(0.0 < bound <= 0.06 for bound in bounds.values())
    assert pickle.loads(pickle.dumps(model)).proven_error == bounds
    with pytest.raises(pinc.PincError, match="x9"):
        pinc.run(smoke, tmp_path / "no", {"training.proven_tolerance": {"x9": 1.0}})
