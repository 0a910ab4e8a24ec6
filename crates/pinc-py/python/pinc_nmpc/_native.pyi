import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Optional, Union, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._config import Config

_Array = NDArray[np.float64]

_Path = Union[str, os.PathLike[str]]

__all__ = [
    "ControlStep",
    "Correction",
    "Estimator",
    "GradientBatch",
    "IntegratorModel",
    "LoopBatch",
    "Model",
    "Nmpc",
    "NmpcBatch",
    "PlanChange",
    "PlanGradient",
    "Plant",
    "StepBatch",
    "Trained",
    "TrainingProgress",
    "allow_processes",
    "certify_into",
    "choose_into",
    "control_into",
    "estimate_into",
    "export_controller",
    "export_net",
    "export_plant",
    "findings",
    "identify_into",
    "resolved",
    "restore_batch",
    "restore_estimator",
    "restore_integrator",
    "restore_nmpc",
    "restore_plant",
    "restore_result",
    "run_into",
    "shrink_into",
    "solve_dense_qp",
    "train",
    "tune_into",
]

@final
class Model:
    """A trained net as a model in discrete time, ``x[k+1] = F(x[k], u[k])``, with its Jacobians.

    All methods take one point, ``x`` of shape ``(n,)`` and ``u`` of shape ``(m,)``, or rows of
    them, ``(points, n)`` and ``(points, m)``; one that is given once stands for all. The net of a
    family of plants takes its parameters ``p`` too. A model can be pickled and copied, and used
    from several threads.
    """

    @staticmethod
    def load(path: Union[str, os.PathLike[str]]) -> Model:
        """Reads a model file, ``model.safetensors``."""
    @staticmethod
    def from_bytes(data: bytes) -> Model:
        """The model of the content of a file."""
    def save(self, path: Union[str, os.PathLike[str]]) -> None:
        """Writes the model file."""
    def to_bytes(self) -> bytes:
        """The content of its file."""
    @property
    def states(self) -> list[str]:
        """Names of the states, in order."""
    @property
    def inputs(self) -> list[str]:
        """Names of the inputs, in order."""
    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that the net of a family of plants takes."""
    @property
    def sample_time_s(self) -> float:
        """Length T of a step in s."""
    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        """The box that the net was trained on: of each variable the lowest and highest value."""
    @property
    def proven_error(self) -> Optional[dict[str, float]]:
        """The proven bound of the absolute error of one step by state, everywhere in the domain;
        None without a certificate in the model file."""
    def error_estimate(
        self,
        config: Config,
        x: ArrayLike,
        u: ArrayLike,
        p: Optional[ArrayLike] = None,
    ) -> _Array:
        """The estimated error of the state after T, to first order, against the equation of the
        plant of ``config``, which is read once for calls with the same one."""
    @property
    def layers(self) -> list[tuple[_Array, _Array]]:
        """Weights ``(outputs, inputs)`` and bias of each layer at the end of a step, from
        ``(x, u, p)``, with all scaling folded in; all but the last are followed by tanh."""
    @property
    def adds_initial_state(self) -> bool:
        """Whether the layers give the change of the state rather than the state."""
    def step(self, x: ArrayLike, u: ArrayLike, p: Optional[ArrayLike] = None) -> _Array:
        """The state after T."""
    def linearize(
        self, x: ArrayLike, u: ArrayLike, p: Optional[ArrayLike] = None
    ) -> tuple[_Array, _Array, _Array]:
        """The state after T with its Jacobians by the state, ``(n, n)``, and by the input,
        ``(n, m)``."""
    def evaluate(
        self, t: float, x: ArrayLike, u: ArrayLike, p: Optional[ArrayLike] = None
    ) -> _Array:
        """The state at the time t of a step, from 0 to T."""
    def predict(self, x: ArrayLike, u: ArrayLike, p: Optional[ArrayLike] = None) -> _Array:
        """The free run from the state ``x`` under the inputs ``u``, a row per step: the states at
        all step marks, ``(steps + 1, n)``, the first of them ``x``."""
    def casadi(self, name: str = "pinc") -> Any:
        """The model as a ``casadi.Function`` of ``(x, u)``, with parameters ``(x, u, p)``, built in
        SX. Needs the package casadi."""
    def do_mpc(self) -> Any:
        """The model as a ``do_mpc.model.Model`` in discrete time, set up, with its variables by their
        names (``T_1`` for ``T[1]``). Needs the package do-mpc."""

@final
class TrainingProgress:
    """How far a training is."""

    @property
    def iteration(self) -> int:
        """Iterations done."""
    @property
    def iterations(self) -> int:
        """How many there are at most."""
    @property
    def elapsed_s(self) -> float:
        """Time since the training began, in s."""
    @property
    def loss(self) -> float:
        """The loss."""
    @property
    def validation_mse(self) -> Optional[float]:
        """The last mean squared error of free runs on the validation scenarios."""

@final
class Trained:
    """A trained net, with what came of its training."""

    @property
    def model(self) -> Model:
        """The net."""
    @property
    def validation(self) -> dict[str, Optional[float]]:
        """Its errors on scenarios that it was not chosen by, as in ``metrics.json``."""
    @property
    def stop_reason(self) -> str:
        """Why the training ended; ``"stopped"`` if the caller stopped it."""
    @property
    def iterations(self) -> int:
        """Iterations done."""
    @property
    def loss_evaluations(self) -> int:
        """Evaluations of the loss and its gradient."""
    @property
    def wall_s(self) -> float:
        """How long the training took, in s."""

def train(
    config: Config,
    overrides: Optional[Mapping[str, object]] = None,
    progress: Optional[Callable[[TrainingProgress], object]] = None,
) -> Trained:
    """Trains the net of a config, in memory.

    ``progress`` is called after every iteration; the training stops, with the best net so far, when
    it returns ``pinc.STOP``; no other value stops it. Ctrl-C raises ``KeyboardInterrupt``, and an
    exception of ``progress`` is raised on.
    """

@final
class Nmpc:
    """The controller of a config, with its estimator if the config has one, for a plant that is
    somewhere else.

    The model is the net ``model``, a ``Model`` or the path of a model file, or the one that
    ``only`` names (``"pinc"``, ``"rk4"``, ``"rk5"``, ``"rosenbrock"``, ``"black-box"``, or ``"policy"``,
    a net in place of the controller), or else the config's first. A net is used by ``"pinc"`` only: a
    ``model`` with another ``only`` is refused.

    A controller can be pickled and copied with its ``state()``; steps release the interpreter's lock.
    """

    def __new__(
        cls,
        config: Config,
        model: Union[Model, str, os.PathLike[str], None] = None,
        only: Optional[str] = None,
        overrides: Optional[Mapping[str, object]] = None,
    ) -> Nmpc: ...
    def step(
        self,
        y: ArrayLike,
        reference: Optional[ArrayLike] = None,
        u_applied: Optional[ArrayLike] = None,
        parameters: Optional[ArrayLike] = None,
        budget_us: Optional[float] = None,
    ) -> ControlStep:
        """Chooses the input for a plant of which ``y`` was measured (see ``measured``). What is
        missing is NaN; without an estimator the status is then ``bad-argument``, and ``u`` the last
        input within its bounds.

        ``reference`` is a value per controlled quantity, held over the horizon, or a row of them
        per step ahead: row j, from 0, for the end of the step that begins j steps from now (with a
        delay of d steps, j + d). The config's references give a row the value at the beginning of
        that step: a row that ends exactly at a change has the value from before it. Without
        ``reference`` they are followed, from the first step on. ``u_applied`` is the input that was
        sent to the plant in place of the last one chosen; with a delay of d steps it acts d steps later. ``parameters`` are the
        values of ``control.measured_parameters``, in that order; as before if they are not given.
        ``budget_us`` is the time that the step may take, in us, in place of ``control.budget_us``.
        """
    def adjoint(
        self,
        by_inputs: Optional[ArrayLike] = None,
        by_states: Optional[ArrayLike] = None,
        smoothing: Optional[float] = None,
    ) -> PlanGradient:
        """The gradient of a function of the last plan in all that its problem is given, from the
        function's gradient in the planned inputs, ``(k, m)`` or its numbers row by row, and states;
        what is missing counts as 0. With a delay the plan begins in the state predicted for when the
        input acts: ``state`` means that one, which is fixed for the other kinds. ``smoothing`` is the
        barrier parameter of a smoothed plan, in units of the cost. With ``control.target`` there is
        none."""
    def sensitivity(
        self, change: Mapping[str, ArrayLike], smoothing: Optional[float] = None
    ) -> PlanChange:
        """By how much the last plan changes if its problem is given other numbers: ``change`` has
        some of the kinds that ``adjoint`` gives, with as many numbers each."""
    def reset(self) -> None:
        """Forgets everything: the next step is again the first, from ``control.initial_input`` on."""
    def state(self) -> str:
        """What the next step starts from, as JSON: the plan, the inputs under way, the estimate. It is
        also what ``pinc serve`` gives for ``save``."""
    def set_state(self, state: str) -> None:
        """Goes on from the ``state()`` of another controller of the same config, without a bump."""
    @property
    def predicted_states(self) -> _Array:
        """The states of the last plan at the ends of the steps ahead, ``(horizon, n)``. With
        ``control.scenarios`` the states of all nodes of the tree, depth by depth."""
    @property
    def planned_inputs(self) -> _Array:
        """The inputs of the last plan, the one chosen first."""
    @property
    def measured(self) -> list[str]:
        """Names of what is measured: all states, or what the estimator is told."""
    @property
    def states(self) -> list[str]:
        """Names of the states."""
    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
    @property
    def controlled(self) -> list[str]:
        """Names of what is controlled: the columns of a reference."""
    @property
    def unknowns(self) -> list[str]:
        """Names of the disturbances and parameters that are estimated."""
    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that derivatives are in: of ``control.measured_parameters``, of the
        ``unknowns`` with an estimator, or else of all that the model has."""
    @property
    def horizon(self) -> int:
        """N2, the number of steps ahead."""
    @property
    def sample_time_s(self) -> float:
        """Length T of a step in s."""

