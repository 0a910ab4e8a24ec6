#!/usr/bin/env python3
"""Writes rhs.csv and flows.csv: what plants.rs, rk4.rs and adaptive.rs compare with, by mpmath.

    python3 expected.py

The equations are written here a second time, from the paper and from Johansson (2000), in 50-digit
arithmetic.
rhs.csv: the right-hand side and its Jacobian (row by row, columns x then u; by mpmath's numerical
differentiation at raised precision). flows.csv: the state after some time under a constant input, by
mpmath's Taylor-series integrator with 25 digits asked for. Fields are separated by commas, the numbers of a
field by spaces; all arguments are decimals, and an f64 may differ from them by rounding.
"""
from pathlib import Path

from mpmath import diff, exp, findroot, log, mp, mpf, nstr, odefun, sqrt

mp.dps = 50
G = mpf(981)


def van_der_pol(x, u):
    return [x[1], (1 - x[0] ** 2) * x[1] - x[0] + u[0]]


def one_tank(h, u):
    return [(mpf("3.14") * u[0] - mpf("0.071") * sqrt(2 * G * h[0])) / 28]


def four_tanks(gamma1, gamma2, k1, k2):
    g1, g2, k1, k2 = map(mpf, (gamma1, gamma2, k1, k2))
    a = [mpf(v) for v in ("0.071", "0.057", "0.071", "0.057")]

    def rhs(h, u):
        w = [a[i] * sqrt(2 * G * h[i]) for i in range(4)]
        return [
            (g1 * k1 * u[0] + w[2] - w[0]) / 28,
            (g2 * k2 * u[1] + w[3] - w[1]) / 32,
            ((1 - g2) * k2 * u[1] - w[2]) / 28,
            ((1 - g1) * k1 * u[0] - w[3]) / 32,
        ]

    return rhs


R = mpf("1.98721")
B = [[mpf(v) for v in row.split()] for row in ("0 184.70 631.05", "222.64 0 -253.88", "1197.41 845.21 0")]
ALPHA = [[mpf(v) for v in row.split()] for row in ("0 0.3084 0.5343", "0.3084 0 0.2994", "0.5343 0.2994 0")]
ANTOINE = [
    [mpf(v) for v in row.split()]
    for row in ("14.3145 2756.22 228.060", "16.5785 3638.27 239.500", "16.3872 3885.70 230.170")
]
HEAT = [mpf(v) for v in ("29.10", "35.21", "40.66")]


def partial_pressures(x, temperature):
    """kPa over a liquid of mole fractions x at a temperature in K: NRTL and Antoine."""
    all3 = range(3)
    tau = [[B[i][j] / (R * temperature) for j in all3] for i in all3]
    g = [[exp(-ALPHA[i][j] * tau[i][j]) for j in all3] for i in all3]

    def ln_gamma(i):
        total = sum(tau[j][i] * g[j][i] * x[j] for j in all3) / sum(g[k][i] * x[k] for k in all3)
        for j in all3:
            below = sum(g[k][j] * x[k] for k in all3)
            mean = sum(x[m] * tau[m][j] * g[m][j] for m in all3) / below
            total += x[j] * g[i][j] / below * (tau[i][j] - mean)
        return total

    celsius = temperature - mpf("273.15")
    return [x[i] * exp(ln_gamma(i) + ANTOINE[i][0] - ANTOINE[i][1] / (celsius + ANTOINE[i][2])) for i in all3]


def vapour_over(liquid):
    pressure = mpf("101.325")
    boiling = findroot(lambda t: log(sum(partial_pressures(liquid, t)) / pressure), mpf(340))
    return [p / pressure for p in partial_pressures(liquid, boiling)]


def acetone_column(x, u):
    liquids = [[x[2 * i], 1 - x[2 * i] - x[2 * i + 1], x[2 * i + 1]] for i in range(3)]
    x0, x1, x2 = ([liquid[0], liquid[2]] for liquid in liquids)
    over = [vapour_over(liquid) for liquid in liquids]
    y0, y1, y2 = ([y[0], y[2]] for y in over)
    reflux, vapour = u[0], u[1] / sum(over[0][i] * HEAT[i] for i in range(3))
    z = [mpf("0.25"), mpf("0.5")]
    pot = [(4 * (z[i] - x0[i]) + reflux * (x1[i] - x0[i]) - vapour * (y0[i] - x0[i])) / 1000 for i in range(2)]
    lower = [(reflux * (x2[i] - x1[i]) + vapour * (y0[i] - y1[i])) / 200 for i in range(2)]
    upper = [(reflux * (y2[i] - x2[i]) + vapour * (y1[i] - y2[i])) / 200 for i in range(2)]
    return pot + lower + upper


