#!/usr/bin/env python3
"""Writes expected.csv: values and derivatives of the functions in tests/suite/digits.rs, by mpmath.

    python3 expected.py > expected.csv

The functions are written here a second time, from their formulas, in 60-digit arithmetic; derivatives
come from mpmath's numerical differentiation at raised precision, so that nothing is shared with the code
under test. 34 digits are printed, far more than an f64 holds. The points are exact in
binary.
"""
from mpmath import atan, cos, diff, exp, log, mp, mpf, nstr, sin, sqrt, tan, tanh

mp.dps = 60

# One variable: value, first and second derivative.
UNARY = {
    "sqrt": sqrt,
    "tanh": tanh,
    "exp": lambda x: exp(x / 4),
    "log": log,
    "sin": sin,
    "cos": cos,
    "tan": lambda x: tan(x / 16),
    "atan": atan,
    "power": lambda x: (x / 4) ** mpf("1.75"),
    "whole power": lambda x: (x / 8) ** 5 + (x + 1) ** -3,
    "reciprocal": lambda x: 1 / x,
    "quotient": lambda x: tanh(x) * sqrt(x) / (x * x + 1),
    "chain": lambda x: tanh(sqrt(x * x * x + mpf(3) / 4) - 2),
    "torricelli": lambda x: (3 - mpf(1) / 8 * sqrt(1962 * x)) / 28,
}
UNARY_POINTS = ["0.0625", "0.375", "1.0", "1.75", "5.5", "18.0"]

# Three variables: value, gradient and upper triangle of the Hessian.
TERNARY = {
    "oscillator": lambda x, y, z: (1 - x * x) * y - x + z,
    "mixed": lambda x, y, z: tanh(x * y) / (z + 2) + sqrt(x * x + y * y + 1) * z,
    "neuron": lambda x, y, z: z * tanh(x * tanh(y) + z / 2) - y / (x * x + 1),
    "arrhenius": lambda x, y, z: x * exp(-y / (z * z + 1)) - sin(x) * cos(y),
    "swing": lambda x, y, z: (sin(x) + cos(x) * atan(z * y)) / (2 - cos(x) ** 2),
}
TERNARY_POINTS = [("0.5", "-0.75", "1.25"), ("-1.5", "2.0", "0.25"), ("2.5", "0.125", "-1.0")]


def digits(value):
    return nstr(value, 34, min_fixed=1, max_fixed=0)


print("function,x,y,z,quantity,expected")
for name, f in UNARY.items():
    for point in UNARY_POINTS:
        x = mpf(point)
        for quantity, value in [("f", f(x)), ("x", diff(f, x)), ("xx", diff(f, x, 2))]:
            print(f"{name},{point},0,0,{quantity},{digits(value)}")
for name, f in TERNARY.items():
    for point in TERNARY_POINTS:
        at = tuple(mpf(p) for p in point)
        for quantity in ["f", "x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz"]:
            orders = tuple(quantity.count(v) for v in "xyz")
            value = f(*at) if quantity == "f" else diff(f, at, orders)
            # Differentiating at 60 digits leaves noise where the derivative is 0.
            value = mpf(0) if abs(value) < mpf(10) ** -30 else value
            print(f"{name},{','.join(point)},{quantity},{digits(value)}")
