"""Many control steps and loops at once, and their derivatives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinc_nmpc as pinc

# The smoke test's plant, with a cost that tells q1 and q2 apart.
WEIGHTS = {"control.q": [8.0, 3.0], "control.sqp.tolerance": 1e-10}


def states(count: int) -> Any:
    """Random states of the oscillator from which its bounds can be met."""
    random = np.random.default_rng(4)
    return random.uniform([-0.8, -0.3], [0.8, 0.3], (count, 2))


@pytest.fixture(scope="module")
def batch(smoke: Path) -> pinc.NmpcBatch:
    """The controller with RK4."""
    return pinc.NmpcBatch(smoke, only="rk4", overrides=WEIGHTS, threads=2)


def test_a_batch_takes_the_steps_of_one_controller(smoke: Path, batch: pinc.NmpcBatch) -> None:
    x = states(50)
    reference = np.linspace(-0.4, 0.4, 100).reshape(50, 2)
    before = np.linspace(-0.5, 0.5, 50)[:, None]
    steps = batch.steps(x, reference, before)
    alone = pinc.NmpcBatch(smoke, only="rk4", overrides=WEIGHTS, threads=1)
    assert np.array_equal(steps.u, alone.steps(x, reference, before).u)
    assert steps.u.shape == (50, 1) and steps.inputs.shape == (50, batch.horizon, 1)
    assert batch.steps(np.empty((0, 2)), np.empty(2)).u.shape == (0, 1)
    none = batch.gradients(np.empty((0, 2)), np.empty(2), np.ones(1)).values
    some = batch.gradients(x, reference, np.ones(1), before).values
    assert {name: (0, *values.shape[1:]) for name, values in some.items()} == {
        name: values.shape for name, values in none.items()
    }
    with pytest.raises(pinc.InputError, match="threads: 100000 given, expected 0 to 1024"):
        pinc.NmpcBatch(smoke, only="rk4", threads=100_000)
    one = pinc.Nmpc(smoke, only="rk4", overrides=WEIGHTS)
    for k in range(0, 50, 7):
        one.reset()
        step = one.step(x[k], reference[k], u_applied=before[k])
        assert np.abs(step.u - steps.u[k]).max() < 1e-7
        assert step.status == steps.status[k] == "converged"
    whole = np.repeat(reference[:, None, :], batch.horizon, axis=1)
    assert np.array_equal(batch.steps(x, whole, before).u, steps.u)


def test_inputs_before_lead_to_their_bounds(smoke: Path) -> None:
    moves = {"control.increment_low": [-0.5], "control.increment_high": [0.5]}
    batch = pinc.NmpcBatch(smoke, only="rk4", overrides=moves, threads=1)
    x, reference, references = states(2), [0.0, 0.0], np.zeros((3, 2))
    for u_before, message in (
        ([1.6], r"u_before\[0\] is 1.6, but must be where a move within its bounds leads"),
        ([[0.0], [-1.7]], r"u_before\[1\] is -1.7, but must be where a move"),
        ([np.nan], r"u_before\[0\] is NaN, but must be finite"),
    ):
        with pytest.raises(pinc.InputError, match=message):
            batch.steps(x, reference, u_before)
        with pytest.raises(pinc.InputError, match=message):
            batch.gradients(x, reference, [1.0], u_before)
        with pytest.raises(pinc.InputError, match=message):
            batch.loops(x, references, u_before)
    far = batch.steps(x, reference, np.float32([1.5]))
    assert (far.u >= 1.0 - 1e-6).all()


def test_gradients_match_differences(smoke: Path, batch: pinc.NmpcBatch) -> None:
    x, reference, before = states(20), np.array([0.1, 0.0]), np.array([0.05])
    found = batch.gradients(x, reference, [1.0], before)
    regular = np.array([name == "regular" for name in found.regularity])
    assert regular.sum() > 10
    step = 1e-4

    def difference(low: Any, high: Any) -> Any:
        return (high.u[:, 0] - low.u[:, 0]) / (2 * step)

    for i, e in enumerate(np.eye(2) * step):
        by_x = difference(batch.steps(x - e, reference, before), batch.steps(x + e, reference, before))
        assert np.abs(found.values["state"][regular, i] - by_x[regular]).max() < 1e-5
        by_r = difference(batch.steps(x, reference - e, before), batch.steps(x, reference + e, before))
        gradient = found.values["reference"].reshape(20, batch.horizon, 2).sum(axis=1)
        assert np.abs(gradient[regular, i] - by_r[regular]).max() < 1e-5
    by_u = difference(batch.steps(x, reference, before - step), batch.steps(x, reference, before + step))
    assert np.abs(found.values["applied_input"][regular, 0] - by_u[regular]).max() < 1e-5

    # A weight, by other controllers; what is the same at all stages may be given stage by stage.
    other = [
        pinc.NmpcBatch(smoke, only="rk4", overrides={**WEIGHTS, "control.q": [8.0 + d, 3.0]})
        for d in (-step, step)
    ]
    by_q = difference(*(batch.steps(x, reference, before) for batch in other))
    gradient = found.values["q"].reshape(20, -1, 2).sum(axis=1)[:, 0]
    scale = found.values["q"].shape[1] // 2
    assert scale in (1, batch.horizon)
    assert np.abs(gradient[regular] - by_q[regular]).max() < 1e-5


def test_one_controller_differentiates_its_last_plan(smoke: Path, batch: pinc.NmpcBatch) -> None:
    one = pinc.Nmpc(smoke, only="rk4", overrides=WEIGHTS)
    one.step([0.3, 0.1], [0.1, 0.0], u_applied=[0.2])
    gradient = one.adjoint([1.0])
    same = batch.gradients([[0.3, 0.1]], [0.1, 0.0], [1.0], [0.2])
    assert gradient.regularity == same.regularity[0] == "regular"
    for kind, values in gradient.values.items():
        assert np.allclose(values, same.values[kind][0], atol=1e-6), kind
    moved = one.sensitivity({"state": [1.0, 0.0], "applied_input": [0.5]})
    expected = gradient.values["state"][0] + 0.5 * gradient.values["applied_input"][0]
    assert abs(moved.inputs[0, 0] - expected) < 1e-9
    assert moved.states.shape == (one.horizon, 2) and moved.regularity == "regular"
    smooth = one.adjoint([1.0], smoothing=1e-4).values["input_high"]
    assert smooth[0] > 0 == gradient.values["input_high"][0]
    with pytest.raises(pinc.InputError, match="applied_inputs"):
        one.sensitivity({"applied_inputs": [0.5]})
    with pytest.raises(pinc.InputError, match="2 numbers given, expected 1"):
        one.sensitivity({"applied_input": [0.5, 0.5]})


def test_loops_match_a_controller_and_the_plant(batch: pinc.NmpcBatch) -> None:
    x = states(6)
    references = np.zeros((6, 15, 2))
    references[:, :, 0] = np.linspace(-0.3, 0.3, 6)[:, None]
    loops = batch.loops(x, references)
    assert loops.states.shape == (6, 16, 2) and loops.inputs.shape == (6, 15, 1)
    assert np.array_equal(loops.states[:, 0], x)
    first = batch.steps(x, references[:, 0])
    assert np.abs(first.u - loops.inputs[:, 0]).max() < 1e-9
    assert loops.error == [None] * 6 and {s for row in loops.status for s in row} == {"converged"}
    errors = np.abs(loops.states[:, 1:] - references).sum(axis=(1, 2))
    assert np.allclose(errors, loops.iae)
    assert loops.max_violation.max() < 1e-6
    assert np.abs(loops.states[:, -1, 0] - references[:, 0, 0]).max() < 0.05


def test_a_controller_that_tracks_nothing_takes_references_without_numbers(smoke: Path) -> None:
    cost: dict[str, object] = {"stage": "x1^2 + x2^2 + 0.1*u^2"}
    nothing = {"control.controlled": None, "control.q": None, "control.references": None}
    economic = {**nothing, "control.cost": cost}
    batch = pinc.NmpcBatch(smoke, only="rk4", overrides=economic)
    x = states(3)
    steps = batch.steps(x, [])
    for shape in ((3, 0), (3, batch.horizon, 0)):
        assert np.array_equal(batch.steps(x, np.zeros(shape)).u, steps.u)
        assert batch.gradients(x, np.zeros(shape), [1.0]).values["state"].shape == (3, 2)
    for references in (np.zeros((5, 0)), np.zeros((3, 5, 0))):
        loops = batch.loops(x, references)
        assert loops.inputs.shape == (3, 5, 1)
        assert np.abs(loops.inputs[:, 0] - steps.u).max() < 1e-9
    with pytest.raises(pinc.InputError, match="references: expected an array of shape"):
        batch.loops(x, np.zeros((0, 0)))
    jax = pytest.importorskip("jax")
    policy = pinc.jax_policy(batch)

    def total(x: Any) -> Any:
        return policy(x, np.zeros(0), np.zeros(1)).sum()

    assert np.isfinite(jax.grad(total)(x)).all()


def test_what_does_not_fit_is_named(smoke: Path, batch: pinc.NmpcBatch) -> None:
    with pytest.raises(pinc.InputError, match="x: expected an array of shape"):
        batch.steps([0.1, 0.2], [0.0, 0.0])
    with pytest.raises(pinc.InputError, match="reference: expected 2 numbers"):
        batch.steps(states(3), np.zeros((2, 2)))
    with pytest.raises(pinc.InputError, match="none.*control.measured_parameters"):
        batch.steps(states(3), [0.0, 0.0], parameters=[1.0])
    with pytest.raises(pinc.InputError, match="by_inputs"):
        batch.gradients(states(3), [0.0, 0.0], np.zeros((2, 1)))
    with pytest.raises(pinc.InputError, match="smoothing is -1"):
        batch.gradients(states(3), [0.0, 0.0], [1.0], smoothing=-1.0)
    tanks = smoke.parents[1] / "estimation" / "tanks.toml"
    with pytest.raises(pinc.InputError, match="estimator"):
        pinc.NmpcBatch(tanks, only="rk4").loops(np.full((1, 4), 3.0), np.full((4, 2), 10.0))


def test_torch_differentiates_a_policy(batch: pinc.NmpcBatch) -> None:
    torch = pytest.importorskip("torch")
    policy = pinc.torch_policy(batch)
    x = torch.tensor(states(5), requires_grad=True)
    reference = torch.tensor([0.1, 0.0], dtype=torch.float64, requires_grad=True)
    before = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    u = policy(x, reference, before)
    assert np.array_equal(u.detach().numpy(), batch.steps(x.detach().numpy(), [0.1, 0.0], [0.0]).u)
    u.square().sum().backward()
    seed = 2 * u.detach().numpy()
    found = batch.gradients(x.detach().numpy(), [0.1, 0.0], seed, [0.0]).values
    assert np.allclose(x.grad.numpy(), found["state"])
    by_reference = found["reference"].reshape(5, batch.horizon, 2).sum(axis=(0, 1))
    assert np.allclose(reference.grad.numpy(), by_reference)
    assert np.allclose(before.grad.numpy(), found["applied_input"].sum(axis=0))


def test_a_policy_warns_where_plans_are_not_optimal(smoke: Path) -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    hasty = {**WEIGHTS, "control.sqp.max_iterations": 1}
    policy = pinc.jax_policy(pinc.NmpcBatch(smoke, only="rk4", overrides=hasty))
    before, reference = np.zeros(1), np.zeros(2)

    def loss(x: Any) -> Any:
        return policy(x, reference, before).sum()

    with pytest.warns(RuntimeWarning, match="plans are not optimal"):
        jax.grad(loss)(states(5))


def test_a_policy_is_differentiated_through_a_delay(smoke: Path) -> None:
    delayed = {**WEIGHTS, "control.delay_steps": 1}
    batch = pinc.NmpcBatch(smoke, only="rk4", overrides=delayed)
    x, reference, before = np.array([[0.3, 0.1]]), np.array([0.1, 0.0]), np.array([0.05])
    found = batch.gradients(x, reference, [1.0], before)
    assert found.regularity == ["regular"]
    step = 1e-4
    for i, e in enumerate(np.eye(2) * step):
        low, high = (batch.steps(x + d, reference, before).u[0, 0] for d in (-e, e))
        assert abs(found.values["state"][0, i] - (high - low) / (2 * step)) < 1e-5
    low, high = (batch.steps(x, reference, before + d).u[0, 0] for d in (-step, step))
    assert abs(found.values["applied_input"][0, 0] - (high - low) / (2 * step)) < 1e-5


def test_a_policy_takes_all_inputs_under_way(smoke: Path) -> None:
    """Chained with the plant it is the closed loop; one input for all under way is another."""
    delayed = {**WEIGHTS, "control.delay_steps": 3, "control.preview": False}
    batch = pinc.NmpcBatch(smoke, only="rk4", overrides=delayed)
    assert batch.delay_steps == 3
    plant, references = pinc.Plant(smoke), np.tile([0.3, 0.0], (8, 1))
    loop = batch.loops([[0.4, 0.1]], references)
    x, under_way = np.array([0.4, 0.1]), np.zeros((3, 1))
    for state in loop.states[0, 1:]:
        u = batch.steps(x[None], references[0], under_way).u
        x = plant.simulate(x, under_way[:1], batch.sample_time_s)[-1]
        under_way = np.concatenate([under_way[1:], u])
        assert np.abs(x - state).max() < 1e-6
    for wrong in (np.zeros(1), np.zeros((1, 1)), np.zeros((1, 2, 1))):
        with pytest.raises(pinc.InputError, match="u_before.*control.delay_steps = 3.*under way"):
            batch.steps(x[None], references[0], wrong)
    found = batch.gradients(x[None], references[0], [1.0], under_way).values["applied_input"]
    assert found.shape == (1, 3, 1)
    for j in range(3):
        moved = np.zeros((3, 1))
        moved[j] = 1e-4
        low, high = (batch.steps(x[None], references[0], under_way + s * moved).u for s in (-1, 1))
        assert abs(found[0, j, 0] - (high - low)[0, 0] / 2e-4) < 1e-5
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    policy = pinc.jax_policy(batch)
    gradient = jax.grad(lambda of: policy(x[None], references[0], of).sum())(under_way)
    assert np.allclose(gradient, found[0])


def test_steps_do_not_know_the_time_that_a_cost_has(smoke: Path) -> None:
    priced = {"control.cost": {"stage": "0.1*u^2*(1 + t)"}}
    batch = pinc.NmpcBatch(smoke, only="rk4", overrides=priced, threads=1)
    x, reference = np.array([[0.5, 0.0]]), np.zeros(2)
    for call in (
        lambda: batch.steps(x, reference),
        lambda: batch.gradients(x, reference, [1.0]),
    ):
        with pytest.raises(pinc.InputError, match=r"no time, but `t` stands in \[control.cost\]"):
            call()
    assert np.isfinite(batch.loops(x, np.zeros((1, 5, 2))).inputs).all()


FAMILY = Path(__file__).resolve().parents[3] / "configs" / "four-tanks" / "family.toml"


def test_parameters_are_those_of_a_step(smoke: Path) -> None:
    """In the order of the config; a batch has them as the controller of one plant."""
    measured = {"control.measured_parameters": ["k2", "k1"]}
    one = pinc.Nmpc(FAMILY, only="rk4", overrides=measured)
    batch = pinc.NmpcBatch(FAMILY, only="rk4", overrides=measured, threads=1)
    assert one.parameters == batch.parameters == ["k2", "k1"]
    x, reference, p = np.array([[8.0, 12.0, 2.0, 3.0]]), np.array([12.0, 13.0]), [3.35, 3.0]
    u = one.step(x[0], reference, parameters=p).u
    assert np.abs(batch.steps(x, reference, parameters=p).u[0] - u).max() < 1e-6
    found = batch.gradients(x, reference, [1.0, 0.5], parameters=p).values["parameters"]
    assert np.allclose(one.adjoint([1.0, 0.5]).values["parameters"], found[0], rtol=1e-4, atol=1e-8)
    moved = one.sensitivity({"parameters": [1.0, 0.0]}).inputs[0] @ [1.0, 0.5]
    assert moved == pytest.approx(found[0, 0], rel=1e-4)
    for i, step in enumerate(np.eye(2) * 1e-4):
        low, high = (batch.steps(x, reference, parameters=p + d).u[0] @ [1.0, 0.5] for d in (-step, step))
        assert found[0, i] == pytest.approx((high - low) / 2e-4, abs=1e-4)
    with pytest.raises(pinc.InputError, match="loops.*`control.measured_parameters`"):
        batch.loops(x, np.tile(reference, (3, 1)))
    assert pinc.NmpcBatch(smoke, only="rk4").parameters == []


def test_a_plan_to_a_target_has_no_derivatives() -> None:
    controller = pinc.Nmpc(FAMILY.parents[1] / "estimation" / "targets.toml", only="rk4")
    step = controller.step([12.3, 12.6])
    assert (step.status, step.target_found) == ("converged", True)
    with pytest.raises(pinc.InputError, match="`control.target`"):
        controller.adjoint([1.0, 0.0])
    with pytest.raises(pinc.InputError, match="`control.target`"):
        controller.sensitivity({"applied_input": [0.1, 0.0]})


def test_gradients_in_references_have_their_shape(smoke: Path, batch: pinc.NmpcBatch) -> None:
    found = batch.gradients(states(3), [0.1, 0.0], [1.0]).values["reference"]
    assert found.shape == (3, batch.horizon, 2)
    one = pinc.Nmpc(smoke, only="rk4", overrides=WEIGHTS)
    one.step(states(1)[0], [0.1, 0.0])
    by_reference = one.adjoint([1.0]).values["reference"]
    assert by_reference.shape == (batch.horizon, 2)
    moved = one.sensitivity({"reference": np.ones((batch.horizon, 2))}).inputs[0, 0]
    assert moved == pytest.approx(by_reference.sum())


def test_policies_take_whole_numbers(batch: pinc.NmpcBatch) -> None:
    u = batch.steps([[0.0, 0.0]], [0.3, 0.0]).u
    assert abs(u[0, 0]) > 0.05
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    whole = pinc.jax_policy(batch)(np.array([[0, 0]]), np.array([0.3, 0.0]), np.array([0]))
    assert np.allclose(whole, u)
    torch = pytest.importorskip("torch")
    policy = pinc.torch_policy(batch)
    whole = policy(torch.tensor([[0, 0]]), torch.tensor([0.3, 0.0]), torch.tensor([0]))
    assert np.allclose(whole.numpy(), u, atol=1e-6)


def test_jax_maps_a_policy(batch: pinc.NmpcBatch) -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    policy = pinc.jax_policy(batch)
    x, reference, before = states(3), np.array([0.1, 0.0]), np.zeros(1)
    found = batch.gradients(x, reference, [1.0], before).values["state"]
    jacobian = jax.jacrev(lambda x: policy(x, reference, before))(x)
    for k in range(3):
        assert np.allclose(jacobian[k, 0, k], found[k])
    mapped = jax.vmap(lambda x: policy(x[None], reference, before)[0])(x)
    assert np.allclose(mapped, batch.steps(x, reference, before).u)


def test_torch_learns_a_reference_from_the_cost_of_a_loop(batch: pinc.NmpcBatch) -> None:
    """Steps through the controller: the set point that brings the first input to 0.1."""
    torch = pytest.importorskip("torch")
    policy = pinc.torch_policy(batch)
    x = torch.tensor([[0.2, 0.1]], dtype=torch.float64)
    reference = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    before = torch.zeros(1, dtype=torch.float64)
    optimizer = torch.optim.SGD([reference], lr=0.3)
    for _ in range(60):
        optimizer.zero_grad()
        loss = (policy(x, reference, before) - 0.1).square().sum()
        loss.backward()
        optimizer.step()
    assert abs(policy(x, reference, before).item() - 0.1) < 1e-3


def test_jax_differentiates_a_policy(batch: pinc.NmpcBatch) -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    policy = pinc.jax_policy(batch)
    x = states(5)
    reference, before = np.array([0.1, 0.0]), np.zeros(1)

    def loss(x: Any, reference: Any, before: Any) -> Any:
        return (policy(x, reference, before) ** 2).sum()

    gradients = jax.jit(jax.grad(loss, argnums=(0, 1, 2)))(x, reference, before)
    u = batch.steps(x, reference, before).u
    found = batch.gradients(x, reference, 2 * u, before).values
    assert np.allclose(gradients[0], found["state"])
    by_reference = found["reference"].reshape(5, batch.horizon, 2).sum(axis=(0, 1))
    assert np.allclose(gradients[1], by_reference)
    assert np.allclose(gradients[2], found["applied_input"].sum(axis=0))
