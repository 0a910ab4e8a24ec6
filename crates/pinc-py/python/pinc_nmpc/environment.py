"""The closed loop of a config as an environment of Gymnasium, and controllers as policies in
environments; needs the package gymnasium."""

import copy
import sys
from collections.abc import Mapping
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from ._config import Config
from ._errors import InputError
from ._native import ControlStep, Nmpc, Plant, resolved

if sys.version_info < (3, 11):
    raise ImportError("pinc_nmpc.environment needs Python 3.11 or later")
import tomllib

try:
    import gymnasium
except ImportError as error:
    raise ImportError("pinc_nmpc.environment needs the package gymnasium: pip install gymnasium") from error

_Array = NDArray[np.float64]


def _numbers(name: str, given: Any, count: int, each: str) -> _Array:
    """Finite numbers, one per ``each``."""
    try:
        values = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {given!r} given, expected numbers, one per {each}") from None
    if values.shape != (count,):
        raise InputError(f"{name}: shape {values.shape} given, expected {(count,)}, one per {each}")
    if not np.isfinite(values).all():
        raise InputError(f"{name}: {given!r} given, expected finite numbers")
    return values


def _sizes(name: str, given: Any, count: int) -> _Array:
    """Numbers of 0 or more, one per state, from these or from one for all states."""
    values = _numbers(name, [given] * count if np.ndim(given) == 0 else given, count, "state")
    if (values < 0).any():
        raise InputError(f"{name}: {given!r} given, expected 0 or more")
    return values


