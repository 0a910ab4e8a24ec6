"""Parts of a record as data of `pinc identify`, whose input is interpolated between rows."""

import json
import math
import subprocess
import tomllib

QUARTERS, REACH = 4, 16


def lanczos(x):
    """The kernel of interpolation."""
    if x == 0:
        return 1.0
    turn = math.pi * x
    return REACH * math.sin(turn) * math.sin(turn / REACH) / turn**2


def weights(quarter):
    """The weights of the rows around the middle of a quarter of a row's interval."""
    at = (quarter + 0.5) / QUARTERS
    of = [lanczos(at - j) for j in range(1 - REACH, REACH + 1)]
    return [weight / sum(of) for weight in of]


def write(rows, config, file):
    """Writes rows of u and y with four steps of the model for each."""
    step = tomllib.loads(config.read_text())["identify"]["step_s"]
    by_quarter = [weights(quarter) for quarter in range(QUARTERS)]
    name = next(iter(tomllib.loads(config.read_text())["plant"]["expression"]["outputs"]))
    with open(file, "w") as to:
        to.write(f"t,u,y_{name}\n")
        for k, (_, y) in enumerate(rows):
            near = range(k + 1 - REACH, k + REACH + 1)
            u = [rows[min(max(at, 0), len(rows) - 1)][0] for at in near]
            for quarter, of in enumerate(by_quarter):
                held = sum(weight * value for weight, value in zip(of, u))
                time = (k * QUARTERS + quarter) * step
                to.write(f"{time!r},{held:.7f},{y if quarter == 0 else ''}\n")
    return file


def identified(pinc, config, files, out, sets=()):
    """Runs `pinc identify` and returns identify.json."""
    command = [pinc, "--quiet", "identify", config, "--data", files[0], "--out", out]
    command += [word for file in files[1:] for word in ("--validate", file)]
    command += [word for set in sets for word in ("--set", set)]
    subprocess.run([str(word) for word in command], check=True)
    return json.loads((out / "identify.json").read_text())


def going_on(config, found):
    """Settings for a fit from where another ended."""
    spec = tomllib.loads(config.read_text())["identify"]["parameters"]
    point = [{**of, "initial": found["parameters"][of["name"]]["value"]} for of in spec]
    rows = ["{ " + ", ".join(f"{k} = {json.dumps(v)}" for k, v in of.items()) + " }" for of in point]
    return ["identify.starts=1", f"identify.parameters=[{', '.join(rows)}]"]


def agreement(found):
    """How many of the starts that were finished end at the best cost."""
    finished = [start for start in found["starts"] if start["status"] != "set aside"]
    near = sum((start["cost"] or math.inf) <= 1.01 * found["cost"] for start in finished)
    return f"{near} of {len(finished)} finished starts end within 1 % of the best cost"
