"""What is in the repository names no package registry and no path of somebody's machine."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Written with groups so that this file does not match itself.
REGISTRY = re.compile(
    r"(?:pypi|pythonhosted|anaconda|npmjs|yarnpkg)[.](?:org|com)|(?:deb|archive|ports)[.](?:debian|ubuntu)[.]", re.I
)
MACHINE_PATH = re.compile(r"(?<![\w.$}~-])/(?:work|root|home|Users)/[\w.]|file:(?://)/\w|[A-Z]:\\Users")
LOCK_OPTION = re.compile(r"^\s*(?:-[ifer]\b|--(?!hash=)\w)|://|\s@\s", re.M)


def tracked_texts() -> list[tuple[str, str]]:
    """Read every tracked text file of the checkout, as (path, text)."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        if os.environ.get("CI"):
            pytest.fail("CI needs git and a checkout")
        pytest.skip("not a git checkout")
    # The checkout may belong to another user than the one who tests.
    command = [git, "-c", f"safe.directory={ROOT}", "ls-files", "-z"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode().split("\0")
    texts: list[tuple[str, str]] = []
    for name in filter(None, listed):
        path = ROOT / name
        content = path.read_bytes() if path.is_file() else b""
        if b"\0" not in content:
            texts.append((name, content.decode("utf-8")))
    return texts


def hits(pattern: re.Pattern[str], texts: list[tuple[str, str]]) -> list[str]:
    return [
        f"{name}:{number}: {line.strip()[:120]}"
        for name, text in texts
        for number, line in enumerate(text.splitlines(), start=1)
        if pattern.search(line)
    ]


def test_no_registry_is_named() -> None:
    assert hits(REGISTRY, tracked_texts()) == []


def test_no_path_of_a_machine_is_named() -> None:
    assert hits(MACHINE_PATH, tracked_texts()) == []


def test_locks_hold_versions_and_hashes_only() -> None:
    locks = [(path.name, path.read_text("utf-8")) for path in sorted((ROOT / "requirements").glob("*.txt"))]
    assert {name for name, _ in locks} == {"core.txt", "test.txt", "uv.txt"}
    assert hits(LOCK_OPTION, locks) == []
    for name, text in locks:
        pinned = re.findall(r"^([a-z0-9][\w.-]*)==\S+.*\\\n +--hash=sha256:[0-9a-f]{64}", text, re.M)
        named = re.findall(r"^[a-z0-9].*", text, re.M)
        assert len(pinned) == len(named) > 0, f"{name} has a requirement without version or hash"


def test_the_locks_agree_and_the_demo_needs_no_peer() -> None:
    def versions(name: str) -> dict[str, str]:
        text = (ROOT / "requirements" / name).read_text("utf-8")
        return dict(re.findall(r"^([a-z0-9][\w.-]*)==(\S+)", text, re.M))

    core, test = versions("core.txt"), versions("test.txt")
    assert {name: version for name, version in test.items() if name in core} == core
    assert {"casadi", "drake", "mujoco", "example-robot-data", "pytest"} <= set(test) - set(core)


@pytest.mark.parametrize(
    ("pattern", "line"),
    [
        (REGISTRY, "--index-url https://" + "pypi" + ".org/simple"),
        (REGISTRY, "https://files." + "pythonhosted" + ".org/packages/x.whl"),
        (REGISTRY, "https://registry." + "npmjs" + ".org/x"),
        (MACHINE_PATH, "path = '/" + "home/somebody/m4'"),
        (MACHINE_PATH, "see (/" + "root/notes.md)"),
        (LOCK_OPTION, "--find-links wheels"),
        (LOCK_OPTION, "-i mirror"),
        (LOCK_OPTION, "pin @ https" + "://mirror/pin.whl"),
    ],
)
def test_the_patterns_find_what_they_look_for(pattern: re.Pattern[str], line: str) -> None:
    assert pattern.search(line)
