#!/usr/bin/env python3
"""How fast does a plant train whose equations stand in the config, beside the same plant built in?

    cargo build --release
    python3 benches/training/text.py

Trains both forms of each plant in turns, with the defaults of preset `ours` and as many iterations. Prints a Markdown table of medians; the
sums are rounded differently, so that the nets differ a little.
"""

import argparse
import pathlib
import statistics
import tempfile

from runs import train

VAN_DER_POL = """
[plant.expression]
states = ["x1", "x2"]
inputs = ["u"]
parameters = { mu = 1.0 }
derivatives = { x1 = "x2", x2 = "mu*(1 - x1^2)*x2 - x1 + u" }
"""

# The parameters of `antonelo`; a negative level lets nothing out.
FOUR_TANKS = """
[plant.expression]
states = ["h1", "h2", "h3", "h4"]
inputs = ["u1", "u2"]
parameters = { A1 = 28, A2 = 32, a1 = 0.071, a2 = 0.057, g = 981, k1 = 3.33, k2 = 3.35, gamma1 = 0.5, gamma2 = 0.5 }

[plant.expression.let]
q1 = "a1*sqrt(2*g*max(h1, 0))"
q2 = "a2*sqrt(2*g*max(h2, 0))"
q3 = "a1*sqrt(2*g*max(h3, 0))"
q4 = "a2*sqrt(2*g*max(h4, 0))"

[plant.expression.derivatives]
h1 = "(-q1 + q3 + gamma1*k1*u1)/A1"
h2 = "(-q2 + q4 + gamma2*k2*u2)/A2"
h3 = "(-q3 + (1 - gamma2)*k2*u2)/A1"
h4 = "(-q4 + (1 - gamma1)*k1*u1)/A2"
"""

CASES = [
    ("Van der Pol 4x20", "configs/van-der-pol/main.toml", VAN_DER_POL),
    ("four tanks 5x20", "configs/four-tanks/main.toml", FOUR_TANKS),
]


def with_equations(config, equations, folder):
    """The config with its `[plant]` section replaced, as a file in the folder."""
    sections = pathlib.Path(config).read_text().split("\n[")
    sections = [equations.strip()[1:] if section.startswith("plant]") else section for section in sections]
    path = pathlib.Path(folder) / "text.toml"
    path.write_text("\n[".join(sections))
    return str(path)


def seconds(args, config, folder):
    """Time of a training without its validations, and the validation error of its net."""
    settings = {"training.phases.0.iterations": args.iterations, "training.validation_every": args.iterations}
    _, metrics = train(args.pinc, config, settings, pathlib.Path(folder) / "run")
    return metrics["training"]["wall_s"], metrics["validation"]["mse_gen"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pinc", default="target/release/pinc", help="the program")
    parser.add_argument("--iterations", type=int, default=1000, help="of each training")
    parser.add_argument("--rounds", type=int, default=3, help="trainings of each form")
    args = parser.parse_args()
    print("| plant | built in, s | text, s | text takes | mse_gen, built in | text |\n" + "|---" * 6 + "|", flush=True)
    for name, config, equations in CASES:
        rounds = []
        for _ in range(args.rounds):
            with tempfile.TemporaryDirectory() as folder:
                text = with_equations(config, equations, folder)
                pair = []
                for form in (config, text):
                    with tempfile.TemporaryDirectory() as out:
                        pair.append(seconds(args, form, out))
                rounds.append(pair)
        (built_in, error), (text, text_error) = ([statistics.median(x) for x in zip(*form)] for form in zip(*rounds))
        print(
            f"| {name} | {built_in:.2f} | {text:.2f} | {100 * (text / built_in - 1):+.0f} % | {error:.1e} | {text_error:.1e} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
