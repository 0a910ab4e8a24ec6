"""A net as a model."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc

POINTS = np.random.default_rng(3).uniform([-2, -3, -1], [2, 3, 1], (20, 3))
X, U = POINTS[:, :2], POINTS[:, 2:]


def test_what_it_says_of_itself(model: pinc.Model) -> None:
    assert (model.states, model.inputs, model.parameters) == (["x1", "x2"], ["u"], [])
    assert model.sample_time_s == 0.5
    assert model.domain == {"x1": (-3.0, 3.0), "x2": (-4.35, 4.35), "u": (-1.0, 1.0)}
    assert [weights.shape for weights, _ in model.layers] == [(10, 3), (10, 10), (2, 10)]
    assert "x1, x2" in repr(model)


def test_files_pickles_and_copies_are_the_same_model(model: pinc.Model, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    model.save(path)
    same = [pinc.Model.load(path), pinc.Model.load(str(path)), copy.deepcopy(model)]
    same += [pickle.loads(pickle.dumps(model, protocol)) for protocol in (2, 5)]
    same.append(pinc.Model.from_bytes(model.to_bytes()))
    for other in same:
        assert other.to_bytes() == model.to_bytes()
        assert np.array_equal(other.step(X, U), model.step(X, U))


def test_the_jacobians_match_the_step(model: pinc.Model) -> None:
    following, a, b = model.linearize(X, U)
    assert (following.shape, a.shape, b.shape) == ((20, 2), (20, 2, 2), (20, 2, 1))
    assert np.allclose(following, model.step(X, U), rtol=0, atol=1e-13)
    h = 1e-5
    for i in range(3):
        shift = h * np.eye(3)[i]
        up, down = POINTS + shift, POINTS - shift
        slope = model.step(up[:, :2], up[:, 2:]) - model.step(down[:, :2], down[:, 2:])
        exact = a[:, :, i] if i < 2 else b[:, :, 0]
        assert np.abs(slope / (2 * h) - exact).max() < 1e-7


def test_rows_are_points(model: pinc.Model) -> None:
    together = model.linearize(X, U)
    for k in range(20):
        alone = model.linearize(X[k], U[k])
        for one, all_of_them in zip(alone, together):
            assert np.allclose(one, all_of_them[k], rtol=0, atol=1e-13)
    # Once for all, of other types, and not in rows.
    assert np.array_equal(model.step(X, U[0]), model.step(X, np.repeat(U[:1], 20, axis=0)))
    assert np.array_equal(model.step([1, 0], [1]), model.step(np.array([1.0, 0.0]), np.ones(1)))
    assert np.array_equal(model.step(np.asfortranarray(X), U), model.step(X, U))
    single = X.astype(np.float32)
    assert np.array_equal(model.step(single, U), model.step(single.astype(np.float64), U))
    assert model.step(np.empty((0, 2)), np.empty((0, 1))).shape == (0, 2)


def test_a_free_run_is_step_after_step(model: pinc.Model) -> None:
    states = model.predict([0.5, -0.2], U)
    assert states.shape == (21, 2)
    x = np.array([0.5, -0.2])
    for k in range(20):
        assert np.array_equal(states[k], x)
        x = model.step(x, U[k])
    assert np.array_equal(states[20], x)
    assert model.predict([0.5, -0.2], np.empty((0, 1))).tolist() == [[0.5, -0.2]]


def test_the_free_run_matches_the_program(done: pinc.Run, model: pinc.Model) -> None:
    table = done.prediction
    states = [np.stack([table[f"{kind}{name}"] for name in ("x1", "x2")], axis=1)
              for kind in ("", "true_") if f"{kind}x1" in table]
    marks = np.isclose(table["t"] / 0.5, np.round(table["t"] / 0.5))
    inputs = table["u"][marks][:-1, None]
    found = model.predict([-1.0, 1.0], inputs)
    assert min(np.abs(found - of[marks]).max() for of in states) < 1e-12


def test_inner_times(model: pinc.Model) -> None:
    assert np.abs(model.evaluate(0.5, X, U) - model.step(X, U)).max() < 1e-12
    halves = model.evaluate(0.25, X, U)
    assert halves.shape == (20, 2)
    assert np.abs(halves - model.step(X, U)).max() > 0.01
    for t in (-0.1, 0.6, np.nan):
        with pytest.raises(pinc.InputError, match="expected from 0 to T = 0.5 s"):
            model.evaluate(t, X, U)


def test_wrong_arguments_are_refused(model: pinc.Model) -> None:
    for x, u, message in [
        ([1.0], [0.0], r"x: an array of shape \(1,\) given, expected 2 numbers \(x1, x2\)"),
        ([1.0, 0.0], [0.0, 1.0], r"u: an array of shape \(2,\) given"),
        (X, U[:5], "u: 5 rows given, expected 20"),
        (np.zeros((2, 2, 2)), [0.0], r"shape \(2, 2, 2\)"),
        (1.0, [0.0], r"shape \(\)"),
    ]:
        for method in (model.step, model.linearize, model.predict):
            with pytest.raises(pinc.InputError, match=message):
                method(x, u)
    with pytest.raises(pinc.InputError, match="expected one state"):
        model.predict(X, U)
    for x in (["a", "b"], None, object()):
        with pytest.raises((TypeError, ValueError)):
            model.step(x, [0.0])  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        pinc.Model()  # type: ignore[call-arg]
    # What is no number stays none.
    assert np.isnan(model.step([np.nan, 0.0], [0.0])).any()


def test_damaged_files_are_refused(model: pinc.Model, tmp_path: Path) -> None:
    with pytest.raises(pinc.InputError, match="none.safetensors"):
        pinc.Model.load(tmp_path / "none.safetensors")
    content = model.to_bytes()
    for damaged in (b"", b"hello", content[:-8], content[:100]):
        with pytest.raises(pinc.InputError):
            pinc.Model.from_bytes(damaged)
    path = tmp_path / "damaged.safetensors"
    path.write_bytes(content[:50])
    with pytest.raises(ValueError, match="damaged.safetensors"):
        pinc.Model.load(path)
    with pytest.raises(pinc.InputError):
        model.save(tmp_path / "no" / "such" / "directory")


def test_threads_share_a_model(model: pinc.Model) -> None:
    expected = model.linearize(X, U)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: model.linearize(X, U), range(50)):
            for one, other in zip(found, expected):
                assert np.array_equal(one, other)
