"""One thing that is wrong, or odd, in a robot's description."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from m4_dynamics.errors import RobotDescriptionError

__all__ = ["Finding", "InvalidUrdfError", "Severity", "has_errors"]

#: An error makes the robot unusable or its motion meaningless, a warning makes it doubtful, a note is worth knowing.
Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, or odd, in a robot's description.

    Attributes:
        severity: How bad it is.
        where: The element, such as "joint 'left_wheel' (line 12)".
        what: What is wrong with it.
        hint: What would mend it.
    """

    severity: Severity
    where: str
    what: str
    hint: str = ""

    def __str__(self) -> str:
        hint = f"; {self.hint}" if self.hint else ""
        return f"{self.where}: {self.what}{hint}"


class InvalidUrdfError(RobotDescriptionError):
    """A URDF that cannot be used.

    Attributes:
        urdf: The file.
        findings: What is wrong with it, worst first.
    """

    def __init__(self, urdf: Path, findings: Iterable[Finding], summary: str) -> None:
        self.urdf = urdf
        self.findings = tuple(findings)
        lines = [f"{urdf}: {summary}", *(f"  {finding}" for finding in self.findings if finding.severity == "error")]
        super().__init__("\n".join(lines))


def has_errors(findings: Iterable[Finding]) -> bool:
    """Whether any of the findings is an error."""
    return any(finding.severity == "error" for finding in findings)
