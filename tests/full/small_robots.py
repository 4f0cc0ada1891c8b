"""Robots small enough for closed forms, written as URDF and TOML and read back through `load_robot`."""

from __future__ import annotations

import itertools
from pathlib import Path

from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot

DISC_RADIUS = 0.15
DISC_MASS = 2.0
BLOCK_HALF_SIZE = (0.2, 0.15, 0.03)
BLOCK_MASS = 3.0


def _link(name: str, mass: float, ixx: float, iyy: float, izz: float) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="{mass!r}"/>'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _load(folder: Path, name: str, links_and_joints: str, table: str) -> Robot:
    (folder / f"{name}.urdf").write_text(f'<robot name="{name}">{links_and_joints}</robot>', encoding="utf-8")
    description = folder / f"{name}.toml"
    description.write_text(f'[robot]\nname = "{name}"\nurdf = "{name}.urdf"\n{table}', encoding="utf-8")
    return load_robot(description)


def rolling_disc(folder: Path, *, friction_static: float, dynamic_fraction: float = 0.8) -> Robot:
    """Two wheels on a light bar that together have the mass and axial inertia of one uniform disc.

    The joints are frictionless, so the bar does not turn and only its mass counts: with m the total mass, the wheels'
    axial inertia is m r^2 / 2.
    """
    bar = 0.01
    wheel = 0.5 * (DISC_MASS - bar)
    axial = 0.25 * DISC_MASS * DISC_RADIUS**2
    parts = [_link("bar", bar, 1e-4, 1e-4, 1e-4)]
    for name, y in (("left", 0.1), ("right", -0.1)):
        parts.append(_link(name, wheel, 0.6 * axial, axial, 0.6 * axial))
        parts.append(
            f'<joint name="{name}_axle" type="continuous"><parent link="bar"/><child link="{name}"/>'
            f'<origin xyz="0 {y} 0"/><axis xyz="0 1 0"/></joint>'
        )
    table = f"""
[wheels]
joints = ["left_axle", "right_axle"]
radius = {DISC_RADIUS}
[ground]
friction_static = {friction_static}
friction_dynamic_fraction = {dynamic_fraction}
"""
    return _load(folder, "rolling_disc", "".join(parts), table)


def block(folder: Path, *, friction_static: float = 0.5, dynamic_fraction: float = 0.8) -> Robot:
    """A uniform box with a contact point at each of its eight corners, and nothing else."""
    a, b, c = BLOCK_HALF_SIZE
    third = BLOCK_MASS / 3.0
    parts = [_link("box", BLOCK_MASS, third * (b * b + c * c), third * (a * a + c * c), third * (a * a + b * b))]
    names = []
    for index, (x, y, z) in enumerate(itertools.product((-a, a), (-b, b), (-c, c))):
        names.append(f"corner_{index}")
        parts.append(
            f'<link name="{names[-1]}"/><joint name="fix_{index}" type="fixed"><parent link="box"/>'
            f'<child link="{names[-1]}"/><origin xyz="{x} {y} {z}"/></joint>'
        )
    table = f"""
[contact]
points = {names!r}
[ground]
friction_static = {friction_static}
friction_dynamic_fraction = {dynamic_fraction}
"""
    return _load(folder, "block", "".join(parts), table.replace("'", '"'))
