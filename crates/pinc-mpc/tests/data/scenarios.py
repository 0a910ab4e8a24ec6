#!/usr/bin/env python3
"""Writes scenarios.toml: random control problems on scenario trees of three plants, with the first inputs
that IPOPT finds for them. Needs CasADi and numpy.

    python3 scenarios.py > scenarios.toml

Each problem is written out as one nonlinear program by direct multiple shooting: a state per node, an input per
node before the control horizon, RK4 with fixed substeps between nodes, slacks of soft bounds. Nodes are paths of
branches, kept in dictionaries. IPOPT works with exact derivatives to a tolerance of 1e-12; problems that it does
not solve are left out. The plants: the Van der Pol oscillator with the damping as parameter, four tanks with
both pump constants, and a stirred-tank reactor with two factors of its kinetics (van de Vusse reactions; numbers
of K.-U. Klatt and S. Engell, "Gain-scheduling trajectory control of a continuous stirred tank reactor", Computers
& Chemical Engineering 22 (1998), in the version with uncertain alpha and beta of S. Lucia et al.).
"""
import itertools

import casadi as ca
import numpy as np

CASES = 54
SUBSTEPS = 4


def van_der_pol(x, u, p):
    return [x[1], p[0] * (1 - x[0] ** 2) * x[1] - x[0] + u[0]]


def four_tanks(h, u, k):
    area, outlet, gamma = [28.0, 32.0, 28.0, 32.0], [0.071, 0.057, 0.071, 0.057], [0.7, 0.6]
    out = [outlet[i] * ca.sqrt(2 * 981.0 * h[i]) for i in range(4)]
    return [
        (gamma[0] * k[0] * u[0] + out[2] - out[0]) / area[0],
        (gamma[1] * k[1] * u[1] + out[3] - out[1]) / area[1],
        ((1 - gamma[1]) * k[1] * u[1] - out[2]) / area[2],
        ((1 - gamma[0]) * k[0] * u[0] - out[3]) / area[3],
    ]


def reactor(x, u, p):
    ca_, cb, tr, tk = x[0], x[1], x[2], x[3]
    flow, heat = u[0], 1000 * u[1]
    k1 = p[1] * 1.287e12 * ca.exp(-9758.3 / (tr + 273.15))
    k2 = 1.287e12 * ca.exp(-9758.3 / (tr + 273.15))
    k3 = 9.043e9 * ca.exp(-p[0] * 8560.0 / (tr + 273.15))
    rho, cp, wall = 0.9342, 3.01, 4032.0 * 0.215
    return [
        flow * (5.1 - ca_) - k1 * ca_ - k3 * ca_**2,
        -flow * cb + k1 * ca_ - k2 * cb,
        (k1 * ca_ * 4.2 - k2 * cb * 11.0 - k3 * ca_**2 * 41.85) / (-rho * cp)
        + flow * (130.0 - tr)
        - wall * (tr - tk) / (rho * cp * 10.01),
        (heat + wall * (tr - tk)) / 10.0,
    ]


