"""One evaluation of loss and gradient, as `pinc bench --loss-gradient-file` writes it."""

import json
from dataclasses import dataclass

import numpy as np
from safetensors import safe_open


@dataclass
class Evaluation:
    """Parameters and points, and the loss and gradient that pinc computed from them.

    `weights[l]` is [out, in], `biases[l]` [out]; points are rows (t, y0, u). `loss` is the sum of
    `MSE_y` and lambda `MSE_F`; `gradient` lies layer by layer: weights row by row, then biases.
    """

    weights: list
    biases: list
    input_mean: np.ndarray
    input_std: np.ndarray
    output_mean: np.ndarray
    output_std: np.ndarray
    collocation: np.ndarray
    initial: np.ndarray
    physics_factor: float
    initial_factor: float
    residual_scale: np.ndarray
    initial_scale: np.ndarray
    loss: float
    gradient: np.ndarray

    @property
    def states(self):
        return len(self.output_mean)

    @property
    def parameters(self):
        return list(zip(self.weights, self.biases))


def read(path):
    """The evaluation in the file `path`; only Van der Pol with the direct ansatz is known here."""
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
        model = json.loads(metadata["model"])
        if metadata["plant"] != "van-der-pol" or model["ansatz"] != "direct":
            raise SystemExit(f"{path}: not Van der Pol with the direct ansatz")
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    layers = sum(name.startswith("layers.") and name.endswith(".weight") for name in tensors)
    collocation, initial = tensors["points.collocation"], tensors["points.initial"]
    states = len(model["states"])
    return Evaluation(
        weights=[tensors[f"layers.{i}.weight"] for i in range(layers)],
        biases=[tensors[f"layers.{i}.bias"] for i in range(layers)],
        input_mean=np.array(model["input_mean"]),
        input_std=np.array(model["input_std"]),
        output_mean=np.array(model["output_mean"]),
        output_std=np.array(model["output_std"]),
        collocation=collocation,
        initial=initial,
        physics_factor=float(tensors["loss.lambda"][0]) / (len(collocation) * states),
        initial_factor=1.0 / (len(initial) * states),
        residual_scale=tensors["loss.residual_scale"],
        initial_scale=tensors["loss.initial_scale"],
        loss=float(tensors["loss.terms"].sum()),
        gradient=tensors["loss.gradient"],
    )


def check(evaluation, name, loss, gradient, tolerance=1e-10):
    """Stops the program if `loss` and `gradient` are not pinc's.

    The gradient is compared by its norm: sums of 10^5 terms in another order differ by some hundred
    roundings of the largest, far below the tolerance.
    """
    flat = np.concatenate([np.concatenate([np.ravel(w), np.ravel(b)]) for w, b in gradient])
    error = np.linalg.norm(flat - evaluation.gradient) / np.linalg.norm(evaluation.gradient)
    difference = abs(float(loss) / evaluation.loss - 1.0)
    if not (difference <= tolerance and error <= tolerance):
        raise SystemExit(f"{name}: differs from pinc by {difference:.1e} in the loss, "
                         f"{error:.1e} in the gradient")
    return max(difference, error)
