"""Writes zoro.txt: the zero-order tightening of a differential drive's plan, by numpy alone.

x+ = x + p T v cos(th + T w/2), y+ = y + p T v sin(th + T w/2), th+ = th + T w, T = 0.2, p = 1; output
d = p sqrt(x^2 + y^2) + 0.1 v. Jacobians by complex steps. K: the regulator along the plan with
weights of 1, 0 at the first stage. P+ = M P M' + W; E+ = the ellipsoid of least trace around M E
M' + boxes, in units of sqrt((M E M')_ii) + box_i; g+ = M g + dF for p at the end of [0.9, 1.05] where dF is larger.
Python 3.12, numpy 2.3. Run: python zoro.py > zoro.txt
"""

import numpy as np
from statistics import NormalDist

T, N, NU, n, m = 0.2, 8, 6, 3, 2
UX = np.array([2.0, 3.0, 1.5])
SD, BOX = np.array([0.01, 0.02, 0.005]), np.array([0.004, 0.003, 0.002])
P0 = np.array([[4e-4, 1e-4, 0], [1e-4, 9e-4, -5e-5], [0, -5e-5, 1e-4]])
Z, LOW, HIGH = NormalDist().inv_cdf(0.99), 0.9, 1.05


def F(x, u, p):
    a = x[2] + T * u[1] / 2
    return np.array([x[0] + p * T * u[0] * np.cos(a), x[1] + p * T * u[0] * np.sin(a), x[2] + T * u[1]])


def h(x, u, p):
    return np.array([p * np.sqrt(x[0] ** 2 + x[1] ** 2) + 0.1 * u[0]])


def jac(f, z):
    step = 1e-30
    return np.array([np.imag(f(z + 1j * step * np.eye(len(z))[i])) / step for i in range(len(z))]).T


us = [np.array([0.8 + 0.05 * k, 0.9 - 0.3 * k]) for k in range(NU)]
us += [us[-1]] * (N - NU)
xs = [np.array([1.0, -0.5, 0.3])]
for u in us:
    xs.append(F(xs[-1], u, 1.0))
A = [jac(lambda x: F(x, us[k], 1.0), xs[k]) for k in range(N)]
B = [jac(lambda u: F(xs[k], u, 1.0), us[k]) for k in range(N)]
Q, R = np.eye(n), np.eye(m)
K, S = [np.zeros((m, n))] * N, Q
for k in range(N - 1, 0, -1):
    K[k] = -np.linalg.solve(R + B[k].T @ S @ B[k], B[k].T @ S @ A[k])
    M = A[k] + B[k] @ K[k]
    S = Q + K[k].T @ R @ K[k] + M.T @ S @ M


def width(row, P, E, g):
    root = lambda X: np.sqrt(row @ X @ row)
    return Z * root(P) + root(E) + abs(row @ g)


P, E, g = P0, np.zeros((n, n)), np.zeros(n)
states, inputs, outputs = [], np.zeros((NU, m)), []
for k in range(N):
    for i in range(m):
        at = (min(k, NU - 1), i)
        inputs[at] = max(inputs[at], width(K[k][i], P, E, g))
    C, D = jac(lambda x: h(x, us[k], 1.0), xs[k + 1])[0], jac(lambda u: h(xs[k + 1], u, 1.0), us[k])[0]
    through = width(D @ K[k], P, E, g)
    M = A[k] + B[k] @ K[k]
    P = M @ P @ M.T + np.diag(SD**2)
    parts = [M @ E @ M.T] + [np.diag(np.eye(n)[i] * BOX[i] ** 2) for i in range(n)]
    far = np.sqrt(np.diag(parts[0])) + BOX
    s = [np.sqrt(np.trace(np.diag(1 / far) @ X @ np.diag(1 / far))) for X in parts]
    E = sum(s) * sum(X / r for X, r in zip(parts, s) if r > 0)
    ends = [F(xs[k], us[k], p) - F(xs[k], us[k], 1.0) for p in (LOW, HIGH)]
    sizes = [np.linalg.norm(d / UX) for d in ends]
    g = M @ g + (ends[1] if sizes[1] >= sizes[0] else -ends[0])
    states.append([width(np.eye(n)[i], P, E, g) for i in range(n)])
    direct = np.sqrt(xs[k + 1][0] ** 2 + xs[k + 1][1] ** 2) * max(1 - LOW, HIGH - 1)
    outputs.append(width(C, P, E, g) + through + direct)
for row in [np.array(xs).ravel(), np.array(us).ravel(), np.ravel(states), inputs.ravel(), np.ravel(outputs)]:
    print(" ".join(f"{v:.17g}" for v in row))
