"""Loss and gradient of the Van der Pol PINC net in JAX, in three ways.

tuned     time tangent by hand, features by rows, chunks that fit into the cache, gradients summed over
          the chunks by a scan, a share of the points for each CPU device
obvious   the same loss over the full batch at once, time tangent by hand, jax.value_and_grad
authors   the full batch, dy/dt by automatic differentiation of the net inside that of the loss

Run as a program, it checks each against pinc's result and prints its median time:

    python jax_loss_gradient.py evaluation.safetensors [--tune]
"""

import os

DEVICES = os.cpu_count()
# Before JAX is loaded: a device per core, each computing on its own thread.
os.environ.setdefault(
    "XLA_FLAGS",
    f"--xla_force_host_platform_device_count={DEVICES} --xla_cpu_multi_thread_eigen=false",
)
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import argparse
import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh, NamedSharding, PartitionSpec as P

import evaluation as ev

jax.config.update("jax_enable_x64", True)


def tanh_exp(z):
    """tanh by the exponential, which XLA vectorizes; its own f64 tanh is slower."""
    return 1.0 - 2.0 / (jnp.exp(2.0 * z) + 1.0)


def right_hand_side(x1, x2, u):
    return x2, (1.0 - x1 * x1) * x2 - x1 + u


class Problem:
    """The parts of the evaluation as arrays; points as [features, points]."""

    def __init__(self, evaluation):
        e = evaluation
        self.e = e
        self.parameters = [(jnp.array(w), jnp.array(b)) for w, b in e.parameters]
        self.collocation = np.ascontiguousarray(e.collocation.T)
        self.initial = np.ascontiguousarray(e.initial.T)

    def normalized(self, points):
        return (points - self.e.input_mean[:, None]) / self.e.input_std[:, None]

    def loss_of_outputs(self, points, y, dy, mask):
        """lambda MSE_F's share of some points: y, dy [states, points] before denormalization."""
        e = self.e
        y = y * e.output_std[:, None] + e.output_mean[:, None]
        dy = dy * e.output_std[:, None]
        f1, f2 = right_hand_side(y[0], y[1], points[3])
        squares = ((dy[0] - f1) * e.residual_scale[0]) ** 2
        squares += ((dy[1] - f2) * e.residual_scale[1]) ** 2
        return e.physics_factor * jnp.sum(squares * mask if mask is not None else squares)

    def initial_loss(self, parameters, points):
        e = self.e
        a = self.normalized(points)
        for w, b in parameters[:-1]:
            a = jnp.tanh(w @ a + b[:, None])
        w, b = parameters[-1]
        y = (w @ a + b[:, None]) * e.output_std[:, None] + e.output_mean[:, None]
        errors = (y - points[1:3]) * e.initial_scale[:, None]
        return e.initial_factor * jnp.sum(errors * errors)

    def first_layer(self, parameters, a, tanh):
        """Its tangent before tanh is a column of its weights, the same for all points."""
        w, b = parameters[0]
        v = tanh(w @ a + b[:, None])
        return v, (1.0 - v * v) * (w[:, 0] / self.e.input_std[0])[:, None]

    def physics_loss(self, parameters, points, mask=None, tanh=jnp.tanh, layout="split"):
        """lambda MSE_F with the time tangent by hand."""
        v, d = self.first_layer(parameters, self.normalized(points), tanh)
        for w, b in parameters[1:-1]:
            z, dz = products(w, v, d, layout)
            v = tanh(z + b[:, None])
            d = (1.0 - v * v) * dz
        w, b = parameters[-1]
        y, dy = products(w, v, d, layout)
        return self.loss_of_outputs(points, y + b[:, None], dy, mask)

    def physics_by_hand(self, parameters, points, mask, tanh, layout):
        """lambda MSE_F and its gradient, both by hand: only a and a' of each layer are kept."""
        a = self.normalized(points)
        v, d = self.first_layer(parameters, a, tanh)
        kept = [(v, d)]
        for w, b in parameters[1:-1]:
            z, dz = products(w, v, d, layout)
            v = tanh(z + b[:, None])
            d = (1.0 - v * v) * dz
            kept.append((v, d))
        w, b = parameters[-1]
        y, dy = products(w, v, d, layout)
        share = lambda y, dy: self.loss_of_outputs(points, y, dy, mask)
        loss, (bv, bd) = jax.value_and_grad(share, argnums=(0, 1))(y + b[:, None], dy)
        gradient = []
        for (w, _), (v, d) in zip(parameters[:0:-1], reversed(kept)):
            gradient.append((outer(bv, bd, v, d, layout), jnp.sum(bv, axis=1)))
            qv, qd = products(w.T, bv, bd, layout)
            s = 1.0 - v * v
            bv, bd = s * qv - 2.0 * v * d * qd, s * qd
        first = (bv @ a.T).at[:, 0].add(jnp.sum(bd, axis=1) / self.e.input_std[0])
        gradient.append((first, jnp.sum(bv, axis=1)))
        return loss, gradient[::-1]


