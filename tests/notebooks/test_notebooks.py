"""Every notebook runs from top to bottom, and is committed with its output."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

PROVES = ("cpic_planner.api",)
NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.ipynb"))


# The committed output is that of the whole notebook; here every cell runs with fewer draws.
FEWER = (
    (r"universes=\d+", "universes=20"),
    (r"realisations=\d+", "realisations=2"),
    (r"n_planets=\d+", "n_planets=100"),
    (r"(confirm_targets\([^)]*)\)", r'\1, realisations=2, fidelity="quick")'),
    (r"rank_targets\(time_s=(\d+)\)", r"rank_targets(time_s=\1, n_planets=100, v_mag_max=3.5)"),
    (r'"contrast=[^"]+"', '"contrast=1e-8"'),
)


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=() if path.stem == "quickstart" else pytest.mark.long) for path in NOTEBOOKS],
    ids=[path.stem for path in NOTEBOOKS],
)
# The kernel client of Jupyter leaves sockets and loops to the garbage collector.
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning", "ignore::DeprecationWarning"
)
def test_notebook_runs(path):
    notebook = nbformat.read(path, as_version=4)
    committed = [cell.get("outputs", []) for cell in notebook.cells if cell.cell_type == "code"]
    assert any(committed), "commit notebooks with their output"
    for cell in notebook.cells:
        for pattern, fewer in FEWER if cell.cell_type == "code" else ():
            cell.source = re.sub(pattern, fewer, cell.source)
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            assert output.output_type != "error"
            assert "Warning" not in output.get("text", "")
