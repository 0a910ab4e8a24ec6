"""RK4 with Jacobians on the rod of configs/distributed/rod.toml: pinc against CasADi's generated C.

    cargo build --release
    python benches/peers/rod.py [--pinc target/release/pinc] [--nodes 10 20 50 100] [--rounds 5]

Time of one stage: four substeps of RK4 with the Jacobians by state and input. CasADi's code is compiled
by gcc -O3 -march=native and called by a C program, one stage after the other, in one thread. pinc gets
the stages of a horizon of 20 at once, as its controller does, in one thread too. Both are run in turn, and
the least of all rounds counts. That they compute the same is checked at one point.

The more nodes, the faster the heat spreads between them: the config's stage is halved until RK4 is
stable on it (from 50 nodes on).

Two forms of the same derivatives are generated, since neither is the faster one for every size:

expanded    the step with its Jacobian as one list of scalar operations, with the zeros left out
substeps    a function of a substep with its Jacobian, called four times; sparse products between them

Of more than --expanded nodes only the second is generated: the compiler takes minutes for the first.
"""

import argparse
import ctypes
import json
import math
import subprocess
import tempfile
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np

TOP = Path(__file__).resolve().parents[2]
CONFIG = TOP / "configs/distributed/rod.toml"
SUBSTEPS = 4
STAGES = 20

DRIVER = """
#include <stdio.h>
#include <string.h>
#include <time.h>
#include "NAME.c"

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

/* The time of a call in ns, least of some rounds of about a millisecond each. */
double least_ns(const double *x, const double *u, double *next, double *a, double *b) {
    static casadi_int iw[NAME_SZ_IW + 1];
    static double w[NAME_SZ_W + 1];
    const double *arg[NAME_SZ_ARG + 1];
    double *res[NAME_SZ_RES + 1];
    double least = 1e9;
    for (int round = 0; round < 200; round++) {
        const double begun = seconds();
        int calls = 0;
        do {
            arg[0] = x, arg[1] = u;
            res[0] = next, res[1] = a, res[2] = b;
            NAME(arg, res, iw, w, 0);
            calls++;
        } while (calls < 20 || seconds() - begun < 1e-3);
        const double each = (seconds() - begun) / calls;
        if (each < least) least = each;
    }
    return 1e9 * least;
}
"""


def rod(nodes, parameters):
    """f(x, u) as a function of CasADi."""
    p = parameters
    x, power = ca.SX.sym("x", nodes), ca.SX.sym("P")
    dz, area = p["length"] / nodes, math.pi * p["diameter"] ** 2 / 4
    flow = [power]
    flow += [p["conductivity"] * area / dz * (x[i] - x[i + 1]) for i in range(nodes - 1)]
    flow.append(p["h_end"] * area * (x[nodes - 1] - p["ambient"]))
    surface = math.pi * p["diameter"] * dz
    dx = []
    for i in range(nodes):
        kelvin = x[i] + 273.15
        square = kelvin * kelvin
        radiation = p["emissivity"] * p["sigma"] * (square * square - (p["ambient"] + 273.15) ** 4)
        loss = surface * (p["h"] * (x[i] - p["ambient"]) + radiation)
        dx.append((flow[i] - flow[i + 1] - loss) / (p["density"] * p["heat_capacity"] * area * dz))
    return ca.Function("rhs", [x, power], [ca.vertcat(*dx)])


def stage_s(nodes, config):
    """The length of a stage in s: the config's, halved until RK4 is far from unstable."""
    p = config["plant"]["expression"]["parameters"]
    diffusivity = p["conductivity"] / (p["density"] * p["heat_capacity"])
    fastest = 4 * diffusivity / (p["length"] / nodes) ** 2
    stage = config["model"]["horizon_s"]
    while stage / SUBSTEPS * fastest > 1.4:
        stage /= 2
    return stage


