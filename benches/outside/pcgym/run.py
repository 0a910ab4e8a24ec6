"""PC-Gym's 13 models under PINC's controller and under PC-Gym's own oracle, judged by PC-Gym.

usage: python run.py [MODEL...] [--rounds 5] [--out TABLE.csv]

Needs the packages pinc-nmpc, pcgym 0.1.8, and numpy below 2.4, with which pcgym works. settings.py has
the environments, models/ the equations in PINC's form.

1. PINC's equations are compared with the package's: the derivative, and a step, at 20 random states
   and inputs. The script ends if they differ by 1e-6.
2. Both controllers are policies in the same environment, one rollout of `policy_eval` each per round,
   in turn. The reward is PC-Gym's. The oracle's policy is the controller that `oracle.setup_mpc` makes,
   on the environment's states: its own rollout simulates for itself, and its score counts states one
   step later than the policies' scores do. That score is in the table as well.
3. Both minimize the summed squared error at the steps ahead, and nothing else, over the same horizon with
   the same weights: moves of inputs cost nothing. RK4 takes the fewest substeps of 1, 2 and 4 that keep
   the error of a step along the loop within a ten-thousandth of the observation's range (4 on
   biofilm_reactor, where it is a hundredth). Both know the set point of the step before, which is what
   the observation has.
4. A violation is a step that the environment reports as one, or an action outside of its bounds by a
   ten-thousandth of its range. The environment counts a state on its bound as outside: PINC's bounds of
   states lie inside by a ten-thousandth of the observation's range. A time is the median over the
   calls of `predict` of all rounds, with normalization: CPU time of the process, which other
   programs on the machine do not lengthen as they do a wall clock's.

Five models of 0.1.8 cannot be made by its `make_env`, as they have no `int_method` and unpack CasADi's
vectors, and RSR is not in its list. They are given as `custom_model`, unpacked.
"""

import argparse
import csv
import logging
import pathlib
import statistics
import sys
import time
import tomllib
import warnings

import casadi
import numpy as np
import pcgym.model_classes
from pcgym import make_env
from pcgym.oracle import oracle
from pcgym.policy_evaluation import policy_eval

import pinc_nmpc as pinc
from pinc_nmpc.environment import NmpcPolicy
from settings import SETTINGS, STEPS

HERE = pathlib.Path(__file__).resolve().parent
SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}


def model_of(name):
    """The package's model, so that it takes vectors of CasADi."""
    made = getattr(pcgym.model_classes, name)
    if "int_method" in made.__dataclass_fields__:
        return made(int_method="casadi")

    class Unpacked(made):
        def __call__(self, x, u):
            sizes = len(self.info()["states"]), len(self.info()["inputs"])
            return super().__call__(*([v[i] for i in range(n)] for v, n in zip((x, u), sizes)))

    return Unpacked()


def environment(name):
    """What `make_env` takes."""
    setting = SETTINGS[name]
    # The observation ends with the set points; a range of 0 could not be normalized.
    low, high = (
        [float(value) for value in side] + [bound(points) for points in setting["set_points"].values()]
        for side, bound in zip(setting["observed"], (min, lambda points: max(points) + 1.0))
    )
    params = {
        "N": STEPS,
        "tsim": setting["step"] * STEPS,
        "SP": setting["set_points"],
        "x0": np.array([*setting["x0"], *(points[0] for points in setting["set_points"].values())], float),
        "a_space": dict(zip(("low", "high"), (np.array(side, float) for side in setting["input"]))),
        "o_space": {"low": np.array(low), "high": np.array(high)},
        "r_scale": setting["scale"],
        "custom_model": model_of(setting.get("model", name)),
        "normalise_a": True,
        "normalise_o": setting.get("normalise_o", True),
        "integration_method": "casadi",
    }
    if "constraints" in setting:
        keys = ("constraints", "cons_type")
        params |= {key: setting[key] for key in keys} | {"done_on_cons_vio": False, "r_penalty": False}
    return params


class Spaces:
    """What the environment does not normalize itself, and the times of `predict`."""

    def __init__(self, env):
        low, high = (np.asarray(getattr(env.observation_space_base, side), float) for side in ("low", "high"))
        self.seen = (low, (high - low) / 2) if env.normalise_o else None
        space = env.env_params["a_space"]
        self.low, self.half = space["low"], (space["high"] - space["low"]) / 2
        self.times, self.failed = [], 0

    def predict(self, observation, deterministic=True):
        start = time.process_time()
        if self.seen is not None:
            observation = self.seen[0] + (observation + 1) * self.seen[1]
        u, converged = self.chosen(observation)
        action = (u - self.low) / self.half - 1
        self.times.append(time.process_time() - start)
        self.failed += not converged
        return action, None


