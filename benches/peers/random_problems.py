"""Random control problems with costs as text: is a plan that PINC calls converged a minimum?

    python random_problems.py PINC [COUNT] [FIRST]

Writes configs into a temporary directory: plants of one to four states with nonlinear equations, economic
stage and terminal costs, weights on changes, bounds on states and on nonlinear outputs, free end times
with values at the end, orbits. PINC, the program, plans each first step (`pinc serve`). IPOPT starts at each plan
that converged, on the same discretization. Counts plans that have a better neighbour: one that is cheaper
by more than 1e-6 of the cost. Exits with 1 if there is one.
"""

import collections
import json
import pathlib
import random
import sys
import tempfile
import tomllib

import casadi_cost

KINDS = ["economic", "output", "state", "free", "product"]


def number(rng, low, high):
    return f"{rng.choice([-1, 1]) * rng.uniform(low, high):.4f}"


def term(rng, x, u):
    """A nonlinear expression of the quantities `x` and `u`."""
    a, b = rng.choice(x), rng.choice(x)
    forms = ["{c}*{a}", "{c}*{a}*{b}", "{c}*tanh({a})", "{c}*sin({d}*{a})", "{c}*cos({d}*{b})",
             "{c}*{a}^2", "{c}*exp(-{a}^2)", "{c}*{a}*{v}", "{c}*sqrt(1 + {a}^2)"]
    values = {"a": a, "b": b, "v": rng.choice(u), "c": number(rng, 0.1, 1.0), "d": number(rng, 0.5, 2.0)}
    return rng.choice(forms).format(**values)


def total(terms):
    return " + ".join(f"({one})" for one in terms)


def make(kind, seed):
    rng = random.Random(seed)
    n, m = rng.randint(1, 4), rng.randint(1, 2)
    x, u = [f"x{i}" for i in range(n)], [f"u{i}" for i in range(m)]
    rates = {}
    for i, name in enumerate(x):
        terms = [f"-{rng.uniform(0.2, 1.0):.4f}*{name}", f"-0.1*{name}^3"]
        terms += [term(rng, x, u) for _ in range(rng.randint(1, 2))]
        terms += [f"{number(rng, 0.3, 1.0)}*{u[i % m]}"] * (i < 2 or rng.random() < 0.5)
        rates[name] = total(terms)
    stage = [term(rng, x, u) for _ in range(rng.randint(1, 3))]
    weighted = rng.random() < 0.4
    if kind != "product" or not weighted:
        stage += [f"{rng.uniform(0.02, 0.5):.4f}*{v}^2" for v in u]
    if kind == "product":
        stage += [f"{number(rng, 0.2, 1.0)}*{rng.choice(u)}*{rng.choice(x)}"]
    if kind != "free" and rng.random() < 0.3:
        stage += [f"0.1*t*{rng.choice(u)}"]
    if kind == "free":
        stage += ["1"]
    start = [rng.uniform(-1.0, 1.0) for _ in x]
    step = round(rng.uniform(0.1, 0.4), 3)
    steps = rng.randint(5, 20)
    inputs = u + ["stretch"] * (kind == "free")
    low = {v: rng.uniform(-2.0, -0.2) for v in u} | {"stretch": 0.4}
    high = {v: rng.uniform(0.2, 2.0) for v in u} | {"stretch": 3.0}
    table = lambda of: "{ " + ", ".join(f"{key} = {value!r}" for key, value in of.items()) + " }"
    text = lambda of: "{ " + ", ".join(f'{key} = "{value}"' for key, value in of.items()) + " }"
    lines = [f'name = "p{seed:04}"', 'preset = "ours"', "seed = 1", "[plant.expression]",
             f"states = {json.dumps(x)}", f"inputs = {json.dumps(inputs)}",
             f"derivatives = {text(rates)}"]
    bounded = ""
    if kind == "output":
        bounded = total([term(rng, x, x) for _ in range(2)])
        value = float(casadi_cost.evaluate(bounded, dict(zip(x, start))))
        lines += [f"outputs = {text({'y': bounded})}"]
    lines += ["[control.cost]", f'stage = "{total(stage)}"']
    if rng.random() < 0.5:
        lines += [f'terminal = "{total([term(rng, x, x) for _ in range(2)])}"']
    lines += ["[control]", 'models = ["rk4"]', f"step_s = {step}", f"duration_s = {step}",
              f"rk4_substeps = {rng.randint(1, 2)}", f"initial_state = {start}", f"n2 = {steps}",
              f"nu = {steps if rng.random() < 0.7 else rng.randint(2, steps)}",
              f"input_low = {table({v: low[v] for v in inputs})}",
              f"input_high = {table({v: high[v] for v in inputs})}",
              "sqp = { max_iterations = 300 }"]
    if weighted:
        lines += [f"r = {table({v: rng.uniform(0.01, 0.3) if v in u else 0.0 for v in inputs})}"]
    if kind == "output":
        lines += [f"output_low = {{ y = -inf }}", f"output_high = {{ y = {value + rng.uniform(0.1, 0.6)!r} }}"]
    if kind == "state":
        i = rng.randrange(n)
        sides = {f"{x[i]}": start[i] + rng.choice([-1, 1]) * rng.uniform(0.05, 0.5)}
        above = sides[x[i]] > start[i]
        lines += [f"state_{'high' if above else 'low'} = {table(sides)}"]
    if kind == "product" and seed % 2:
        lines += [f"periodic = {json.dumps(x[:m])}"]
    if kind == "free":
        lines += ['free_time = "stretch"', f"end_state = {{ x0 = {start[0] + rng.uniform(-0.5, 0.5)!r} }}",
                  f"initial_input = {table({v: 1.0 if v == 'stretch' else 0.0 for v in inputs})}"]
    return "\n".join(lines) + "\n"


def judge(pinc, path, kind, counts):
    config = tomllib.loads(path.read_text())
    answer, plan = casadi_cost.plan_of(pinc, path, config)
    status = answer["status"]
    counts[f"all {status}"] += 1
    counts[f"{kind} {status}"] += 1
    if status != "converged":
        print(path.stem, kind, status, flush=True)
        return
    cost, inputs, found, _, before = casadi_cost.solve(config, plan, casadi_cost.LOCAL)
    size = max(1e-3, abs(answer["cost"]))
    if abs(before - answer["cost"]) > 1e-6 * size:
        counts["other cost of the same inputs"] += 1
        print(path.stem, kind, "costs", answer["cost"], "here", before)
    gain, named = (answer["cost"] - cost) / size, answer["curvature_dropped"]
    if gain > 1e-6 and found == "Solve_Succeeded":
        counts["better neighbour" + (", curvature_dropped" if named else "")] += 1
        far = max(abs(a - b) for a, b in zip(inputs, plan))
        print(path.stem, kind, f"better by {gain:.2e}, {far:.1e} away",
              "curvature_dropped" if named else "", flush=True)
    elif named:
        counts["minimum, curvature_dropped"] += 1


if __name__ == "__main__":
    pinc, count, first = (sys.argv[1:] + ["200", "0"][len(sys.argv) - 2:])[:3]
    counts = collections.Counter()
    with tempfile.TemporaryDirectory() as directory:
        for k in range(int(first), int(first) + int(count)):
            path = pathlib.Path(directory) / f"p{k:04}.toml"
            path.write_text(make(KINDS[k % len(KINDS)], k))
            judge(pinc, path, KINDS[k % len(KINDS)], counts)
    for name, number in sorted(counts.items()):
        print(f"{number:5} {name}")
    sys.exit(any(name.startswith("better") for name in counts))
