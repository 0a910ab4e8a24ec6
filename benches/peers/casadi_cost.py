"""Solves the first plan of a config with a [control.cost] by IPOPT, on the discretization of PINC:
multiple shooting, classical RK4 with the config's substeps, the cost as one more state.

    python casadi_cost.py CONFIG.toml... > ../../crates/pinc/tests/suite/optima.jsonl
    python casadi_cost.py --beside PINC CONFIG.toml... >> ../../crates/pinc/tests/suite/optima.jsonl

Prints per config one line of JSON: objective, and the inputs of the plan. With --beside IPOPT starts at
the plan of PINC, the program, where it finds worse minima from the config's own first plan.
"""

import json
import pathlib
import subprocess
import sys
import tomllib

import casadi as ca

FUNCTIONS = {name: getattr(ca, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "tanh")}
FUNCTIONS |= {"atan": ca.atan, "abs": ca.fabs, "min": ca.fmin, "max": ca.fmax, "pi": ca.pi}


def evaluate(text, scope):
    return eval(f"({text})".replace("^", "**"), {"__builtins__": {}}, FUNCTIONS | scope)


def model(config):
    """x, u, t -> x', the rate of the cost, and the cost of an end."""
    plant, cost = config["plant"]["expression"], config["control"]["cost"]
    x = ca.SX.sym("x", len(plant["states"]))
    u = ca.SX.sym("u", len(plant["inputs"]))
    t = ca.SX.sym("t")
    scope = dict(plant.get("parameters", {}))
    named = lambda v: v if isinstance(v, str) else v["name"]
    scope |= {named(v): x[i] for i, v in enumerate(plant["states"])}
    scope |= {named(v): u[i] for i, v in enumerate(plant["inputs"])}
    waiting = dict(plant.get("let", {}))
    while waiting:
        for name, text in list(waiting.items()):
            try:
                scope[name] = evaluate(text, scope)
                del waiting[name]
            except NameError:
                pass
    dx = ca.vertcat(*(evaluate(plant["derivatives"][named(v)], scope) for v in plant["states"]))
    outputs = sorted(plant.get("outputs", {}).items())
    for name, output in outputs:
        text = output if isinstance(output, str) else output["expression"]
        scope[name] = evaluate(text, scope)
    bounded = ca.Function("h", [x, u], [ca.vertcat(*(scope[name] for name, _ in outputs))])
    seconds = {"min": 60.0, "h": 3600.0, "d": 86400.0}.get(plant.get("time_unit"), 1.0)
    scope |= cost.get("parameters", {}) | {"t": t}
    stage = evaluate(cost.get("stage", "0"), scope)
    end = evaluate(cost.get("terminal", "0"), scope)
    rates = ca.Function("f", [x, u, t], [dx / seconds, stage / seconds])
    return rates, ca.Function("e", [x, u, t], [end]), bounded


def step(f, n, m, length, substeps, stretch=None):
    y, v, s = ca.SX.sym("y", n), ca.SX.sym("v", m), ca.SX.sym("s")
    h = length / substeps * (1 if stretch is None else v[stretch])
    k1, l1 = f(y, v, s)
    k2, l2 = f(y + h / 2 * k1, v, s + h / 2)
    k3, l3 = f(y + h / 2 * k2, v, s + h / 2)
    k4, l4 = f(y + h * k3, v, s + h)
    j = ca.SX.sym("J")
    z = ca.vertcat(y, s, j)
    following = ca.vertcat(
        y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), s + h, j + h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)
    )
    sub = ca.Function("sub", [z, v], [following])
    chain = sub.mapaccum(substeps) if substeps > 1 else sub
    zx, zu, zt = ca.MX.sym("x", n), ca.MX.sym("u", m), ca.MX.sym("t")
    out = chain(ca.vertcat(zx, zt, 0), ca.repmat(zu, 1, substeps))
    last = out[:, -1]
    return ca.Function("F", [zx, zu, zt], [last[:n], last[n + 1]])


def listed(config):
    """[control] with its tables by name as lists."""
    plant, control = config["plant"]["expression"], dict(config["control"])
    states, inputs = ([v if isinstance(v, str) else v["name"] for v in plant[key]]
                      for key in ("states", "inputs"))
    inf = float("inf")
    outputs = sorted(plant.get("outputs", {}))
    for key, names, default in [("state_low", states, -inf), ("state_high", states, inf),
                                ("output_low", outputs, -inf), ("output_high", outputs, inf),
                                ("input_low", inputs, -inf), ("input_high", inputs, inf),
                                ("initial_input", inputs, 0.0), ("r", inputs, 0.0)]:
        if isinstance(control.get(key), dict):
            control[key] = [control[key].get(name, default) for name in names]
    ends = dict(control.get("end_state", {}))
    ends |= {name: control["initial_state"][states.index(name)] for name in control.get("periodic", [])}
    control["ends"] = [(i, ends[name]) for i, name in enumerate(states) if name in ends]
    stretch = control.get("free_time")
    control["stretch"] = inputs.index(stretch) if stretch else None
    return control