class Ours(Spaces):
    """PINC's controller."""

    def __init__(self, name, env):
        super().__init__(env)
        setting = SETTINGS[name]
        with open(HERE / "models" / f"{setting.get('model', name)}.toml", "rb") as file:
            config = tomllib.load(file)
        control = config.pop("control") | setting.get("control", {})
        self.plant = pinc.Plant(config)
        names = [state.replace("[", "").replace("]", "") for state in self.plant.states]
        self.order = [env.model.info()["states"].index(state) for state in names]
        assert self.plant.inputs == env.model.info()["inputs"]
        self.second = SECONDS[config["plant"]["expression"].get("time_unit", "s")]
        self.step_s = setting["step"] * self.second
        low, high = ([float(value) for value in side] for side in setting["input"])
        control |= {
            "step_s": self.step_s,
            "duration_s": self.step_s * STEPS,
            "initial_state": [float(setting["x0"][place]) for place in self.order],
            "controlled": [self.plant.states[names.index(state)] for state in setting["set_points"]],
            "q": list(setting["scale"].values()),
            "r": [0.0 for _ in low],
            "n2": setting["horizon"],
            "nu": setting["horizon"],
            "input_low": low,
            "input_high": high,
            "references": [{"start_s": 0.0, "value": [float(v[0]) for v in setting["set_points"].values()]}],
        }
        width = np.subtract(*setting["observed"][::-1])
        for state, bounds in setting.get("constraints", {}).items():
            for bound, kind in zip(bounds, setting["cons_type"][state]):
                key, inwards = {">=": ("state_low", 1e-4), "<=": ("state_high", -1e-4)}[kind]
                margin = inwards * width[env.model.info()["states"].index(state)]
                control.setdefault(key, {})[state] = float(bound + margin)
        self.policy = NmpcPolicy(pinc.Nmpc(config | {"control": control}, only=control["models"][0]))
        self.columns = self.order + list(range(len(self.order), len(env.x0)))

    def chosen(self, seen):
        u, _ = self.policy.predict(seen[self.columns])
        return u, self.policy.steps[0].status == "converged"


class Oracle(Spaces):
    """The controller that PC-Gym's oracle makes, on the environment's states."""

    def __init__(self, params, limits, env):
        super().__init__(env)
        self.mpc, _ = oracle(make_env, params, limits).setup_mpc()
        self.mpc.x0 = params["x0"][: env.Nx_oracle]
        self.mpc.set_initial_guess()

    def chosen(self, seen):
        u = self.mpc.make_step(seen[: self.mpc.model.n_x].reshape(-1, 1)).ravel()
        return u, self.mpc.solver_stats["success"]


def compare(ours, env):
    """The largest differences of derivatives and of a step between the package's model and PINC's,
    relative to the larger of the value and 0.001, and of how many steps."""
    x, u = casadi.SX.sym("x", env.Nx_oracle), casadi.SX.sym("u", env.Nu)
    equation = casadi.vertcat(*env.model(x, u))
    right_side = casadi.Function("f", [x, u], [equation])
    ode = {"x": x, "p": u, "ode": equation}
    options = {"reltol": 1e-11, "abstol": 1e-12, "max_num_steps": 100_000, "show_eval_warnings": False}
    step = casadi.integrator("step", "cvodes", ode, 0, env.dt, options)
    random = np.random.default_rng(1)
    space = env.env_params["a_space"]
    x0 = np.array(env.x0[: env.Nx_oracle])
    worst, steps = [0.0, 0.0], 0
    for _ in range(20):
        x = x0 * random.uniform(0.95, 1.05, len(x0)) + 0.01 * random.uniform(0, 1, len(x0)) * (x0 == 0)
        u = random.uniform(space["low"], space["high"])
        theirs = [right_side(x, u).full().ravel()]
        found = [ours.plant.derivative(x[ours.order], u) * ours.second]
        try:
            theirs.append(step(x0=x, p=u)["xf"].full().ravel())
            found.append(ours.plant.simulate(x[ours.order], u, ours.step_s)[1])
            steps += 1
        except (RuntimeError, pinc.PincError):
            pass  # The biofilm reactor leaves the region in which its equation has a solution.
        for kind, (a, b) in enumerate(zip(theirs, found)):
            difference = np.abs(a[ours.order] - b) / np.maximum(np.abs(b), 1e-3)
            worst[kind] = max(worst[kind], float(difference.max()))
    return worst, steps


