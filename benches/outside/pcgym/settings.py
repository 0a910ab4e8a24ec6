"""The environments: what is tracked, from where, within which bounds, in which steps.

Both controllers get these numbers. They are PC-Gym's own, from its repository:

- cstr, four_tank, multistage_extraction and crystallization are the experiments of its paper
  (pc-gym_paper/train_policies; cstr as in example_notebooks/Benchmarking.ipynb) with their horizons of
  the oracle. Crystallization has the default task's absolute temperature as its input.
- cstr_bounded is cstr within the temperatures of example_notebooks/Constraints.ipynb.
- biofilm_start is the biofilm reactor of tests/oracle/test_oracle.py, which begins elsewhere.
- RSR is pc-gym_paper/train_policies/Biofilm, with 60 of its 10 000 steps.
- The others are the default tasks of docs/guides/default_tasks.md, in the time steps of
  scripts/gen_reference_trajectories.py, with the oracle's default horizon of 5.

The reward is PC-Gym's default: minus the squared distance from the set points, times `scale`. That is
1000 for cstr as in the paper, else 1 over the squared range of the observations. The examples' noise
is left out, because the oracle has none.
"""

import numpy as np

STEPS = 60


def parts(*values):
    """Set points that change at equal distances."""
    return [value for value in values for _ in range(STEPS // len(values))]


def by_range(width, *names):
    return {name: 1 / width**2 for name in names}


# `step` is in the model's unit of time. The spaces of observations end with the set points.
_CSTR = {
    "step": 26 / STEPS,
    "x0": [0.8, 330],
    "input": ([295], [302]),
    "observed": ([0.7, 300], [1, 350]),
    "set_points": {"Ca": parts(0.85, 0.9, 0.87)},
    "scale": {"Ca": 1e3},
    "horizon": 15,
}

SETTINGS = {
    "cstr": _CSTR,
    "cstr_bounded": _CSTR
    | {"model": "cstr", "constraints": {"T": [319, 331]}, "cons_type": {"T": [">=", "<="]}},
    "first_order_system": {
        "step": 10 / STEPS,
        "x0": [0.1],
        "input": ([0], [1]),
        "observed": ([0], [1]),
        "set_points": {"x": parts(0.7)},
        "scale": by_range(1, "x"),
    },
    "multistage_extraction": {
        "step": 1,
        "x0": [0.55, 0.3, 0.45, 0.25, 0.4, 0.20, 0.35, 0.15, 0.25, 0.1],
        "input": ([5, 10], [500, 1000]),
        "observed": ([0] * 10, [1] * 10),
        "set_points": {"X5": parts(0.3, 0.4, 0.3)},
        "scale": by_range(1, "X5"),
        "horizon": 20,
    },
    "nonsmooth_control": {
        "step": 5 / STEPS,
        "x0": [0.8, 0],
        "input": ([-1], [1]),
        "observed": ([-1, -1], [1, 1]),
        "set_points": {"X1": parts(0)},
        "scale": by_range(2, "X1"),
    },
    "RSR": {
        "step": 2,
        "x0": [20, 0.8861, 0.1082, 0.0058, 20, 0.8861, 0.1082, 0.0058, 20, 0.1139, 0.7779, 0.1082],
        "input": ([0.667, 8, 8, 0.67, 8], [1, 40, 40, 3, 40]),
        "observed": (
            [10, 0, 0, 0, 10, 0, 0, 0, 10, 0, 0.75, 0],
            [30, 1, 0.15, 0.02, 30, 1, 0.15, 0.02, 30, 0.15, 1, 0.15],
        ),
        "set_points": {"H_R": parts(20, 22), "H_M": parts(20), "H_B": parts(20)},
        "scale": by_range(20, "H_R", "H_M", "H_B"),
    },
    "cstr_series_recycle": {
        "step": 10 / STEPS,
        "x0": [90, 310, 85, 310],
        "input": ([0.001, 0.001, 290, 290], [0.01, 0.01, 320, 320]),
        "observed": ([0, 290, 0, 290], [100, 400, 100, 400]),
        "set_points": {"C2": parts(60)},
        "scale": by_range(100, "C2"),
    },
    "distillation_column": {
        "step": 20 / STEPS,
        "x0": [0.85, 0.75, 0.6, 0.4, 0.2, 0.15, 0.1, 0.05, 0.02],
        "input": ([1, 80], [10, 300]),
        "observed": ([0] * 9, [1] * 9),
        "set_points": {"X0": parts(0.9)},
        "scale": by_range(1, "X0"),
    },
    "multistage_extraction_reactive": {
        "step": 1,
        "x0": [1, 0, 1, 0] * 5,
        "input": ([5, 10], [500, 1000]),
        "observed": ([0] * 20, [2] * 20),
        "set_points": {"XA5": parts(0.5)},
        "scale": by_range(2, "XA5"),
    },
    "four_tank": {
        "step": 1000 / STEPS,
        "x0": [0.141, 0.112, 0.072, 0.42],
        "input": ([0.1, 0.1], [10, 10]),
        "observed": ([0] * 4, [0.5] * 4),
        "set_points": {"h3": parts(0.5, 0.1), "h4": parts(0.2, 0.3)},
        "scale": by_range(0.5, "h3", "h4"),
        "horizon": 19,
    },
    "heat_exchanger": {
        "step": 10 / STEPS,
        "x0": [350, 340, 310] * 8,
        "input": ([0.5, 0.5, 340, 300], [5, 5, 360, 320]),
        "observed": ([280] * 24, [400] * 24),
        "set_points": {"Tt8": parts(320)},
        "scale": by_range(120, "Tt8"),
    },
    "biofilm_reactor": {
        "step": 100 / STEPS,
        "x0": [2, 0.1, 10, 0.1] * 4,
        "input": ([0, 1, 0.05, 0.05, 0.05], [10, 30, 1, 1, 1]),
        "observed": ([0] * 16, [10, 10, 10, 500] * 4),
        "set_points": {"S2_A": parts(2)},
        "scale": by_range(10, "S2_A"),
    },
    "biofilm_start": {
        "model": "biofilm_reactor",
        "control": {"rk4_substeps": 1},
        "step": 0.1,
        "x0": [10, 5, 5, 300] * 4,
        "input": ([0, 1, 0.05, 0.05, 0.05], [10, 30, 1, 1, 1]),
        "observed": ([0] * 16, [10, 10, 10, 500] * 4),
        "set_points": {"S2_A": parts(12.5)},
        "scale": by_range(10, "S2_A"),
        "horizon": 2,
    },
    "polymerisation_reactor": {
        "step": 2 / STEPS,
        "x0": [340, 5, 0.3],
        "input": ([0.1, 320, 4, 0.3], [2, 360, 8, 1]),
        "observed": ([300, 0, 0], [400, 10, 1]),
        "set_points": {"M": parts(3)},
        "scale": by_range(10, "M"),
    },
    "crystallization": {
        "step": 0.5,
        "x0": [1478.00986666666, 22995.8230590611, 1800863.24079725, 248516167.940593, 0.15861523304]
        + [
            float(np.sqrt(1800863.24079725 * 1478.00986666666 / 22995.8230590611**2 - 1)),
            22995.8230590611 / (1478.00986666666 + 1e-6),
        ],
        "input": ([10], [40]),
        "observed": ([0] * 7, [1e20, 1e20, 1e20, 1e20, 0.5, 2, 20]),
        "set_points": {"CV": parts(1), "Ln": parts(15)},
        "scale": by_range(2, "CV") | by_range(20, "Ln"),
        "horizon": 2,
        # Ranges of 1e20 leave no digits of the moments in a normalized observation.
        "normalise_o": False,
    },
}
