#!/usr/bin/env python3
"""Casing heading of the gas-lifted well of configs/oil-well/gas-lift.toml: where it begins, and
what it costs. Needs Python 3.11 alone.

    python3 benches/distributed/casing_heading.py

The equations are written here a second time, with the pressures eliminated, and the parameters are
read from the config. Prints, for each rate of gas: the opening of the choke above which the steady
state is unstable, the period of the oscillation there, and with half of the choke open the steady
state, the range of the pressure at the bottom hole once it oscillates, its period, and the mean
production beside the steady state's.
"""

import math
import pathlib
import tomllib

CONFIG = pathlib.Path(__file__).resolve().parents[2] / "configs" / "oil-well" / "gas-lift.toml"
P = tomllib.loads(CONFIG.read_text())["plant"]["expression"]["parameters"]

BAR = 1e5
GAS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)


def well(x, choke, gas):
    """The rates of the masses, and bottom-hole pressure in bar and production in kg/s."""
    annulus, tubing, oil = x
    tube = P["L"] * P["A_tubing"]
    below = P["L_below"] * P["A_below"]
    warm, cold = P["R"] * P["T_tubing"] / P["M"], P["R"] * P["T_annulus"] / P["M"]
    p_annulus = (cold + P["g"] * P["L"]) * annulus / P["V_annulus"]
    p_head = warm * tubing / (tube + below - oil / P["rho"])
    density = (tubing + oil - P["rho"] * below) / tube
    p_foot = p_head + density * P["g"] * P["L"]
    p_bottom = p_foot + P["rho"] * P["g"] * P["L_below"]
    flow = p_annulus / cold * max(p_annulus - p_foot, 0.0)
    injected = P["C_injection"] * math.sqrt(flow)
    outflow = density * max(p_head - P["p_separator"] * BAR, 0.0)
    produced = choke * P["C_choke"] * math.sqrt(outflow)
    inflow = P["PI"] * max(P["p_reservoir"] * BAR - p_bottom, 0.0)
    share = tubing / (tubing + oil)
    rates = [gas - injected, injected - share * produced, inflow - (1.0 - share) * produced]
    return rates, p_bottom / BAR, (1.0 - share) * produced


def step(x, u, h):
    """A step of RK4."""
    moved = lambda k, part: [a + part * h * b for a, b in zip(x, k)]
    k1 = well(x, *u)[0]
    k2 = well(moved(k1, 0.5), *u)[0]
    k3 = well(moved(k2, 0.5), *u)[0]
    k4 = well(moved(k3, 1.0), *u)[0]
    return [a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]


def jacobian(x, u):
    """Columns of central differences, as rows of the matrix."""
    columns = []
    for i in range(3):
        h = 1e-6 * x[i]
        at = lambda sign: well([a + sign * h * (j == i) for j, a in enumerate(x)], *u)[0]
        columns.append([(a - b) / (2.0 * h) for a, b in zip(at(1.0), at(-1.0))])
    return [list(row) for row in zip(*columns)]


def determinant(m):
    return sum(
        m[0][i] * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3])
        for i in range(3)
    )


def bisect(low, high, is_low):
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_low(middle) else (low, middle)
    return 0.5 * (low + high)