PLANTS = {
    "van-der-pol": dict(
        rhs=van_der_pol, dims=(2, 1, 1), step=0.5, tracked=[0, 1], q=[10.0, 10.0], r=[1.0],
        u=([-1.0], [1.0]), x=([-1.0, -1.0], [1.0, 1.0]),
        start=([-0.6, -0.6], [0.6, 0.6]), reference=([-0.6, 0.0], [0.6, 0.0]),
        nominal=[1.0], spread=0.4,
    ),
    "four-tanks": dict(
        rhs=four_tanks, dims=(4, 2, 2), step=10.0, tracked=[0, 1], q=[10.0, 10.0], r=[1.0, 1.0],
        u=([0.0, 0.0], [5.0, 5.0]), x=([2.0, 2.0, 0.6, 0.6], [16.0, 16.0, 5.5, 5.5]),
        start=([8.0, 8.0, 1.0, 1.0], [14.0, 14.0, 3.0, 3.0]), reference=([9.0, 9.0], [15.0, 15.0]),
        nominal=[3.33, 3.35], spread=0.15,
    ),
    "reactor": dict(
        rhs=reactor, dims=(4, 2, 2), step=0.005, tracked=[1], q=[100.0], r=[1e-3, 1e-2],
        u=([5.0, -8.5], [100.0, 0.0]), x=([0.1, 0.1, 50.0, 50.0], [2.0, 2.0, 136.0, 136.0]),
        start=([0.7, 0.45, 130.0, 126.0], [0.9, 0.55, 134.5, 131.0]), reference=([0.55], [0.65]),
        nominal=[1.0, 1.0], spread=0.05,
    ),
}
# The reactor as do-mpc's example CSTR has it, but for the integrator and for the weights of later changes of
# the inputs: nine scenarios over 20 steps, a soft limit of 140 degrees; from its start, and from hot ones.
LONG = PLANTS["reactor"] | dict(
    q=[1.0], r=[1e-5, 2.5e-4], x=([0.1, 0.1, 50.0, 50.0], [2.0, 2.0, 140.0, 140.0]),
)
STARTS = [
    [0.8, 0.5, 134.14, 130.0], [0.8, 0.5, 141.5, 138.0], [0.7, 0.4, 139.5, 139.0], [1.2, 0.6, 141.0, 132.0],
]


def step_function(plant):
    n, m, np_ = plant["dims"]
    x, u, p = ca.SX.sym("x", n), ca.SX.sym("u", m), ca.SX.sym("p", np_)
    f = lambda z: ca.vertcat(*plant["rhs"](z, u, p))
    h, z = plant["step"] / SUBSTEPS, x
    for _ in range(SUBSTEPS):
        k1 = f(z)
        k2 = f(z + h / 2 * k1)
        k3 = f(z + h / 2 * k2)
        k4 = f(z + h * k3)
        z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("F", [x, u, p], [z])


def solve(plant, case):
    """The first input, or None."""
    n, m, _ = plant["dims"]
    step = step_function(plant)
    branches, robust, horizon, control = case["values"], case["robust"], case["horizon"], case["control"]
    w, w0, low, high, g, g_low, g_high, cost = [], [], [], [], [], [], [], 0
    states, inputs, weight = {(): ca.DM(case["x"])}, {}, {(): 1.0}

    def unknown(name, size, start, least, most):
        v = ca.SX.sym(name, size)
        w.append(v), w0.extend(start), low.extend(least), high.extend(most)
        return v

    for depth in range(horizon + 1):
        for path in [path for path in states if len(path) == depth]:
            if depth < control:
                inputs[path] = unknown("u", m, case["previous"], *plant["u"])
                before = inputs[path[:-1]] if path else ca.DM(case["previous"])
                for i in range(m):
                    cost += weight[path] * plant["r"][i] * (inputs[path][i] - before[i]) ** 2
            else:
                inputs[path] = inputs[path[:-1]]
            if depth == horizon:
                continue
            followers = range(len(branches)) if depth < robust else path[-1:]
            for branch in followers:
                child = path + (branch,)
                part = case["weights"][branch] if depth < robust else 1.0
                weight[child] = weight[path] * part
                soft = case["penalty"]
                free = [-np.inf] * n, [np.inf] * n
                states[child] = unknown("x", n, case["x"], *(free if soft else plant["x"]))
                g.append(step(states[path], inputs[path], branches[branch]) - states[child])
                g_low.extend([0] * n), g_high.extend([0] * n)
                if soft:
                    slack = unknown("s", n, [0.1] * n, [0] * n, [np.inf] * n)
                    g.append(states[child] - slack), g_low.extend(free[0]), g_high.extend(plant["x"][1])
                    g.append(states[child] + slack), g_low.extend(plant["x"][0]), g_high.extend(free[1])
                    for i in range(n):
                        cost += weight[child] * soft[i] * slack[i]
                for i, (state, value) in enumerate(zip(plant["tracked"], case["reference"])):
                    cost += weight[child] * plant["q"][i] * (states[child][state] - value) ** 2
    nlp = {"x": ca.vertcat(*w), "f": cost, "g": ca.vertcat(*g)}
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-12,
               "ipopt.dual_inf_tol": 1e-9, "ipopt.constr_viol_tol": 1e-11, "ipopt.compl_inf_tol": 1e-11,
               "ipopt.bound_relax_factor": 0.0, "ipopt.max_iter": 500, "ipopt.acceptable_iter": 0}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    found = solver(x0=w0, lbx=low, ubx=high, lbg=g_low, ubg=g_high)
    if not solver.stats()["success"]:
        return None
    return [float(v) for v in np.array(ca.Function("u", [nlp["x"]], [inputs[()]])(found["x"])).flatten()]


