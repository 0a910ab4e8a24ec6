"""Results that go to other processes, or are copied."""

import copy
import inspect
import multiprocessing
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinc_nmpc as pinc


def fields(of: Any) -> Any:
    """What can be compared of a result, of its parts, and of the parts of these."""
    if isinstance(of, np.ndarray):
        return of.shape, of.tobytes()
    if isinstance(of, pinc.Model):
        return of.to_bytes()
    if isinstance(of, dict):
        return {name: fields(value) for name, value in of.items()}
    if type(of).__module__ == "pinc_nmpc":
        names = [name for name in dir(of) if not name.startswith("_")]
        return type(of), {name: fields(getattr(of, name)) for name in names}
    return of


@pytest.fixture(scope="module")
def results(smoke: Path) -> dict[type, Any]:
    """A result of each class of the native module that is no controller, model or plant."""
    seen: list[pinc.TrainingProgress] = []
    short = {"training.phases.0.iterations": 3}
    trained = pinc.train(smoke, short, progress=seen.append)
    controller = pinc.Nmpc(smoke, only="rk4", overrides={"control.sqp.tolerance": 1e-10})
    step = controller.step([0.5, 0.1], [0.0, 0.0])
    batch = pinc.NmpcBatch(smoke, only="rk4")
    x = np.array([[0.5, 0.1], [0.2, 0.0]])
    tanks = Path(smoke).parents[1] / "estimation" / "tanks.toml"
    estimator = pinc.Estimator(tanks, only="rk4")
    all_of_them = [
        trained,
        seen[-1],
        step,
        controller.adjoint([1.0]),
        controller.sensitivity({"state": [1.0, 0.0]}),
        batch.steps(x, [0.0, 0.0]),
        batch.gradients(x, [0.0, 0.0], [1.0]),
        batch.loops(x, np.zeros((4, 2))),
        estimator.correct([2.0] * len(estimator.measured)),
    ]
    return {type(one): one for one in all_of_them}


def test_results_are_pickled_and_copied(results: dict[type, Any]) -> None:
    for kind, result in results.items():
        pickles = [pickle.loads(pickle.dumps(result, protocol)) for protocol in (2, 5)]
        for other in [*pickles, copy.copy(result), copy.deepcopy(result)]:
            assert type(other) is kind and other is not result
            assert fields(other) == fields(result), kind
    # A deep copy has numbers of its own.
    step = results[pinc.ControlStep]
    other = copy.deepcopy(step)
    other.u[0] += 1.0
    assert other.u[0] == step.u[0] + 1.0
    assert copy.deepcopy(pinc.STOP) is pinc.STOP is pickle.loads(pickle.dumps(pinc.STOP))


def test_every_class_of_the_native_module_can_be_pickled(results: dict[type, Any]) -> None:
    with_state = {pinc.Estimator, pinc.IntegratorModel, pinc.Model, pinc.Nmpc, pinc.NmpcBatch, pinc.Plant}
    classes = {of for _, of in inspect.getmembers(pinc._native, inspect.isclass)}  # type: ignore[attr-defined]
    assert classes == with_state | set(results)


def chosen(controller: pinc.Nmpc) -> pinc.ControlStep:
    """A step in another process."""
    return controller.step([0.5, 0.1], [0.0, 0.0])


def test_results_come_back_from_processes(smoke: Path) -> None:
    controller = pinc.Nmpc(smoke, only="rk4")
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (there,) = pool.map(chosen, [controller])
    here = chosen(controller)
    assert np.array_equal(there.u, here.u) and there.status == here.status
