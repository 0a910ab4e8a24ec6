"""The steps that the line search of Hager and Zhang (SIAM J. Optim. 16 (2005), steps L0 to L2)
tries on functions of one variable, from the paper: python3 hager_zhang.py

Prints, for each function and first step, how many points are tried and the last of them.
"""

from math import cos, exp, hypot, inf, isfinite, sin, tanh

DELTA, SIGMA, EPSILON, GAMMA, RHO = 0.1, 0.9, 1e-6, 0.66, 5.0


class Found(Exception):
    pass


def search(f, first):
    value0, slope0 = f(0.0)
    epsilon = EPSILON * abs(value0)
    tried = []

    def phi(step):
        tried.append(step)
        value, slope = f(step)
        if not (isfinite(value) and isfinite(slope)):
            value, slope = inf, -1.0
        wolfe = value - value0 <= DELTA * step * slope0 and slope >= SIGMA * slope0
        approximate = (2 * DELTA - 1) * slope0 >= slope >= SIGMA * slope0
        if wolfe or (approximate and value <= value0 + epsilon):
            raise Found
        return step, value, slope

    def low(point):
        return point[1] <= value0 + epsilon

    def u3(a, b):
        while True:
            d = phi((a[0] + b[0]) / 2)
            if d[2] >= 0:
                return a, d
            a, b = (d, b) if low(d) else (a, d)

    def update(a, b, c):
        if not a[0] < c < b[0]:
            return a, b
        c = phi(c)
        if c[2] >= 0:
            return a, c
        return (c, b) if low(c) else u3(a, c)

    def secant(a, b):
        rise = b[2] - a[2]
        return (a[0] * b[2] - b[0] * a[2]) / rise if rise != 0 else inf

    def secant2(a, b):
        c = secant(a, b)
        left, right = update(a, b, c)
        if c == right[0] and c != b[0]:
            return update(left, right, secant(b, right))
        if c == left[0] and c != a[0]:
            return update(left, right, secant(a, left))
        return left, right

    def bracket(step):
        origin = left = (0.0, value0, slope0)
        while True:
            c = phi(step)
            if c[2] >= 0:
                return left, c
            if not low(c):
                return u3(origin, c)
            left, step = c, step * RHO

    try:
        a, b = bracket(first)
        while True:
            left, right = secant2(a, b)
            if right[0] - left[0] > GAMMA * (b[0] - a[0]):
                left, right = update(left, right, (left[0] + right[0]) / 2)
            a, b = left, right
    except Found:
        return len(tried), tried[-1]


def wall(a):
    rise = max(a - 1.0, 0.0)
    return -a + 0.5 * 1e4 * rise * rise, -1.0 + 1e4 * rise


def steep(a):
    return 0.1 * (a - 1.0) ** 10, (a - 1.0) ** 9


def waves(a):
    return -0.1 * a - sin(9.0 * a), -0.1 - 9.0 * cos(9.0 * a)


def ripples(a):
    return 0.02 * (a - 1.0) ** 2 - 0.1 * sin(20.0 * a), 0.04 * (a - 1.0) - 2.0 * cos(20.0 * a)


def barrier(a):
    return (inf, 0.0) if a >= 2.0 else ((a - 1.0) ** 2, 2.0 * (a - 1.0))


def well(a):
    d = max(a - 1.0, 0.0)
    return -a + 50.0 * d**4, -1.0 + 200.0 * d**3


def valley(a):
    d = hypot(a - 1.0, 0.01)
    return 5.0 * d + 4.0 * (a - 1.0), 5.0 * (a - 1.0) / d + 4.0


def notch(a):
    d = 100.0 * (a - 2.0)
    return -0.2 * a + 3.0 * exp(-d * d), -0.2 - 600.0 * d * exp(-d * d)


def cliff(a):
    t = tanh(200.0 * (a - 1.3))
    return -a + 3.0 * (t + 1.0), -1.0 + 600.0 * (1.0 - t * t)


for f, steps in [
    (wall, [0.001, 0.1, 1.7, 3.0, 40.0, 1000.0]),
    (steep, [0.001, 3.0, 40.0, 1000.0]),
    (waves, [0.001, 1.2, 1.7]),
    (ripples, [1.7, 2.1, 3.0, 5.0, 7.3, 11.0, 40.0, 1000.0]),
    (barrier, [3.0, 40.0, 1000.0]),
    (well, [0.1, 2.1]),
    (valley, [0.1, 0.9, 40.0]),
    (notch, [0.4]),
    (cliff, [0.001, 0.4, 2.1]),
]:
    for first in steps:
        count, last = search(f, first)
        print(f"({f.__name__}, {first!r}, {count}, {last!r}),")
