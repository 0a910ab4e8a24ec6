"""Records of a hydraulic servo axis with viscous and Coulomb friction, for configs/identification/servo.toml.

    python3 benches/data/servo.py

The numbers are those of the plant `hydraulic-servo`.
"""

import math
import pathlib
import random

FOLDER = pathlib.Path("configs/identification")
T = 0.01


def orifice(d):
    return d / math.sqrt(math.sqrt(d * d + 0.25))


def flow(s, p):
    opening = math.sqrt(s * s + 1e-6)
    return 1.5e-4 * ((opening + s) * orifice(21 - p) - (opening - s) * orifice(21 + p))


def friction(v):
    return 2000 * v + 400 * math.tanh(v / 0.02)


def rates(x, u):
    _, v, p, s = x
    oil = 4 * 1400 / 6e-5
    return (v, p - friction(v) / 1000, (flow(s, p) - 1e-3 * v - 4e-7 * p) * oil, (u - s) / 2e-3)


def step(x, u, steps=200):
    h = T / steps
    for _ in range(steps):
        k1 = rates(x, u)
        k2 = rates([a + h / 2 * k for a, k in zip(x, k1)], u)
        k3 = rates([a + h / 2 * k for a, k in zip(x, k2)], u)
        k4 = rates([a + h * k for a, k in zip(x, k3)], u)
        x = [a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4)]
    return x


def write(name, seed, measured):
    """A record of 200 rows, measured with noise; or without, with the force."""
    draw, x = random.Random(seed), [0.0] * 4
    with open(FOLDER / name, "w") as file:
        file.write("t,u,y_x,y_p,y_force\n")
        for k in range(200):
            if k % 8 == 0:
                u = round(draw.uniform(-1, 1) ** 3 * 0.3, 4)
            noise = [measured * draw.gauss(0, sd) for sd in (2e-6, 0.02)]
            force = "" if measured else f"{friction(x[1]):.3f}"
            file.write(f"{T * k:.2f},{u},{x[0] + noise[0]:.7f},{x[2] + noise[1]:.4f},{force}\n")
            x = step(x, u)


if __name__ == "__main__":
    write("servo.csv", 1, True)
    write("servo-held-out.csv", 2, False)
