"""The notebook runs from top to bottom, shows what it promises, and is kept without its outputs."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "analysis" / "from_urdf_to_climb.ipynb"


def test_it_is_kept_without_outputs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


def test_it_runs_and_climbs(monkeypatch: pytest.MonkeyPatch) -> None:
    # A notebook's own way to draw, whatever the tests' is.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}}).execute()
    printed = "".join(
        output.text
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type == "stream" and output.name == "stdout"
    )
    assert "m4: 6.000 kg, 18 degrees of freedom" in printed
    assert "climbed: " in printed
    shown = [
        mime
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type in ("display_data", "execute_result")
        for mime in output.data
    ]
    assert "image/png" in shown  # the curves
    replay = notebook.cells[-1].outputs[0].data["text/html"]
    assert replay.startswith("<iframe")
    assert "3D replay" in replay
