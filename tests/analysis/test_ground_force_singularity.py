"""The script runs, and prints the figures that its picture shows."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "analysis" / "ground_force_singularity.py"


def test_script_draws_and_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "--slope", "30", "--out", str(tmp_path / "pictures")])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    out = capsys.readouterr().out
    assert "singular pitch on 30 deg: -32.68 deg" in out
    assert (tmp_path / "pictures" / "ground_force_singularity.png").stat().st_size > 10_000
