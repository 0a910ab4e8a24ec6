"""PINC and do-mpc on five of do-mpc's examples, each in the example's own simulator.

usage: python run.py do-mpc/examples [EXAMPLE...] [--out TABLE.csv]

Needs the packages pinc-nmpc and do-mpc, and the examples of https://github.com/do-mpc/do-mpc, whose
model, controller and simulator are taken as they are. PINC solves the problem of a config of this
repository with the weights and parameters of the example below; do-mpc weights moves of scaled inputs.

The differences of inputs are along do-mpc's loop: PINC is given the state and the last input, and its
input is compared with do-mpc's, in widths of the bounds. The cost of a loop is what the example minimizes,
without the moves, summed over the loop of each controller. Times are medians of CPU times.
"""

import argparse
import csv
import importlib.util
import math
import pathlib
import statistics
import sys
import time
import tomllib

import casadi
import numpy as np

import pinc_nmpc as pinc

CONFIGS = pathlib.Path(__file__).resolve().parents[3] / "configs"


class Example:
    """A config, the steps of a loop and the cost of a state and the input that led there; the units of
    do-mpc's inputs in PINC's, how the config is to be changed, and what do-mpc's model, controller and
    simulator are told."""

    def __init__(self, config, steps, cost, units=(1.0,), change=None, model=(), mpc=(), simulator=()):
        self.config, self.steps, self.cost, self.units = config, steps, cost, np.array(units)
        self.change = change or (lambda config: None)
        self.model, self.mpc, self.simulator = model, mpc, simulator


def of_batch_reactor(config):
    """The example's yield."""
    config["plant"]["expression"]["parameters"]["Yx"] = 0.5


def of_polymerization(config):
    """The example's scenarios, its weights of moves, and its adiabatic temperature as a state."""
    plant, control = config["plant"]["expression"], config["control"]
    plant["states"].append({"name": "adiabatic", "unit": "K"})
    plant["let"]["heating"] = " ".join(plant["derivatives"]["T_R"].split())
    plant["derivatives"]["T_R"] = "heating"
    plant["derivatives"]["adiabatic"] = (
        "heating + delta_H/(c_R*mass)*(feed*(w_A - m_A/mass) - inside - outside)"
    )
    control["state_high"]["adiabatic"] = control.pop("output_high")[0]
    del plant["outputs"], control["output_softness"]
    water, monomer, product, temperature = control["initial_state"][:4]
    rise = 950.0 * monomer / (5.0 * (water + monomer + product))
    control["initial_state"].append(temperature + rise)
    control["r"][0] /= 1e4
    values = {"delta_H": [950.0, 1235.0, 665.0], "k_0": [7.0, 9.1, 4.9]}
    control["scenarios"] = {"values": values, "robust_horizon": 1}


def of_pendulum(x, _):
    """Distance of the cart from its place and potential energy of both rods."""
    return 10 * (x[0] + 0.8) ** 2 - 9.80665 * (0.15 * math.cos(x[1]) + 0.05 * math.cos(x[2]))


def of_kite(x, u):
    """The pull in mean wind."""
    lift = 6.0 - 0.028 * u[0] ** 2
    return -0.5 * 10.0**2 * 300.0 * math.cos(x[0]) ** 3 * (lift + 1) * math.hypot(lift, 1) / 1e4


EXAMPLES = {
    "CSTR": Example(
        CONFIGS / "robust/reactor.toml", 50, lambda x, _: (x[1] - 0.6) ** 2, units=(1.0, 1e-3)
    ),
    "batch_reactor": Example(
        CONFIGS / "gallery/batch-reactor.toml", 150, lambda x, _: -x[2], change=of_batch_reactor
    ),
    "double_inverted_pendulum": Example(
        CONFIGS / "gallery/double-pendulum.toml",
        100,
        of_pendulum,
        model=[[{"x": 0.0, "y": 0.6, "r": 0.3}]],
    ),
    "industrial_poly": Example(
        CONFIGS / "gallery/polymerization.toml",
        30,
        lambda x, _: -x[2],
        units=(1.0, 1.0, 1.0),
        change=of_polymerization,
    ),
    # Mean wind, lift over drag and least height, which the example draws.
    "kite": Example(
        pathlib.Path(__file__).with_name("kite.toml"),
        100,
        of_kite,
        mpc=[10.0, 6.0, 100.0],
        simulator=[10.0, 6.0],
    ),
}


