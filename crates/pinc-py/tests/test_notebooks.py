"""The notebooks run from their first cell to their last, with nothing but the package, and are typed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
@pytest.mark.filterwarnings("ignore")
def test_a_notebook_runs_and_draws(path: Path, tmp_path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    stored = [cell for cell in cells if cell.outputs or cell.execution_count]
    assert not stored, "stored with outputs"
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    pictures = [o for cell in cells for o in cell.outputs if "image/png" in o.get("data", {})]
    assert pictures


def test_the_code_of_notebooks_is_typed(tmp_path: Path) -> None:
    mypy = pytest.importorskip("mypy")
    for path in NOTEBOOKS:
        cells = nbformat.read(path, as_version=4).cells
        code = "\n".join(cell.source for cell in cells if cell.cell_type == "code")
        (tmp_path / f"{path.stem.replace('-', '_')}.py").write_text(code)
    checkers = [[sys.executable, "-m", mypy.__name__, "--strict", "--cache-dir", os.devnull]]
    try:
        import pyright  # noqa: F401
    except ImportError:
        pass
    else:
        checkers.append([sys.executable, "-m", "pyright", "--pythonpath", sys.executable])
    for checker in checkers:
        done = subprocess.run(
            [*checker, "."], cwd=tmp_path, text=True, capture_output=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
