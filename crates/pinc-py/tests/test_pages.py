"""Pages that are to be followed by copy and paste: their blocks, in order."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[3]


def follow(page: Path, directory: Path, skip: str = "pip install") -> str:
    """Runs the blocks of a page in a directory: all of Python as one program's, C into the file that
    its first line names, commands of the shell. Returns what was printed."""
    printed, program = "", ["import matplotlib\nmatplotlib.use('Agg')\n"]

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=directory, text=True, capture_output=True, check=False)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout

    blocks = re.findall(r"^```(python|sh|c)\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    for language, text in blocks:
        if language == "python":
            program.append(text)
            continue
        if len(program) > 1:
            printed += run(sys.executable, "-c", "".join(program))
            program = program[:1]
        named = re.match(r"/\* (\w+\.c):", text)
        if named:
            (directory / named[1]).write_text(text)
        elif language == "sh" and skip not in text:
            printed += run("bash", "-ec", text)
    return printed + (run(sys.executable, "-c", "".join(program)) if len(program) > 1 else "")


def test_a_newcomer_controls_a_plant_of_their_own(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    printed = follow(TOP / "crates/pinc-py/README.md", tmp_path)
    assert (tmp_path / "tank.png").stat().st_size > 10_000
    assert (tmp_path / "runs/tank/report.html").is_file()
    level = re.search(r"^(0\.\d+) converged$", printed, re.MULTILINE)
    assert level and abs(float(level[1]) - 0.5) < 1e-3, printed


def test_from_a_notebook_to_a_microcontroller(tmp_path: Path) -> None:
    if not shutil.which("cc"):
        pytest.skip("needs a C compiler")
    emulated = shutil.which("qemu-system-arm") and shutil.which("arm-none-eabi-gcc")
    (tmp_path / "configs").symlink_to(TOP / "configs")
    page = TOP / "docs/microcontroller.md"
    printed = follow(page, tmp_path, "pip install" if emulated else "arm-none-eabi-gcc")
    tests = re.findall(r"osc: 20 steps, largest difference (\S+), allowed (\S+)", printed)
    assert len(tests) == (2 if emulated else 1), printed
    assert all(float(found) <= float(allowed) for found, allowed in tests)