def part(folder, name):
    """A function of a file of an example that has its name."""
    sys.path.append(str(folder))
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name)


def without_algebraic(simulator):
    """The simulator with its algebraic equations, which are linear, solved for: the example's IDAS ends
    at some states of the pendulum."""
    x, z, p, ode, equation = (casadi.vertcat(simulator.dae[key]) for key in ("x", "z", "p", "ode", "alg"))
    if z.numel():
        rest = casadi.substitute(equation, z, casadi.DM.zeros(z.numel()))
        ode = casadi.substitute(ode, z, -casadi.solve(casadi.jacobian(equation, z), rest))
        problem = {"x": x, "p": p, "ode": ode}
        accuracy = {"abstol": 1e-8, "reltol": 1e-8}
        own = casadi.integrator("own", "cvodes", problem, 0.0, simulator.settings.t_step, accuracy)
        simulator.simulator = lambda x0, z0, p: {**own(x0=x0, p=p), "zf": 0 * z0.cat}
    return simulator


def timed(call, times):
    begun = time.process_time()
    result = call()
    times.append(time.process_time() - begun)
    return result


def judged(folder, example):
    """The row of the table."""
    model = part(folder, "template_model")(*example.model)
    mpc = part(folder, "template_mpc")(model, *example.mpc, silence_solver=True)
    config = tomllib.loads(example.config.read_text())
    example.change(config)
    ours = pinc.Nmpc(config)
    control = config["control"]
    scenarios = control.get("scenarios", {"values": {}})
    width = np.subtract(control["input_high"], control["input_low"])
    start = np.array(control["initial_state"])

    def loop(choose):
        simulator = without_algebraic(part(folder, "template_simulator")(model, *example.simulator))
        np.random.seed(1)  # of the kite's wind
        x, cost = start, 0.0
        simulator.x0 = x
        for _ in range(example.steps):
            u = choose(x)
            x = simulator.make_step(u.reshape(-1, 1)).ravel()
            cost += example.cost(x, u)
        return cost

    its, own, differences, failed = [], [], [], [0, 0]

    def of_dompc(x):
        u = timed(lambda: mpc.make_step(x.reshape(-1, 1)), its).ravel()
        failed[0] += not mpc.solver_stats["success"]
        before = {} if len(its) == 1 else {"u_applied": of_dompc.before}
        step = ours.step(x, **before)
        of_dompc.before = u * example.units
        differences.append(float(np.max(np.abs(step.u - of_dompc.before) / width)))
        return u

    def of_ours(x):
        step = timed(lambda: ours.step(x), own)
        failed[1] += step.status != "converged"
        return step.u / example.units

    mpc.x0 = start
    mpc.u0 = np.array(control.get("initial_input", [0.0] * len(width))) / example.units
    mpc.set_initial_guess()
    costs = [loop(of_dompc)]
    ours.reset()
    costs.append(loop(of_ours))
    times = [statistics.median(values) for values in (its, own)]
    print(f"{failed[0]} and {failed[1]} of {example.steps} steps did not converge", flush=True)
    return {
        "example": folder.name,
        "states": len(start),
        "scenarios": math.prod(len(of) for of in scenarios["values"].values()),
        "horizon": control["n2"],
        "inputs differ by (median)": f"{statistics.median(differences):.1e}",
        "at most": f"{max(differences):.1e}",
        "do-mpc's cost": f"{costs[0]:.6g}",
        "PINC's cost": f"{costs[1]:.6g}",
        "do-mpc's step (ms)": f"{1e3 * times[0]:.1f}",
        "PINC's step (ms)": f"{1e3 * times[1]:.3f}",
        "times shorter": f"{times[0] / times[1]:.{0 if times[1] < times[0] else 2}f}",
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("examples", nargs="*", default=list(EXAMPLES), metavar="EXAMPLE")
    parser.add_argument("--out", type=pathlib.Path, help="the table, as CSV")
    given = parser.parse_args()
    rows = [judged(given.folder / name, EXAMPLES[name]) for name in given.examples]
    for row in rows:
        print(", ".join(f"{key}: {value}" for key, value in row.items()))
    if given.out:
        with open(given.out, "w", newline="") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