def rollout(params, policy):
    """The return and the violations by PC-Gym's evaluation."""
    found = policy_eval(make_env, {"policy": policy}, 1, params).get_rollouts()["policy"]
    low, high = (params["a_space"][side][:, None, None] for side in ("low", "high"))
    slack = 1e-4 * (high - low)
    broken = ((found["u"] < low - slack) | (found["u"] > high + slack)).any(axis=(0, 2))
    if "g" in found:
        broken = broken | (found["g"][:, :, 0, 0] != 0).any(axis=0)
    return float(found["r"].sum()), int(broken.sum())


def judged(name, rounds):
    """The row of the table."""
    setting = SETTINGS[name] = {"horizon": 5} | SETTINGS[name]
    params = environment(name)
    env = make_env(params)
    (derivative, step), steps = compare(Ours(name, env), env)
    print(f"{name}: derivatives differ by {derivative:.1e}, {steps} steps by {step:.1e}")
    if max(derivative, step) > 1e-6:
        sys.exit(f"{name}: the equations are not the package's")
    weights = [setting["scale"].get(state, 1.0) for state in env.model.info()["states"]]
    limits = {"N": setting["horizon"], "Q": np.diag(weights)}
    makers = {"pinc": lambda: Ours(name, env), "oracle": lambda: Oracle(params, limits, env)}
    times, results, failed, notes = {}, {}, {}, []
    for _ in range(rounds):
        for kind, make in makers.items():
            policy = make()
            try:
                results[kind] = rollout(params, policy)
            except RuntimeError as error:
                notes = [f"the environment fails under {kind}: {str(error).splitlines()[-1]}"]
                continue
            times.setdefault(kind, []).extend(policy.times)
            failed[kind] = policy.failed
    try:
        own = policy_eval(make_env, {}, 1, params, oracle=True, MPC_params=limits).get_rollouts()
        own = float(own["oracle"]["r"].sum())
    except RuntimeError:
        own = None
    print(*(f"{kind}: {failed[kind]} of {STEPS} steps did not converge; " for kind in failed), *notes)
    median = {kind: statistics.median(values) for kind, values in times.items()}

    def text(values, kind, form, factor=1):
        return form.format(values[kind] * factor) if kind in values else "fails"

    returns, broken = ({kind: result[i] for kind, result in results.items()} for i in range(2))
    both = len(results) == 2
    return {
        "environment": name,
        "states": env.Nx_oracle,
        "horizon": setting["horizon"],
        "PINC's return": text(returns, "pinc", "{:.5g}"),
        "oracle's return": text(returns, "oracle", "{:.5g}"),
        "oracle's loss by PINC's": f"{returns['oracle'] / returns['pinc']:.5f}" if both else "",
        "oracle's own score": "fails" if own is None else f"{own:.5g}",
        "PINC's violations": text(broken, "pinc", "{}"),
        "oracle's violations": text(broken, "oracle", "{}"),
        "PINC's step (us)": text(median, "pinc", "{:.0f}", 1e6),
        "oracle's step (ms)": text(median, "oracle", "{:.1f}", 1e3),
        "times shorter": f"{median['oracle'] / median['pinc']:.0f}" if both else "",
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", metavar="MODEL", help=", ".join(SETTINGS))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=pathlib.Path, help="the table, as CSV")
    args = parser.parse_args()
    if unknown := [name for name in args.models if name not in SETTINGS]:
        parser.error(f"unknown model {unknown[0]}, expected one of {', '.join(SETTINGS)}")
    # do-mpc warns of packages that it lacks, CasADi of trial points without a value.
    warnings.filterwarnings("ignore")
    logging.disable(logging.WARNING)
    rows = []
    for name in args.models or SETTINGS:
        rows.append(judged(name, args.rounds))
        print("  " + ", ".join(f"{key}: {value}" for key, value in rows[-1].items()), flush=True)
    if args.out:
        with open(args.out, "w", newline="") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
