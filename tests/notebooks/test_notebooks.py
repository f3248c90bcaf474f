"""Every notebook runs from top to bottom, and is committed with its output."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

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


def quick(path):
    """A notebook with fewer draws."""
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        for pattern, fewer in FEWER if cell.cell_type == "code" else ():
            cell.source = re.sub(pattern, fewer, cell.source)
    return notebook


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_committed_with_its_output(path):
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    outputs = [output for cell in cells for output in cell.outputs]
    assert outputs
    for output in outputs:
        assert output.output_type != "error"
        assert "Warning" not in output.get("text", "")


@pytest.mark.long
def test_cells_of_the_quickstart_run_one_after_the_other(capsys):
    """Without a kernel, which takes most of the time."""
    import matplotlib.pyplot as plt

    names = {}
    with plt.rc_context({"backend": "agg"}):
        for cell in quick(next(path for path in NOTEBOOKS if path.stem == "quickstart")).cells:
            if cell.cell_type == "code":
                exec(cell.source, names)
        plt.close("all")
    assert names["band"].verdict in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
# The kernel client of Jupyter leaves sockets and loops to the garbage collector.
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning", "ignore::DeprecationWarning"
)
def test_notebook_runs(path):
    notebook = quick(path)
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            assert output.output_type != "error"
            assert "Warning" not in output.get("text", "")
