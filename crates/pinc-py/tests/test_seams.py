"""The same controller by two ways: in the closed loop of a run, and stepped by hand."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Optional

import numpy as np
import pytest

import pinc_nmpc as pinc

if sys.version_info < (3, 11):
    pytest.skip("tomllib is part of Python 3.11", allow_module_level=True)
import tomllib

POINTS = 9  # of a dense trace per step
STEPS = 12  # of a shortened loop
CONFIGS = Path(__file__).resolve().parents[3] / "configs"
INTEGRATORS = ("rk4", "rk5", "rosenbrock")
# What a closed loop with an integrator needs of a config.
OF_LOOPS = ("name", "preset", "seed", "time_unit", "plant", "domain", "control")
PUMPS = {"k1": 3.33, "k2": 3.35}


def sections(path: Path) -> dict[str, Any]:
    """A config, with what its preset says of the loop."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    of_preset = content.get("presets", {}).get(content.get("preset"), {}).get("control", {})
    if "control" in content:
        content["control"].update(of_preset)
    return content


PATHS = sorted(CONFIGS.rglob("*.toml"))
SHIPPED = {str(path.relative_to(CONFIGS)): sections(path) for path in PATHS}
LOOPS = [name for name, content in SHIPPED.items() if "control" in content]
MODELS = {name: SHIPPED[name]["control"].get("models", ["rk4"]) for name in LOOPS}
STEPPED = [name for name in LOOPS if set(INTEGRATORS).intersection(MODELS[name])]


class Loop:
    """The loop of a shipped config with its first integrator, over a few steps, with ``changes`` of
    the section ``[control]``."""

    def __init__(self, name: str, changes: Mapping[str, Any]) -> None:
        content = SHIPPED[name]
        control = content["control"]
        self.path = CONFIGS / name
        self.step_s: float = control.get("step_s") or content["model"]["horizon_s"]
        if "stages_s" in control:
            self.step_s = control["stages_s"][0]
        self.kind = next(kind for kind in control.get("models", ["rk4"]) if kind in INTEGRATORS)
        # References and what happens to the plant within the steps that are taken; functions of time
        # stay as they are.
        within = {
            key: [
                {**change, "start_s": 3 * i * self.step_s}
                for i, change in enumerate(control[key][:most], start=first)
            ]
            for key, most, first in (("references", 4, 0), ("plant_schedule", 3, 1))
            if isinstance(control.get(key), list)
        }
        shortened = {
            "models": [self.kind],
            "repetitions": 1,
            "duration_s": STEPS * self.step_s,
            "close_ups_s": [[0.0, STEPS * self.step_s]],
            # The controllers are compared, not the plant.
            "plant_tolerance": 1e-6,
            "max_failed_share": 1.0,
            **within,
        }
        self.delay: int = {**control, **changes}.get("delay_steps", 0)
        changed = {**shortened, **changes}
        self.has_estimator = "estimator" in {**control, **changed}
        self.overrides = {f"control.{key}": value for key, value in changed.items()}
        kept = {key: content[key] for key in OF_LOOPS if key in content}
        kept["control"] = {"step_s": self.step_s, **control}
        self.alone = {**kept, **self.overrides}

    def run(self, out: Path) -> pinc.Run:
        """The loop of ``pinc.run``, without the training of a net."""
        return pinc.run("# The loop alone.\n", out, self.alone)

    def controller(self) -> pinc.Nmpc:
        """The controller of the shipped config."""
        return pinc.Nmpc(self.path, only=self.kind, overrides=self.overrides)


def largest_difference(
    loop: Loop, out: Path, parameters: Optional[list[list[float]]] = None
) -> float:
    """The largest difference of an input, relative to 1 + |u|, between the loop of a run and a
    controller that is given what the run's was given."""
    run, controller = loop.run(out), loop.controller()
    marks = slice(0, POINTS * STEPS, POINTS)
    trace, steps = run.control(), run.steps()
    given = trace
    names = controller.measured
    if loop.has_estimator:
        given, marks = run.estimates(), slice(0, STEPS)
        names = [f"y_{name}" for name in names]
    measured = np.array([given[name][marks] for name in names]).T
    acted = np.array([trace[name][: POINTS * STEPS : POINTS] for name in controller.inputs]).T
    assert measured.shape[0] == len(steps["step"]) == STEPS
    worst = 0.0
    for k, y in enumerate(measured):
        step = controller.step(y, parameters=parameters[k] if parameters else None)
        assert step.status == steps["status"][k]
        if k + loop.delay < STEPS:
            u = acted[k + loop.delay]
            worst = max(worst, float((np.abs(step.u - u) / (1.0 + np.abs(u))).max()))
    return worst


@pytest.mark.parametrize("name", STEPPED)
def test_stepped_by_hand_a_shipped_controller_gives_the_inputs_of_its_loop(
    name: str, tmp_path: Path
) -> None:
    assert largest_difference(Loop(name, {}), tmp_path) < 1e-9


