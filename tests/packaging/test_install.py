"""The built wheel and source archive hold what an installed package needs, robot descriptions included."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

import m4_dynamics

ROOT = Path(__file__).resolve().parents[2]
RELEASE = f"m4_dynamics-{m4_dynamics.__version__}"
# Whatever lies in urdf/ must be installed, except the scripts that write it.
DESCRIPTION = {
    path.relative_to(ROOT / "urdf").as_posix()
    for path in (ROOT / "urdf").rglob("*")
    if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".py"
}


def build(source: Path, target: str, folder: Path) -> Path:
    """Build with the backend itself: offline, no isolated environment, nothing written into the source tree."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    result = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, "wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, "sdist", tmp_path_factory.mktemp("sdist"))


def test_the_wheel_holds_code_marker_and_descriptions(wheel: Path) -> None:
    assert {"m4.urdf", "m4.srdf", "m4.toml", "meshes/tyre.obj"} <= DESCRIPTION
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        installed = "m4_dynamics/urdf/"
        assert {name.removeprefix(installed) for name in names if name.startswith(installed)} == DESCRIPTION
        for file in DESCRIPTION:
            assert archive.read(f"m4_dynamics/urdf/{file}") == (ROOT / "urdf" / file).read_bytes()
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "m4_dynamics").rglob("*.py")}
    assert modules <= names
    assert "m4_dynamics/py.typed" in names
    # Nothing is installed beside the package: no top-level urdf, tests or analysis.
    assert {name.split("/")[0] for name in names} == {"m4_dynamics", f"{RELEASE}.dist-info"}
    assert not [name for name in names if "__pycache__" in name]


def test_the_metadata_is_complete(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        folder = f"{RELEASE}.dist-info"
        metadata = Parser().parsestr(archive.read(f"{folder}/METADATA").decode())
        assert archive.read(f"{folder}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
        assert "m4 = m4_dynamics.cli.main:main" in archive.read(f"{folder}/entry_points.txt").decode()
    assert metadata["Version"] == m4_dynamics.__version__
    assert metadata["License-Expression"] == "BSD-2-Clause"
    assert metadata["Requires-Python"] == ">=3.11"
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    assert set(metadata.get_all("Provides-Extra")) == set(extras) == {"build", "peers", "test"}
    plain = [line for line in metadata.get_all("Requires-Dist") if "extra ==" not in line]
    assert not [line for line in plain if line.startswith(("drake", "mujoco", "casadi", "example-robot-data"))]


def test_the_installed_package_works_elsewhere(wheel: Path, tmp_path: Path) -> None:
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)  # a pure wheel is installed by unpacking it
    script = (
        "import m4_dynamics.cli.main as m; from m4_dynamics.robot.loading import load_robot; robot = load_robot();"
        "bodies = robot.visual_model.geometryObjects; meshes = {body.meshPath for body in bodies};"
        "print(m.__file__, *robot.files.values(), f'{robot.mass:.3f}', sep='\\n');"
        "print(*sorted(meshes), sep='\\n'); m.main(['--help'])"
    )
    result = subprocess.run(
        [sys.executable, "-c", script],
        cwd=elsewhere,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    code, *files, mass = result.stdout.splitlines()[:5]
    assert all(Path(file).is_relative_to(site / "m4_dynamics" / "urdf") for file in files)
    assert Path(code).is_relative_to(site)
    assert mass == "6.000"
    meshes = [line for line in result.stdout.splitlines() if line.endswith(".obj")]
    assert {Path(mesh).relative_to(site / "m4_dynamics" / "urdf").as_posix() for mesh in meshes} == {
        file for file in DESCRIPTION if file.endswith(".obj")
    }
    assert "usage: m4" in result.stdout


def test_the_source_archive_builds_the_same_wheel(wheel: Path, sdist: Path, tmp_path: Path) -> None:
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    rebuilt = build(tmp_path / RELEASE, "wheel", tmp_path / "rebuilt")
    with zipfile.ZipFile(wheel) as first, zipfile.ZipFile(rebuilt) as second:
        assert sorted(first.namelist()) == sorted(second.namelist())
        assert all(first.read(name) == second.read(name) for name in first.namelist())
