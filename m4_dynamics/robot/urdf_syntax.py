"""Check every element of a URDF on its own: tags, attributes, numbers, joint types and limits.

A reader that refuses a URDF seldom says where. Each link and each joint is therefore handed to yourdfpy alone, so that
its complaint belongs to one element; what it passes over or stumbles on (missing tags, numbers that are none) is
checked on the XML before.
"""

from __future__ import annotations

import io
import logging
import math
from typing import Any, TypeAlias

from lxml import etree

from m4_dynamics.robot.finding import Finding

__all__ = ["Element", "element_findings", "end_of_joint", "location", "numbers_of", "part_findings"]

#: An element of the parsed file; lxml has no public name for its type.
Element: TypeAlias = Any

#: Tag -> attribute -> (how many numbers it holds, whether it must be there).
_NUMERIC: dict[str, dict[str, tuple[int, bool]]] = {
    "origin": {"xyz": (3, False), "rpy": (3, False)},
    "axis": {"xyz": (3, True)},
    "mass": {"value": (1, True)},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), (1, True)),
    "limit": {"lower": (1, False), "upper": (1, False), "effort": (1, True), "velocity": (1, True)},
    "dynamics": {"damping": (1, False), "friction": (1, False)},
    "mimic": {"multiplier": (1, False), "offset": (1, False)},
    "box": {"size": (3, True)},
    "cylinder": {"radius": (1, True), "length": (1, True)},
    "sphere": {"radius": (1, True)},
    "mesh": {"scale": (3, False)},
}

#: Tag -> attributes that must hold text.
_TEXT: dict[str, tuple[str, ...]] = {
    "link": ("name",),
    "joint": ("name", "type"),
    "parent": ("link",),
    "child": ("link",),
    "mesh": ("filename",),
    "mimic": ("joint",),
}

#: Tag -> children that must be there.
_CHILDREN: dict[str, tuple[str, ...]] = {
    "joint": ("parent", "child"),
    "inertial": ("mass", "inertia"),
    "visual": ("geometry",),
    "collision": ("geometry",),
}

_SHAPES = ("box", "cylinder", "sphere", "mesh")


def location(element: Element) -> str:
    """The element in words: its tag, its name and its line."""
    name = element.get("name")
    called = f"{element.tag} '{name}'" if name else f"{element.tag} without a name"
    return f"{called} (line {element.sourceline})"


def end_of_joint(joint: Element, tag: str) -> str | None:
    """Name of the link at one end of a joint ("parent" or "child"), or None if it is not given."""
    end = joint.find(tag)
    return None if end is None else end.get("link")


def numbers_of(text: str | None) -> list[float] | None:
    """The finite numbers in an attribute, or None if it holds anything else."""
    try:
        numbers = [float(word) for word in (text or "").split()]
    except ValueError:
        return None
    return numbers if numbers and all(map(math.isfinite, numbers)) else None


def element_findings(element: Element) -> list[Finding]:
    """Check one link or joint by itself.

    Args:
        element: The link's or the joint's element.

    Returns:
        What is wrong with it.
    """
    where = location(element)
    findings = []
    for part in element.iter(etree.Element):
        findings += part_findings(part, where)
    # Where tags or numbers are missing, yourdfpy stops at the first of them without a place: it has nothing to add.
    return findings or _yourdfpy_findings(element, where)


def part_findings(part: Element, where: str) -> list[Finding]:
    """Check one tag's attributes and children.

    Args:
        part: The tag.
        where: The link or joint that it belongs to, for the findings.

    Returns:
        What is missing or malformed in it.
    """
    tag = part.tag
    findings = []
    for name in _TEXT.get(tag, ()):
        if not part.get(name):
            findings.append(Finding("error", where, f"<{tag}> has no attribute '{name}'", f'add {name}="..."'))
    for name, (count, required) in _NUMERIC.get(tag, {}).items():
        text = part.get(name)
        if text is None:
            if required:
                hint = f'add {name}="..."'
                findings.append(Finding("error", where, f"<{tag}> has no attribute '{name}'", hint))
            continue
        numbers = numbers_of(text)
        allowed = (1, count) if tag == "mesh" else (count,)
        if numbers is None or len(numbers) not in allowed:
            wanted = "one finite number" if count == 1 else f"{count} finite numbers"
            findings.append(Finding("error", where, f'<{tag}> {name}="{text}" is not {wanted}', f"give {wanted}"))
    for child in _CHILDREN.get(tag, ()):
        if part.find(child) is None:
            findings.append(Finding("error", where, f"<{tag}> has no <{child}>", f"add <{child} .../>"))
    if tag == "geometry":
        findings += _shape_findings(part, where)
    return findings


def _shape_findings(geometry: Element, where: str) -> list[Finding]:
    shapes = [part for part in geometry if part.tag in _SHAPES]
    if len(shapes) != 1:
        shape_list = ", ".join(f"<{shape}>" for shape in _SHAPES)
        return [Finding("error", where, f"<geometry> holds {len(shapes)} shapes", f"give exactly one of {shape_list}")]
    findings = []
    for name in ("size", "radius", "length"):
        numbers = numbers_of(shapes[0].get(name))
        if numbers is not None and min(numbers) <= 0.0:
            what = f'<{shapes[0].tag}> {name}="{shapes[0].get(name)}" is not positive'
            findings.append(Finding("error", where, what, "give lengths above 0"))
    return findings


def _yourdfpy_findings(element: Element, where: str) -> list[Finding]:
    import yourdfpy  # takes a second to import, and only a diagnosis needs it

    alone = b'<robot name="one">' + etree.tostring(element, with_tail=False) + b"</robot>"
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    try:
        urdf = yourdfpy.URDF.load(io.BytesIO(alone), build_scene_graph=False, load_meshes=False)
        urdf.validate()
    except Exception as error:  # yourdfpy raises whatever its parser stumbled on: KeyError, AttributeError, ...
        return [Finding("error", where, f"cannot be read ({type(error).__name__}: {error})")]
    return [_translated(error.msg, where, element) for error in urdf.errors]


def _translated(complaint: str, where: str, element: Element) -> Finding:
    """yourdfpy's complaint in this package's words, with what Pinocchio would make of it."""
    kind = element.get("type")
    if "'type'" in complaint:
        valid = "revolute, continuous, prismatic, fixed, floating, planar"
        return Finding("error", where, f"unknown joint type '{kind}'", f"valid: {valid}")
    if "<limit> of a" in complaint:
        hint = 'add <limit lower="..." upper="..." effort="..." velocity="..."/>, or make the joint continuous'
        return Finding("error", where, f"a {kind} joint needs a <limit>", hint)
    for name in ("lower", "upper"):
        if f"'{name}'" in complaint:
            hint = f'add {name}="...", or make the joint continuous'
            return Finding("warning", where, f"<limit> has no attribute '{name}', which then counts as 0", hint)
    return Finding("error", where, complaint)