QUIET = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-11,
         "ipopt.max_iter": 5000, "ipopt.bound_relax_factor": 0.0}
# IPOPT goes to the nearest minimum instead of the middle of the bounds.
LOCAL = {"ipopt.mu_init": 1e-7, "ipopt.mu_strategy": "monotone", "ipopt.bound_push": 1e-9,
         "ipopt.bound_frac": 1e-9, "ipopt.slack_bound_push": 1e-9, "ipopt.slack_bound_frac": 1e-9,
         "ipopt.tol": 1e-10}


def solve(config, guess=None, options=None):
    """IPOPT's plan from the config's first plan, or the inputs `guess`, whose states follow by the model:
    objective, inputs, status, iterations, and the objective of the guess."""
    control = listed(config)
    n, m = len(control["initial_state"]), len(control["input_low"])
    lengths = control.get("stages_s", [control["step_s"]] * control["n2"])
    f, end, bounded = model(config)
    steps, stretch = {}, control["stretch"]
    for length in [None, *lengths]:
        own = length or lengths[0]
        substeps = max(1, -int(-control["rk4_substeps"] * own / lengths[0] * (1 - 1e-12) // 1))
        factor = stretch if length else None
        steps[length] = steps.get(length) or step(f, n, m, own, substeps, factor)
    inf = float("inf")
    X = [ca.MX.sym(f"x{j + 1}", n) for j in range(len(lengths))]
    U = [ca.MX.sym(f"u{j}", m) for j in range(control["nu"])]
    x, time, J, g, same = ca.DM(control["initial_state"]), 0.0, 0, [], []
    outputs, least, most = [], [], []
    previous = control.get("initial_input", [0.0] * m)
    r = control.get("r", [0.0] * m)
    for j, length in enumerate(lengths):
        u = U[min(j, len(U) - 1)]
        # The first stage is not stretched.
        following, cost = steps[length if j > 0 or stretch is None else None](x, u, time)
        J += cost
        if j < len(U):
            J += sum(w * (u[i] - previous[i]) ** 2 for i, w in enumerate(r))
            if j > 0 and stretch is not None:
                same.append(u[stretch] - previous[stretch])
            previous = u
        g.append(following - X[j])
        if "output_high" in control or "output_low" in control:
            outputs.append(bounded(X[j], u))
            least += control.get("output_low", [-inf] * outputs[-1].numel())
            most += control.get("output_high", [inf] * outputs[-1].numel())
        x, time = X[j], time + length
    J += end(x, U[-1], time)
    for i, value in control["ends"]:
        same.append(X[-1][i] - value)
    low = control.get("state_low", [-inf] * n) * len(X) + control["input_low"] * len(U)
    high = control.get("state_high", [inf] * n) * len(X) + control["input_high"] * len(U)
    held = control.get("first_plan", {}).get("input", control.get("initial_input", [0.0] * m))
    start = list(control["initial_state"]) * len(X) + list(held) * len(U)
    if guess is not None:
        start, x, time = [], ca.DM(control["initial_state"]), 0.0
        for j, length in enumerate(lengths):
            u = guess[m * min(j, len(U) - 1):][:m]
            x, _ = steps[length if j > 0 or stretch is None else None](x, u, time)
            start, time = start + x.full().ravel().tolist(), time + length
        start += guess
    z = ca.vertcat(*X, *U)
    problem = {"x": z, "f": J, "g": ca.vertcat(*g, *same, *outputs)}
    solver = ca.nlpsol("s", "ipopt", problem, QUIET | (options or {}))
    equal = [0] * (n * len(X) + len(same))
    found = solver(x0=start, lbx=low, ubx=high, lbg=equal + least, ubg=equal + most)
    inputs = found["x"].full().ravel().tolist()[n * len(X):]
    stats, before = solver.stats(), float(ca.Function("J", [z], [J])(start))
    return float(found["f"]), inputs, stats["return_status"], stats["iter_count"], before


def plan_of(pinc, path, config):
    """The answer of `pinc serve` to the initial state, and the inputs of the plan."""
    control = config["control"]
    lines = [{"y": control["initial_state"]}, {"command": "save"}]
    served = subprocess.run([pinc, "serve", path], input="\n".join(map(json.dumps, lines)), text=True,
                            capture_output=True, check=True).stdout.splitlines()
    answer, saved = (json.loads(line) for line in served)
    states = control["n2"] * len(control["initial_state"])
    inputs = control["nu"] * len(control["input_low"])
    return answer, saved["state"]["numbers"][states:states + inputs]


if __name__ == "__main__":
    pinc, paths = (sys.argv[2], sys.argv[3:]) if sys.argv[1] == "--beside" else (None, sys.argv[1:])
    for path in paths:
        config = tomllib.loads(pathlib.Path(path).read_text())
        beside = (plan_of(pinc, path, config)[1], LOCAL) if pinc else ()
        objective, inputs, status, count, _ = solve(config, *beside)
        print(json.dumps({"name": config["name"], "objective": objective, "inputs": inputs,
                          "status": status, "iterations": count}), flush=True)
