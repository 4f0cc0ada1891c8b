"""The script runs, and prints a line for each plant."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "analysis" / "fidelity_study.py"


def test_script_draws_and_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    arguments = ["--slope", "15", "--plants", "ideal", "control delay", "--errors", "6", "--workers", "1"]
    arguments += ["--out", str(tmp_path / "pictures")]
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *arguments])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    out = capsys.readouterr().out
    for plant in ("ideal", "control delay"):
        line = next(line for line in out.splitlines() if line.startswith(plant))
        assert "climbed" in line
        assert line.split()[-1] == "6", "the worst pitch error that it recovers from"
    assert (tmp_path / "pictures" / "fidelity_study.png").stat().st_size > 10_000