def acetone_still(x, u):
    y = vapour_over([x[0], x[1], 1 - x[0] - x[1]])
    vapour = u[1] / sum(y[i] * HEAT[i] for i in range(3))
    return [(u[0] * (mpf("0.5") - x[i]) - 3 * x[i] - vapour * (y[i] - x[i])) / 1000 for i in range(2)]


PLANTS = {
    "acetone-column": acetone_column,
    "acetone-still": acetone_still,
    "van-der-pol": van_der_pol,
    "one-tank": one_tank,
    "antonelo": four_tanks("0.5", "0.5", "3.33", "3.35"),
    "johansson-nonminimum": four_tanks("0.43", "0.34", "3.14", "3.29"),
    "johansson-minimum": four_tanks("0.70", "0.60", "3.33", "3.35"),
}
TANK_POINTS = [("12.4 12.7 1.8 1.4", "3.0 3.0"), ("2.5 17.0 0.6 5.5", "0.75 4.5")]
POINTS = {
    "acetone-column": [("0.1 0.7 0.4 0.3 0.6 0.1", "3.0 120.0"), ("0.05 0.8 0.2 0.5 0.4 0.2", "2.0 90.0")],
    "acetone-still": [("0.1 0.2", "4.0 100.0"), ("0.3 0.05", "2.0 150.0"), ("0.01 0.02", "6.0 30.0")],
    "van-der-pol": [("0.5 -1.5", "0.25"), ("-2.75 3.0", "-1.0"), ("0.0 0.0", "0.0")],
    "one-tank": [("2.0", "4.45"), ("13.7", "0.5")],
} | dict.fromkeys(["antonelo", "johansson-nonminimum", "johansson-minimum"], TANK_POINTS)
FLOWS = [
    ("van-der-pol", "1.0 0.5", "0.3", "0.5"),
    ("van-der-pol", "-2.0 2.5", "-0.8", "10.0"),
    ("van-der-pol", "0.5 -1.5", "0.25", "2.0"),
    ("one-tank", "5.0", "2.0", "10.0"),
    ("antonelo", "9.0 9.0 2.0 3.0", "3.0 2.0", "10.0"),
    ("johansson-nonminimum", "12.6 13.0 4.8 4.9", "1.0 4.0", "50.0"),
]


def numbers(text):
    return [mpf(v) for v in text.split()]


def digits(values):
    return " ".join(nstr(v, 25, min_fixed=1, max_fixed=0) for v in values)


def jacobian(f, x, u):
    n, at = len(x), x + u
    rows = []
    for i in range(n):
        for j in range(len(at)):
            slope = diff(lambda v: f((at[:j] + [v] + at[j + 1 :])[:n], (at[:j] + [v] + at[j + 1 :])[n:])[i], at[j])
            # Numerical differentiation leaves noise where the derivative is 0.
            rows.append(slope if abs(slope) > mpf(10) ** -25 else mpf(0))
    return rows


here = Path(__file__).parent
with open(here / "rhs.csv", "w") as out:
    print("plant,x,u,rhs,jacobian", file=out)
    for plant, points in POINTS.items():
        for x, u in points:
            at = numbers(x), numbers(u)
            f = PLANTS[plant]
            print(f"{plant},{x},{u},{digits(f(*at))},{digits(jacobian(f, *at))}", file=out)

mp.dps = 30
with open(here / "flows.csv", "w") as out:
    print("plant,x,u,duration_s,x_end", file=out)
    for plant, x, u, duration in FLOWS:
        f, at = PLANTS[plant], numbers(u)
        end = odefun(lambda t, y: f(y, at), 0, numbers(x), tol=mpf(10) ** -27)(mpf(duration))
        print(f"{plant},{x},{u},{duration},{digits(end)}", file=out)
