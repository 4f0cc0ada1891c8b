"""The script that takes the README's pictures from the pages."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

SCRIPT = Path(__file__).parents[2] / "analysis" / "page_pictures.py"


@pytest.mark.usefixtures("browser")
def test_pictures_are_taken_from_the_pages(mission_folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPT), str(mission_folder), str(tmp_path), "--time", "9"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"viewer.png", "postures.png"}
    for path in tmp_path.iterdir():
        assert path.stat().st_size < 300e3  # the README stays quick to load
        colours = np.unique(imread(path).reshape(-1, 3), axis=0)
        assert len(colours) > 500


def test_without_a_run_there_is_a_sentence(tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPT), str(tmp_path / "nowhere")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "no trajectory at" in result.stderr
    assert "Traceback" not in result.stderr