@final
class Plant:
    """The plant of a config: its equation x' = f(x, u), its outputs h(x, u), and its simulator.

    With ``in_loop`` it is the plant of the closed loop, ``[control.plant]``, where the config has
    one. Methods take points or rows of points as those of a ``Model``. A plant can be pickled, and
    used from several threads.

    Example::

        tank = pinc.Plant({
            "name": "tank", "preset": "ours", "seed": 1,
            "plant": {"expression": {
                "states": ["h"], "inputs": ["q"], "parameters": {"k": 0.5, "a": 2.0},
                "derivatives": {"h": "(q - k*sqrt(h))/a"},
            }},
        })
        levels = tank.simulate([1.0], [[0.6]] * 20, step_s=1.0)
    """

    def __new__(
        cls,
        config: Config,
        overrides: Optional[Mapping[str, object]] = None,
        in_loop: bool = False,
    ) -> Plant: ...
    @property
    def states(self) -> list[str]:
        """Names of the states, in order."""
    @property
    def inputs(self) -> list[str]:
        """Names of the inputs, in order."""
    @property
    def outputs(self) -> list[str]:
        """Names of the outputs, in order; the states' where the plant has no outputs of its own."""
    @property
    def units(self) -> dict[str, str]:
        """The units of states, inputs and outputs by their names."""
    @property
    def parameters(self) -> dict[str, float]:
        """The values of the equation's parameters by their names."""
    @property
    def sample_time_s(self) -> Optional[float]:
        """Length T of the config's control step in s, or None."""
    def derivative(self, x: ArrayLike, u: ArrayLike) -> _Array:
        """The time derivative f(x, u) of the state, ``(n,)``, per s."""
    def jacobian(self, x: ArrayLike, u: ArrayLike) -> _Array:
        """The Jacobian of f by the states, then the inputs, ``(n, n + m)``."""
    def output(self, x: ArrayLike, u: ArrayLike) -> _Array:
        """The outputs h(x, u)."""
    def simulate(
        self, x: ArrayLike, u: ArrayLike, step_s: Optional[float] = None
    ) -> _Array:
        """The states from the state ``x`` on, ``(steps + 1, n)``, under the inputs ``u``, a row per
        step of ``step_s`` seconds (the config's control step), held over the step. The equation is
        integrated to the tolerance ``control.plant_tolerance``, or 1e-10; a black box is asked."""
    def model(
        self,
        method: str = "rk4",
        step_s: Optional[float] = None,
        substeps: Optional[int] = None,
    ) -> IntegratorModel:
        """An integrator of the equation as a model: ``"rk4"``, ``"rk5"`` or ``"rosenbrock"``, with
        steps of ``step_s`` seconds in ``substeps`` parts; both are the config's, or 4 substeps."""

