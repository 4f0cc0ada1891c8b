"""Imports run one way only, down the floors of the package, and the entry points stay light."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Container
from pathlib import Path

import pytest

PACKAGE = "m4_dynamics"
ROOT = Path(__file__).resolve().parents[2]

#: Floor -> the floors that it may import, itself aside, from the ground up. A file that knows more than its floor is
#: listed on its own.
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "output": {"errors"},
    "robot": {"errors"},
    "full": {"errors", "robot"},
    "reduced": {"errors"},
    "reduced.reduction": {"errors", "robot", "full", "reduced"},
    "control": {"errors", "reduced"},
    "simulation": {"errors", "output", "robot", "full", "reduced", "reduced.reduction", "control"},
}
for top_floor in ("mission", "feasibility", "view", "bench", "cli"):
    ALLOWED[top_floor] = set(ALLOWED)  # everything below

#: Third-party module -> the only floors (or files) that may import it. Modules that are not listed are free.
RESERVED: dict[str, set[str]] = {
    "pinocchio": {"robot", "full", "reduced.reduction", "simulation", "mission", "feasibility", "view", "bench", "cli"},
    "coal": {"robot", "full", "reduced.reduction", "simulation", "feasibility", "view"},
    "hppfcl": set(),
    "proxsuite": {"control.mpc", "bench"},
    "casadi": {"bench"},
    "mujoco": {"bench"},
    "pydrake": {"bench"},
    "meshcat": {"view"},
    "matplotlib": {"view"},
    "plotly": {"view"},
    "zarr": {"feasibility"},
    "dask": {"feasibility"},
    "distributed": {"feasibility"},
}


def place(module: str, known: Container[str]) -> str:
    """Find the most specific known floor or file that a module below the package belongs to."""
    parts = module.split(".")[1:]
    for length in range(len(parts), 0, -1):
        if ".".join(parts[:length]) in known:
            return ".".join(parts[:length])
    return parts[0] if parts else ""


def imported_modules(source: str, module: str, is_package: bool, exists: set[str]) -> list[tuple[int, str]]:
    """List the modules that a file imports anywhere in it, as (line, absolute dotted name)."""
    found: list[tuple[int, str]] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                anchor = module.split(".") if is_package else module.split(".")[:-1]
                anchor = anchor[: len(anchor) - (node.level - 1)]
                base = ".".join([*anchor, base] if base else anchor)
            for alias in node.names:
                # `from package import name` imports the module package.name if there is one.
                name = f"{base}.{alias.name}"
                found.append((node.lineno, name if name in exists else base))
    return found


def violations(package: Path) -> list[str]:
    """Check every file of a package against the tables above; one line per forbidden import."""
    files: dict[str, Path] = {}
    for path in sorted(package.rglob("*.py")):
        parts = [PACKAGE, *path.relative_to(package).with_suffix("").parts]
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    exists = set(files)
    problems: list[str] = []
    for module, path in files.items():
        here = place(module, ALLOWED)
        where = path.relative_to(package).as_posix()
        if module != PACKAGE and here not in ALLOWED:
            problems.append(f"{where}: '{here}' is on no floor: add it to the table of this test")
            continue
        for line, name in imported_modules(path.read_text("utf-8"), module, path.name == "__init__.py", exists):
            top = name.split(".")[0]
            if top == PACKAGE:
                if name == PACKAGE:
                    continue  # the version and the lazily loaded names
                there = place(name, ALLOWED)
                if module == PACKAGE:
                    problems.append(f"{where}:{line}: the package itself imports {name}; load it on first use")
                elif there != here and there not in ALLOWED[here]:
                    problems.append(f"{where}:{line}: {here} must not import {there}")
            elif top in RESERVED:
                allowed = RESERVED[top]
                if place(module, allowed) not in allowed:
                    problems.append(f"{where}:{line}: {here or PACKAGE} must not import {top}")
    return problems


def test_imports_run_one_way() -> None:
    assert violations(ROOT / PACKAGE) == []


@pytest.mark.parametrize(
    ("file", "line", "expected"),
    [
        ("robot/a.py", "from m4_dynamics.full import dynamics", "robot must not import full"),
        ("robot/a.py", "from ..full.dynamics import f", "robot must not import full"),
        ("reduced/__init__.py", "from .reduction import reduce_robot", "reduced must not import reduced.reduction"),
        ("reduced/trim.py", "import m4_dynamics.reduced.reduction", "reduced must not import reduced.reduction"),
        ("reduced/trim.py", "from m4_dynamics.robot.robot import Robot", "reduced must not import robot"),
        ("reduced/trim.py", "def f():\n    import pinocchio as pin", "reduced must not import pinocchio"),
        ("reduced/reduction.py", "from proxsuite import proxqp", "reduced.reduction must not import proxsuite"),
        ("reduced/reduction.py", "from m4_dynamics.control import lqr", "reduced.reduction must not import control"),
        ("control/lqr.py", "import proxsuite", "control must not import proxsuite"),
        ("control/lqr.py", "from m4_dynamics import simulation", "control must not import simulation"),
        ("simulation/plant.py", "from m4_dynamics.view.plots import plot", "simulation must not import view"),
        ("errors.py", "from m4_dynamics.robot import robot", "errors must not import robot"),
        ("__init__.py", "from m4_dynamics.errors import M4Error", "the package itself imports m4_dynamics.errors"),
        ("utils.py", "import os", "'utils' is on no floor"),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, file: str, line: str, expected: str) -> None:
    package = tmp_path / PACKAGE
    for name in ("full/dynamics.py", "reduced/reduction.py", "simulation/__init__.py", file):
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    (package / file).write_text(line)
    found = violations(package)
    assert len(found) == 1
    assert expected in found[0]


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("reduced/reduction.py", "import pinocchio\nfrom m4_dynamics.full import dynamics\nfrom .trim import Trim"),
        ("control/mpc/qp.py", "from proxsuite import proxqp\nfrom ..lqr import lqr_gain"),
        ("cli/wair.py", "from m4_dynamics import __version__\nfrom m4_dynamics.view import plots"),
    ],
)
def test_an_allowed_import_passes(tmp_path: Path, file: str, line: str) -> None:
    path = tmp_path / PACKAGE / file
    path.parent.mkdir(parents=True)
    path.write_text(line)
    assert violations(tmp_path / PACKAGE) == []


def loaded_modules(code: str) -> set[str]:
    """Run code in a new interpreter and list the top-level modules that it has loaded at its end."""
    script = f"import sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\nprint('loaded:', *sys.modules)"
    result = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in result.stdout.rsplit("loaded:", 1)[1].split()}


HEAVY = {"pinocchio", "numba", "matplotlib", "xarray", "scipy", "proxsuite", "meshcat", "yourdfpy", "h5py", "pandas"}
HEAVY |= {"zarr", "dask", "distributed", "plotly"}
PENDULUM = sorted(path.stem for path in (ROOT / PACKAGE / "reduced").glob("*.py") if path.stem != "reduction")


@pytest.mark.parametrize(
    "code",
    [
        "import m4_dynamics",
        "import m4_dynamics.cli.main as m; m.main(['--help'])",
        "import m4_dynamics.cli.main as m; m.main(['--version'])",
    ],
)
def test_entry_points_stay_light(code: str) -> None:
    loaded = loaded_modules(code)
    assert PACKAGE in loaded
    assert loaded & HEAVY == set()


def test_the_pendulum_needs_no_rigid_body_library() -> None:
    names = [f"{PACKAGE}.reduced" if stem == "__init__" else f"{PACKAGE}.reduced.{stem}" for stem in PENDULUM]
    assert f"{PACKAGE}.reduced.trim" in names
    assert loaded_modules("import " + ", ".join(names)) & {"pinocchio", "proxsuite"} == set()
