"""Say what is wrong with a URDF: which link, which joint, what is missing.

Pinocchio refuses a bad URDF with one sentence that names nothing, and takes some bad ones without a word: a negative
mass, an impossible inertia, a joint without a lower limit, a link with two parents, a malformed `<inertial>`.
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pinocchio as pin
from lxml import etree

from m4_dynamics.robot.finding import Finding, Severity, has_errors
from m4_dynamics.robot.inertia import model_inertia_findings
from m4_dynamics.robot.urdf_masses import mass_findings
from m4_dynamics.robot.urdf_syntax import Element, element_findings, end_of_joint, location, numbers_of

__all__ = ["diagnose_urdf"]

_ORDER = {"error": 0, "warning": 1, "note": 2}


def diagnose_urdf(path: Path) -> tuple[Finding, ...]:
    """Find what is wrong with a URDF.

    Args:
        path: The file.

    Returns:
        The findings, errors first. Without an error among them Pinocchio loads the file and its masses are sound.
    """
    where = path.name
    try:
        root = etree.parse(str(path)).getroot()
    except OSError as error:
        return (Finding("error", where, f"cannot be read ({error})"),)
    except etree.XMLSyntaxError as error:
        return (Finding("error", where, f"not valid XML: {error.msg}", "mend the XML, or export the file again"),)
    findings = list(_root_findings(root, where))
    links = root.findall("link")
    joints = root.findall("joint")
    for element in (*links, *joints):
        findings += element_findings(element)
    findings += _tree_findings(links, joints, where)
    findings += mass_findings(root)
    for joint in joints:
        findings += _joint_findings(joint, joints)
    findings += _mesh_findings(links, path)
    if not has_errors(findings):
        findings += _model_findings(path)
    return tuple(sorted(findings, key=lambda finding: _ORDER[finding.severity]))


def _root_findings(root: Element, where: str) -> list[Finding]:
    if root.tag != "robot":
        return [Finding("error", where, f"the root element is <{root.tag}>, not <robot>", "is this a URDF file?")]
    findings = []
    if not root.get("name"):
        findings.append(Finding("error", where, "<robot> has no attribute 'name'", 'add name="..."'))
    if any(element.prefix == "xacro" for element in root.iter(etree.Element)):
        findings.append(Finding("error", where, "holds xacro macros", "expand it with xacro first"))
    if root.find("link") is None:
        findings.append(Finding("error", where, "has no link", "a robot needs at least one link"))
    return findings


def _tree_findings(links: list[Element], joints: list[Element], where: str) -> list[Finding]:
    """Links and joints must make one tree: unique names, known links, one parent each, one root."""
    findings = []
    for kind, elements in (("link", links), ("joint", joints)):
        for name, count in Counter(element.get("name") for element in elements).items():
            if name and count > 1:
                lines = ", ".join(str(element.sourceline) for element in elements if element.get("name") == name)
                what = f"{count} {kind}s have this name (lines {lines})"
                findings.append(Finding("error", f"{kind} '{name}'", what, "give each its own name"))
    names = [name for link in links if (name := link.get("name"))]
    parents: dict[str, list[str]] = {name: [] for name in names}
    for joint in joints:
        parent, child = end_of_joint(joint, "parent"), end_of_joint(joint, "child")
        for tag, link in (("parent", parent), ("child", child)):
            if link is not None and link not in parents:
                hint = f"add the link, or name one of: {_shortened(names)}"
                findings.append(Finding("error", location(joint), f"its {tag} link '{link}' does not exist", hint))
        if child in parents and parent in parents:
            parents[child].append(parent)
    for name, above in parents.items():
        if len(above) > 1:
            what = f"is the child of {len(above)} joints (of {', '.join(above)})"
            findings.append(Finding("error", f"link '{name}'", what, "a URDF is a tree: leave one parent"))
    if findings:
        return findings  # roots and loops mean nothing until the names are right
    roots = [name for name, above in parents.items() if not above]
    if len(roots) > 1:
        what = f"{len(roots)} links have no parent: {_shortened(roots)}"
        findings.append(Finding("error", where, what, "connect all but one of them with a joint"))
    for loop in _loops(parents):
        what = f"the joints make a loop: {' -> '.join(loop)}"
        findings.append(Finding("error", where, what, "a URDF is a tree: cut the loop at one joint"))
    return findings


def _shortened(names: list[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _loops(parents: dict[str, list[str]]) -> list[list[str]]:
    """Closed chains of links, each once, from a map of links to their (single) parents."""
    loops = []
    done: set[str] = set()
    for start in parents:
        chain: list[str] = []
        link: str | None = start
        while link is not None and link not in done and link not in chain:
            chain.append(link)
            link = next(iter(parents[link]), None)
        if link in chain:
            loops.append([*reversed(chain[chain.index(link) :]), chain[-1]])
        done.update(chain)
    return loops


def _joint_findings(joint: Element, joints: list[Element]) -> list[Finding]:
    findings = []
    where = location(joint)
    axis = joint.find("axis")
    numbers = None if axis is None else numbers_of(axis.get("xyz"))
    if joint.get("type") in ("revolute", "continuous", "prismatic") and numbers and not any(numbers):
        findings.append(Finding("error", where, "its axis is zero", 'give a direction, such as xyz="0 0 1"'))
    limit = joint.find("limit")
    if limit is not None and joint.get("type") in ("revolute", "prismatic"):
        lower, upper = numbers_of(limit.get("lower")), numbers_of(limit.get("upper"))
        if lower and upper and lower[0] > upper[0]:
            what = f"its lower limit {lower[0]:g} is above its upper limit {upper[0]:g}"
            findings.append(Finding("error", where, what, "exchange the two"))
        elif lower and upper and lower[0] == upper[0]:
            what = f"both limits are {lower[0]:g}: it cannot move"
            findings.append(Finding("warning", where, what, "widen the limits, or make the joint fixed or continuous"))
    mimic = joint.find("mimic")
    if mimic is not None and mimic.get("joint") not in [other.get("name") for other in joints]:
        what = f"mimics joint '{mimic.get('joint')}', which does not exist"
        findings.append(Finding("warning", where, what, "name an existing joint"))
    return findings


def _mesh_findings(links: list[Element], path: Path) -> list[Finding]:
    findings = []
    missing: set[str] = set()
    hint = "put the file there, or mend the path; package:// starts from a folder above the URDF"
    # What collides must be there; without what is only seen, the robot is shown by what collides.
    levels: tuple[tuple[str, Severity], ...] = (("collision", "error"), ("visual", "warning"))
    for kind, level in levels:
        for link in links:
            for mesh in (mesh for shape in link.iter(kind) for mesh in shape.iter("mesh")):
                name = mesh.get("filename")
                if name and name not in missing and not _mesh_exists(name, path):
                    missing.add(name)
                    findings.append(Finding(level, location(link), f"{kind} mesh '{name}' is not to be found", hint))
    return findings


def _model_findings(path: Path) -> list[Finding]:
    """What only the loaded model shows."""
    try:
        model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        return [Finding("error", path.name, f"Pinocchio refuses it: {error}")]
    return model_inertia_findings(model)


def _mesh_exists(name: str, urdf: Path) -> bool:
    """Whether a mesh is where Pinocchio would look for it."""
    if name.startswith("file://"):
        return Path(name.removeprefix("file://")).is_file()
    if "://" not in name and Path(name).is_absolute():
        return Path(name).is_file()
    relative = name.split("://", 1)[-1].lstrip("/")
    folders = [*urdf.resolve().parents, *map(Path, filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(":")))]
    return any((folder / relative).is_file() for folder in folders)
