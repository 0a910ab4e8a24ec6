"""The closed loop as an environment of Gymnasium."""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinc_nmpc as pinc

pytest.importorskip("gymnasium")
if sys.version_info < (3, 11):
    pytest.skip("tomllib is part of Python 3.11", allow_module_level=True)
from pinc_nmpc.environment import LoopEnv, NmpcPolicy  # noqa: E402


def test_the_controller_in_the_environment_is_the_closed_loop(
    smoke: Path, done: pinc.Run
) -> None:
    trace = done.control("rk4")
    env, controller = LoopEnv(smoke), pinc.Nmpc(smoke, only="rk4")
    observation, _ = env.reset(seed=1)
    rewards, truncated, k = [], False, 0
    u_before = 0.0
    while not truncated:
        x, reference = observation[:2], observation[2:]
        assert np.abs(x - [trace["x1"][9 * k], trace["x2"][9 * k]]).max() < 1e-7
        u = controller.step(x).u
        assert abs(u[0] - trace["u"][9 * k]) < 1e-7
        observation, reward, terminated, truncated, info = env.step(u)
        error = info["x"] - reference
        assert reward == pytest.approx(-10 * error @ error - (u[0] - u_before) ** 2)
        u_before, k = u[0], k + 1
        rewards.append(reward)
        assert not terminated
    assert k == 10 and info["t"] == 5.0


def test_the_environment_follows_the_rules_of_gymnasium(smoke: Path) -> None:
    from gymnasium.utils.env_checker import check_env

    env = LoopEnv(smoke, spread=0.1, noise_sd=0.01)
    with warnings.catch_warnings():
        # States have no limits.
        warnings.filterwarnings("ignore", message=".*infinity.*")
        warnings.filterwarnings("ignore", message=".*symmetric and normalized.*")
        check_env(env, skip_render_check=True)
    first, _ = env.reset(seed=3)
    again, _ = env.reset(seed=3)
    assert np.array_equal(first, again)
    given, _ = env.reset(options={"x": [0.2, 0.3]})
    assert np.abs(given[:2] - [0.2, 0.3]).max() < 0.1
    env.reset(options={"x": [0.0, 0.0]})
    *_, info = env.step(np.array([7.0]))
    assert info["x"] == pytest.approx(
        pinc.Plant(smoke).simulate([0.0, 0.0], [1.0])[1], abs=1e-9
    )


def test_changes_of_the_input_are_clipped_too(smoke: Path) -> None:
    env = LoopEnv(smoke, {"control.increment_low": [-0.1], "control.increment_high": [0.05]})
    env.reset(options={"x": [0.0, 0.0]})
    *_, info = env.step(np.array([0.7]))
    plant = pinc.Plant(smoke)
    first = plant.simulate([0.0, 0.0], [0.05])[1]
    assert info["x"] == pytest.approx(first, abs=1e-9)
    *_, info = env.step(np.array([-1.0]))
    assert info["x"] == pytest.approx(plant.simulate(first, [-0.05])[1], abs=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda config: LoopEnv(config, noise_sd=float("nan")), "noise_sd: .* given, expected finite"),
        (lambda config: LoopEnv(config, noise_sd=-0.1), "noise_sd: -0.1 given, expected 0 or more"),
        (lambda config: LoopEnv(config, spread=[0.1, -0.1]), "spread: .* given, expected 0 or more"),
        (lambda config: LoopEnv(config, spread=[1, 2, 3]), "spread: shape .3,. given, expected .2,."),
        (lambda config: LoopEnv(config, spread="far"), "spread: .* given, expected numbers"),
        (
            lambda config: LoopEnv(config).reset(options={"x": [1.0, 2.0, 3.0]}),
            'options."x".: shape .3,. given, expected .2,.',
        ),
        (
            lambda config: LoopEnv(config).reset(options={"x": [1.0, np.nan]}),
            'options."x".: .* given, expected finite',
        ),
        (lambda config: LoopEnv(config).step(np.array([np.nan])), "action: .* expected finite"),
    ],
)
def test_arguments_that_cannot_be_used_are_named(smoke: Path, call: Any, message: str) -> None:
    with pytest.raises(pinc.InputError, match=message):
        call(smoke)


def test_what_an_environment_does_not_have_is_refused(smoke: Path) -> None:
    for key, value in (
        ("bound_schedule", [{"start_s": 1.0, "input_high": {"u": 0.5}}]),
        ("delay_steps", 2),
        ("input_differences", [{"between": [0, -1], "weight": [2.5]}]),
        ("integer", ["u"]),
        ("loads", [{"start_s": 0.0, "rates": {"x1": 0.1}}]),
        ("measured_parameters", ["mu"]),
        ("plant_schedule", [{"start_s": 0.0, "values": {"mu": 1.5}}]),
    ):
        family = {"domain.parameters": {"mu": [0.5, 1.5]}} if key == "measured_parameters" else {}
        with pytest.raises(pinc.InputError, match=f"control.{key}: given"):
            LoopEnv(smoke, {f"control.{key}": value, **family})
    with pytest.raises(pinc.InputError, match="action: shape .2,. given, expected .1,."):
        env = LoopEnv(smoke)
        env.reset()
        env.step(np.array([0.1, 0.2]))


def test_a_controller_is_a_policy_of_the_environment(smoke: Path) -> None:
    env, controller = LoopEnv(smoke), pinc.Nmpc(smoke, only="rk4")
    policy = NmpcPolicy(pinc.Nmpc(smoke, only="rk4"))
    observation, _ = env.reset(options={"x": [0.3, -0.2]})
    for _ in range(4):
        action, state = policy.predict(observation, deterministic=True)
        assert state is None and policy.steps[0].status == "converged"
        assert np.array_equal(action, controller.step(observation[:2], observation[2:]).u)
        observation, *_ = env.step(action)


def test_rows_of_observations_have_a_controller_each(smoke: Path) -> None:
    reference = [1.0, 0.0]
    first, second = [1.0, 0.05, *reference], [-0.5, 0.4, *reference]
    alone = [pinc.Nmpc(smoke, only="rk4") for _ in range(2)]
    policy = NmpcPolicy(pinc.Nmpc(smoke, only="rk4"))
    policy.predict(second)
    actions, _ = policy.predict([first, second], None, [True, False])
    for row, controller, action in zip([first, second], alone, actions):
        assert np.array_equal(action, controller.step(row[:2], reference).u)
    # The second row goes on, the first begins again.
    actions, state = policy.predict([first, first], ("hidden",), [True, False])
    assert state == ("hidden",) and len(policy.steps) == 2
    fresh = pinc.Nmpc(smoke, only="rk4").step(first[:2], reference).u
    assert np.array_equal(actions[0], fresh)
    assert np.array_equal(actions[1], alone[1].step(first[:2], reference).u)
    assert not np.array_equal(actions[1], fresh)


@pytest.mark.parametrize("observation", [[0.1, 0.2], [[0.1, 0.2, 1.0]], [[[0.1, 0.2, 1.0, 0.0]]]])
def test_a_policy_names_what_an_observation_has(smoke: Path, observation: object) -> None:
    policy = NmpcPolicy(pinc.Nmpc(smoke, only="rk4"))
    with pytest.raises(pinc.InputError, match="expected 4 numbers.*2 measured, then 2 references"):
        policy.predict(observation)
