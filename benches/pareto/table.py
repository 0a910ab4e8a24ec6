"""The page of charts and tables of sweeps with [one_step], docs/accuracy-cost.md, docs/pareto/*.svg and
docs/tables/accuracy-cost/*.csv:

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

from sweep import MODELS, exact, is_good, loops, methods, off

INTRODUCTION = """\
# Accuracy against cost

Cost and error of one step of T, for nets by size and training and for numerical methods by
substeps, and the closed loop with each. Made by the commands below and
`python3 benches/pareto/table.py runs/*-pareto`; [findings.md](findings.md#accuracy-against-cost)
says what follows.

- Errors are over points that fill the training domain, in widths of the domain: root mean square
  over the states at a point; rms, median and 99th percentile over the points; rms over points and
  entries for Jacobians.
- "alone" waits for the step before, as a simulation does. "with Jacobians" computes as many steps
  at a time as the controller's horizon has, on one thread.
- "control step" is the median time of the whole controller. "training" includes the integration of
  a distilled net's targets."""

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


# Where `.ci/numbers` finds the numbers of a table again.
ERRORS = ("one_step_rms", "one_step_median", "one_step_p99", "jacobian_rms")
COLUMNS = [
    "-",
    *(f"error sweep[case={{model}}].?_{name}" for name in ERRORS),
    *("timed", "timed", "net sweep[case={model}].?_iae_dense_sum", "timed", "timed"),
]
NUMBERS = "\n| " + " | ".join(COLUMNS) + " |\n"


def error(value):
    return f"{value:.1e}" if math.isfinite(value) else "not finite"


def row(loop):
    """The cells of a loop."""
    training = loop["training"]
    return [
        loop["case"],
        *(error(loop[column]) for column in ("rms", "median", "p99", "jacobian_rms")),
        f"{loop['alone']:.0f}",
        f"{loop['jacobians']:.0f}",
        f"{loop['iae']:.6g}",
        f"{loop['step']:.1f}",
        "" if math.isnan(training) else f"{training:.1f}",
    ]


def measured(directory):
    """The loops of a sweep with models of which single steps were looked at."""
    return [loop for loop in loops(directory) if not math.isnan(loop["alone"])]


def write_table(path, directory):
    """A run's table, and beside it where `.ci/numbers` finds its numbers."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(HEADS)
        rows.writerows(row(loop) for loop in measured(directory))
    path.with_suffix(".numbers").write_text(NUMBERS)


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
    "reactor": ("distilled 1x48", "distilled 2x48"),
    "gas-lift": ("3x24", "distilled 3x24"),
    "pump": ("3x24", "distilled 2x24"),
}


def cheapest(integrators, rms, column):
    """The least time at an error, between numbers of substeps, with the method that takes it."""
    best = (math.inf, "")
    for model in {loop["model"] for loop in integrators}:
        own = [m for m in integrators if m["model"] == model and math.isfinite(m["rms"])]
        own.sort(key=lambda method: method["rms"])
        for fine, coarse in zip(own, own[1:]):
            if fine["rms"] <= rms <= coarse["rms"]:
                part = math.log(rms / fine["rms"]) / math.log(coarse["rms"] / fine["rms"])
                logs = [math.log(method[column]) for method in (fine, coarse)]
                best = min(best, (math.exp(logs[0] + part * (logs[1] - logs[0])), MODELS[model]))
        # One that is more exact with its fewest substeps is cheap enough.
        if own and own[-1]["rms"] <= rms:
            best = min(best, (own[-1][column], MODELS[model]))
    return best


def summary(plant, directory):
    found = measured(directory)
    standard = exact(found)
    good = min((m for m in methods(found) if is_good(m, standard)), key=lambda m: m["step"])
    for net in (loop for loop in found if loop["case"] in SUMMARY.get(plant, ())):
        cells = [plant, net["case"], f"{net['rms']:.1e}"]
        for column in ("alone", "jacobians"):
            time, name = cheapest(methods(found), net["rms"], column)
            factor = f"{time / net[column]:.2g} ({name})" if name else "–"
            cells += [f"{net[column]:.0f}", factor]
        factor = f"{good['step'] / net['step']:.1f} ({good['case']}, {good['step']:.1f} us)"
        cells += [f"{100 * off(net, standard):+.2f} %", f"{net['step']:.1f}"]
        cells.append(factor if is_good(net, standard) else "–")
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
    machine = f"{provenance['cpu']}, {provenance['cores']} cores"
    lines += [f"*Timed on {machine}, {provenance['started'].split('T')[0]}.*", ""]
    lines += [f"![Error of one step over its time: {plant}](pareto/{plant}.svg)", ""]
    return [*lines, f"[Table](tables/accuracy-cost/{plant}.csv)"]


def main():
    docs = Path("docs")
    page = docs / "accuracy-cost.md"
    found = sections(page.read_text())
    (docs / "pareto").mkdir(exist_ok=True)
    for directory in map(Path, sys.argv[1:]):
        plant = directory.name.removesuffix("-pareto")
        picture = directory / "figures" / "accuracy-cost.svg"
        shutil.copy(picture, docs / "pareto" / f"{plant}.svg")
        write_table(docs / "tables" / "accuracy-cost" / f"{plant}.csv", directory)
        found[plant] = section(plant, directory)
        print(*summary(plant, directory), sep="\n")
    lines = [INTRODUCTION]
    for plant in sorted(found, key=place):
        lines += found[plant]
    page.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