def draw(rng, plant, number):
    n, m, count = plant["dims"]
    uniform = lambda low, high: [round(float(rng.uniform(a, b)), 3) for a, b in zip(low, high)]
    nominal, spread = np.array(plant["nominal"]), plant["spread"]
    robust = 1 + number % 2
    lists = [[1.0] + [1 + s * spread * rng.uniform(0.4, 1.0) for s in (1, -1)[: 2 - (robust - 1)]] for _ in range(count)]
    if robust == 2:
        lists = lists[:1] + [[1.0]] * (count - 1)
    values = [[round(float(v * f), 4) for v, f in zip(nominal, factors)] for factors in itertools.product(*lists)]
    weights = rng.uniform(0.5, 1.5, len(values))
    weights = [1 / len(values)] * len(values) if number % 3 == 0 else [float(w) for w in weights / weights.sum()]
    horizon = int(rng.integers(robust + 2, robust + 6))
    u_low, u_high = plant["u"]
    middle = [a + 0.3 * (b - a) for a, b in zip(u_low, u_high)], [a + 0.7 * (b - a) for a, b in zip(u_low, u_high)]
    return {
        "x": uniform(*plant["start"]),
        "previous": uniform(*middle),
        "reference": uniform(*plant["reference"]),
        "values": values,
        "weights": weights,
        "robust": robust,
        "horizon": horizon,
        "control": int(rng.integers(robust + 1, horizon + 1)),
        "penalty": [] if number % 4 < 2 else [round(float(v), 2) for v in rng.uniform(0.5, 20.0, n)],
    }


def write(name, plant, case):
    """Solves and prints a case; whether IPOPT solved it."""
    u = solve(plant, case)
    if u is None:
        return False
    keys = {"tracked": plant["tracked"], "q": plant["q"], "r": plant["r"]}
    keys |= {f"{of}_{side}": plant[of][i] for of in "ux" for i, side in enumerate(["low", "high"])}
    print(f'\n[[case]]\nplant = "{name}"')
    for key, value in (keys | case | {"u": u}).items():
        print(f"{key} = {value}")
    return True


def main():
    rng = np.random.default_rng(40)
    print("# Written by scenarios.py: random problems on scenario trees with IPOPT's first inputs.")
    done = {name: 0 for name in PLANTS}
    while min(done.values()) < CASES // len(PLANTS):
        for name, plant in PLANTS.items():
            if done[name] == CASES // len(PLANTS):
                continue
            done[name] += write(name, plant, draw(rng, plant, done[name]))
    values = [list(v) for v in itertools.product([1.0, 1.05, 0.95], [1.0, 1.1, 0.9])]
    for x in STARTS:
        case = {"x": x, "previous": [0.0, 0.0], "reference": [0.6], "values": values, "weights": [1 / 9] * 9,
                "robust": 1, "horizon": 20, "control": 20, "penalty": [1e4, 1e4, 100.0, 1e4]}
        assert write("reactor", LONG, case), x


main()
