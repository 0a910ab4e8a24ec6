"""The page of charts and tables of sweeps with [one_step], docs/accuracy-cost.md and docs/pareto/*.svg:

    for config in configs/pareto/*.toml; do pinc run $config; done
    python3 benches/pareto/table.py runs/*-pareto

Prints the rows of the summary in docs/measurements.md. Sections of plants that are not given stay
as they are. Needs Python alone.
"""

import csv
import json
import math
import shutil
import sys
from pathlib import Path

INTRODUCTION = """\
# Accuracy against cost

What one step of T costs and how exact it is, for nets by size and training and for numerical
methods by substeps, and what this means in the closed loop. Made by the commands below and
`python3 benches/pareto/table.py runs/*-pareto`; the findings are in
[findings.md](findings.md#accuracy-against-cost). To compare on a plant of your own, write another
config of this kind.

Errors of one step are over points that fill the training domain, in widths of the domain: at a
point the root mean square over the states; over the points the rms, the median and the 99th
percentile; of the Jacobians the rms over points and entries. Alone, a step waits for the one
before, as in a simulation; with Jacobians, as many are computed at a time as the controller's
horizon has, by one thread. The control step is the median time of the whole controller. For
distilled nets, the training time includes the integration of their targets."""

# The page's order; other plants come after these.
ORDER = (
    *("van-der-pol", "four-tanks", "still", "column", "servo", "car", "arm"),
    *("rod", "rod-20s", "reactor", "gas-lift", "pump"),
)

HEADS = (
    "model",
    "rms",
    "median",
    "99 %",
    "Jacobians",
    "alone, ns",
    "with Jacobians, ns",
    "IAE",
    "control step, us",
    "training, s",
)


# The models in a loop, as columns begin with them, and their names.
MODELS = {"pinc": "net", "rk4": "RK4", "rk5": "RK5", "rosenbrock": "Rosenbrock"}


def error(text):
    return f"{float(text):.1e}" if text not in ("", "NaN", "inf") else "not finite"


def row(case, result, time, model):
    """The cells of one case, whose only model is `model`."""
    of = lambda table, column: table[f"{model}_{column}"]
    errors = [of(result, f"one_step_{c}") for c in ("rms", "median", "p99")]
    training = time["training_wall_s"] if model == "pinc" else ""
    return [
        case,
        *map(error, errors),
        error(of(result, "jacobian_rms")),
        f"{float(of(time, 'forward_ns')):.0f}",
        f"{float(of(time, 'forward_jacobian_ns')):.0f}",
        f"{float(of(result, 'iae_dense_sum')):.6g}",
        f"{float(of(time, 'step_us')):.1f}",
        f"{float(training):.1f}" if training else "",
    ]


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def cases(directory, column):
    """Result, times and model of each loop of a sweep that has a time in this column."""
    for result, time in zip(read(directory / "sweep.csv"), read(directory / "timings.csv")):
        for model in MODELS:
            if time.get(f"{model}_{column}"):
                yield result, time, model


def table(directory):
    """The lines of a run's table."""
    yield "| " + " | ".join(HEADS) + " |"
    yield "|" + "---|" * len(HEADS)
    for result, time, model in cases(directory, "forward_ns"):
        yield "| " + " | ".join(row(result["case"], result, time, model)) + " |"


# The nets in the summary.
SUMMARY = {
    "van-der-pol": ("3x16", "distilled 2x16", "distilled 2x24"),
    "four-tanks": ("2x24", "distilled 2x24"),
    "still": ("3x16", "distilled 2x8"),
    "column": ("3x32", "distilled 3x32"),
    "servo": ("4x20", "distilled 2x16", "distilled 4x32"),
    "car": ("4x32", "distilled 3x24"),
    "arm": ("3x24", "distilled 2x16"),
    "rod": ("1x24", "distilled 1x24"),
    "rod-20s": ("distilled 1x24", "distilled 1x32"),
    "reactor": ("1x48", "distilled 2x48"),
    "gas-lift": ("3x24", "distilled 3x24"),
    "pump": ("3x24", "distilled 2x24"),
}


