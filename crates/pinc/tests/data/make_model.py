"""Writes model.safetensors, inputs.csv and expected.csv for the test of models from other programs.

The net is random; its values are computed with numpy, by the formula of the model file:

    y = output_mean + output_std * (W_L tanh(.. tanh(W_0 z + b_0) ..) + b_L)
    z = ((t, y0, u) - input_mean) / input_std

Run in this directory: python3 make_model.py (needs numpy and safetensors).
"""

import csv
import json

import numpy as np
from safetensors.numpy import save_file

rng = np.random.default_rng(20)
WIDTHS = [4, 7, 5, 2]  # t, two states, one input; two hidden layers; two states
T = 0.5

layers = []
tensors = {}
for i, (n_in, n_out) in enumerate(zip(WIDTHS, WIDTHS[1:])):
    weight = rng.normal(size=(n_out, n_in)) / np.sqrt(n_in)
    bias = 0.1 * rng.normal(size=n_out)
    layers.append((weight, bias))
    tensors[f"layers.{i}.weight"] = weight
    tensors[f"layers.{i}.bias"] = bias

input_mean = np.array([0.25, 0.1, -0.2, 0.05])
input_std = np.array([0.15, 1.7, 1.8, 0.6])
output_mean = np.array([0.1, -0.2])
output_std = np.array([1.7, 1.8])

model = {
    "states": ["x1", "x2"],
    "inputs": ["u"],
    "horizon_s": T,
    "activation": "tanh",
    "ansatz": "direct",
    "input_mean": input_mean.tolist(),
    "input_std": input_std.tolist(),
    "output_mean": output_mean.tolist(),
    "output_std": output_std.tolist(),
    "skip": False,
    "domain": {"low": [-3.0, -3.0, -1.0], "high": [3.0, 3.0, 1.0]},
}
metadata = {"format": "pinc-model", "version": "1", "model": json.dumps(model)}
save_file(tensors, "model.safetensors", metadata=metadata)


def net(t, y0, u):
    a = (np.concatenate([[t], y0, u]) - input_mean) / input_std
    for weight, bias in layers[:-1]:
        a = np.tanh(weight @ a + bias)
    weight, bias = layers[-1]
    return output_mean + output_std * (weight @ a + bias)


def on_the_grid(y0, inputs):
    """Rows at t = 0, T/4, .., each input held over one T; the chain written out by hand."""
    rows = [(0.0, inputs[0], y0)]
    y = y0
    for k, u in enumerate(inputs):
        for i in (1, 2, 3):
            rows.append((k * T + i * T / 4, u, net(i * T / 4, y, u)))
        y = net(T, y, u)
        after = inputs[min(k + 1, len(inputs) - 1)]
        rows.append(((k + 1) * T, after, y))
    return rows


def with_a_change_inside(y0):
    """The input changes at t = 0.7, inside the interval from 0.5 to 1.0."""
    u, v = np.array([0.3]), np.array([-0.8])
    y_mark = net(T, y0, u)  # 0.5; no row there
    y_change = net(0.7 - T, y_mark, u)
    y_next = net(T, y_change, v)  # 1.2, a mark of the restarted chain
    return [
        (0.0, u, y0),
        (0.4, u, net(0.4, y0, u)),
        (0.7, v, y_change),
        (1.0, v, net(1.0 - 0.7, y_change, v)),
        (1.2, v, y_next),
        (1.3, v, net(1.3 - 1.2, y_next, v)),
    ]


scenarios = {
    "grid": on_the_grid(np.array([0.5, -1.0]), rng.uniform(-1, 1, size=(4, 1))),
    "change": with_a_change_inside(np.array([-1.5, 0.25])),
}
with open("inputs.csv", "w", newline="") as f_in, open("expected.csv", "w", newline="") as f_out:
    for f in (f_in, f_out):
        csv.writer(f, lineterminator="\n").writerow(["scenario", "t", "u", "x1", "x2"])
    for name, rows in scenarios.items():
        for i, (t, u, y) in enumerate(rows):
            cells = [name, repr(float(t)), repr(float(u[0]))]
            state = [repr(float(v)) for v in y]
            csv.writer(f_in, lineterminator="\n").writerow(cells + (state if i == 0 else ["", ""]))
            csv.writer(f_out, lineterminator="\n").writerow(cells + state)
