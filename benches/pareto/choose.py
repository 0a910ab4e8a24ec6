"""What `pinc choose` advises, beside the cheapest good model of the full sweep, as a table in Markdown.

    for plant in van-der-pol four-tanks still car rod motor; do pinc run configs/pareto/$plant.toml; done
    python3 benches/pareto/choose.py PINC

with the program PINC, from the root of the repository; `--help` lists the options. Each plant is tried with
several seeds, which takes up to 2 min a choice: leave the machine alone meanwhile. What was advised is added
to choose.csv in the directory of the results, and not asked for again. Needs Python 3.11 alone.

A model of a sweep is good by the rules of `pinc choose`: its IAE exceeds the most exact numerical
method's by at most 1 %, and it breaks bounds by at most 1 % of the narrowest bounded range more than this
method. The loops with the cheapest of them, and those with the advised models, are then run again, in
turns. The cheapest is the one whose median control step is the least in the median of the rounds; what
another costs over it is the median of their ratios, round by round.
"""

import argparse
import csv
import math
import re
import subprocess
import sys
import time
import tomllib
from collections import Counter
from functools import partial
from pathlib import Path
from statistics import median

from loops import again, control
from sweep import WITHIN, exact, loops, off, read

PLANTS = ("van-der-pol", "four-tanks", "still", "car", "rod", "motor")
AS_CHEAP = 1.1
# How many models of a sweep are run again, and how often in a round.
CONTENDERS = 4
REPETITIONS = ("--set", "control.repetitions=30")
COLUMNS = ("plant", "seed", "advised", "took_s")


def narrowest(config):
    """The narrowest range that a state or an input is bounded to."""
    control = tomllib.loads(config.read_text())["control"]
    ranges = [math.inf]
    for kind in ("state", "input"):
        if f"{kind}_low" in control and f"{kind}_high" in control:
            ends = zip(control[f"{kind}_low"], control[f"{kind}_high"])
            ranges += [high - low for low, high in ends]
    return min(ranges)


def title(loop):
    """What `pinc choose` calls the model of a loop."""
    is_physics = loop["model"] == "pinc" and not loop["case"].startswith("distilled")
    return f"PINC {loop['case']}" if is_physics else loop["case"]


def contenders(directory):
    """The good models of a sweep with the shortest control steps."""
    found = list(loops(directory))
    standard = exact(found)
    most = standard["violation"] + WITHIN * narrowest(directory / "config.toml")
    good = [m for m in found if off(m, standard) <= WITHIN and m["violation"] <= most]
    return sorted(good, key=lambda loop: loop["step"])[:CONTENDERS]


def directory_of(options, plant, seed):
    """Where a choice is."""
    return options.out / f"choose-{plant}-{seed}"


def choose(options, plant, seed):
    """The model advised, and how long that took in s."""
    out = directory_of(options, plant, seed)
    config = Path("configs/pareto") / f"{plant}.toml"
    command = [options.pinc, "choose", config, "--budget-s", options.budget_s, "--out", out]
    command += ["--set", f"seed={seed}"]
    begin = time.monotonic()
    ended = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, text=True)
    took = time.monotonic() - begin
    found = re.search(r"^Use (.*?): its IAE", ended.stdout, re.MULTILINE)
    if not found:
        sys.exit(f"{plant}, seed {seed}: no advice; the directory {out} of another try may be in the way")
    name = re.sub(r" with (\d+) substeps?", r" x\1", found[1])
    net = re.match(r"a net of (\d+x\d+) trained on (an integrator|the equation)", name)
    if net:
        name = ("distilled " if net[2] == "an integrator" else "PINC ") + net[1]
    return name, took


def choices(options, plant):
    """What is advised for each seed: from the file, or asked for and added to it."""
    path = options.out / "choose.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {(row["plant"], int(row["seed"])): row for row in read(path)} if path.exists() else {}
    for seed in range(1, options.seeds + 1):
        if (plant, seed) not in known:
            name, took = choose(options, plant, seed)
            row = dict(zip(COLUMNS, (plant, seed, name, f"{took:.0f}")))
            is_new = not path.exists()
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                if is_new:
                    writer.writeheader()
                writer.writerow(row)
            known[plant, seed] = row
        yield known[plant, seed]


def advised_step(options, plant, seed):
    """The median control step of one more run of the loop with the advised model, in us."""
    directory = directory_of(options, plant, seed)
    net = directory / "recommended.safetensors"
    model = ["--model", net] if net.exists() else []
    return control(options.pinc, [directory / "recommended.toml", *model, *REPETITIONS])


def row(options, plant):
    """The line of a plant."""
    directory = options.sweeps / f"{plant}-pareto"
    best = contenders(directory)
    advised = list(choices(options, plant))
    # Of an integrator all seeds have the same; each net is another.
    net = re.compile("PINC|distilled")
    key = lambda c: f"{c['advised']}, {c['seed']}" if net.match(c["advised"]) else c["advised"]
    runs = {key(c): partial(advised_step, options, plant, c["seed"]) for c in advised}
    runs |= {title(loop): partial(again, options.pinc, directory, loop, REPETITIONS) for loop in best}
    rounds = [{name: run() for name, run in runs.items()} for _ in range(options.rounds)]
    step = {name: median(steps[name] for steps in rounds) for name in runs}
    winner = min(map(title, best), key=step.get)
    over = lambda name: median(steps[name] / steps[winner] for steps in rounds)
    ratio = max(over(key(choice)) for choice in advised)
    counts = Counter(choice["advised"] for choice in advised).most_common()
    names = counts[0][0] if len(counts) == 1 else ", ".join(f"{n} ({k})" for n, k in counts)
    holds = "yes" if ratio <= AS_CHEAP or all(c["advised"] == winner for c in advised) else "no"
    longest = max(float(choice["took_s"]) for choice in advised)
    cells = [plant, winner, f"{step[winner]:.1f}", names, f"{ratio:.2f}", holds, f"{longest:.0f}"]
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pinc", help="the program")
    parser.add_argument("plants", nargs="*", default=PLANTS, help="all six if none is named")
    parser.add_argument("--seeds", type=int, default=5, help="the seeds 1 to this one")
    parser.add_argument("--budget-s", type=float, default=110, help="of a choice")
    parser.add_argument("--rounds", type=int, default=10, help="in which the loops are run again")
    parser.add_argument("--sweeps", type=Path, default=Path("runs"), help="where <plant>-pareto are")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="where the choices go")
    options = parser.parse_intermixed_args()
    missing = [p for p in options.plants if not (options.sweeps / f"{p}-pareto/sweep.csv").exists()]
    if missing:
        runs = "; ".join(f"{options.pinc} run configs/pareto/{plant}.toml" for plant in missing)
        sys.exit(f"{options.sweeps} lacks sweeps; first: {runs}")
    print(
        "| plant | cheapest good model of the sweep | its control step, us | advised (seeds) "
        "| cost of the advised over it, at most | within 10 % | longest choice, s |"
    )
    print("|---|---|---|---|---|---|---|")
    for plant in options.plants:
        print(row(options, plant), flush=True)


if __name__ == "__main__":
    main()
