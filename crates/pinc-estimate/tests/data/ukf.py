"""answer-*-ukf.csv: the unscented Kalman filter straight from its formulas, in 40 digits."""

import csv
from decimal import Decimal as D
from decimal import getcontext

getcontext().prec = 40
ALPHA, BETA, KAPPA = D(1) / 1000, D(2), D(0)


def sqrt(value):
    return value.sqrt()


def rk4(f, x, u, step, substeps):
    h = step / substeps
    for _ in range(substeps):
        k1 = f(x, u)
        k2 = f([a + h / 2 * b for a, b in zip(x, k1)], u)
        k3 = f([a + h / 2 * b for a, b in zip(x, k2)], u)
        k4 = f([a + h * b for a, b in zip(x, k3)], u)
        x = [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]
    return x


def tanks(h, u):
    w = [D(a) * sqrt(2 * 981 * level) for a, level in zip(["0.071", "0.057"] * 2, h)]
    f = [D("3.33") * u[0] / 2, D("3.35") * u[1] / 2]
    return [
        (f[0] + w[2] - w[0]) / 28,
        (f[1] + w[3] - w[1]) / 32,
        (f[1] - w[2]) / 28,
        (f[0] - w[3]) / 32,
    ]


def oscillator(x, u):
    return [x[1], (1 - x[0] ** 2) * x[1] - x[0] + u[0]]


def cholesky(p):
    n = len(p)
    low = [[D(0)] * n for _ in range(n)]
    for i in range(n):
        for j in range(i + 1):
            rest = p[i][j] - sum(low[i][k] * low[j][k] for k in range(j))
            low[i][j] = sqrt(rest) if i == j else rest / low[j][j]
    return low


def inverse(s):
    n = len(s)
    rows = [list(r) + [D(i == j) for j in range(n)] for i, r in enumerate(s)]
    for c in range(n):
        pivot = rows[c][c]
        rows[c] = [v / pivot for v in rows[c]]
        for r in range(n):
            if r != c:
                factor = rows[r][c]
                rows[r] = [a - factor * b for a, b in zip(rows[r], rows[c])]
    return [r[n:] for r in rows]


def points(z, p):
    n = len(z)
    lam = ALPHA**2 * (n + KAPPA) - n
    root = cholesky(p)
    sigma = [list(z)]
    for sign in (1, -1):
        for j in range(n):
            sigma.append([z[i] + sign * sqrt(n + lam) * root[i][j] for i in range(n)])
    means = [lam / (n + lam)] + [1 / (2 * (n + lam))] * (2 * n)
    covariances = [means[0] + 1 - ALPHA**2 + BETA] + means[1:]
    return sigma, means, covariances


def mean(values, weights):
    return [sum(w * v[i] for w, v in zip(weights, values)) for i in range(len(values[0]))]


def covariance(a, mean_a, b, mean_b, weights):
    return [
        [
            sum(w * (x[i] - mean_a[i]) * (y[j] - mean_b[j]) for w, x, y in zip(weights, a, b))
            for j in range(len(mean_b))
        ]
        for i in range(len(mean_a))
    ]


def filtered(name, f, step, inputs, measured, states, z, sds):
    z, (p_sd, q_sd, r_sd) = [D(v) for v in z], [D(v) for v in sds]
    n, m = len(z), len(measured)
    p = [[p_sd**2 * (i == j) for j in range(n)] for i in range(n)]
    with open(f"estim-{name}.csv") as data, open(f"answer-{name}-ukf.csv", "w") as out:
        print(",".join(["t"] + states + ["sd_" + s for s in states]), file=out)
        for row in csv.DictReader(data):
            y = [D(row[c]) for c in measured]
            u = [D(row[c]) for c in inputs]
            sigma, means, weights = points(z, p)
            seen = [s[:m] for s in sigma]
            expected = mean(seen, means)
            s = covariance(seen, expected, seen, expected, weights)
            s = [[s[i][j] + r_sd**2 * (i == j) for j in range(m)] for i in range(m)]
            cross = covariance(sigma, z, seen, expected, weights)
            inv = inverse(s)
            gain = [[sum(c[k] * inv[k][j] for k in range(m)) for j in range(m)] for c in cross]
            z = [a + sum(g * (b - e) for g, b, e in zip(k, y, expected)) for a, k in zip(z, gain)]
            ks = [[sum(k[a] * s[a][b] for a in range(m)) for b in range(m)] for k in gain]
            p = [
                [p[i][j] - sum(ks[i][a] * gain[j][a] for a in range(m)) for j in range(n)]
                for i in range(n)
            ]
            numbers = [D(row["t"])] + z + [sqrt(p[i][i]) for i in range(n)]
            print(",".join(repr(float(v)) for v in numbers), file=out)
            sigma, means, weights = points(z, p)
            ahead = [rk4(f, s, u, step, 4) for s in sigma]
            z = mean(ahead, means)
            p = covariance(ahead, z, ahead, z, weights)
            p = [[p[i][j] + q_sd**2 * (i == j) for j in range(n)] for i in range(n)]


LEVELS = ["h1", "h2", "h3", "h4"]
START = ["8", "13", "3.5", "2.5"]
filtered("tanks", tanks, D(10), ["u1", "u2"], ["y_h1", "y_h2"], LEVELS, START,
         ["1", ".03", ".05"])
START = ["0", "0"]
filtered("vdp", oscillator, D(".5"), ["u"], ["y_x1"], ["x1", "x2"], START, ["1", ".02", ".1"])
