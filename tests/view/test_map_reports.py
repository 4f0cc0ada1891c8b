"""From a map's page to the reports of its cells: found, marked, listed and followed, offline and after a move."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest
import xarray

from m4_dynamics.cli.main import main
from m4_dynamics.feasibility.cell import CellIndex
from m4_dynamics.feasibility.files import load_map
from m4_dynamics.simulation.balance import BalanceLoop
from m4_dynamics.view.cell_reports import cell_record, find_cell_reports
from m4_dynamics.view.map_page import write_map_page

SMALL = ("--slope", "10:50:3", "--thrust", "4,16,40", "--friction", "0.4,0.8", "--plant", "mip", "--workers", "0")
CELL = CellIndex(friction=1, slope=1, thrust=1, start=0)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small map in which one cell has a report, beside the page as it was before; nobody changes it."""
    folder = tmp_path_factory.mktemp("maps") / "my map"
    assert main(["map", "closed-loop", *SMALL, "--out", str(folder)]) == 0
    shutil.copy(folder / "map.html", folder.parent / "before.html")
    place = ["--slope", "30", "--thrust", "16", "--friction", "0.8"]
    assert main(["map", "replay", str(folder), *place]) == 0
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of the map without its report, at another place."""
    return Path(shutil.copytree(made, tmp_path / "moved", ignore=shutil.ignore_patterns("cell-*", "map.zarr")))


def pretend(folder: Path, name: str, summary: object) -> None:
    """A run's folder with a report and whatever its summary is said to hold."""
    (folder / name).mkdir(parents=True)
    (folder / name / "report.html").write_text("<!DOCTYPE html><title>a report</title>")
    (folder / name / "summary.json").write_text(summary if isinstance(summary, str) else json.dumps(summary))


def run_of(dataset: xarray.Dataset, index: CellIndex = CELL, **changes: object) -> dict[str, Any]:
    record = cell_record(dataset.attrs["fingerprint"], index)
    return {"verdict": "slipped", "cell": {**record["cell"], **changes}}


def links_of(page: Path) -> list[str]:
    """The list of links below the map."""
    return re.findall(r'<a href="([^"]+)"', page.read_text("utf-8").split('<section id="cell"')[1])


def click(page: Any, x: float, y: float, cell: str) -> None:
    """Click a cell as a hand does: plotly takes the cell that the pointer has been over for a moment."""
    page.mouse.move(x, y)
    page.locator(".hovertext", has_text=cell).wait_for()
    page.mouse.click(x, y)


def test_a_replay_says_which_cell_it_is_and_the_page_gets_its_link(made: Path) -> None:
    dataset = load_map(made)
    (report,) = find_cell_reports(dataset, made)
    assert report.index == CELL
    assert report.href == "cell-30-16-0.8-0/report.html"
    summary = json.loads((made / "cell-30-16-0.8-0" / "summary.json").read_text())
    assert report.verdict == summary["verdict"] == "climbed"
    assert links_of(made.parent / "before.html") == []
    assert links_of(made / "map.html") == [report.href]


def test_but_for_the_reports_the_page_is_the_one_that_the_map_was_made_with(made: Path, tmp_path: Path) -> None:
    anew = write_map_page(load_map(made), tmp_path / "map.html", subject=shlex.quote(str(made)))
    before = made.parent / "before.html"
    assert anew.read_bytes() == before.read_bytes()
    # The slider switches the marks too: every friction has its own.
    marks = [page.read_text("utf-8").count('"symbol":"diamond"') for page in (before, made / "map.html")]
    assert marks == [0, 2]


def test_only_reports_of_this_map_in_its_own_folder_are_linked(folder: Path, tmp_path: Path) -> None:
    dataset = load_map(folder)
    assert find_cell_reports(dataset, folder) == ()
    pretend(folder, "cell-of-another-map", run_of(dataset, map="0" * 64))
    pretend(folder, "off-the-map", run_of(dataset, slope=3))
    pretend(folder, "before-the-map", run_of(dataset, slope=-1))
    pretend(folder, "half-copied", '{"verdict": "climb')
    pretend(folder, "not-a-replay", {"verdict": "climbed"})
    pretend(folder, "no-summary-but-a-list", [1, 2])
    pretend(folder, "deeper/inside", run_of(dataset))
    pretend(tmp_path, "elsewhere", run_of(dataset))
    (folder / "leads-elsewhere").symlink_to(tmp_path / "elsewhere")
    pretend(folder, "without-a-report", run_of(dataset))
    (folder / "without-a-report" / "report.html").unlink()
    assert find_cell_reports(dataset, folder) == ()
    pretend(folder, "the-one", run_of(dataset))
    assert [one.folder for one in find_cell_reports(dataset, folder)] == ["the-one"]
    del dataset.attrs["fingerprint"]
    assert find_cell_reports(dataset, folder) == ()


def test_a_replay_elsewhere_or_of_an_unfinished_map_leaves_the_page_alone(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(made, tmp_path / "map", ignore=shutil.ignore_patterns("cell-*")))
    before = (folder / "map.html").read_bytes()
    place = ["map", "replay", str(folder), "--slope", "30", "--thrust", "16"]
    assert main([*place, "--out", str(tmp_path / "run")]) == 0
    assert (folder / "map.html").read_bytes() == before
    (folder / "map.html").unlink()
    capsys.readouterr()
    assert main(place) == 0
    assert not (folder / "map.html").exists()
    said = capsys.readouterr()
    assert "map.html" not in said.out + said.err


