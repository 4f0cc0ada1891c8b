"""What the README names exists: commands parse, files are there, functions import, tests are found, examples work."""

from __future__ import annotations

import importlib
import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from m4_dynamics.cli.main import COMMANDS, build_parser

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text("utf-8")
SPANS = re.findall(r"(?<!`)`([^`\n]+)`(?!`)", re.sub(r"^```.*?^```$", "", README, flags=re.M | re.S))
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", README, re.M | re.S)

#: Labels of the paper's equations and figures; the tables must have a row for every one.
EQUATIONS = (
    "energy", "eom_full", "eom_full_ss", "pos_vectors", "virtual_work", "lagrangian_2d", "eom_2d", "motor_model",
    "eom_2d_v2", "nonlinear_model_2d", "fbd_equations_1", "fbd_equations_2", "fbd_equations_3", "ground_friction",
    "ground_constraint", "discrete_model", "mpc_formulation",
)  # fmt: skip
FIGURES = (
    "robot_overview", "wair", "m4_dof", "fbd_2d", "plot_states", "plot_mpc", "m4_experiment", "wair_experiment"
)  # fmt: skip


def block(language: str, containing: str) -> str:
    (found,) = [text for name, text in BLOCKS if name == language and containing in text]
    return found


def lines_and_spans() -> list[str]:
    """Everything that the README shows as a command: lines of shell blocks and inline code."""
    shell = [line.split("#")[0].strip() for name, text in BLOCKS if name == "sh" for line in text.splitlines()]
    return [text for text in [*shell, *SPANS] if text]


def table_rows(heading: str, until: str) -> list[list[str]]:
    part = README.split(heading, 1)[1].split(until, 1)[0]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in part.splitlines() if line[:3] == "| `"]


COMMAND_LINES = sorted({text for text in lines_and_spans() if text.startswith("m4 ")})
SCRIPT_LINES = sorted({text for text in lines_and_spans() if text.startswith("python ")})
TEST_NAMES = sorted({text for text in SPANS if "::" in text})
PAPER_ROWS = table_rows("Every equation:", "### Corrections")
NAMES = sorted({name for row in PAPER_ROWS for name in re.findall(r"`([a-z_]+(?:\.\w+)+)`", row[1])} - {"urdf/m4.srdf"})


def test_there_is_something_to_check() -> None:
    assert {line.split()[1] for line in COMMAND_LINES} == set(COMMANDS)
    assert len(SCRIPT_LINES) >= 5
    assert len(TEST_NAMES) >= 30
    assert len(NAMES) >= 30


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_command_parses(line: str) -> None:
    words = shlex.split(line)[1:]
    parsed = build_parser(words[0]).parse_args(words)
    robot = getattr(parsed, "robot", None)
    assert robot is None or (ROOT / robot).is_file()


@pytest.mark.parametrize("line", SCRIPT_LINES)
def test_script_is_there_and_knows_its_options(line: str) -> None:
    script, *arguments = shlex.split(line)[1:]
    code = (ROOT / script).read_text("utf-8")
    for option in (word for word in arguments if word.startswith("--")):
        assert f'"{option}"' in code


def test_options_that_are_named_alone_exist() -> None:
    known = "".join(path.read_text("utf-8") for path in (ROOT / "analysis").glob("*.py"))
    known += "".join(build_parser(command).format_help() for command in COMMANDS)
    known += "".join(path.read_text("utf-8") for path in (ROOT / "m4_dynamics" / "cli").glob("*.py"))
    for span in SPANS:
        if span.startswith("--"):
            assert f'"{span.split()[0]}"' in known, span


def test_files_exist() -> None:
    linked = re.findall(r"\]\(([^)#]+)\)", README) + re.findall(r'src="([^"]+)"', README)
    named = [span for span in SPANS if re.fullmatch(r"(?:analysis|docs|m4_dynamics|tests|urdf)/[\w./]+", span)]
    assert len(linked) > 5
    assert len(named) > 2
    for name in [*linked, *named]:
        assert (ROOT / name).exists(), name


def test_the_gallery_lists_every_script() -> None:
    gallery = (ROOT / "analysis" / "README.md").read_text("utf-8")
    scripts = {path.name for path in (ROOT / "analysis").glob("*.py")}
    assert set(re.findall(r"^\| \[(\w+\.py)\]\(\1\)", gallery, re.M)) == scripts
    assert set(re.findall(r"`python analysis/(\w+\.py)", gallery)) == scripts


def test_pictures_are_small() -> None:
    for name in re.findall(r'src="([^"]+)"', README):
        assert (ROOT / name).stat().st_size < 300_000, name


def test_links_within_the_page_lead_somewhere() -> None:
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", README, flags=re.M | re.S), re.M)
    anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    for target in re.findall(r"\]\(#([^)]+)\)", README):
        assert target in anchors


@pytest.mark.parametrize("name", NAMES)
def test_function_of_the_table_exists(name: str) -> None:
    parts = ["m4_dynamics", *name.split(".")]
    for length in range(len(parts) - 1, 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[length:]:
            found = getattr(found, attribute)
        assert callable(found)
        return
    pytest.fail(f"no module of {name}")


@cache
def functions_of(file: str) -> frozenset[str]:
    return frozenset(re.findall(r"^def (test_\w+)", (ROOT / "tests" / file).read_text("utf-8"), re.M))


@pytest.mark.parametrize("name", TEST_NAMES)
def test_test_of_the_table_exists(name: str) -> None:
    file, _, function = name.partition("::")
    assert function in functions_of(file)


def test_every_equation_and_figure_of_the_paper_has_its_row() -> None:
    first_cells = " ".join(row[0] for row in PAPER_ROWS)
    for label in (*EQUATIONS, *FIGURES):
        assert f"`{label}`" in first_cells, label
    assert {len(row) for row in PAPER_ROWS} == {4}


def test_examples_are_the_files_they_come_from() -> None:
    script = (ROOT / "analysis" / "own_controller.py").read_text("utf-8")
    assert block("python", "plant.step()") in script
    description = (ROOT / "analysis" / "robots" / "two_wheeler.toml").read_text("utf-8")
    assert block("toml", "two_wheeler.urdf") in description


def test_targets_of_make_exist() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = re.findall(r"^make (\w+)", "\n".join(text for name, text in BLOCKS if name == "sh"), re.M)
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.M)