# What no shipped config has, or not together.
CHANGED = {
    "delay, from an initial input": (
        "van-der-pol/control.toml",
        {"delay_steps": 2, "initial_input": [0.3]},
    ),
    "increments, without preview": (
        "van-der-pol/control.toml",
        {
            "preview": False,
            "initial_input": [0.45],
            "increment_low": [-0.05],
            "increment_high": [0.1],
        },
    ),
    "an estimator behind a delay": (
        "estimation/tanks.toml",
        {"delay_steps": 2, "initial_input": [3.0, 3.1]},
    ),
    "an unscented filter": ("estimation/tanks.toml", {"estimator.kind": "ukf"}),
    "a moving horizon": (
        "estimation/tanks.toml",
        {"estimator.kind": "mhe", "estimator.window": 4, "delay_steps": 1},
    ),
}


@pytest.mark.parametrize("what", CHANGED)
def test_stepped_by_hand_a_changed_controller_gives_the_inputs_of_its_loop(
    what: str, tmp_path: Path
) -> None:
    assert largest_difference(Loop(*CHANGED[what]), tmp_path) < 1e-9


TWO_SENSORS = {
    "measurement": {"measured": ["h1", "h2"], "noise_sd": [0.05, 0.05]},
    "estimator": {
        "kind": "ekf",
        "process_sd": [0.01] * 4,
        "measurement_sd": [0.05, 0.05],
        "initial_estimate": [8.0, 9.0, 2.0, 2.0],
        "initial_sd": [0.5] * 4,
        "disturbance": "input",
        "disturbance_sd": [0.01, 0.01],
        "disturbance_initial_sd": [0.1, 0.1],
    },
}


@pytest.mark.parametrize("feedback", [{}, TWO_SENSORS], ids=["states", "estimator"])
def test_measured_parameters_match_the_schedule(
    feedback: dict[str, object], tmp_path: Path
) -> None:
    changed = {"k1": 3.0, "k2": 2.9}
    at = 5  # the step
    loop = Loop(
        "four-tanks/family.toml",
        {
            **feedback,
            "measured_parameters": list(PUMPS),
            "plant": {"four-tanks": {"parameters": "antonelo", "pump": list(PUMPS.values())}},
            "parameters": PUMPS,
            "plant_schedule": [{"start_s": at * 10.0, "values": changed}],
            "delay_steps": 1,
        },
    )
    told = [list(PUMPS.values())] * at + [list(changed.values())] * (STEPS - at)
    assert largest_difference(loop, tmp_path / "told", told) < 1e-9
    late = [told[0], *told[:-1]]
    assert largest_difference(loop, tmp_path / "late", late) > 1e-4
    if feedback:
        assert_estimates(loop, tmp_path / "estimates", told)


def assert_estimates(loop: Loop, out: Path, told: list[list[float]]) -> None:
    """An estimator stepped by hand that is told these parameters finds what the loop's found."""
    estimator = pinc.Estimator(loop.path, only=loop.kind, overrides=loop.overrides)
    assert estimator.parameters == list(PUMPS)
    run = loop.run(out)
    found, trace = run.estimates(), run.control()
    measured = np.array([found[f"y_{name}"][:STEPS] for name in estimator.measured]).T
    acted = np.array([trace[name][: POINTS * STEPS : POINTS] for name in estimator.inputs]).T
    for k, (y, u) in enumerate(zip(measured, acted)):
        estimator.correct(y, told[k])
        expected = [found[name][k] for name in estimator.names]
        assert np.allclose(estimator.estimate, expected, rtol=1e-9, atol=1e-9)
        estimator.predict(u)
    with pytest.raises(pinc.InputError, match="parameters: 1 numbers given, expected 2"):
        estimator.correct(measured[0], [3.0])
    with pytest.raises(pinc.InputError, match="parameters: expected finite numbers"):
        estimator.correct(measured[0], [3.0, float("nan")])


@pytest.mark.parametrize("name", [name for name in SHIPPED if name not in LOOPS])
def test_a_config_without_a_loop_has_no_controller(name: str) -> None:
    # A list of runs is no experiment.
    key = "a list of runs" if "runs" in SHIPPED[name] else r"\[control\]"
    with pytest.raises(pinc.InputError, match=key):
        pinc.Nmpc(CONFIGS / name, only="rk4")


@pytest.mark.parametrize("name", [name for name in SHIPPED if "sweep" in SHIPPED[name]])
def test_a_sweep_is_left_to_the_program(name: str, tmp_path: Path) -> None:
    with pytest.raises(pinc.InputError, match="sweep.*`pinc run` takes sweeps"):
        pinc.run(CONFIGS / name, tmp_path / "run")
    assert not (tmp_path / "run").exists()


# What Python refuses: the config, what is changed of it, and what the message names.
REFUSED = [
    (
        "four-tanks/family.toml",
        {"parameter_schedule": [{"start_s": 60.0, "values": {"k1": 2.9}}]},
        "control.parameter_schedule",
    ),
    ("van-der-pol/control.toml", {"models": ["pinc"]}, "control.models"),
    ("van-der-pol/control.toml", {"initial_input": [0.1, 0.2]}, "control.initial_input"),
    ("van-der-pol/control.toml", {"delay_steps": -1}, "delay_steps"),
    ("four-tanks/family.toml", {"measured_parameters": ["mu"]}, "control.measured_parameters"),
]


@pytest.mark.parametrize(("name", "changes", "named"), REFUSED)
def test_what_is_refused_is_named(name: str, changes: dict[str, Any], named: str) -> None:
    overrides = {f"control.{key}": value for key, value in changes.items()}
    with pytest.raises(pinc.InputError, match=named):
        pinc.Nmpc(CONFIGS / name, only="rk4", overrides=overrides)