def substep(rhs, h, x, u):
    k1 = rhs(x, u)
    k2 = rhs(x + h / 2 * k1, u)
    k3 = rhs(x + h / 2 * k2, u)
    k4 = rhs(x + h * k3, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def expanded(rhs, nodes, h):
    x, u = ca.SX.sym("x", nodes), ca.SX.sym("u")
    one = ca.Function("one", [x, u], [substep(rhs, h, x, u)])
    along = ca.Function("along", [x, u], [ca.jacobian(one(x, u), x), ca.jacobian(one(x, u), u)])
    return propagated(one, along, x, u)


def by_substeps(rhs, nodes, h):
    x, u = ca.SX.sym("x", nodes), ca.SX.sym("u")
    to = substep(rhs, h, x, u)
    both = ca.Function("both", [x, u], [to, ca.jacobian(to, x), ca.jacobian(to, u)], {"cse": True})
    x, u = ca.MX.sym("x", nodes), ca.MX.sym("u")
    state, a, b = x, None, None
    for _ in range(SUBSTEPS):
        state, ja, jb = both(state, u)
        a, b = (ja, jb) if a is None else (ja @ a, ja @ b + jb)
    return [x, u], [state, ca.densify(a), ca.densify(b)]


def propagated(one, along, x, u):
    state, a, b = x, None, None
    for _ in range(SUBSTEPS):
        ja, jb = along(state, u)
        a, b = (ja, jb) if a is None else (ja @ a, ja @ b + jb)
        state = one(state, u)
    return [x, u], [state, ca.densify(a), ca.densify(b)]


def compiled(form, name, folder):
    """The function in a library with the driver, by its time and results at a point."""
    arguments, results = form
    options = {"cse": True} if isinstance(arguments[0], ca.SX) else {}
    function = ca.Function(name, arguments, results, options)
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": False})
    generator.add(function)
    generator.generate(str(folder) + "/")
    sizes = {
        "SZ_ARG": function.sz_arg(),
        "SZ_RES": function.sz_res(),
        "SZ_IW": function.sz_iw(),
        "SZ_W": function.sz_w(),
    }
    driver = DRIVER
    for key, size in sizes.items():
        driver = driver.replace(f"NAME_{key}", str(size))
    source, library = folder / f"{name}_driver.c", folder / f"{name}.so"
    source.write_text(driver.replace("NAME", name))
    flags = ["-O3", "-march=native", "-shared", "-fPIC", "-w"]
    subprocess.run(["gcc", *flags, str(source), "-o", str(library), "-lm"], check=True)
    call = ctypes.CDLL(str(library)).least_ns
    call.restype = ctypes.c_double
    return call


def measured(call, nodes, x, u):
    """Least time of a stage in ns, and the state after it."""
    vectors = [np.array(x), np.array([u]), np.zeros(nodes), np.zeros(nodes * nodes), np.zeros(nodes)]
    pointers = [v.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for v in vectors]
    return call(*pointers), vectors[2]


def pincs(pinc, nodes, stage):
    """The time of a stage of pinc's RK4 in ns, a median of some hundred."""
    sets = {
        "plant.expression.sizes.n": nodes,
        "model.horizon_s": stage,
        "control.rk4_substeps": SUBSTEPS,
        "control.duration_s": 10 * stage,
        "control.references": "[{start_s = 0.0, value = [120.0]}]",
        "one_step": "{points = 64}",
    }
    with tempfile.TemporaryDirectory() as folder:
        arguments = [str(pinc), "control", str(CONFIG), "--only", "rk4", "--out", folder]
        for key, value in sets.items():
            arguments += ["--set", f"{key}={value}"]
        done = subprocess.run(arguments, capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(f"{' '.join(arguments)}\n{done.stderr}")
        metrics = json.loads((Path(folder) / "metrics.json").read_text())
    return metrics["one_step"][0]["forward_jacobian_ns"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pinc", type=Path, default=TOP / "target/release/pinc")
    parser.add_argument("--nodes", type=int, nargs="+", default=[10, 20, 50, 100])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--expanded", type=int, default=20, help="most nodes of this form")
    options = parser.parse_args()
    config = tomllib.loads(CONFIG.read_text())
    parameters = config["plant"]["expression"]["parameters"]
    print(f"{'nodes':>5} {'pinc, us':>9} {'expanded':>9} {'substeps':>9}   a stage; the horizon has {STAGES}")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for nodes in options.nodes:
            rhs = rod(nodes, parameters)
            stage = stage_s(nodes, config)
            h = stage / SUBSTEPS
            calls = {"substeps": compiled(by_substeps(rhs, nodes, h), f"substeps{nodes}", folder)}
            if nodes <= options.expanded:
                calls["expanded"] = compiled(expanded(rhs, nodes, h), f"expanded{nodes}", folder)
            x = list(np.linspace(140.0, 80.0, nodes))
            least = {}
            for _ in range(options.rounds):
                times = {"pinc": pincs(options.pinc, nodes, stage)}
                for name, call in calls.items():
                    times[name], reached = measured(call, nodes, x, 40.0)
                    check(rhs, h, x, reached)
                for name, ns in times.items():
                    least[name] = min(least.get(name, math.inf), ns)
            shown = [f"{least[name] / 1e3:9.2f}" if name in least else f"{'-':>9}"
                     for name in ("pinc", "expanded", "substeps")]
            print(f"{nodes:5}", *shown, flush=True)


def check(rhs, h, x, reached):
    """That generated code takes the step that the equation says."""
    state = ca.DM(x)
    for _ in range(SUBSTEPS):
        state = substep(rhs, h, state, 40.0)
    if np.abs(np.array(state).ravel() - reached).max() > 1e-9:
        raise SystemExit("generated code and the equation disagree")


if __name__ == "__main__":
    main()
