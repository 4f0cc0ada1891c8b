#!/usr/bin/env python3
"""Write `m4.urdf` from one table of dimensions, so that inertias and collision shapes cannot drift apart.

Run `python urdf/generate_m4.py` and `python urdf/generate_meshes.py`, which makes the visual meshes from the same
table, after a change; tests hold the committed files equal to what the scripts write.

Frames: x forward, y left, z up (dorsal), the base frame at the middle of the four hip axes. `side` is +1 on the left
and -1 on the right, `end` is +1 at the front and -1 at the rear. With all joints at zero the legs hang down and the
wheels stand on the ground (ground vehicle). A positive frontal angle raises a leg outboard on either side (the joint
axis is side * x); a positive sagittal angle swings it backwards.

The masses, sizes and joint origins follow the public CAD export of M4. That export lacks battery and electronics, so
the base is made up until the robot weighs the 6.0 kg of the paper (section II).
"""

from __future__ import annotations

import argparse
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class BoxBody:
    """A body with the inertia of a homogeneous box.

    Attributes:
        mass: Mass [kg].
        centre: Centre of mass and of the box in the link frame, +y outboard (mirrored on the right) [m].
        size: Edge lengths along the link's axes [m].
    """

    mass: float
    centre: Vector
    size: Vector

    def inertia(self) -> Vector:
        """Principal moments of inertia (xx, yy, zz) about the centre of mass [kg m2]."""
        x, y, z = self.size
        return (
            self.mass * (y * y + z * z) / 12.0,
            self.mass * (x * x + z * z) / 12.0,
            self.mass * (x * x + y * y) / 12.0,
        )


@dataclass(frozen=True)
class Dimensions:
    """Every length, mass and limit of the robot; +y components are outboard and mirrored on the right side."""

    base = BoxBody(mass=2.450, centre=(0.0, 0.0, -0.03), size=(0.46, 0.12, 0.09))
    hip_frontal = BoxBody(mass=0.135, centre=(0.0, 0.035, 0.0), size=(0.05, 0.08, 0.04))
    hip_sagittal = BoxBody(mass=0.300, centre=(0.0, 0.01, -0.095), size=(0.04, 0.05, 0.16))

    # The wheel is shroud, hub and propeller in one body; its inertia comes from the CAD export.
    wheel_mass: float = 0.4525
    wheel_radius: float = 0.125
    wheel_width: float = 0.06
    wheel_inertia_axial: float = 2.0e-3
    wheel_inertia_transverse: float = 1.05e-3

    # Joint origins in the parent link; the first x is multiplied by `end`, every y by `side`.
    hip_frontal_origin: Vector = (0.2225, 0.0323, 0.0)
    hip_sagittal_origin: Vector = (0.0, 0.0611, -0.0069)
    wheel_origin: Vector = (0.0, 0.046, -0.162)

    hip_frontal_limits: tuple[float, float] = (-0.2, 1.75)
    hip_sagittal_limits: tuple[float, float] = (-1.75, 1.75)
    hip_effort: float = 10.5
    hip_speed: float = 1.57
    wheel_effort: float = 3.0
    wheel_speed: float = 15.0

    # The top cover makes the paper's 0.35 m of height; narrower than the base, so that raised legs clear it.
    cover_top: float = 0.056
    cover_length: float = 0.44
    cover_width: float = 0.10
    skid_offset: float = 0.04  # |y| of the two belly skids
    skid_bottom: float = -0.163  # z of their lower edge
    skid_half_length: float = 0.165
    skid_thickness: float = 0.012
    skid_strut_x: float = 0.12

    imu: Vector = (0.0, 0.0, 0.0)
    battery: Vector = (0.0, 0.0, -0.055)
    electronics: Vector = (0.0, 0.0, 0.0)


COLOURS = {
    "carbon": (0.16, 0.17, 0.19),
    "cover": (0.88, 0.89, 0.90),
    "battery": (0.42, 0.44, 0.48),
    "skid": (0.55, 0.56, 0.58),
    "servo": (0.24, 0.25, 0.28),
    "front": (0.93, 0.42, 0.10),  # orange: the end that is forward for the ground vehicle
    "rear": (0.10, 0.42, 0.72),  # blue: the end whose wheels carry the pendulum
    "tyre": (0.12, 0.12, 0.13),
    "propeller_front": (0.97, 0.92, 0.80),  # light: the propellers that push while it balances
    "propeller_rear": (0.38, 0.40, 0.43),  # dark: those that stand still meanwhile
}


def number(value: float) -> str:
    """A float as short as it can be written; rounding to 15 digits drops the noise of products such as 3 * 0.1."""
    rounded = float(f"{value:.15g}")
    return "0" if rounded == 0.0 else repr(rounded)


def vector(values: tuple[float, ...]) -> str:
    """Numbers separated by blanks, as URDF wants them."""
    return " ".join(number(value) for value in values)


