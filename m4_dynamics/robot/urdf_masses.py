"""Check the masses and inertias of a URDF's links, as the file states them.

Pinocchio merges links that are fixed to one another, so the loaded model no longer shows which link was wrong; and it
drops a malformed `<inertial>`, mass and all, with no more than a line on stderr.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.robot.finding import Finding
from m4_dynamics.robot.inertia import inertia_findings
from m4_dynamics.robot.urdf_syntax import Element, end_of_joint, location, numbers_of, part_findings

__all__ = ["inertial_syntax_findings", "mass_findings"]


def inertial_syntax_findings(root: Element) -> list[Finding]:
    """Find the <inertial> elements that Pinocchio would drop or misread.

    Args:
        root: The <robot> element.

    Returns:
        What is missing or malformed in them.
    """
    findings = []
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            for part in inertial.iter("inertial", "origin", "mass", "inertia"):
                findings += part_findings(part, location(link))
    return findings


def mass_findings(root: Element) -> list[Finding]:
    """Check the mass and the inertia of every link, and that every joint moves some mass.

    Args:
        root: The <robot> element.

    Returns:
        What is wrong with them; malformed or missing <inertial> elements count as massless here.
    """
    links, joints = root.findall("link"), root.findall("joint")
    findings = []
    masses: dict[str, float] = {}
    for link in links:
        values = _inertial_values(link)
        name = link.get("name") or ""
        masses[name] = 0.0 if values is None else values[0]
        if values is not None:
            findings += inertia_findings(values[0], values[1], location(link))
    children: dict[str, list[Element]] = {name: [] for name in masses}
    for joint in joints:
        children.get(end_of_joint(joint, "parent") or "", []).append(joint)
    for joint in joints:
        child = end_of_joint(joint, "child")
        if joint.get("type") != "fixed" and child in masses and _carried_mass(child, children, masses) <= 0.0:
            what = f"moves no mass: link '{child}' and all that hangs on it weigh nothing"
            findings.append(
                Finding("error", location(joint), what, "give the link an <inertial>, or make the joint fixed")
            )
    if links and not findings and sum(masses.values()) <= 0.0:
        findings.append(Finding("error", "robot", "all links together weigh nothing", "give the links an <inertial>"))
    return findings


def _inertial_values(link: Element) -> tuple[float, NDArray[np.float64]] | None:
    """Mass and inertia tensor of a link, or None where they are missing or malformed."""
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    inertia = None if inertial is None else inertial.find("inertia")
    if mass is None or inertia is None:
        return None
    values = [numbers_of(mass.get("value"))]
    values += [numbers_of(inertia.get(name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
    numbers = [value[0] for value in values if value is not None and len(value) == 1]
    if len(numbers) != len(values):
        return None
    total, xx, xy, xz, yy, yz, zz = numbers
    return total, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _carried_mass(link: str, children: dict[str, list[Element]], masses: dict[str, float]) -> float:
    """Mass of a link and everything below it; a link is counted once even where the joints make a loop."""
    seen: set[str] = set()
    waiting = [link]
    total = 0.0
    while waiting:
        name = waiting.pop()
        if name in seen or name not in masses:
            continue
        seen.add(name)
        total += masses[name]
        waiting += [child for joint in children[name] if (child := end_of_joint(joint, "child"))]
    return total