def test_a_click_on_the_marked_cell_leads_to_its_report(browser: Any, made: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(made, tmp_path / "another place"))  # the links do not mind
    page = browser.new_page(viewport={"width": 1200, "height": 950})
    problems: list[str] = []
    page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on(
        "request",
        lambda asked: None if asked.url.startswith(("file:", "data:", "blob:")) else problems.append(asked.url),
    )
    page.goto((folder / "map.html").as_uri())
    # A cell without a report says how to make one; the marked one leads to its report.
    box = page.locator(".scatterlayer path.point").last.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    click(page, x, y + 150, "slope 30.00 deg, thrust 4.00 N")
    page.get_by_text("Write its report").wait_for()
    assert page.locator("#cell a").count() == 0
    click(page, x, y, "slope 30.00 deg, thrust 16.00 N")
    link = page.locator("#cell a")
    link.wait_for()
    assert link.get_attribute("href") == "cell-30-16-0.8-0/report.html"
    assert "30°, 16 N, μₛ 0.8" in page.inner_text("#cell")
    (command,) = page.locator("#cell code").all_inner_texts()
    assert command == f"m4 view '{made}' --slope 30 --thrust 16 --friction 0.8"
    link.click()
    page.wait_for_selector("#panels svg path")
    assert page.url == (folder / "cell-30-16-0.8-0" / "report.html").as_uri()
    assert "Climbed" in page.inner_text("#verdict")
    assert problems == []
    page.close()


def test_the_list_of_reports_is_reached_by_keyboard_whatever_the_folders_are_called(browser: Any, folder: Path) -> None:
    dataset = load_map(folder)
    names = ["a & <b>", 'quo"te', "100% #1?", "ümlaut: c"]
    for k, name in enumerate(names):
        pretend(folder, name, run_of(dataset, CellIndex(k // 2, k % 2, 2, 0)))
    write_map_page(dataset, folder / "map.html", subject="MAP", reports=find_cell_reports(dataset, folder))
    page = browser.new_page()
    page.goto((folder / "map.html").as_uri())
    page.locator("summary").focus()
    page.keyboard.press("Enter")
    assert page.inner_text("summary") == f"Reports ({len(names)})"
    links = page.locator("#reports a")
    assert links.all_inner_texts() == [
        f"{slope}°, 40 N, μₛ {friction}: start 0, slipped" for friction in (0.4, 0.8) for slope in (10, 30)
    ]
    for k in range(len(names)):
        page.goto((folder / "map.html").as_uri())
        page.locator("summary").focus()
        page.keyboard.press("Enter")
        for _ in range(k + 1):
            page.keyboard.press("Tab")
        with page.expect_navigation():
            page.keyboard.press("Enter")
        assert page.title() == "a report"
    page.close()


def test_reports_of_the_disagreements_are_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["map", "closed-loop", "--slope", "10,45", "--thrust", "0,16", "--plant", "mip", "--workers", "0"]
    command += ["--starts", "2", "--out", str(tmp_path), "--reports"]
    assert main(command) == 0
    dataset = load_map(tmp_path)
    apart = dataset["disagreement"].to_numpy() > 0
    assert apart.any()
    assert not apart.all()
    reports = find_cell_reports(dataset, tmp_path)
    assert {one.index[:3] for one in reports} == {
        tuple(map(int, where)) for where in zip(*apart.nonzero(), strict=True)
    }
    for one in reports:
        verdicts = dataset["verdict"].to_numpy()[one.index[:3]]
        assert verdicts[one.index.start] == verdicts.max()
        assert f'href="{one.href}"' in (tmp_path / "map.html").read_text("utf-8")
    # The command in a report is the one that simulates this cell alone: it gives the same run.
    first = tmp_path / reports[0].folder / "summary.json"
    summary = json.loads(first.read_text())
    assert main(summary["provenance"]["command"].replace("m4 ", "", 1).split()) == 0
    again = json.loads(first.read_text())
    assert again["pitch_error_deg"] == summary["pitch_error_deg"]
    assert again["pitch_rms_deg"] == pytest.approx(summary["pitch_rms_deg"], rel=1e-6)  # a fall magnifies rounding
    capsys.readouterr()
    times = {path: path.stat().st_mtime_ns for path in tmp_path.glob("cell-*/report.html")}
    assert main([*command, "--resume"]) == 0
    assert "reports written: 0" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("cell-*/report.html")} == times


def test_an_interrupt_leaves_whole_reports_and_a_page_that_links_to_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from m4_dynamics.cli import map_cells

    real, calls = map_cells.simulate, []

    def second_time(*arguments: Any, **options: Any) -> Any:
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(map_cells, "simulate", second_time)
    command = [
        "map",
        "closed-loop",
        "--slope",
        "5,10",
        "--thrust",
        "0",
        "--plant",
        "mip",
        "--workers",
        "0",
        "--reports",
    ]
    assert main([*command, "--out", str(tmp_path)]) == 130
    assert "interrupted" in capsys.readouterr().err
    (report,) = find_cell_reports(load_map(tmp_path), tmp_path)
    assert f'href="{report.href}"' in (tmp_path / "map.html").read_text("utf-8")
    assert {path.name for path in tmp_path.iterdir()} == {
        "map.zarr", "map.nc", "map.png", "map.html", report.folder
    }  # fmt: skip


def test_an_interrupted_replay_leaves_no_report_of_half_a_run(
    folder: Path, made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(made / "map.zarr", folder / "map.zarr")
    real, steps = BalanceLoop.advance, []

    def hundredth_time(loop: BalanceLoop) -> None:
        steps.append(loop)
        if len(steps) == 100:
            raise KeyboardInterrupt
        real(loop)

    monkeypatch.setattr(BalanceLoop, "advance", hundredth_time)
    before = (folder / "map.html").read_bytes()
    assert main(["map", "replay", str(folder), "--slope", "30", "--thrust", "16"]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert list(folder.glob("cell-*")) == []
    assert (folder / "map.html").read_bytes() == before
