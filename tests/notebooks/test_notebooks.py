"""The notebooks: stored without outputs, and running from top to bottom without a complaint."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
NAMES = [path.stem for path in NOTEBOOKS]

# What takes long is made smaller here; `make docs` runs the notebooks as they are.
# In `make test` run those that take little; CI and `pytest -m campaign` run the dear ones too.
DEAR = (
    "bring-your-arm", "design", "not-like-its-model", "paper", "polynomial-against-optimal",
    "tuning-sensitivity",
)  # fmt: skip

SOME = ["polynomial:travel=middle", "polynomial:points=auto", "collocation"]
SMALLER = {
    "design": {
        '"rho": [0.8, 1.0, 1.6], "kappa": [0.7, 1.5]': '"rho": [1.0, 1.6], "kappa": [0.7]',
        '"count": 2': '"count": 1',
        '"methods": ["collocation", "convex"]': '"methods": ["collocation"]',
        '"samples": 50': '"samples": 5',
    },
    "polynomial-against-optimal": {
        "compare(problem, samples=60": "compare(problem, SOME, samples=20",
        "import planner\n": f"import planner\nSOME = {SOME!r}\n",
    },
    "tuning-sensitivity": {
        "samples=60, record_s=None": "samples=20, record_s=None",
        "(0.6, 1.0, 3.5)": "(3.5,)",
    },
    "bring-your-arm": {"identify(log, problem)": "identify(log, problem, starts=1)"},
    "sweeps": {'"count": 4': '"count": 2', '"count": 5': '"count": 2'},
}


def formats() -> Any:
    """Imported when it is used: it takes more than a second."""
    return pytest.importorskip("nbformat", reason="needs the extra 'dev'")


def read(path: Path) -> Any:
    return formats().read(path, as_version=4)


def test_the_notebooks_promised_are_there() -> None:
    assert len(NOTEBOOKS) >= 8
    assert {*DEAR, *SMALLER} <= set(NAMES)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=NAMES)
def test_stored_without_outputs(path: Path) -> None:
    notebook = read(path)
    formats().validate(notebook)
    assert set(notebook.metadata) <= {"kernelspec", "language_info"}
    assert notebook.cells[0].cell_type == "markdown"
    assert notebook.cells[0].source.startswith("# ")
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None
        assert not cell.metadata


@pytest.fixture(scope="module")
def kernel() -> Iterator[Any]:
    """One process for all notebooks, which import the same."""
    pytest.importorskip("ipykernel", reason="needs the extra 'notebook'")
    client = pytest.importorskip("jupyter_client", reason="needs the extra 'dev'")
    manager = client.KernelManager(kernel_name="python3")
    manager.start_kernel(cwd=str(FOLDER))
    yield manager
    manager.shutdown_kernel(now=True)


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.campaign] * (path.stem in DEAR))
        for path in NOTEBOOKS
    ],
)
@pytest.mark.filterwarnings("default")  # of the client, not of the notebook, whose own fail below
def test_runs_from_top_to_bottom(path: Path, kernel: Any) -> None:
    nbclient = pytest.importorskip("nbclient", reason="needs the extra 'dev'")
    notebook = read(path)
    for usual, smaller in SMALLER.get(path.stem, {}).items():
        assert any(usual in cell.source for cell in notebook.cells), f"{usual} is not in it"
        for cell in notebook.cells:
            cell.source = cell.source.replace(usual, smaller)
    notebook.cells.insert(0, formats().v4.new_code_cell("%reset -f"))  # no name of the one before
    client = nbclient.NotebookClient(notebook, km=kernel, timeout=120)
    client.execute(cleanup_kc=False)
    client.kc.stop_channels()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    complaints = [o.text for o in outputs if o.get("name") == "stderr"]
    assert complaints == []
    assert any("image/png" in o.get("data", {}) for o in outputs), "shows no figure"
