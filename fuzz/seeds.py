"""Writes the seed corpus: the expressions of every shipped config, and some more.

    python3 fuzz/seeds.py       from the top folder
"""

import pathlib
import tomllib

corpus = pathlib.Path("fuzz/corpus/expression")
corpus.mkdir(parents=True, exist_ok=True)
for path in sorted(pathlib.Path("configs").rglob("*.toml")):
    name = "-".join(path.relative_to("configs").with_suffix("").parts)
    equations = tomllib.loads(path.read_text()).get("plant", {}).get("expression")
    if equations:
        lets = [f"{name} = {value}" for name, value in equations.get("let", {}).items()]
        lines = [*equations["derivatives"].values(), *lets]
        (corpus / name).write_text("\n".join(line.replace("\n", " ") for line in lines))
formulas = [
    "-x^2 + 1.5e-3*y/(1 + abs(u))\nmin(x, y) - max(u, pi)*sign(x)\n",
    "a*x + b\nb - a\na = sqrt(max(x, 0))\nb = a*exp(-y) + log(2)\n",
    "sin(x)*cos(y) - tan(u)/2\ntanh(x) + atan(y)^2^3\n",
]
for i, text in enumerate(formulas):
    (corpus / f"formula-{i}").write_text(text)