@final
class IntegratorModel:
    """An integrator of a plant as a model in discrete time, ``x[k+1] = F(x[k], u[k])``, with its
    Jacobians; ``Plant.model`` makes it. Its methods are as those of a ``Model``."""

    @property
    def states(self) -> list[str]:
        """Names of the states, in order."""
    @property
    def inputs(self) -> list[str]:
        """Names of the inputs, in order."""
    @property
    def sample_time_s(self) -> float:
        """Length T of a step in s."""
    @property
    def substeps(self) -> int:
        """Number of substeps of a step."""
    def step(self, x: ArrayLike, u: ArrayLike) -> _Array:
        """The state after T. Threads share many points."""
    def linearize(self, x: ArrayLike, u: ArrayLike) -> tuple[_Array, _Array, _Array]:
        """The state after T with its Jacobians by the state, ``(n, n)``, and by the input,
        ``(n, m)``."""
    def predict(self, x: ArrayLike, u: ArrayLike) -> _Array:
        """The free run from the state ``x`` under the inputs ``u``, a row per step: the states at
        all step marks, ``(steps + 1, n)``, the first of them ``x``."""

@final
class Estimator:
    """The estimator of a config, step by step: ``correct`` with what is measured, use ``estimate``,
    then ``predict`` with the input that is applied.

    The model is the net ``model``, or the one that ``only`` names, or else the config's first
    integrator. An estimator can be pickled with what it knows.
    """

    def __new__(
        cls,
        config: Config,
        model: Union[Model, str, os.PathLike[str], None] = None,
        only: Optional[str] = None,
        overrides: Optional[Mapping[str, object]] = None,
    ) -> Estimator: ...
    def reset(self, u: Optional[ArrayLike] = None) -> None:
        """Forgets everything: the estimate is again the initial one. ``u`` is the input that acts
        before the first measurement: ``control.initial_input``, or 0."""
    def correct(self, y: ArrayLike, parameters: Optional[ArrayLike] = None) -> Correction:
        """Corrects the estimate with what is measured now; NaN is missing. ``parameters`` are the
        values of ``Estimator.parameters`` from now on; as before if they are not given."""
    def predict(self, u: ArrayLike) -> str:
        """Moves the estimate on by a step of T under the input ``u``. Returns how that ended;
        ``"updated"`` is the ordinary status."""
    @property
    def estimate(self) -> _Array:
        """The estimate of ``names``."""
    @property
    def sd(self) -> _Array:
        """Its standard deviations."""
    @property
    def covariance(self) -> _Array:
        """Its covariance."""
    @property
    def innovation(self) -> _Array:
        """The innovation of the last correction, measured minus expected; NaN where the measurement
        was missing or rejected."""
    @property
    def names(self) -> list[str]:
        """What is estimated: the states, disturbances and parameters."""
    @property
    def measured(self) -> list[str]:
        """Names of what is measured: the argument y of ``correct``."""
    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that are known anew in each step, measured or scheduled."""
    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
    @property
    def sample_time_s(self) -> float:
        """Length T of a step in s."""
    def state(self) -> _Array:
        """What it knows from its past, as numbers."""
    def set_state(self, state: ArrayLike) -> None:
        """Goes on from the ``state()`` of another estimator of the same config."""

@final
class Correction:
    """What came of a correction."""

    @property
    def status(self) -> str:
        """How it ended; ``"updated"`` is the ordinary status."""
    @property
    def nis(self) -> float:
        """The normalized innovation squared; NaN where nothing was used."""
    @property
    def measured(self) -> int:
        """How many measurements were used."""
    @property
    def rejected(self) -> int:
        """How many measurements the gate rejected."""

@final
class PlanGradient:
    """The gradient of a function of a plan."""

    @property
    def regularity(self) -> str:
        """``"regular"``; ``"kink"`` where a constraint is about to become active or inactive and
        the gradient is one side's; ``"singular"``, with NaN; ``"not-optimal"`` where the step did
        not converge, the plan is a substitute's, or the controller a restored copy before its first
        step."""
    @property
    def values(self) -> dict[str, _Array]:
        """The gradient by kind of number: ``state``, ``reference``, ``applied_input``,
        ``parameters``, ``q``, ``r``, ``terminal``, ``input_sequence``, bounds as ``state_low``, and
        weights of violations as ``state_penalty``, each as far as the problem has it, row by row."""

@final
class PlanChange:
    """By how much a plan changes."""

    @property
    def regularity(self) -> str:
        """As of a ``PlanGradient``."""
    @property
    def states(self) -> _Array:
        """Of the planned states, ``(horizon, n)``."""
    @property
    def inputs(self) -> _Array:
        """Of the planned inputs, ``(control horizon, m)``."""

@final
class NmpcBatch:
    """The controller of a config for many states at once, on ``threads`` threads (0: one per core),
    without an estimator.

    A batch can be pickled. Each step and each loop starts afresh: results do not depend on what else is
    in the batch, nor on the number of threads. The other arguments are as of ``Nmpc``.
    """

    def __new__(
        cls,
        config: Config,
        model: Union[Model, str, os.PathLike[str], None] = None,
        only: Optional[str] = None,
        overrides: Optional[Mapping[str, object]] = None,
        threads: int = 0,
    ) -> NmpcBatch: ...
    def steps(
        self,
        x: ArrayLike,
        reference: ArrayLike,
        u_before: Optional[ArrayLike] = None,
        parameters: Optional[ArrayLike] = None,
    ) -> StepBatch:
        """Takes a control step from each of the states ``x``, ``(steps, n)``.

        ``reference`` is a value per controlled quantity, ``(outputs,)`` or one for each step,
        ``(steps, outputs)``, held over the horizon, or ``(steps, horizon, outputs)``. ``u_before``,
        the input applied last, from where a move leads to its bounds, is ``(m,)`` or ``(steps, m)``,
        ``control.initial_input`` or 0 if it is not given; from ``control.delay_steps = 2`` on it has
        all inputs under way, the next to act first: ``(delay, m)`` or ``(steps, delay, m)``. ``parameters`` are those that the property of
        this name lists, ``(np,)`` or ``(steps, np)``, the config's if they are not given."""
    def gradients(
        self,
        x: ArrayLike,
        reference: ArrayLike,
        by_inputs: ArrayLike,
        u_before: Optional[ArrayLike] = None,
        parameters: Optional[ArrayLike] = None,
        smoothing: Optional[float] = None,
    ) -> GradientBatch:
        """Takes the steps, and differentiates a function of each plan's inputs, from its gradient
        ``by_inputs``: ``(m,)`` for all steps, ``(steps, m)``, or ``(steps, k, m)`` for the first k
        inputs. ``smoothing`` is as of ``Nmpc.adjoint``."""
    def loops(
        self, x: ArrayLike, references: ArrayLike, u_before: Optional[ArrayLike] = None
    ) -> LoopBatch:
        """Runs closed loops with the config's plant from the states ``x``, ``(loops, n)``.
        ``references`` have a row per control step: ``(steps, outputs)`` for all loops, or ``(loops,
        steps, outputs)``. ``u_before``, ``(m,)`` or ``(loops, m)``, is all that is under way."""
    @property
    def states(self) -> list[str]:
        """Names of the states."""
    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
    @property
    def controlled(self) -> list[str]:
        """Names of what is controlled: the columns of a reference."""
    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that steps take, in their order: of ``control.measured_parameters``,
        or else of all that the model has."""
    @property
    def delay_steps(self) -> int:
        """How many steps an input takes to act."""
    @property
    def horizon(self) -> int:
        """N2, the number of steps ahead."""
    @property
    def sample_time_s(self) -> float:
        """Length T of a step in s."""

@final
class StepBatch:
    """What came of many control steps."""

    @property
    def u(self) -> _Array:
        """The inputs to apply, ``(steps, m)``."""
    @property
    def inputs(self) -> _Array:
        """The planned inputs, ``(steps, control horizon, m)``."""
    @property
    def status(self) -> list[str]:
        """How the optimizations ended."""
    @property
    def sqp_iterations(self) -> list[int]:
        """How many quadratic programs were solved, and iterations of the barrier method taken."""
    @property
    def kkt(self) -> _Array:
        """The KKT residuals, ``(steps,)``."""

@final
class GradientBatch:
    """What came of many control steps, with gradients."""

    @property
    def steps(self) -> StepBatch:
        """The steps."""
    @property
    def regularity(self) -> list[str]:
        """As of a ``PlanGradient``."""
    @property
    def values(self) -> dict[str, _Array]:
        """The gradients by kind of number, as of a ``PlanGradient``, with the steps in front; that in
        ``applied_input`` has the shape of ``u_before``."""

@final
class LoopBatch:
    """What came of many closed loops. A loop that ended early has NaN for what is missing."""

    @property
    def states(self) -> _Array:
        """The states at the control steps, ``(loops, steps + 1, n)``."""
    @property
    def inputs(self) -> _Array:
        """The inputs chosen, ``(loops, steps, m)``."""
    @property
    def status(self) -> list[list[str]]:
        """How the optimizations ended."""
    @property
    def iae(self) -> _Array:
        """The absolute errors at the ends of the steps, summed over steps and outputs,
        ``(loops,)``."""
    @property
    def max_violation(self) -> _Array:
        """By how much the plant was outside its bounds at most, ``(loops,)``."""
    @property
    def error(self) -> list[Optional[str]]:
        """Why a loop ended early, or None."""

@final
class ControlStep:
    """What came of a control step."""

    @property
    def u(self) -> _Array:
        """The input to apply, within its bounds whatever the status."""
    @property
    def status(self) -> str:
        """How the optimization ended, as in ``steps.csv``: ``"converged"`` is the ordinary one."""
    @property
    def x(self) -> _Array:
        """The state that the controller took the plant to be in: what was measured, or the
        estimate."""
    @property
    def unknowns(self) -> _Array:
        """The estimated disturbances and parameters; empty without an estimator."""
    @property
    def estimator(self) -> Optional[str]:
        """How the estimator's correction ended; ``"updated"`` is the ordinary one."""
    @property
    def sqp_iterations(self) -> int:
        """How many quadratic programs were solved, and iterations of the barrier method taken."""
    @property
    def kkt(self) -> float:
        """The KKT residual that the optimization ended with."""
    @property
    def cost(self) -> Optional[float]:
        """The cost of the plan, with ``control.cost``."""
    @property
    def curvature_dropped(self) -> bool:
        """Whether negative curvature of the cost was dropped, so that the plan is not proven to be a
        minimum; only with ``control.cost``."""
    @property
    def start(self) -> Optional[int]:
        """From which of ``control.sqp.starts`` the plan was found, in a step that tried several; 0 is
        the start without others."""
    @property
    def target_found(self) -> Optional[bool]:
        """With ``control.target``: whether a steady state was found for each row of the reference; a
        row without one stays as it was given."""
    @property
    def in_tube(self) -> Optional[bool]:
        """With ``control.uncertainty``: whether the plan keeps the tightened bounds; if not, the plant
        may break its bounds."""
    @property
    def step_us(self) -> float:
        """How long the step took, in us."""
    @property
    def trust(self) -> Optional[str]:
        """With ``control.error_tolerance``: ``"trusted"`` where the net's estimated error in the
        plan's first step is within its tolerance, ``"doubted"`` or ``"substituted"`` where not."""
    @property
    def model_error(self) -> _Array:
        """The estimated error of the net in that step, ``(n,)``, in the states' units; empty without
        ``control.error_tolerance``."""