def rest(p_bottom, gas):
    """The steady state with a pressure at the bottom hole in bar, and the opening that holds it."""
    tube, below = P["L"] * P["A_tubing"], P["L_below"] * P["A_below"]
    warm, cold = P["R"] * P["T_tubing"] / P["M"], P["R"] * P["T_annulus"] / P["M"]
    oil = P["PI"] * (P["p_reservoir"] - p_bottom) * BAR
    share = gas / (gas + oil)
    p_foot = p_bottom * BAR - P["rho"] * P["g"] * P["L_below"]
    density = lambda mass: (mass - P["rho"] * below) / tube
    p_head = lambda mass: warm * share * mass / (tube + below - (1.0 - share) * mass / P["rho"])
    light = lambda mass: p_head(mass) + density(mass) * P["g"] * P["L"] < p_foot
    mass = bisect(P["rho"] * below, P["rho"] * (tube + below), light)
    # What passes the orifice is the gas injected.
    p_annulus = 0.5 * (p_foot + math.sqrt(p_foot**2 + 4.0 * cold * (gas / P["C_injection"]) ** 2))
    annulus = p_annulus * P["V_annulus"] / (cold + P["g"] * P["L"])
    driven = density(mass) * max(p_head(mass) - P["p_separator"] * BAR, 0.0)
    choke = (gas + oil) / (P["C_choke"] * math.sqrt(driven)) if driven > 0.0 else math.inf
    return [annulus, share * mass, (1.0 - share) * mass], choke


def steady(choke, gas):
    p_bottom = bisect(20.0, P["p_reservoir"], lambda p: rest(p, gas)[1] > choke)
    return rest(p_bottom, gas)[0]


def fastest_growth(x, u):
    """The eigenvalue of the largest real part, by the roots of the characteristic polynomial."""
    m = jacobian(x, u)
    trace = sum(m[i][i] for i in range(3))
    minors = sum(m[i][i] * m[j][j] - m[i][j] * m[j][i] for i in range(3) for j in range(i))
    a, b, c = -trace, minors, -determinant(m)
    roots = [(0.4 + 0.9j) ** k * 0.01 for k in range(3)]
    for _ in range(100):
        for i, z in enumerate(roots):
            others = math.prod((z - w for j, w in enumerate(roots) if j != i), start=1.0 + 0.0j)
            roots[i] = z - (((z + a) * z + b) * z + c) / others
    return max(roots, key=lambda z: z.real)


def critical(gas):
    """The opening at which the steady state becomes unstable, and the period there in min."""
    growth = lambda choke: fastest_growth(steady(choke, gas), (choke, gas))
    openings = [0.01 * k for k in range(5, 101)]
    unstable = next((choke for choke in openings if growth(choke).real > 0.0), None)
    if unstable is None:
        return None
    limit = bisect(unstable - 0.01, unstable, lambda choke: growth(choke).real < 0.0)
    return limit, 2.0 * math.pi / abs(growth(limit).imag) / 60.0


def cycle(u, x):
    """The second half of 40 hours from near the steady state: the range of p_bottom, the period in
    min, by its maxima, and the mean production."""
    h, count = 2.0, 72000
    x = [x[0], x[1], 1.001 * x[2]]
    pressures, produced = [], 0.0
    for k in range(count):
        x = step(x, u, h)
        if k >= count // 2:
            _, pressure, production = well(x, *u)
            pressures.append(pressure)
            produced += production / (count - count // 2)
    low, high = min(pressures), max(pressures)
    middle = 0.5 * (low + high)
    up = [i for i, (a, b) in enumerate(zip(pressures, pressures[1:])) if a < middle <= b]
    period = (up[-1] - up[0]) / (len(up) - 1) * h / 60.0 if len(up) > 1 else math.nan
    return low, high, period, produced


def main():
    print("| gas, kg/s | unstable from an opening of | period there, min | at 0.5: steady p_bottom,"
          " bar | oscillates between, bar | period, min | steady production, kg/s | mean, kg/s |")
    print("|---|---|---|---|---|---|---|---|")
    for gas in GAS:
        limit = critical(gas)
        u = (0.5, gas)
        x = steady(*u)
        _, pressure, production = well(x, *u)
        low, high, period, mean = cycle(u, x)
        limits = (f"{limit[0]:.3f}", f"{limit[1]:.0f}") if limit else ("none", "")
        swings = high - low > 0.1
        ranges = (f"{low:.1f} to {high:.1f}", f"{period:.0f}") if swings else ("it does not", "")
        productions = (f"{production:.2f}", f"{mean:.2f}")
        cells = [f"{gas:g}", *limits, f"{pressure:.1f}", *ranges, *productions]
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