def products(w, v, d, layout):
    """w v and w d: as columns of one product (`stacked`) or as two (`split`)."""
    if layout == "split":
        return w @ v, w @ d
    both = w @ jnp.concatenate([v, d], axis=1)
    return both[:, : v.shape[1]], both[:, v.shape[1] :]


def outer(bv, bd, v, d, layout):
    """bv v' + bd d': as one product or as two."""
    if layout == "split":
        return bv @ v.T + bd @ d.T
    return jnp.concatenate([bv, bd], axis=1) @ jnp.concatenate([v, d], axis=1).T


def tuned(problem, chunk=128, layout="split", tanh=tanh_exp, hand=True):
    """A function of the parameters, compiled: loss and gradient."""
    points = problem.collocation
    chunks = -(-points.shape[1] // (chunk * DEVICES)) * DEVICES
    padding = chunks * chunk - points.shape[1]
    padded = np.concatenate([points, np.repeat(points[:, :1], padding, axis=1)], axis=1)
    mask = (np.arange(chunks * chunk) < points.shape[1]).astype(float)
    # [chunks, features, points]
    stacked = np.ascontiguousarray(padded.reshape(len(points), chunks, chunk).transpose(1, 0, 2))
    initial = problem.initial[:, : problem.initial.shape[1] // DEVICES * DEVICES]
    assert initial.shape == problem.initial.shape, "initial conditions do not divide evenly"

    mesh = Mesh(np.array(jax.devices()[:DEVICES]), ("d",))
    put = lambda array, spec: jax.device_put(array, NamedSharding(mesh, spec))
    data = (
        put(stacked, P("d")),
        put(mask.reshape(chunks, chunk), P("d")),
        put(initial, P(None, "d")),
    )

    def share(parameters, stacked, mask, initial):
        def body(carry, xs):
            points, mask = xs
            if hand:
                result = problem.physics_by_hand(parameters, points, mask, tanh, layout)
            else:
                f = lambda p: problem.physics_loss(p, points, mask, tanh, layout)
                result = jax.value_and_grad(f)(parameters)
            return jax.tree.map(jnp.add, carry, result), None

        start = jax.value_and_grad(problem.initial_loss)(parameters, initial)
        sums, _ = lax.scan(body, start, (stacked, mask))
        return jax.tree.map(lambda x: lax.psum(x, "d"), sums)

    specs = (P(), P("d"), P("d"), P(None, "d"))
    sharded = jax.shard_map(share, mesh=mesh, in_specs=specs, out_specs=P(), check_vma=False)
    compiled = jax.jit(sharded)
    parameters = put(problem.parameters, P())
    return lambda: compiled(parameters, *data)


def obvious(problem):
    """The full batch at once, on one device."""
    points, initial = jnp.array(problem.collocation), jnp.array(problem.initial)

    def loss(parameters, points, initial):
        physics = problem.physics_loss(parameters, points)
        return problem.initial_loss(parameters, initial) + physics

    compiled = jax.jit(jax.value_and_grad(loss))
    return lambda: compiled(problem.parameters, points, initial)


def authors(problem):
    """The full batch, dy/dt by automatic differentiation inside that of the loss."""
    e = problem.e
    points, initial = jnp.array(e.collocation), jnp.array(e.initial)

    def net(parameters, points):
        a = (points - e.input_mean) / e.input_std
        for w, b in parameters[:-1]:
            a = jnp.tanh(a @ w.T + b)
        w, b = parameters[-1]
        return (a @ w.T + b) * e.output_std + e.output_mean

    def loss(parameters, points, initial):
        of_time = lambda t: net(parameters, jnp.concatenate([t, points[:, 1:]], axis=1))
        t = points[:, :1]
        y, dy = jax.jvp(of_time, (t,), (jnp.ones_like(t),))
        f = jnp.stack(right_hand_side(y[:, 0], y[:, 1], points[:, 3]), axis=1)
        physics = e.physics_factor * jnp.sum(((dy - f) * e.residual_scale) ** 2)
        error = (net(parameters, initial) - initial[:, 1:3]) * e.initial_scale
        return physics + e.initial_factor * jnp.sum(error**2)

    compiled = jax.jit(jax.value_and_grad(loss))
    return lambda: compiled(problem.parameters, points, initial)


def best_tuned(problem):
    """The fastest of those settings of `tuned` that come near the best, here and now."""
    settings = [
        dict(chunk=chunk, layout=layout, tanh=tanh)
        for chunk in (128, 256, 512)
        for layout in ("split", "stacked")
        for tanh in (tanh_exp, jnp.tanh)
    ]
    works = [tuned(problem, **setting) for setting in settings]
    return min(works, key=lambda work: timed(work, 0.5))


VARIANTS = {"tuned": best_tuned, "obvious": obvious, "authors": authors}


def timed(work, seconds=1.5):
    """The median time of `work`, in ms, over about so many seconds."""
    jax.block_until_ready(work())
    times, begun = [], time.perf_counter()
    while len(times) < 5 or time.perf_counter() - begun < seconds:
        clock = time.perf_counter()
        jax.block_until_ready(work())
        times.append(time.perf_counter() - clock)
    return 1e3 * statistics.median(times)


def tune(problem, evaluation):
    """All settings of `tuned`: wall time, and processor time by the number of devices, which other
    programs on the machine disturb less."""
    for hand in (True, False):
        for layout in ("split", "stacked"):
            for tanh in (tanh_exp, jnp.tanh):
                for chunk in (64, 128, 256, 512, 1024, 4096):
                    work = tuned(problem, chunk, layout, tanh, hand)
                    ev.check(evaluation, "tuned", *work())
                    wall = timed(work, 0.7)
                    clock = time.process_time()
                    for _ in range(10):
                        jax.block_until_ready(work())
                    processor = 100.0 * (time.process_time() - clock) / DEVICES
                    backward = "by hand" if hand else "automatic"
                    print(f"{wall:8.1f} ms  {processor:8.1f} ms  chunk {chunk:5}  {layout:8}"
                          f"{tanh.__name__:9} backward {backward}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", help="written by `pinc bench --loss-gradient-file`")
    parser.add_argument("--tune", action="store_true", help="try settings of the tuned one")
    arguments = parser.parse_args()
    evaluation = ev.read(arguments.file)
    problem = Problem(evaluation)
    if arguments.tune:
        return tune(problem, evaluation)
    for name, build in VARIANTS.items():
        work = build(problem)
        error = ev.check(evaluation, name, *work())
        print(f"{name:8}  {timed(work):8.1f} ms   differs from pinc by {error:.0e}")


if __name__ == "__main__":
    main()
