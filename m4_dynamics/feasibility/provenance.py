"""What a map came from: enough to compute it again, and to refuse to mix it with another."""

from __future__ import annotations

from typing import Any, Protocol

from m4_dynamics import __version__
from m4_dynamics.robot.robot import Robot

__all__ = ["robot_provenance", "sweep_identity"]


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


class Plain(Protocol):
    """What can say itself in plain values."""

    def as_dict(self) -> dict[str, Any]:
        """Values that JSON can hold."""
        ...


def sweep_identity(robot: Robot, grid: Plain, settings: Plain) -> dict[str, Any]:
    """What all records of a sweep share.

    Args:
        robot: The robot.
        grid: The axes.
        settings: What the rollouts have in common.

    Returns:
        Robot with its files' hashes and the version, axes, settings.
    """
    provenance = robot_provenance(robot)
    provenance.pop("command")
    return {"provenance": provenance, "grid": grid.as_dict(), "settings": settings.as_dict()}
