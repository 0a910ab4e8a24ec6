"""The main job from Python: a net of the Van der Pol oscillator, and the loop that it controls.

    python crates/pinc-py/examples/main_job.py [PICTURE]

Each part between `# %%` is a cell of a notebook; editors that know them run one at a time. Takes
some ten seconds; needs matplotlib.
"""

# %% Packages and the config

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # to a file; leave this out in a notebook
import matplotlib.pyplot as plt
import numpy as np

import pinc_nmpc as pinc

CONFIG = Path(__file__).resolve().parents[3] / "configs" / "van-der-pol" / "main.toml"

# %% Training, with its progress


def show(now: pinc.TrainingProgress) -> None:
    """Every tenth of the training, a line."""
    if now.iteration % (now.iterations // 10) == 0:
        print(f"{now.iteration:5d}/{now.iterations}  loss {now.loss:.2e}", flush=True)


trained = pinc.train(CONFIG, progress=show)
model = trained.model
print(trained, f"MSE of free runs {trained.validation['mse_gen']:.2e}")

# %% A free run against an accurate integration


def plant(x: np.ndarray, u: float, seconds: float, steps: int = 100) -> np.ndarray:
    """The oscillator, by classical Runge-Kutta steps."""

    def f(x: np.ndarray) -> np.ndarray:
        return np.array([x[1], (1 - x[0] ** 2) * x[1] - x[0] + u])

    h = seconds / steps
    for _ in range(steps):
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        k4 = f(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


T = model.sample_time_s
inputs = np.random.default_rng(1).uniform(-1, 1, (20, 1))
predicted = model.predict([1.0, 0.0], inputs)
marked = [np.array([1.0, 0.0])]
for (u,) in inputs:
    marked.append(plant(marked[-1], u, T))
true = np.array(marked)
print(f"free run of {len(inputs)} steps: off by {np.abs(predicted - true).max():.1e} at most")

# %% The closed loop, with the net and with RK4 as the controller's model

loops = {}
for name in ("pinc", "rk4"):
    controller = pinc.Nmpc(CONFIG, model, only=name)
    x = np.array([1.0, 0.0])
    states, applied, statuses = [], [], set()
    for _ in range(round(60 / T)):
        step = controller.step(x)  # follows the references of the config
        states.append(x)
        applied.append(step.u[0])
        statuses.add(step.status)
        x = plant(x, step.u[0], T)
    loops[name] = np.array(states), np.array(applied)
    print(f"{name}: {len(states)} steps, {', '.join(sorted(statuses))}")
apart = np.abs(loops["pinc"][0] - loops["rk4"][0]).max()
print(f"the two loops are {apart:.1e} apart at most")

# %% The picture

t = T * np.arange(len(loops["pinc"][0]))
starts, targets = [0, 15, 30, 45], [0.0, -0.5, 0.8, 1.0]  # the config's references of x1
figure, (run, state, control) = plt.subplots(3, 1, figsize=(8, 8), constrained_layout=True)
marks = T * np.arange(len(true))
for i, variable in enumerate(model.states):
    run.plot(marks, true[:, i], color=f"C{i}", label=f"{variable}, integrated")
    run.plot(marks, predicted[:, i], "x", color=f"C{i}", label=f"{variable}, net")
run.set(title="Free run", xlabel="t in s")
run.legend(ncols=2, loc="lower left")
state.step(starts + [60], targets + targets[-1:], "k:", where="post", label="reference of x1")
for name, style in (("pinc", "-"), ("rk4", "--")):
    visited, chosen = loops[name]
    state.plot(t, visited[:, 0], style, label=f"x1, {name}")
    control.step(t, chosen, style, where="post", label=f"u, {name}")
state.set(title="Closed loop")
state.legend()
control.set(xlabel="t in s")
control.legend()
picture = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("main_job.png")
figure.savefig(picture, dpi=120)
print(f"picture: {picture}")
