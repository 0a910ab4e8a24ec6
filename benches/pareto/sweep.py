"""The closed loops of a sweep with [one_step], and the rules by which their models are compared."""

import csv
import math

# The models in a loop, as columns begin with them, and their names.
MODELS = {"pinc": "net", "rk4": "RK4", "rk5": "RK5", "rosenbrock": "Rosenbrock"}

# How far a good model's IAE is from the exact one's at the most, relative.
WITHIN = 0.01

# What is read of a loop, by the ends of the columns, from sweep.csv and timings.csv.
RESULTS = {
    "rms": "one_step_rms",
    "median": "one_step_median",
    "p99": "one_step_p99",
    "jacobian_rms": "jacobian_rms",
    "iae": "iae_dense_sum",
    "offset": "offset_max",
    "violation": "max_violation",
    "iterations": "sqp_iterations_mean",
}
TIMES = {"alone": "forward_ns", "jacobians": "forward_jacobian_ns", "step": "step_us"}


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def number(text):
    return float(text) if text else math.nan


def loops(directory):
    """The loops of a sweep that came to their end: case, model and numbers, NaN what is missing."""
    for result, time in zip(read(directory / "sweep.csv"), read(directory / "timings.csv")):
        for model in MODELS:
            if time.get(f"{model}_step_us") and result["status"] == "done":
                loop = {"case": result["case"], "model": model, "training": math.nan}
                for found, columns in ((result, RESULTS), (time, TIMES)):
                    for key, column in columns.items():
                        loop[key] = number(found.get(f"{model}_{column}"))
                if model == "pinc":
                    loop["training"] = number(time["training_wall_s"])
                yield loop


def methods(found):
    return [loop for loop in found if loop["model"] != "pinc"]


def exact(found):
    """The exact model: the numerical method with the least error of a step."""
    known = (loop for loop in methods(found) if math.isfinite(loop["rms"]))
    return min(known, key=lambda loop: loop["rms"])


def off(loop, standard):
    """By how much the IAE of a loop exceeds the exact model's, relative."""
    return loop["iae"] / standard["iae"] - 1.0


def is_good(loop, standard):
    return abs(off(loop, standard)) < WITHIN
