"""What `pinc choose` advises, beside the cheapest model of the full sweep, as a table in Markdown.

    for config in configs/pareto/*.toml; do pinc run $config; done
    python3 benches/choose/table.py PINC [SEEDS [PLANT...]]

with the program PINC, for the seeds 1 to SEEDS (5 if nothing is said) and the plants named, or all six. The
sweeps are read from runs/<plant>-pareto, as docs/accuracy-cost.md; the choices are made in
runs/choose-<plant>-<seed>. Leave the machine alone meanwhile: at most 2 min for each choice. Needs Python
alone.

The winner of a sweep is the cheapest of its models whose IAE is within 1 % of that of the numerical method
with the most exact step. Of an advised model that is none of the sweep's, the sweep tells no cost: its own
loop's time is then compared.
"""

import csv
import re
import subprocess
import sys
import time
from pathlib import Path

PLANTS = ("van-der-pol", "four-tanks", "still", "car", "rod", "motor")
WITHIN = 0.01
BUDGET_S = 110
MODELS = ("pinc", "rk4", "rk5", "rosenbrock")


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def sweep(plant):
    """The control step in us of each good model of a sweep, by its name."""
    directory = Path("runs") / f"{plant}-pareto"
    models = []
    for result, timing in zip(read(directory / "sweep.csv"), read(directory / "timings.csv")):
        for model in MODELS:
            if result.get(f"{model}_iae_dense_sum"):
                number = lambda table, column: float(table[f"{model}_{column}"] or "nan")
                name = result["case"]
                if model == "pinc" and not name.startswith("distilled"):
                    name = f"PINC {name}"
                rms, iae = number(result, "one_step_rms"), number(result, "iae_dense_sum")
                models.append((name, model, rms, iae, number(timing, "step_us")))
    exact = min((of for of in models if of[1] != "pinc" and of[2] == of[2]), key=lambda of: of[2])
    return {name: step for name, _, _, iae, step in models if iae <= (1 + WITHIN) * exact[3]}


def choose(pinc, plant, seed):
    """The model advised, the time of its control step in us, and how long that took in s."""
    out = Path("runs") / f"choose-{plant}-{seed}"
    config = Path("configs/pareto") / f"{plant}.toml"
    command = [pinc, "choose", config, "--budget-s", BUDGET_S, "--out", out, "--set", f"seed={seed}"]
    begin = time.monotonic()
    ended = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=True)
    found = re.search(r"^Use (.*?): .*control step takes ([0-9.]+) us", ended.stdout, re.MULTILINE)
    name = re.sub(r" with (\d+) substeps?", r" x\1", found[1])
    net = re.match(r"a net of (\d+x\d+) trained on (an integrator|the equation)", name)
    if net:
        name = ("distilled " if net[2] == "an integrator" else "PINC ") + net[1]
    return name, float(found[2]), time.monotonic() - begin


def main():
    pinc, seeds = sys.argv[1], int((sys.argv[2:] or ["5"])[0])
    print("| plant | seed | advised | its control step, us | winner of the sweep | us | ratio | took, s |")
    print("|---|---|---|---|---|---|---|---|")
    for plant in sys.argv[3:] or PLANTS:
        good = sweep(plant)
        winner = min(good, key=good.get)
        for seed in range(1, seeds + 1):
            name, own, took = choose(pinc, plant, seed)
            step = good.get(name, own)
            cells = [plant, seed, name, f"{step:.1f}", winner, f"{good[winner]:.1f}"]
            cells += [f"{step / good[winner]:.2f}", f"{took:.0f}"]
            print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


if __name__ == "__main__":
    main()
