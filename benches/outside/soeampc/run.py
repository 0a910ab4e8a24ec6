"""Makes soeampc's labels for its stirred tank, shrinks the controller, and counts fallbacks.

usage: python run.py [--labels 960000] [--loops 1000] [--out DIR]

The problem is of the repository hshose/soeampc (H. Hose, J. Koehler, M. N. Zeilinger, S. Trimpe,
"Approximate non-linear model predictive control with safety-augmented neural networks", 2023), folder
examples/stirtank: cstr.toml has its numbers. As there, states are drawn in the box of their bounds
until so many have a plan that is optimal and ends in the terminal set, x' P x <= alpha^2 within 1e-4.

What differs: the model takes 8 steps of RK4 where soeampc has an implicit method of 6 stages; the
terminal set is not a constraint of the problem, but a plan that ends outside it is no label; bounds do
not shrink along the horizon, by 0.05 % at most; and the input u = K x + v is within its bounds at both
ends of an interval. In the loop it is not clipped. A loop's first plan to fall back on holds v = 0, where
soeampc has a plan of its controller.
"""

import argparse
import pathlib
import time
from collections import Counter

import numpy as np

import pinc_nmpc as pinc

HERE = pathlib.Path(__file__).resolve().parent
P = np.array([[2.94367120497978, -0.0940402114388137], [-0.0940402114388137, 0.131511527944079]])
# alpha less what the disturbance takes of it over the horizon, and the tolerance of soeampc's check.
ALPHA = 0.000803673335633732 - 0.0801275940617796 * 3.83125434992557e-05 / 0.05 * (1 - np.exp(-1.0))
TERMINAL = ALPHA**2 + 1e-4
CHUNK = 40_000


def rates(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    y1, y2 = x[:, 0] + 0.2632, x[:, 1] + 0.6519
    u = 4.18568208028577 * x[:, 0] + 48.6017393013163 * x[:, 1] + v
    reaction = 300.0 * y1 * np.exp(-5.0 / y2)
    cooling = 0.117 * (u + 0.7853) * (y2 - 0.3816)
    return np.stack([(1 - y1) / 20 - reaction, (0.3947 - y2) / 20 + reaction - cooling], axis=1)


def ends(x: np.ndarray, plans: np.ndarray) -> np.ndarray:
    """The states at the ends of plans."""
    h = 0.25
    for v in plans[:, :, 0].T:
        for _ in range(8):
            k1 = rates(x, v)
            k2 = rates(x + 0.5 * h * k1, v)
            k3 = rates(x + 0.5 * h * k2, v)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3, v))
    return x


def labels(batch: pinc.NmpcBatch, count: int) -> tuple[np.ndarray, int, float]:
    """At least so many states with labels, how many were drawn, and the controller's time in s."""
    random = np.random.default_rng(42)
    found: list[np.ndarray] = []
    drawn, taken = 0, 0.0
    while sum(map(len, found)) < count:
        x = random.uniform(-0.2, 0.2, (CHUNK, 2))
        begin = time.perf_counter()
        steps = batch.steps(x, np.zeros(3))
        taken += time.perf_counter() - begin
        last = ends(x, steps.inputs)
        inside = np.einsum("ki,ij,kj->k", last, P, last) <= TERMINAL
        found.append(x[inside & (np.array(steps.status) == "converged")])
        drawn += CHUNK
    return np.concatenate(found), drawn, taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--labels", type=int, default=960_000)
    parser.add_argument("--loops", type=int, default=1000)
    parser.add_argument("--out", default="runs/soeampc")
    given = parser.parse_args()
    config = HERE / "cstr.toml"
    x, drawn, taken = labels(pinc.NmpcBatch(config), given.labels)
    print(f"{len(x)} labels of {drawn} states: {taken:.1f} s of the controller", flush=True)
    begin = time.perf_counter()
    shrunk = pinc.shrink(config, out=given.out, only="rk4", iterations=1500)
    print(f"{shrunk}\n{time.perf_counter() - begin:.1f} s for the net", flush=True)
    policy = str(shrunk.directory / "policy.json")
    sets = {"control.models": ["rk4", "policy"], "control.policy": policy}
    x = x[: given.loops]
    for name in ["rk4", "policy"]:
        batch = pinc.NmpcBatch(config, only=name, overrides=sets)
        loops = batch.loops(x, np.zeros((50, 3)))
        # As in soeampc, a loop ends in the terminal set.
        states = loops.states[:, :-1]
        outside = np.einsum("lki,ij,lkj->lk", states, P, states) > TERMINAL
        counted = Counter(np.array(loops.status)[outside].tolist())
        shares = {status: f"{count / outside.sum():.2%}" for status, count in counted.items()}
        broken = (np.abs(loops.states[:, 1:]) > 0.2002).any(axis=(1, 2)).sum()
        print(name, shares, f"IAE {loops.iae.mean():.4f}, bounds broken in {broken} of {len(x)} loops")


main()
