"""Controllers as functions that PyTorch and JAX differentiate."""

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Optional

import numpy as np

if TYPE_CHECKING:
    from ._native import NmpcBatch

_KINDS = ("state", "reference", "applied_input", "parameters")


def _inputs(batch: "NmpcBatch", given: list[Any]) -> Any:
    x, reference, u_before = given[:3]
    parameters = given[3] if len(given) > 3 else None
    return batch.steps(x, reference, u_before, parameters).u


def _gradients(
    batch: "NmpcBatch", given: list[Any], by_inputs: Any, smoothing: Optional[float]
) -> list[Any]:
    x, reference, u_before = given[:3]
    parameters = given[3] if len(given) > 3 else None
    found = batch.gradients(x, reference, by_inputs, u_before, parameters, smoothing)
    lost = found.regularity.count("not-optimal")
    if lost:
        message = f"{lost} of {len(found.regularity)} plans are not optimal; their gradients are wrong"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
    # A controller that tracks nothing has no derivatives in references.
    arrays = (found.values.get(kind, np.empty(0)) for kind in _KINDS)
    return [array.reshape(like.shape) for like, array in zip(given, arrays)]


def _of_each(batch: "NmpcBatch", points: int, shape: Any) -> tuple[int, ...]:
    """The shape of ``u_before`` with what is given for one point repeated for each."""
    of_one = 1 if batch.delay_steps < 2 else 2
    return (points, *shape[-of_one:])


def torch_policy(batch: "NmpcBatch", smoothing: Optional[float] = None) -> Callable[..., Any]:
    """The controller as a function of PyTorch tensors, ``u = policy(x, reference, u_before,
    parameters=None)``, with gradients in all of them. Needs the package torch.

    ``x`` is ``(points, n)``; ``reference`` ``(outputs,)``, ``(points, outputs)`` or ``(points,
    horizon, outputs)``; ``u_before`` ``(m,)`` or ``(points, m)``, from ``control.delay_steps = 2`` on
    all inputs under way, the next to act first, ``(delay, m)`` or ``(points, delay, m)``;
    ``parameters``, those that ``batch.parameters`` names, ``(np,)`` or ``(points, np)``. The result is
    ``(points, m)``. Whole numbers count as numbers of the default precision. With ``smoothing`` the
    gradients are those of the smoothed plan. Where a plan is not optimal the backward pass warns.
    Differentiate by ``backward`` or ``torch.autograd``: ``torch.func`` cannot transform it.
    """
    try:
        import torch
    except ImportError as error:
        raise ImportError("torch_policy needs the package torch: pip install torch") from error

    def arrays(tensors: Any) -> list[Any]:
        return [tensor.detach().cpu().to(torch.float64).numpy() for tensor in tensors]

    class Policy(torch.autograd.Function):  # type: ignore[misc, unused-ignore]
        @staticmethod
        def forward(ctx: Any, *tensors: Any) -> Any:
            ctx.save_for_backward(*tensors)
            return torch.from_numpy(_inputs(batch, arrays(tensors))).to(tensors[0])

        @staticmethod
        def backward(ctx: Any, by_inputs: Any) -> Any:
            given = ctx.saved_tensors
            (seed,) = arrays([by_inputs])
            found = _gradients(batch, arrays(given), seed, smoothing)
            return tuple(torch.from_numpy(array).to(like) for array, like in zip(found, given))

    def policy(x: Any, reference: Any, u_before: Any, parameters: Any = None) -> Any:
        points = x.shape[0]
        if reference.dim() < 3:
            reference = reference.expand(points, -1).unsqueeze(1).expand(-1, batch.horizon, -1)
        given = [x, reference, u_before.expand(_of_each(batch, points, u_before.shape))]
        if parameters is not None:
            given.append(parameters.expand(points, -1))
        real = torch.get_default_dtype()
        return Policy.apply(*(one if one.is_floating_point() else one.to(real) for one in given))

    return policy


def jax_policy(batch: "NmpcBatch", smoothing: Optional[float] = None) -> Callable[..., Any]:
    """``torch_policy`` for JAX: a function that can be jitted, mapped by ``vmap`` and differentiated in
    reverse mode, once. Needs the package jax; for all digits, ``jax.config.update("jax_enable_x64", True)``.
    """
    try:
        import jax
        import jax.numpy as jnp
    except ImportError as error:
        raise ImportError("jax_policy needs the package jax: pip install jax") from error

    def call(function: Callable[..., Any], shapes: Any, *given: Any) -> Any:
        def on_arrays(*arrays: Any) -> Any:
            found = function(*(np.asarray(array, dtype=np.float64) for array in arrays))
            return jax.tree.map(lambda array, like: array.astype(like.dtype), found, shapes)

        return jax.pure_callback(on_arrays, shapes, *given, vmap_method="sequential")

    def chosen(*given: Any) -> Any:
        x = given[0]
        shape = jax.ShapeDtypeStruct((x.shape[0], len(batch.inputs)), x.dtype)
        return call(lambda *arrays: _inputs(batch, list(arrays)), shape, *given)

    def real(given: Any) -> Any:
        given = jnp.asarray(given)
        return given if jnp.issubdtype(given.dtype, jnp.floating) else given.astype(float)

    inputs: Any = jax.custom_vjp(chosen)

    def forward(*given: Any) -> Any:
        return inputs(*given), given

    def backward(given: Any, by_inputs: Any) -> Any:
        def function(seed: Any, *arrays: Any) -> Any:
            return tuple(_gradients(batch, list(arrays), seed, smoothing))

        shapes = tuple(jax.ShapeDtypeStruct(like.shape, like.dtype) for like in given)
        return call(function, shapes, by_inputs, *given)

    inputs.defvjp(forward, backward)

    def policy(x: Any, reference: Any, u_before: Any, parameters: Any = None) -> Any:
        x, reference, u_before = (real(one) for one in (x, reference, u_before))
        points = x.shape[0]
        if reference.ndim < 3:
            width = reference.shape[-1]
            held = jnp.broadcast_to(reference, (points, width))[:, None, :]
            reference = jnp.broadcast_to(held, (points, batch.horizon, width))
        given = [x, reference, jnp.broadcast_to(u_before, _of_each(batch, points, u_before.shape))]
        if parameters is not None:
            parameters = real(parameters)
            given.append(jnp.broadcast_to(parameters, (points, parameters.shape[-1])))
        return inputs(*given)

    return policy
