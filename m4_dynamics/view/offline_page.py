"""One self-contained page with meshcat's viewer: its program, packed commands and the facts that its script shows.

No server is started and no port opened; whoever wants one serves the text.
"""

from __future__ import annotations

import base64
import html
import importlib.util
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.three import Command, pack_in_parts

__all__ = ["PAGE_POLICY", "camera_facts", "offline_page", "rounded", "viewer_program"]

#: Nothing may be fetched from anywhere; what runs is in the page.
PAGE_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
_FIELD_OF_VIEW = 30.0  # [deg] vertical


def offline_page(*, title: str, commands: Sequence[Command], facts: dict[str, Any]) -> str:
    """Put a page together.

    Args:
        title: Its title and heading.
        commands: What the viewer shows.
        facts: What the page's script shows beside it, as plain values.

    Returns:
        The page's text; the same arguments give the same text.

    Raises:
        ResultFileError: The viewer's program is not installed.
    """
    folder = resources.files("m4_dynamics.view.page")
    # A mesh that four wheels share, and the instants that all tracks share, are written once.
    numbers: dict[bytes, int] = {}
    packed = [[numbers.setdefault(part, len(numbers)) for part in pack_in_parts(one)] for one in commands]
    parts = [base64.b64encode(part).decode("ascii") for part in numbers]
    content = {"parts": parts, "commands": packed, **facts}
    data = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    program, licences = viewer_program()
    return Template(folder.joinpath("replay.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(title),
        policy=PAGE_POLICY,
        licences=licences.replace("--", "- -"),
        style=folder.joinpath("scene.css").read_text(encoding="utf-8"),
        viewer=program,
        # Inside a script element only "</" could end the data early.
        data=data.replace("</", "<\\/"),
        script="".join(folder.joinpath(name).read_text(encoding="utf-8") for name in ("scene.js", "replay.js")),
    )


def camera_facts(
    low: Sequence[float], high: Sequence[float], direction: Sequence[float], *, follow: str | None, following: bool
) -> dict[str, Any]:
    """What the page's script wants to know of its camera.

    Args:
        low: Lowest corner of the box to be seen [m].
        high: Highest corner [m].
        direction: From the box to the camera.
        follow: The node that the camera can follow, or None.
        following: Whether it does so from the start.

    Returns:
        Plain values.
    """
    return {
        "low": rounded(low, 3),
        "high": rounded(high, 3),
        "direction": list(direction),
        "field_of_view": _FIELD_OF_VIEW,
        "follow": following,
        "root": follow,
    }


def rounded(values: ArrayLike, digits: int) -> list[float | None]:
    """Numbers for JSON, which has no NaN: those become null."""
    return [
        round(float(one), digits) if np.isfinite(one) else None for one in np.ravel(np.asarray(values, dtype=float))
    ]


def viewer_program() -> tuple[str, str]:
    """The text of meshcat's viewer and its licences; the package is found without importing it, which is slow."""
    package = importlib.util.find_spec("meshcat")
    if package is None or not package.submodule_search_locations:
        raise ResultFileError("the page needs the Python package meshcat, which is not installed")
    viewer = Path(package.submodule_search_locations[0]) / "viewer"
    try:
        program = (viewer / "dist" / "main.min.js").read_text(encoding="utf-8")
        licences = [
            (viewer / name).read_text(encoding="utf-8").strip() for name in ("LICENSE", "dist/main.min.js.LICENSE.txt")
        ]
    except OSError as error:
        raise ResultFileError(f"meshcat's viewer cannot be read: {error}") from error
    return program.replace("</script", "<\\/script"), "meshcat viewer\n\n" + "\n\n".join(licences)
