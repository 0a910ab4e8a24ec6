"""Writes the seed corpora: for `config` every shipped config, for `expression` the expressions in
them and some more, for `model` the model file of the tests.

    python3 fuzz/seeds.py       from the top folder
"""

import pathlib
import tomllib

FORMULAS = [
    "-x^2 + 1.5e-3*y/(1 + abs(u))\nmin(x, y) - max(u, pi)*sign(x)\n",
    "a*x + b\nb - a\na = sqrt(max(x, 0))\nb = a*exp(-y) + log(2)\n",
    "sin(x)*cos(y) - tan(u)/2\ntanh(x) + atan(y)^2^3\n",
]
SETS = "#set training.time_limit_s=2.0\n#set model.neurons=8\n#set preset=\"ours\"\n"


def corpus(target):
    folder = pathlib.Path("fuzz/corpus") / target
    folder.mkdir(parents=True, exist_ok=True)
    return folder


for path in sorted(pathlib.Path("configs").rglob("*.toml")):
    name = "-".join(path.relative_to("configs").with_suffix("").parts)
    text = path.read_text()
    # Comments would only make the texts long.
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    (corpus("config") / name).write_text("\n".join(lines) + "\n" + SETS)
    equations = tomllib.loads(text).get("plant", {}).get("expression")
    if equations:
        lets = [f"{name} = {value}" for name, value in equations.get("let", {}).items()]
        lines = [*equations["derivatives"].values(), *lets]
        (corpus("expression") / name).write_text("\n".join(line.replace("\n", " ") for line in lines))
for i, text in enumerate(FORMULAS):
    (corpus("expression") / f"formula-{i}").write_text(text)
model = pathlib.Path("crates/pinc/tests/data/model.safetensors")
(corpus("model") / model.name).write_bytes(model.read_bytes())