def add_origin(parent: ET.Element, position: Vector, rpy: Vector = (0.0, 0.0, 0.0)) -> None:
    """Append an origin element; angles in rad."""
    # Angles keep every digit: a rounded quarter turn would tilt the thrust.
    ET.SubElement(parent, "origin", xyz=vector(position), rpy=" ".join(f"{angle:.17g}" for angle in rpy))


def add_inertial(link: ET.Element, mass: float, centre: Vector, inertia: Vector) -> None:
    """Append an inertial element with principal axes along the link's axes."""
    inertial = ET.SubElement(link, "inertial")
    add_origin(inertial, centre)
    ET.SubElement(inertial, "mass", value=number(mass))
    xx, yy, zz = (number(moment) for moment in inertia)
    ET.SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)


def add_collision(link: ET.Element, name: str, position: Vector, shape: Vector | tuple[float, float]) -> None:
    """Append a collision shape: a box (three edges) or a cylinder about y (radius, length)."""
    element = ET.SubElement(link, "collision", name=name)
    is_box = len(shape) == 3
    add_origin(element, position, (0.0, 0.0, 0.0) if is_box else (math.pi / 2.0, 0.0, 0.0))
    geometry = ET.SubElement(element, "geometry")
    if is_box:
        ET.SubElement(geometry, "box", size=vector(shape))
    else:
        ET.SubElement(geometry, "cylinder", radius=number(shape[0]), length=number(shape[1]))


def add_mesh(
    link: ET.Element,
    name: str,
    mesh: str,
    colour: str,
    *,
    position: Vector = (0.0, 0.0, 0.0),
    turned: bool = False,
) -> None:
    """Append a coloured visual mesh, turned by half a turn about z for the rear end or the right-hand side."""
    element = ET.SubElement(link, "visual", name=name)
    add_origin(element, position, (0.0, 0.0, math.pi if turned else 0.0))
    # Relative to the URDF, so that a checkout and an installed package both find it.
    ET.SubElement(ET.SubElement(element, "geometry"), "mesh", filename=f"meshes/{mesh}.obj")
    ET.SubElement(element, "material", name=colour)


def add_joint(
    robot: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    position: Vector,
    rpy: Vector = (0.0, 0.0, 0.0),
) -> ET.Element:
    """Append a joint between two links."""
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    add_origin(joint, position, rpy)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def add_frame(robot: ET.Element, name: str, parent: str, position: Vector, rpy: Vector = (0.0, 0.0, 0.0)) -> None:
    """Append a massless frame fixed to a link."""
    ET.SubElement(robot, "link", name=name)
    add_joint(robot, f"{name}_fixed", "fixed", parent, name, position, rpy)


def add_base(robot: ET.Element, size: Dimensions) -> None:
    """Append the base with its cover, its skids and its frames."""
    link = ET.SubElement(robot, "link", name="base")
    add_inertial(link, size.base.mass, size.base.centre, size.base.inertia())
    length, width, height = size.base.size
    base_top = size.base.centre[2] + height / 2.0
    base_bottom = size.base.centre[2] - height / 2.0

    add_collision(link, "base_box_collision", size.base.centre, size.base.size)
    cover = (size.cover_length, size.cover_width, size.cover_top - base_top)
    add_collision(link, "base_cover_collision", (0.0, 0.0, (size.cover_top + base_top) / 2.0), cover)
    for mesh, colour in (("frame", "carbon"), ("battery", "battery"), ("cover", "cover")):
        add_mesh(link, f"base_{mesh}", mesh, colour)
    for end_name in ("front", "rear"):
        add_mesh(link, f"base_band_{end_name}", "end_band", end_name, turned=end_name == "rear")

    for side, side_name in ((1, "left"), (-1, "right")):
        y = side * size.skid_offset
        rail = (2.0 * size.skid_half_length, size.skid_thickness, size.skid_thickness)
        rail_centre = (0.0, y, size.skid_bottom + size.skid_thickness / 2.0)
        add_collision(link, f"skid_{side_name}_rail_collision", rail_centre, rail)
        rail_top = size.skid_bottom + size.skid_thickness
        strut = (size.skid_thickness, size.skid_thickness, base_bottom - rail_top)
        for end, end_name in ((1, "front"), (-1, "rear")):
            strut_centre = (end * size.skid_strut_x, y, (base_bottom + rail_top) / 2.0)
            add_collision(link, f"skid_{side_name}_{end_name}_strut_collision", strut_centre, strut)
        add_mesh(link, f"skid_{side_name}", "skid", "skid", position=(0.0, y, 0.0))

    for end, end_name in ((1, "front"), (-1, "rear")):
        for side, side_name in ((1, "left"), (-1, "right")):
            tip = (end * size.skid_half_length, side * size.skid_offset, size.skid_bottom)
            add_frame(robot, f"skid_{end_name}_{side_name}", "base", tip)
            for level, (x, y, z) in (
                ("top", (cover[0] / 2.0, cover[1] / 2.0, size.cover_top)),
                ("bottom", (length / 2.0, width / 2.0, base_bottom)),
            ):
                corner = (end * x, side * y, z)
                add_frame(robot, f"base_corner_{end_name}_{side_name}_{level}", "base", corner)
    add_frame(robot, "imu", "base", size.imu)
    add_frame(robot, "battery", "base", size.battery)
    add_frame(robot, "electronics", "base", size.electronics)


