"""`m4 mission` from the command line."""

from __future__ import annotations

import json

import pytest

from m4_dynamics.cli.main import main


def test_lists_what_comes_with_the_package(capsys):
    assert main(["mission", "--list"]) == 0
    out = capsys.readouterr().out
    for name in ("wair15", "wair45", "uprighting", "landing"):
        assert name in out


def test_writes_its_results_and_prints_every_phase(tmp_path, capsys):
    assert main(["mission", "uprighting", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    for phase in ("rest", "morph to sitting", "raise", "balance", "completed"):
        assert phase in out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["verdict"] == "completed"
    assert [phase["name"] for phase in summary["phases"]] == ["rest", "morph to sitting", "raise", "balance"]
    assert (tmp_path / "viewer.html").stat().st_size > 100_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "there is no [[phase]]"),
        ("phase = 3", "there is no [[phase]]"),
        ('[[phase]]\nname = "x"\nkind = "fly"', "kind must be one of hold, morph, raise, sit, balance"),
        ('[[phase]]\nname = "x"\nkind = "hold"', "phase 'x'] duration_s is missing"),
        ('[[phase]]\nname = "x"\nkind = "hold"\nduration_s = -1', "duration_s must be"),
        ('[[phase]]\nname = "x"\nkind = "hold"\nduration_s = 1\nspeed = 2', "unknown key 'speed'"),
        ('[[phase]]\nname = "x"\nkind = "morph"\nposture = "bridge"', "posture 'bridge' is unknown"),
        ('[[phase]]\nname = "x"\nkind = "balance"\ncontroller = "magic"', "controller must be one of"),
        ('[[phase]]\nname = "x"\nkind = "balance"\nspeed_m_s = 0', "speed_m_s must be"),
        ('[terrain]\nprofile = "hill"\n[[phase]]\nname = "x"\nkind = "hold"\nduration_s = 1', "profile must be one of"),
        ('[terrain]\nprofile = "ramp"\n[[phase]]\nname = "x"\nkind = "hold"\nduration_s = 1', "slope_deg is missing"),
        ('[[phase]]\nname = "x"\nkind = "hold"\nduration_s = 1\n' * 2, "two phases are called 'x'"),
        ("this is not TOML", "not valid TOML"),
    ],
)
def test_mistakes_are_named_by_phase_and_key(tmp_path, capsys, text, words):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    assert main(["mission", str(file), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "mine.toml" in error
    assert not (tmp_path / "run").exists()


def test_an_unknown_mission_lists_the_known_ones(tmp_path, capsys):
    assert main(["mission", "moonwalk", "--out", str(tmp_path)]) == 2
    assert "wair45" in capsys.readouterr().err


def test_a_failed_phase_keeps_the_trajectory(tmp_path, capsys):
    file = tmp_path / "too_steep.toml"
    file.write_text(
        '[start]\nposture = "mip_sitting"\n[terrain]\nprofile = "ramp"\nslope_deg = 70\n'
        '[[phase]]\nname = "up"\nkind = "raise"\n'
        '[[phase]]\nname = "climb"\nkind = "balance"\nto_m = 1.0\n'
    )
    assert main(["mission", str(file), "--no-viewer", "--out", str(tmp_path / "run")]) == 1
    assert "phase 'climb' infeasible: " in capsys.readouterr().out
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["verdict"] == "failed"
    assert (tmp_path / "run" / "trajectory.nc").is_file()
