"""`m4 view` from the outside: pages in files, a page on a port, and bad input."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main
from m4_dynamics.robot.loading import bundled_description

WITHOUT_SCREEN = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}


def test_a_run_becomes_one_file(mission_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "run.html"
    for source in (mission_folder, mission_folder / "trajectory.nc"):
        assert main(["view", str(source), "--html", str(page)]) == 0
        captured = capsys.readouterr()
        assert captured.out == f"written: {page}\n"
        assert captured.err == ""
        assert "<title>m4: mission short</title>" in page.read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["run.html"]


def test_postures_become_one_file(tmp_path: Path) -> None:
    page = tmp_path / "postures.html"
    assert main(["view", "--posture", "uas", "--html", str(page)]) == 0
    assert "<title>m4: uas</title>" in page.read_text(encoding="utf-8")
    assert main(["view", "--all-postures", "--html", str(page)]) == 0
    assert "<title>m4: postures</title>" in page.read_text(encoding="utf-8")


def test_a_bare_urdf_is_shown_with_its_joints_at_zero(tmp_path: Path) -> None:
    folder = tmp_path / "bare"
    shutil.copytree(bundled_description().with_name("meshes"), folder / "meshes")
    shutil.copy(bundled_description().with_name("m4.urdf"), folder)
    page = tmp_path / "bare.html"
    assert main(["view", "--robot", str(folder / "m4.urdf"), "--html", str(page)]) == 0
    assert "<title>m4: all joints at zero</title>" in page.read_text(encoding="utf-8")


def test_a_cell_of_a_map_is_simulated_and_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid = ("--slope", "10:50:3", "--thrust", "4,16,40", "--plant", "mip", "--workers", "0")
    assert main(["map", "closed-loop", *grid, "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    page = tmp_path / "cell.html"
    assert main(["view", str(tmp_path), "--slope", "31", "--thrust", "15", "--html", str(page)]) == 0
    assert "cell at 30 deg, 16 N, friction 0.8, start 0; climbed" in capsys.readouterr().out
    assert "<title>m4 on a 30° slope</title>" in page.read_text(encoding="utf-8")
    page.unlink()
    assert main(["view", str(tmp_path), "--html", str(page)]) == 2
    assert "choose one of its cells with --slope DEG --thrust N" in capsys.readouterr().err
    assert main(["view", str(tmp_path), "--slope", "30", "--thrust", "40", "--html", str(page)]) == 2
    assert "nothing to replay" in capsys.readouterr().err
    assert not page.exists()


def test_a_robot_that_changed_since_is_mentioned(
    mission_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(bundled_description().parent, tmp_path / "robot")
    urdf = tmp_path / "robot" / "m4.urdf"
    urdf.write_text(urdf.read_text(encoding="utf-8") + "<!-- changed -->\n", encoding="utf-8")
    page = tmp_path / "run.html"
    assert main(["view", str(mission_folder), "--robot", str(urdf), "--html", str(page)]) == 0
    assert capsys.readouterr().err.startswith("note: m4.urdf changed since the run")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "there is nothing to view; give a run's folder"),
        (["nowhere"], "no trajectory at nowhere"),
        (["--posture", "heap"], "unknown posture 'heap'.*valid: ugv, crouch"),
        (["--posture", "mip", "--all-postures"], "exclude each other"),
        (["--robot", "nowhere.urdf"], "no such file"),
        (["RUN", "--posture", "mip"], "leave --posture and --all-postures out"),
        (["RUN", "--slope", "45"], "takes both --slope and --thrust, got --slope alone"),
        (["--thrust", "12"], "chooses a cell of a map"),
        (["RUN", "--slope", "45", "--thrust", "12"], "there is no store"),
        (["RUN", "--html", "no/such/folder/page.html"], "the folder no/such/folder does not exist"),
        (["RUN", "--robot", "SCOOTER"], "was made with robot 'm4'; give its description with --robot"),
        (["--posture", "mip", "--port", "70000"], "port = 70000 is not valid; expected a number from 0 to 65535"),
        (["--posture", "mip", "--host", "host.invalid"], "address = 'host.invalid:0' is not valid"),
    ],
)
def test_bad_input_is_answered_with_a_sentence(
    mission_folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    scooter = Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml"
    known = {"RUN": str(mission_folder), "SCOOTER": str(scooter)}
    assert main(["view", *(known.get(word, word) for word in options)]) == 2
    captured = capsys.readouterr()
    assert re.search(message, captured.err), captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


class Served:
    """`m4 view` in a process of its own."""

    def __init__(self, *options: str) -> None:
        command = [sys.executable, "-m", "m4_dynamics.cli.main", "view", "--posture", "mip", *options]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=WITHOUT_SCREEN
        )
        self.line = self.process.stdout.readline()
        self.url = self.line.split()[0] if self.line else ""

    @property
    def port(self) -> int:
        return int(self.url.rstrip("/").rsplit(":", 1)[1])

    def end(self, how: int) -> tuple[int, str]:
        """Send a signal; the exit code and what was said on stderr."""
        self.process.send_signal(how)
        _, errors = self.process.communicate(timeout=20)
        return self.process.returncode, errors


@pytest.fixture
def served() -> Iterator[Served]:
    one = Served()
    yield one
    if one.process.poll() is None:
        one.process.kill()
    one.process.communicate()


def refuses(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


def test_the_page_is_served_on_loopback_alone(served: Served) -> None:
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/ \(Ctrl-C ends it\)\n", served.line)
    with urllib.request.urlopen(served.url, timeout=10) as answer:
        page = answer.read().decode("utf-8")
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    assert "<title>m4: mip</title>" in page
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(f"{served.url}etc/passwd", timeout=10)
    assert caught.value.code == 404
    listening = Path("/proc/net/tcp")
    if listening.is_file():  # every socket that listens on the port: the address is 127.0.0.1, bytes reversed
        rows = [line.split() for line in listening.read_text().splitlines()[1:]]
        addresses = {row[1].split(":")[0] for row in rows if int(row[1].split(":")[1], 16) == served.port}
        assert addresses == {"0100007F"}


@pytest.mark.parametrize(("how", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, -signal.SIGTERM), (signal.SIGKILL, -9)])
def test_nothing_is_left_when_it_ends(served: Served, how: int, code: int) -> None:
    children = Path(f"/proc/{served.process.pid}/task/{served.process.pid}/children")
    if children.is_file():
        assert children.read_text() == ""  # there is no other process that could be left
    port = served.port
    returned, errors = served.end(how)
    assert returned == code
    assert "Traceback" not in errors
    deadline = time.monotonic() + 5.0
    while not refuses(port) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert refuses(port)


def test_a_taken_port_is_an_answer(served: Served, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", "--posture", "mip", "--port", str(served.port)]) == 2
    assert f"address = '127.0.0.1:{served.port}' is not valid" in capsys.readouterr().err


def test_a_browser_is_opened_only_if_wanted_and_possible(monkeypatch: pytest.MonkeyPatch) -> None:
    from m4_dynamics.view import serving

    opened: list[str] = []
    monkeypatch.setattr(serving, "open_browser", opened.append)
    monkeypatch.setattr(serving.PageServer, "run", lambda self: self._server.server_close())
    for screen, options, wanted in ((":0", [], 1), (":0", ["--no-browser"], 0), (None, [], 0)):
        opened.clear()
        monkeypatch.setattr(serving.sys, "platform", "linux")
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        if screen is None:
            monkeypatch.delenv("DISPLAY", raising=False)
        else:
            monkeypatch.setenv("DISPLAY", screen)
        assert main(["view", "--posture", "mip", *options]) == 0
        assert len(opened) == wanted