def number(text):
    return float(text) if text else math.nan


def cheapest(methods, rms, column):
    """The least time at an error, between numbers of substeps, with the method that takes it."""
    best = (math.inf, "")
    for name in {method["name"] for method in methods}:
        own = [m for m in methods if m["name"] == name and math.isfinite(m["rms"])]
        own.sort(key=lambda method: method["rms"])
        for fine, coarse in zip(own, own[1:]):
            if fine["rms"] <= rms <= coarse["rms"]:
                part = math.log(rms / fine["rms"]) / math.log(coarse["rms"] / fine["rms"])
                logs = [math.log(method[column]) for method in (fine, coarse)]
                best = min(best, (math.exp(logs[0] + part * (logs[1] - logs[0])), name))
        # One that is more exact with its fewest substeps is cheap enough.
        if own and own[-1]["rms"] <= rms:
            best = min(best, (own[-1][column], name))
    return best


def summary(plant, directory):
    rows = [
        {
            "case": result["case"],
            "name": MODELS[model],
            "rms": number(result[f"{model}_one_step_rms"]),
            "iae": number(result[f"{model}_iae_dense_sum"]),
            "alone": float(time[f"{model}_forward_ns"]),
            "jacobians": float(time[f"{model}_forward_jacobian_ns"]),
            "step": float(time[f"{model}_step_us"]),
        }
        for result, time, model in cases(directory, "forward_ns")
    ]
    methods = [row for row in rows if row["name"] != "net"]
    exact = min((m for m in methods if math.isfinite(m["rms"])), key=lambda m: m["rms"])["iae"]
    good = min((m for m in methods if abs(m["iae"] / exact - 1) < 0.01), key=lambda m: m["step"])
    for net in (row for row in rows if row["case"] in SUMMARY.get(plant, ())):
        cells = [plant, net["case"], f"{net['rms']:.1e}"]
        for column in ("alone", "jacobians"):
            time, name = cheapest(methods, net["rms"], column)
            factor = f"{time / net[column]:.2g} ({name})" if name else "–"
            cells += [f"{net[column]:.0f}", factor]
        off = net["iae"] / exact - 1
        factor = f"{good['step'] / net['step']:.1f} ({good['case']}, {good['step']:.1f} us)"
        cells += [f"{100 * off:+.2f} %", f"{net['step']:.1f}", factor if abs(off) < 0.01 else "–"]
        yield "| " + " | ".join(cells) + " |"


def place(plant):
    return (ORDER.index(plant), "") if plant in ORDER else (len(ORDER), plant)


def sections(page):
    """The sections of a page by their headings, without what comes before them."""
    parts = page.split("\n## ")[1:]
    return {part.split("\n", 1)[0]: ["", *("## " + part).rstrip().split("\n")] for part in parts}


def section(plant, directory):
    provenance = json.loads((directory / "provenance.json").read_text())
    lines = ["", f"## {plant}", "", "```sh", f"pinc run configs/pareto/{plant}.toml", "```", ""]
    lines += [f"Processor: {provenance['cpu']}, {provenance['cores']} cores.", ""]
    lines += [f"![Error of one step over its time: {plant}](pareto/{plant}.svg)", ""]
    return lines + list(table(directory))


def main():
    docs = Path("docs")
    page = docs / "accuracy-cost.md"
    found = sections(page.read_text())
    (docs / "pareto").mkdir(exist_ok=True)
    for directory in map(Path, sys.argv[1:]):
        plant = directory.name.removesuffix("-pareto")
        picture = directory / "figures" / "accuracy-cost.svg"
        shutil.copy(picture, docs / "pareto" / f"{plant}.svg")
        found[plant] = section(plant, directory)
        print(*summary(plant, directory), sep="\n")
    lines = [INTRODUCTION]
    for plant in sorted(found, key=place):
        lines += found[plant]
    page.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