def add_leg(robot: ET.Element, size: Dimensions, end: int, side: int) -> None:
    """Append one leg: two hip links, the wheel, and the thruster's frame, which does not spin with the wheel."""
    end_name = "front" if end > 0 else "rear"
    leg = f"{end_name}_{'left' if side > 0 else 'right'}"

    def mirrored(point: Vector) -> Vector:
        return (point[0], side * point[1], point[2])

    def add_hip(
        name: str,
        body: BoxBody,
        parent: str,
        origin: Vector,
        axis: Vector,
        limits: tuple[float, float],
        meshes: tuple[tuple[str, str], ...],
    ) -> str:
        link_name = f"{leg}_{name}_link"
        link = ET.SubElement(robot, "link", name=link_name)
        add_inertial(link, body.mass, mirrored(body.centre), body.inertia())
        add_collision(link, f"{leg}_{name}_collision", mirrored(body.centre), body.size)
        for mesh, colour in meshes:
            add_mesh(link, f"{leg}_{mesh}", mesh, colour, turned=side < 0)
        joint = add_joint(robot, f"{leg}_{name}", "revolute", parent, link_name, origin)
        ET.SubElement(joint, "axis", xyz=vector(axis))
        lower, upper = (number(limit) for limit in limits)
        ET.SubElement(
            joint, "limit", lower=lower, upper=upper, effort=number(size.hip_effort), velocity=number(size.hip_speed)
        )
        return link_name

    hip_x, hip_y, hip_z = size.hip_frontal_origin
    frontal = add_hip(
        "hip_frontal",
        size.hip_frontal,
        "base",
        (end * hip_x, side * hip_y, hip_z),
        (float(side), 0.0, 0.0),
        size.hip_frontal_limits,
        (("frontal_bracket", end_name), ("frontal_servo", "servo")),
    )
    sagittal = add_hip(
        "hip_sagittal",
        size.hip_sagittal,
        frontal,
        mirrored(size.hip_sagittal_origin),
        (0.0, 1.0, 0.0),
        size.hip_sagittal_limits,
        (("sagittal_leg", end_name), ("sagittal_servo", "servo")),
    )

    wheel_name = f"{leg}_wheel_link"
    wheel = ET.SubElement(robot, "link", name=wheel_name)
    moments = (size.wheel_inertia_transverse, size.wheel_inertia_axial, size.wheel_inertia_transverse)
    add_inertial(wheel, size.wheel_mass, (0.0, 0.0, 0.0), moments)
    for mesh, colour in (("tyre", "tyre"), ("shroud", end_name), ("propeller", f"propeller_{end_name}")):
        add_mesh(wheel, f"{leg}_{mesh}", mesh, colour, turned=side < 0)
    add_collision(wheel, f"{leg}_wheel_collision", (0.0, 0.0, 0.0), (size.wheel_radius, size.wheel_width))
    joint = add_joint(robot, f"{leg}_wheel", "continuous", sagittal, wheel_name, mirrored(size.wheel_origin))
    ET.SubElement(joint, "axis", xyz="0 1 0")
    ET.SubElement(joint, "limit", effort=number(size.wheel_effort), velocity=number(size.wheel_speed))

    # Thrust acts along the frame's z axis, which points along the leg's outboard axis (side * y): with the leg raised
    # by 90 deg it points along the base's +z on either side.
    thrust_frame_rpy = (-side * math.pi / 2.0, 0.0, 0.0)
    add_frame(robot, f"{leg}_thruster", sagittal, mirrored(size.wheel_origin), thrust_frame_rpy)


def build(size: Dimensions | None = None) -> str:
    """The URDF as text.

    Args:
        size: The robot's dimensions; None takes the defaults.

    Returns:
        The whole file.
    """
    size = size or Dimensions()
    robot = ET.Element("robot", name="m4")
    # MuJoCo drops the folder of a mesh unless told otherwise; other readers pass this element over.
    ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler", strippath="false")
    for name, rgb in COLOURS.items():
        material = ET.SubElement(robot, "material", name=name)
        ET.SubElement(material, "color", rgba=vector((*rgb, 1.0)))
    add_base(robot, size)
    for end in (1, -1):
        for side in (1, -1):
            add_leg(robot, size, end, side)
    ET.indent(robot)
    note = "<!-- Written by generate_m4.py from its table of dimensions; change the table, not this file. -->"
    return f'<?xml version="1.0" encoding="utf-8"?>\n{note}\n{ET.tostring(robot, encoding="unicode")}\n'


def main() -> None:
    """Write the URDF beside this script, or where `--output` says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("m4.urdf"))
    path = parser.parse_args().output
    path.write_text(build(), encoding="utf-8")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
