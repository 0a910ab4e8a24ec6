"""Controllers, step by step."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc

POINTS = 9  # of a dense trace per step
CONFIGS = Path(__file__).resolve().parents[3] / "configs"
TANKS = CONFIGS / "estimation" / "tanks.toml"
FAMILY = CONFIGS / "four-tanks" / "family.toml"


@pytest.mark.parametrize("kind", ["pinc", "rk4"])
def test_it_takes_the_steps_of_the_closed_loop(
    done: pinc.Run, smoke: Path, model: pinc.Model, kind: str
) -> None:
    trace, steps = done.control(kind), done.steps(kind)
    marks = slice(0, POINTS * len(steps["step"]), POINTS)
    net = done.path / "model.safetensors"
    nets = (model, net, str(net)) if kind == "pinc" else (None,)
    controllers = [pinc.Nmpc(smoke, of, only=kind) for of in nets]
    for controller in controllers:
        for k, (x1, x2, u) in enumerate(zip(*(trace[n][marks] for n in ("x1", "x2", "u")))):
            step = controller.step([x1, x2])
            assert abs(step.u[0] - u) < 1e-9
            assert step.status == steps["status"][k]
            assert step.sqp_iterations == steps["sqp_iterations"][k]
            assert np.array_equal(step.x, [x1, x2])
            assert step.estimator is None and step.unknowns.size == 0
            assert step.kkt < 1e-7 and step.step_us > 0


def test_what_it_says_of_itself(smoke: Path) -> None:
    controller = pinc.Nmpc(smoke, only="rk4")
    assert controller.measured == controller.states == controller.controlled == ["x1", "x2"]
    assert (controller.inputs, controller.unknowns) == (["u"], [])
    assert controller.sample_time_s == 0.5
    step = controller.step([0.3, 0.1])
    plan = controller.planned_inputs
    assert controller.predicted_states.shape == (controller.horizon, 2)
    assert np.array_equal(plan[0], step.u) and plan.shape[1] == 1
    assert "controlled x1, x2" in repr(controller) and "converged" in repr(step)


def test_a_step_may_have_a_budget_of_its_own(smoke: Path) -> None:
    controller = pinc.Nmpc(smoke, only="rk4")
    assert controller.step([0.5, 0.1], budget_us=1e-3).status == "deadline"
    assert controller.step([0.5, 0.1]).status == "converged"
    with pytest.raises(pinc.InputError, match="budget_us"):
        controller.step([0.5, 0.1], budget_us=-1.0)


def test_a_state_is_taken_over_without_a_bump() -> None:
    first, second = pinc.Nmpc(TANKS, only="rk4"), pinc.Nmpc(TANKS, only="rk4")
    readings = [[2.0 + 0.1 * k, 2.0 - 0.02 * k] for k in range(12)]
    for y in readings[:6]:
        first.step(y)
    second.set_state(first.state())
    assert second.state() == first.state()
    for y in readings[6:]:
        one, other = first.step(y), second.step(y)
        assert np.allclose(one.u, other.u, rtol=0, atol=1e-9)
        assert np.allclose(one.x, other.x, rtol=0, atol=1e-9)
    before = second.state()
    for wrong in ("", "{}", before.replace("h4", "h5"), before.replace("[2.0", "[2.0, 2.0", 1)):
        if wrong != before:
            with pytest.raises(pinc.InputError, match="state"):
                second.set_state(wrong)
    assert second.state() == before


def test_a_net_that_would_not_be_used_is_refused(smoke: Path, model: pinc.Model) -> None:
    with pytest.raises(pinc.InputError, match="model.*rk4"):
        pinc.Nmpc(smoke, model, only="rk4")


def test_measured_parameters_match_the_step() -> None:
    y = [8.0, 12.0, 2.0, 3.0]

    def controller(key: str, value: object) -> pinc.Nmpc:
        return pinc.Nmpc(FAMILY, only="rk4", overrides={key: value})

    told = controller("control.parameters", {"k1": 3.33, "k2": 3.35}).step(y)
    measured = controller("control.measured_parameters", ["k1", "k2"])
    with pytest.raises(pinc.InputError, match="parameters: 1 numbers given, expected 2"):
        measured.step(y, parameters=[3.33])
    with pytest.raises(pinc.InputError, match="y: 1 numbers given"):
        measured.step([8.0], parameters=[3.33, 3.35])
    nominal = measured.step(y)
    assert np.abs(nominal.u - told.u).max() > 1e-3
    measured.reset()
    assert np.array_equal(measured.step(y, parameters=[3.33, 3.35]).u, told.u)
    # As before, until a reset forgets it.
    measured.reset()
    assert np.array_equal(measured.step(y).u, nominal.u)


def test_no_parameters_are_those_of_a_config_that_measures_none() -> None:
    controller = pinc.Nmpc(TANKS, only="rk4")
    assert controller.parameters != [] and controller.unknowns == controller.parameters
    plain = controller.step([2.0, 2.0]).u
    controller.reset()
    assert np.array_equal(controller.step([2.0, 2.0], parameters=[]).u, plain)


def test_reference_applied_input_and_reset_count(smoke: Path) -> None:
    controller = pinc.Nmpc(smoke, only="rk4")

    def second(**given: object) -> float:
        controller.reset()
        controller.step([0.5, 0.1])
        return float(controller.step([0.4, 0.2], **given).u[0])  # type: ignore[arg-type]

    plain = second()
    assert second() == plain
    assert second(u_applied=[1.0]) > plain + 0.05
    held = second(reference=[0.8, 0.0])
    assert held > plain + 0.1
    assert second(reference=np.tile([0.8, 0.0], (controller.horizon, 1))) == held


def test_increments_count_from_the_initial_input(smoke: Path) -> None:
    bounds = {"control.increment_low": [-0.02], "control.increment_high": [0.02]}
    controller = pinc.Nmpc(smoke, only="rk4", overrides=bounds | {"control.initial_input": [0.45]})
    for _ in range(2):
        assert abs(controller.step([0.9, 0.0]).u[0] - 0.47) < 1e-7
        controller.reset()


def test_a_missing_measurement_holds_the_last_input(smoke: Path) -> None:
    given = {"control.initial_input": [0.25]}
    controller, told = (pinc.Nmpc(smoke, only="rk4", overrides=given) for _ in range(2))
    step = controller.step([np.nan, 0.1])
    assert (step.status, step.u[0], step.sqp_iterations) == ("bad-argument", 0.25, 0)
    assert np.isnan(step.x[0]) and step.x[1] == 0.1 and np.isinf(step.kkt)
    told.step([0.5, 0.1])
    same = told.step([0.4, 0.0], u_applied=[0.25]).u[0]
    assert abs(controller.step([0.4, 0.0]).u[0] - same) < 1e-7


def test_a_row_has_the_reference_of_the_beginning_of_its_step(smoke: Path) -> None:
    followed, given = (pinc.Nmpc(smoke, only="rk4") for _ in range(2))
    references = [(0.0, [0.0, 0.0]), (2.5, [-0.5, 0.0])]  # of the config
    steps = 10
    for k in range(steps):
        times = [min(k + j, steps - 1) * followed.sample_time_s for j in range(followed.horizon)]
        rows = [[value for start, value in references if start <= t][-1] for t in times]
        x = [0.3 - 0.05 * k, 0.1]
        assert followed.step(x).u == given.step(x, reference=rows).u


def test_an_estimator_is_taken_along(tmp_path: Path) -> None:
    few = {"control.duration_s": 300.0, "control.models": ["rk4"], "control.repetitions": 1}
    tanks = TANKS.read_text(encoding="utf-8").split("[training]")[0].split("[model]")[0]
    loop = "[control]\nstep_s = 10.0\n" + TANKS.read_text(encoding="utf-8").split("[control]\n")[1]
    run = pinc.run(tanks + loop, tmp_path, few | {"control.repetitions": 1})
    trace, estimates = run.control(), run.estimates("rk4")
    controller = pinc.Nmpc(tanks + loop, overrides=few)
    assert controller.measured == ["h1", "h2"] and controller.unknowns == ["d_u1", "d_u2"]
    for k, (h1, h2) in enumerate(zip(estimates["y_h1"], estimates["y_h2"])):
        step = controller.step([h1, h2])
        assert step.estimator == "updated"
        for name, value in zip(controller.states + controller.unknowns, [*step.x, *step.unknowns]):
            assert abs(value - estimates[name][k]) < 1e-9
        assert np.abs(step.u - [trace[n][POINTS * k] for n in controller.inputs]).max() < 1e-8
    assert controller.step([np.nan, np.nan]).estimator == "nothing-measured"


def test_wrong_arguments_are_refused_and_change_nothing(smoke: Path) -> None:
    controller, other = (pinc.Nmpc(smoke, only="rk4") for _ in range(2))
    assert controller.step([0.5, 0.1]).u == other.step([0.5, 0.1]).u
    for y, given, message in [
        ([0.1], {}, "y: 1 numbers given, expected 2, one per state"),
        ([[0.1, 0.2]], {}, "y: an array of shape"),
        ([0.1, 0.2], {"reference": [0.1]}, "reference: 1 numbers given, expected 2"),
        ([0.1, 0.2], {"reference": [[0.1, 0.2]]}, "1 rows given, expected"),
        ([0.1, 0.2], {"reference": np.zeros((1, 1, 2))}, "3 dimensions"),
        ([0.1, 0.2], {"reference": [np.inf, 0]}, "reference: inf given"),
        ([0.1, 0.2], {"u_applied": [0.1, 0.2]}, "u_applied: 2 numbers given, expected 1"),
    ]:
        with pytest.raises(pinc.InputError, match=message):
            controller.step(y, **given)
    assert controller.step([0.4, -0.1]).u == other.step([0.4, -0.1]).u


def test_controllers_that_cannot_be_made_are_refused(
    smoke: Path, model: pinc.Model, tmp_path: Path
) -> None:
    for given, message in [
        ({}, "a trained net"),
        ({"only": "none"}, "only: \"none\" given, expected one of pinc, rk4"),
        ({"only": "rosenbrock"}, "control.models"),
        ({"model": tmp_path / "none"}, "none"),
        ({"model": model, "overrides": {"model.horizon_s": 0.25}}, "step length T"),
    ]:
        with pytest.raises(pinc.InputError, match=message):
            pinc.Nmpc(smoke, **given)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        pinc.Nmpc(smoke, model=3)  # type: ignore[arg-type]


def test_pickled_controllers_keep_the_files_of_their_config(
    smoke: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day = tmp_path / "day.csv"
    day.write_text("t,x1\n0,0.5\n10,0.8\n")
    monkeypatch.chdir(tmp_path)
    references = {"control.references": {"x1": {"file": "day.csv", "interpolation": "linear"}}}
    short = {"control.controlled": ["x1"], "control.q": [10.0], "control.models": ["rk4"]}
    controller = pinc.Nmpc(smoke, overrides={**short, **references}, only="rk4")
    pickled = pickle.dumps(controller)
    day.write_text("t,x1\n0,-0.5\n10,-0.8\n")
    monkeypatch.chdir("/")
    others = [pickle.loads(pickled), copy.deepcopy(controller)]
    expected = controller.step([0.1, 0.0]).u
    for other in others:
        assert np.array_equal(other.step([0.1, 0.0]).u, expected)


def test_controllers_are_pickled_with_their_state(smoke: Path, model: pinc.Model) -> None:
    for controller in (pinc.Nmpc(smoke, model), pinc.Nmpc(TANKS, only="rk4")):
        y = np.full(len(controller.measured), 0.5)
        for k in range(4):
            controller.step(y + 0.1 * k)
        other = pickle.loads(pickle.dumps(controller))
        for k in range(4):
            assert np.abs(controller.step(y - 0.1 * k).u - other.step(y - 0.1 * k).u).max() < 1e-9
    batch = pinc.NmpcBatch(smoke, only="rk4")
    other = pickle.loads(pickle.dumps(batch))
    given = ([[0.5, 0.1], [0.2, -0.3]], [0.0, 0.0])
    assert np.array_equal(batch.steps(*given).u, other.steps(*given).u)


def test_the_plan_is_that_of_the_last_step_where_the_next_is_prepared(smoke: Path) -> None:
    real_time = {"control.sqp.real_time": True}
    controller = pinc.Nmpc(smoke, only="rk4", overrides=real_time)
    batch = pinc.NmpcBatch(smoke, only="rk4", overrides=real_time)
    model = pinc.Plant(smoke).model("rk4")
    step = controller.step([0.5, 0.1], [0.1, 0.0])
    assert np.array_equal(controller.planned_inputs[0], step.u)
    planned = batch.steps([[0.5, 0.1]], [0.1, 0.0]).inputs[0]
    assert np.abs(controller.planned_inputs - planned).max() < 1e-9
    next_state = model.step([0.5, 0.1], step.u)
    assert np.abs(controller.predicted_states[0] - next_state).max() < 0.05
    with pytest.raises(pinc.InputError, match="real_time"):
        controller.adjoint([1.0])
    controller.reset()
    assert not controller.planned_inputs.any()


# A spring under a load, both of which an estimator finds, not in the order of their names.
SPRING = """
name = "spring"
preset = "ours"
seed = 1
[plant.expression]
states = ["x1", "x2"]
inputs = ["u"]
parameters = { load = 0.1, k = 1.0 }
derivatives = { x1 = "x2", x2 = "u - k*x1 - 0.3*x2 + load" }
[domain]
state_low = [-3.0, -3.0]
state_high = [3.0, 3.0]
input_low = [-2.0]
input_high = [2.0]
parameters = { load = [-1.0, 1.0], k = [0.5, 2.0] }
[control]
duration_s = 4.0
models = ["rk4"]
step_s = 0.2
initial_state = [1.0, 0.0]
controlled = ["x1"]
q = [1.0]
r = [0.1]
n2 = 8
nu = 5
input_low = [-2.0]
input_high = [2.0]
references = [{ start_s = 0.0, value = [0.5] }]
sqp = { tolerance = 1e-10 }
"""
ESTIMATOR = {
    "kind": "ekf",
    "process_sd": [0.05, 0.05],
    "measurement_sd": [0.05, 0.05],
    "initial_estimate": [1.0, 0.0],
    "initial_sd": [0.3, 0.3],
    "parameters": [
        {"name": "load", "initial": 0.2, "initial_sd": 0.3, "drift_sd": 0.05},
        {"name": "k", "initial": 1.1, "initial_sd": 0.2, "drift_sd": 0.05},
    ],
}


def test_derivatives_in_parameters_have_the_order_of_the_unknowns(tmp_path: Path) -> None:
    config = tmp_path / "spring.toml"
    config.write_text(SPRING)
    measured = {"measured": ["x1", "x2"], "noise_sd": [0.01, 0.01]}
    sets = {"control.estimator": ESTIMATOR, "control.measurement": measured}
    controller = pinc.Nmpc(config, overrides=sets)
    step = controller.step([0.9, 0.1])
    found = controller.adjoint([1.0]).values["parameters"]
    assert len(found) == len(controller.unknowns) == 2

    def u(unknowns: dict[str, float]) -> float:
        plain = pinc.Nmpc(config, overrides={"control.parameters": unknowns})
        return float(plain.step(step.x).u[0])

    estimates = dict(zip(controller.unknowns, step.unknowns))
    for k, name in enumerate(controller.unknowns):
        low, high = (u({**estimates, name: estimates[name] + d}) for d in (-1e-4, 1e-4))
        assert abs(found[k] - (high - low) / 2e-4) < 1e-5, name


def test_a_number_is_a_vector_of_one(model: pinc.Model) -> None:
    assert np.array_equal(model.step([0.5, 0.1], 0.2), model.step([0.5, 0.1], [0.2]))
    tank = pinc.Nmpc(CONFIGS / "smoke" / "rk4-only.toml")
    same = pinc.Nmpc(CONFIGS / "smoke" / "rk4-only.toml")
    assert tank.step(5.0, reference=9.0).u == same.step([5.0], reference=[9.0]).u