def run_into(common: object) -> Path: ...
def control_into(common: object) -> Path: ...
def findings(common: object) -> str: ...
def certify_into(
    common: object,
    points: Optional[int],
    data: Optional[_Path],
    run: Optional[_Path],
    domain: bool,
    budget_s: Optional[float],
) -> tuple[Path, str]: ...
def identify_into(
    common: object, data: list[_Path], validate: list[_Path], starts: Optional[int]
) -> tuple[Path, str]: ...
def estimate_into(common: object, data: _Path) -> dict[str, Any]: ...
def choose_into(
    common: object, within: float, budget_s: float, target: str
) -> tuple[Path, Path, Path, str]: ...
def tune_into(common: object) -> tuple[Path, Path, Path, tuple[float, float], str]: ...
def shrink_into(
    common: object,
    neurons: Optional[int],
    samples: Optional[int],
    iterations: Optional[int],
    loops: Optional[int],
) -> tuple[Path, str, Optional[str]]: ...
def export_controller(common: object, to: str, name: Optional[str], errors: bool) -> Path: ...
def export_plant(common: object, to: str, name: Optional[str]) -> Path: ...
def export_net(
    model: _Path,
    to: str,
    name: Optional[str],
    out: Optional[_Path],
    judged: Optional[Config],
) -> Path: ...
def resolved(config: Config, overrides: Optional[Mapping[str, object]] = None) -> str:
    """The config with all values spelled out, as TOML."""
def solve_dense_qp(
    p: ArrayLike,
    q: ArrayLike,
    g: Optional[ArrayLike] = None,
    h: Optional[ArrayLike] = None,
    a: Optional[ArrayLike] = None,
    b: Optional[ArrayLike] = None,
    lb: Optional[ArrayLike] = None,
    ub: Optional[ArrayLike] = None,
) -> Optional[tuple[_Array, _Array, _Array, _Array]]: ...
def allow_processes() -> None:
    """Lets the plant of a config be a program or an FMU from now on, which runs with your rights."""

_Parts = tuple[str, Optional[str], list[str]]
_Origin = tuple[_Parts, Optional[bytes], Optional[str]]

def restore_nmpc(origin: _Origin, state: str) -> Nmpc: ...
def restore_batch(origin: _Origin, threads: int) -> NmpcBatch: ...
def restore_estimator(origin: _Origin, state: ArrayLike) -> Estimator: ...
def restore_plant(source: _Parts, in_loop: bool) -> Plant: ...
def restore_result(class_name: str, fields: object) -> Any: ...
def restore_integrator(
    source: _Parts, in_loop: bool, method: str, step_s: float, substeps: int
) -> IntegratorModel: ...
