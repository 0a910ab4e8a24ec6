#!/usr/bin/env python3
"""Fits START of src/acetone_mixture.rs: 1/T of the boiling mixture as a quotient of two cubic forms in the
mole fractions of acetone, methanol and water, at 101.325 kPa. Prints both coefficients of each monomial and
the largest error in K. Needs numpy.

    python3 start.py

The equation is the same as in expected.py. The fit is linear least squares on (numerator - z denominator), weighted by
the denominator and the error of the fit before; of all fits with positive coefficients below, which keep
the quotient finite, that with the smallest error is taken.
"""
import numpy as np

GAS = 1.98721
B = np.array([[0, 184.70, 631.05], [222.64, 0, -253.88], [1197.41, 845.21, 0]])
ALPHA = np.array([[0, 0.3084, 0.5343], [0.3084, 0, 0.2994], [0.5343, 0.2994, 0]])
ANTOINE = np.array([[14.3145, 2756.22, 228.060], [16.5785, 3638.27, 239.500], [16.3872, 3885.70, 230.170]])
POWERS = [(i, j, 3 - i - j) for i in range(4) for j in range(4 - i)]
MIDDLE, SCALE = 1 / 340, 1e-4


def excess(x, z):
    """ln of the sum of the partial pressures over 101.325 kPa."""
    tau = B[None] * z[:, None, None] / GAS
    g = np.exp(-ALPHA * tau)
    s = np.einsum("nk,nkj->nj", x, g)
    c = np.einsum("nk,nkj->nj", x, tau * g) / s
    ln_gamma = c + np.einsum("nj,nij,nij->ni", x / s, g, tau - c[:, None, :])
    celsius = 1 / z - 273.15
    ln_pressure = ANTOINE[:, 0] - ANTOINE[:, 1] / (celsius[:, None] + ANTOINE[:, 2])
    return np.log((x * np.exp(ln_gamma + ln_pressure)).sum(1) / 101.325)


def boiling(x):
    z = np.full(len(x), MIDDLE)
    for _ in range(12):
        h = z * 1e-6
        z = z - excess(x, z) * 2 * h / (excess(x, z + h) - excess(x, z - h))
    return z


def main():
    part = (1 - np.cos(np.pi * np.arange(61) / 60)) / 2
    acetone, rest = (grid.ravel() for grid in np.meshgrid(part, part, indexing="ij"))
    methanol = (1 - acetone) * rest
    x = np.stack([acetone, methanol, 1 - acetone - methanol], axis=1)
    z = boiling(x)
    monomials = np.stack([np.prod(x ** np.array(p), axis=1) for p in POWERS], axis=1)
    target = (z - MIDDLE) / SCALE
    weight, below, best = np.ones(len(z)), np.ones(len(z)), (np.inf, None)
    for _ in range(400):
        w = weight / below
        matrix = np.hstack([monomials, -target[:, None] * monomials[:, 1:]]) * w[:, None]
        size = np.linalg.norm(matrix, axis=0)
        right = target * monomials[:, 0] * w
        c = np.linalg.lstsq(matrix / size, right, rcond=1e-12)[0] / size
        denominator = np.concatenate([[1.0], c[len(POWERS):]])
        numerator = c[: len(POWERS)] * SCALE + denominator * MIDDLE
        below = monomials @ denominator
        error = np.abs(below / (monomials @ numerator) - 1 / z)
        if error.max() < best[0] and denominator.min() > 0:
            best = error.max(), (numerator, denominator)
        weight = weight * (0.2 + error / error.max())
        weight /= weight.mean()
    for powers, n, d in zip(POWERS, *best[1]):
        print(powers, f"{n:.6g}", f"{d:.6g}")
    print(f"{best[0]:.3f} K")


if __name__ == "__main__":
    main()
