"""What a map came from: enough to compute it again, and to refuse to mix it with another."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from m4_dynamics import __version__
from m4_dynamics.robot.robot import Robot

__all__ = ["fingerprint", "robot_provenance"]


def robot_provenance(robot: Robot, *, command: str = "") -> dict[str, str]:
    """Attributes that say what robot and version a map is of.

    Args:
        robot: The robot.
        command: The command line, if there is one.

    Returns:
        Name, hashes of the robot's files, version, command.
    """
    hashes = {f"sha256_{kind}": digest for kind, digest in sorted(robot.file_hashes.items())}
    files = {f"file_{kind}": path.name for kind, path in sorted(robot.files.items())}
    return {"robot": robot.name, **hashes, **files, "version": __version__, "command": command}


def fingerprint(*parts: Mapping[str, Any]) -> str:
    """Hash of settings, the same in every process.

    Args:
        parts: Plain values.

    Returns:
        SHA-256 of their JSON.
    """
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