class LoopEnv(gymnasium.Env[_Array, _Array]):
    """The plant of a config under inputs of your own, a step of T at a time.

    An action is the plant's input, clipped to the controller's bounds of inputs
    and of their changes. An observation is the state,
    then the reference of what is controlled. The reward is minus the cost of the step, with the
    config's weights: ``-(sum q e^2 + sum r du^2)`` with the errors e at its end and the change du of
    the input. An episode ends (is truncated) after ``control.duration_s``.

    ``spread`` is how far an episode may start from ``control.initial_state``, uniformly, as a number
    or one per state. ``noise_sd`` is the noise of the observed states.

    Example::

        env = LoopEnv("configs/van-der-pol/control.toml")
        observation, _ = env.reset(seed=1)
        observation, reward, _, truncated, info = env.step(np.array([0.2]))
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        config: Config,
        overrides: Optional[Mapping[str, object]] = None,
        *,
        spread: Any = 0.0,
        noise_sd: Any = 0.0,
    ) -> None:
        self._plant = Plant(config, overrides, in_loop=True)
        control = tomllib.loads(resolved(config, overrides)).get("control")
        if control is None or self._plant.sample_time_s is None:
            raise InputError("the config has no section [control], which an environment needs")
        if "cost" in control:
            raise InputError("control.cost: an environment has the costs q and r")
        refused = (
            "bound_schedule",
            "delay_steps",
            "input_differences",
            "integer",
            "loads",
            "measured_parameters",
            "plant_schedule",
        )
        for key in refused:
            if control.get(key):
                raise InputError(f"control.{key}: given, but an environment has none")
        self._q, self._r = np.array(control["q"]), np.array(control["r"])
        names = self._plant.states
        missing = [name for name in control["controlled"] if name not in names]
        if missing:
            raise InputError(f"control.controlled: {missing[0]} is no state, which a reward needs")
        self._places = [names.index(name) for name in control["controlled"]]
        if self._q.shape != (len(self._places),) or self._r.shape != (len(self._plant.inputs),):
            raise InputError("control.q, control.r: an environment has one weight per quantity")
        self._step_s = self._plant.sample_time_s
        self._steps = max(round(control["duration_s"] / self._step_s), 1)
        self._references = control["references"]
        self._start = np.array(control["initial_state"], dtype=np.float64)
        none = [0.0] * len(self._r)
        self._first_input = np.array(control.get("initial_input", none), dtype=np.float64)
        self._spread = _sizes("spread", spread, len(names))
        self._noise_sd = _sizes("noise_sd", noise_sd, len(names))
        size = len(names) + len(self._places)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
        low, high = (np.array(control[key], np.float64) for key in ("input_low", "input_high"))
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        no_bound = np.full(len(self._r), np.inf)
        self._least_change = np.array(control.get("increment_low", -no_bound), np.float64)
        self._most_change = np.array(control.get("increment_high", no_bound), np.float64)
        self._x, self._u, self._k = self._start, self._first_input, 0

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[dict[str, Any]] = None
    ) -> tuple[_Array, dict[str, Any]]:
        """Begins an episode; ``options`` may have the state ``x`` that it begins in."""
        super().reset(seed=seed)
        given = (options or {}).get("x")
        if given is None:
            self._x = self._start + self.np_random.uniform(-1, 1, len(self._start)) * self._spread
        else:
            self._x = _numbers('options["x"]', given, len(self._start), "state")
        self._u, self._k = self._first_input, 0
        return self._observation(), self._info()

    def step(self, action: _Array) -> tuple[_Array, float, bool, bool, dict[str, Any]]:
        """Moves the plant on by T under the input ``action``."""
        box = self.action_space
        assert isinstance(box, gymnasium.spaces.Box)
        u = _numbers("action", action, len(self._r), "input")
        u = np.clip(u, self._u + self._least_change, self._u + self._most_change)
        u = np.clip(u, box.low, box.high)
        reference = self._reference()
        self._x = self._plant.simulate(self._x, u, self._step_s)[1]
        error = self._x[self._places] - reference
        change = u - self._u
        cost = float(self._q @ error**2 + self._r @ change**2)
        self._u, self._k = u, self._k + 1
        return self._observation(), -cost, False, self._k >= self._steps, self._info()

    def _reference(self) -> _Array:
        """What the step at hand is to reach, by the rule of the closed loop."""
        now = self._k * self._step_s * (1 + 1e-12)
        begun = [row["value"] for row in self._references if row["start_s"] <= now]
        return np.array(begun[-1], dtype=np.float64)

    def _observation(self) -> _Array:
        noise = self.np_random.normal(size=len(self._x)) * self._noise_sd
        return np.concatenate([self._x + noise, self._reference()])

    def _info(self) -> dict[str, Any]:
        return {"x": self._x.copy(), "t": self._k * self._step_s}


class NmpcPolicy:
    """A controller as a policy with ``predict`` as Stable-Baselines3 and PC-Gym call it.

    An observation has what the controller measures, ``controller.measured``, then the reference of
    what is controlled, as those of a ``LoopEnv``; an action has the inputs, not normalized. Rows of
    observations, as of a vector environment, have a controller each. ``steps`` are the last control
    steps, one per row, with their status.

    Example::

        policy = NmpcPolicy(pinc.Nmpc(config, only="rk4"))
        action, _ = policy.predict(observation)
    """

    def __init__(self, controller: Nmpc) -> None:
        self._controllers = [controller]
        self._measured = len(controller.measured)
        self._size = self._measured + len(controller.controlled)
        self.steps: list[ControlStep] = []

    def predict(
        self,
        observation: Any,
        state: Optional[tuple[Any, ...]] = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[_Array, Optional[tuple[Any, ...]]]:
        """Chooses the action, always the same for the same past, and returns it with ``state``.

        ``episode_start`` is whether an episode begins, one value or one per row: the controller then
        forgets the plan of the episode before."""
        given = np.asarray(observation, dtype=np.float64)
        rows = np.atleast_2d(given)
        if given.ndim > 2 or rows.shape[1] != self._size:
            raise InputError(
                f"observation: its shape is {given.shape}, expected {self._size} numbers, or rows of "
                f"them: {self._measured} measured, then {self._size - self._measured} references"
            )
        while len(self._controllers) < len(rows):
            another = copy.copy(self._controllers[0])
            another.reset()
            self._controllers.append(another)
        if episode_start is not None:
            for controller, start in zip(self._controllers, np.broadcast_to(episode_start, len(rows))):
                if start:
                    controller.reset()
        self.steps = [
            controller.step(row[: self._measured], row[self._measured :])
            for controller, row in zip(self._controllers, rows)
        ]
        actions = np.array([step.u for step in self.steps])
        return actions[0] if given.ndim < 2 else actions, state
