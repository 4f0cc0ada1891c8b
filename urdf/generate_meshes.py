#!/usr/bin/env python3
"""Write M4's visual meshes from the dimensions that also give its collision shapes and inertias.

Run `python urdf/generate_meshes.py` after a change of `generate_m4.py`'s table; a test holds the committed files equal
to this script's output. A mesh stands in the frame of its link on the left-hand side, or at the front end; the
right-hand side and the rear end turn the same mesh by half a turn about z, so every mesh is symmetric enough for that.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from generate_m4 import Dimensions
from mesh_shapes import (
    Mesh,
    Vector,
    around,
    bar,
    box,
    disc,
    joined,
    loft,
    plate,
    revolved,
    rounded_rectangle,
    tube,
    two_circles,
)

_PLATE = 0.003  # [m] thickness of carbon plates
_ROUND = 48  # corners of large circles


def frame(size: Dimensions) -> Mesh:
    """The base's frame: two carbon plates, a truss on either side, bulkheads at the ends."""
    length, width, height = size.base.size
    low, high = size.base.centre[2] - height / 2.0, size.base.centre[2] + height / 2.0
    outline = rounded_rectangle(length, width, 0.018)
    parts = [plate(outline, low, low + _PLATE, 2), plate(outline, high - _PLATE, high, 2)]
    inner_low, inner_high = low + _PLATE, high - _PLATE
    bays = 6
    reach = length / 2.0 - 0.022
    for side in (1.0, -1.0):
        y = side * (width / 2.0 - 0.004)
        places = [-reach + 2.0 * reach * index / bays for index in range(bays + 1)]
        for index, x in enumerate(places):
            if index in (0, bays):
                parts.append(bar((x, y, inner_low), (x, y, inner_high), 0.012, 0.006, (1.0, 0.0, 0.0)))
            if index < bays:
                rises = index % 2 == 0
                ends = (inner_low, inner_high) if rises else (inner_high, inner_low)
                parts.append(bar((x, y, ends[0]), (places[index + 1], y, ends[1]), 0.009, 0.005, (0.0, 0.0, 1.0)))
    for end in (1.0, -1.0):
        x = end * (length / 2.0 - 0.014)
        parts.append(box((0.012, 0.5 * width, height - 2.0 * _PLATE), (x, 0.0, size.base.centre[2])))
    return joined(*parts)


def battery(size: Dimensions) -> Mesh:
    """The battery on the lower plate, with its two straps."""
    low = size.base.centre[2] - size.base.size[2] / 2.0 + _PLATE
    cell = (0.170, 0.076, 2.0 * (size.battery[2] - low))
    centre = (size.battery[0], size.battery[1], size.battery[2])
    body = plate(rounded_rectangle(cell[0], cell[1], 0.006, 2), low, low + cell[2], 2)
    straps = [
        box((0.018, cell[1] + 0.003, cell[2] + 0.003), (centre[0] + x, centre[1], low + cell[2] / 2.0))
        for x in (-0.045, 0.045)
    ]
    return joined(body.moved((centre[0], centre[1], 0.0)), *straps)


def cover(size: Dimensions) -> Mesh:
    """The shell over the electronics: flanks that lean in, edges cut off."""
    base_top = size.base.centre[2] + size.base.size[2] / 2.0
    height = size.cover_top - base_top

    def section(x: float, share: float) -> list[Vector]:
        half, top = size.cover_width / 2.0, base_top + share * height
        return [
            (x, -half, base_top),
            (x, half, base_top),
            (x, half, base_top + 0.35 * share * height),
            (x, half - 0.016, top),
            (x, -half + 0.016, top),
            (x, -half, base_top + 0.35 * share * height),
        ]

    reach = size.cover_length / 2.0
    return loft([section(-reach, 0.45), section(-reach + 0.05, 1.0), section(reach - 0.05, 1.0), section(reach, 0.45)])


def end_band(size: Dimensions) -> Mesh:
    """A coloured band around the cover's front end, and its bumper; the rear end turns it by half a turn."""
    base_top = size.base.centre[2] + size.base.size[2] / 2.0
    height = size.cover_top - base_top
    proud = 0.0012

    def section(x: float) -> list[Vector]:
        half, top = size.cover_width / 2.0 + proud, base_top + height + proud
        return [
            (x, -half, base_top),
            (x, half, base_top),
            (x, half, base_top + 0.35 * height + 0.4 * proud),
            (x, half - 0.016, top),
            (x, -half + 0.016, top),
            (x, -half, base_top + 0.35 * height + 0.4 * proud),
        ]

    reach = size.cover_length / 2.0 - 0.05
    band = loft([section(reach - 0.034), section(reach - 0.002)])
    length, width, depth = size.base.size
    middle = size.base.centre[2]
    bumper = plate(rounded_rectangle(0.72 * width, 0.5 * depth, 0.010), length / 2.0 - 0.009, length / 2.0, 0)
    return joined(band, bumper.moved((0.0, 0.0, middle)))


def skid(size: Dimensions) -> Mesh:
    """One landing skid in the plane y = 0: a tube with raised ends on two struts."""
    radius = size.skid_thickness / 2.0
    low, reach = size.skid_bottom + radius, size.skid_half_length - radius
    base_bottom = size.base.centre[2] - size.base.size[2] / 2.0
    rail = tube([(-reach, 0.0, low), (reach, 0.0, low)], radius)
    feet = [disc(radius, -0.5 * radius, 0.5 * radius, 0, 8).moved((end * reach, 0.0, low)) for end in (1.0, -1.0)]
    caps = [box((2.0 * radius, 1.6 * radius, 1.6 * radius), (end * reach, 0.0, low)) for end in (1.0, -1.0)]
    struts = [
        tube([(end * size.skid_strut_x, 0.0, low), (end * size.skid_strut_x, 0.0, base_bottom)], 0.7 * radius)
        for end in (1.0, -1.0)
    ]
    brace = tube([(-size.skid_strut_x, 0.0, low + 0.055), (size.skid_strut_x, 0.0, low + 0.055)], 0.45 * radius, 6)
    return joined(rail, *feet, *caps, *struts, brace)


def frontal_bracket(size: Dimensions) -> Mesh:
    """The first hip link: a fork from the frontal axis at the base out to the sagittal axis."""
    length, width, height = size.hip_frontal.size
    outer = size.hip_frontal.centre[1] + width / 2.0
    inner = size.hip_frontal.centre[1] - width / 2.0
    cheeks = [
        plate(
            [(inner + 0.006, -height / 2), (outer - 0.008, -height / 2), (outer, -0.3 * height), (outer, 0.3 * height),
             (outer - 0.008, height / 2), (inner + 0.006, height / 2), (inner, 0.3 * height), (inner, -0.3 * height)],
            x - 0.0025, x + 0.0025, 0,
        )
        for x in (-(length / 2.0 - 0.0025), length / 2.0 - 0.0025)
    ]  # fmt: skip
    web = box((length - 0.006, 0.006, 0.8 * height), (0.0, outer - 0.004, 0.0))
    _, y, z = size.hip_sagittal_origin
    boss = disc(0.0185, y - 0.012, outer + 0.004, 1, 28).moved((0.0, 0.0, z))
    return joined(*cheeks, web, boss)


def frontal_servo(size: Dimensions) -> Mesh:
    """The servo inside the first hip link, with its discs on the frontal axis."""
    length, width, height = size.hip_frontal.size
    x, y, z = size.hip_frontal.centre
    body = box((length - 0.012, 0.6 * width, 0.86 * height), (x, y - 0.004, z))
    horns = [
        disc(0.013, *sorted((end * (length / 2.0 - 0.001), end * (length / 2.0 + 0.004))), 0) for end in (1.0, -1.0)
    ]
    return joined(body, *horns)


def sagittal_leg(size: Dimensions) -> Mesh:
    """The second hip link: two tapered carbon plates from the hip to the wheel's axle, with spacers."""
    width = size.hip_sagittal.size[1]
    inner = size.hip_sagittal.centre[1] - width / 2.0
    outer = size.wheel_origin[1] - size.wheel_width / 2.0 - 0.002  # the wheel turns just outside
    outline = two_circles((0.0, 0.0195), (size.wheel_origin[2], 0.0130))
    # `plate` along y takes (z, x): the outline is symmetric, so exchanging its axes needs no more than its reversal.
    turned = [(up, across) for across, up in reversed(outline)]
    plates = [plate(turned, low, low + _PLATE, 1) for low in (inner, outer - _PLATE)]
    spacers = [
        disc(0.0035, inner + _PLATE, outer - _PLATE, 1, 8).moved((x, 0.0, share * size.wheel_origin[2]))
        for share, x in ((0.42, 0.011), (0.42, -0.011), (0.7, 0.009), (0.7, -0.009))
    ]
    return joined(*plates, *spacers)


def sagittal_servo(size: Dimensions) -> Mesh:
    """Between the plates of the second hip link: the servo at the hip, the wheel's motor at the axle, and the axle."""
    inner = size.hip_sagittal.centre[1] - size.hip_sagittal.size[1] / 2.0
    _, wheel_y, wheel_z = size.wheel_origin
    outer = wheel_y - size.wheel_width / 2.0 - 0.002
    servo = box((0.030, outer - inner - 2.0 * _PLATE, 0.044), (0.0, (outer + inner) / 2.0, -0.030))
    horn = disc(0.0125, inner - 0.003, outer + 0.003, 1)
    motor = disc(0.0165, inner + 0.004, outer - 0.001, 1, 24).moved((0.0, 0.0, wheel_z))
    axle = disc(0.0055, outer - 0.002, wheel_y, 1, 12).moved((0.0, 0.0, wheel_z))
    return joined(servo, horn, motor, axle)


def tyre(size: Dimensions) -> Mesh:
    """The tyre around the shroud, with two staggered rows of lugs that let the eye see it turn."""
    radius, half = size.wheel_radius, size.wheel_width / 2.0
    carcass = revolved(
        [(radius - 0.0115, -half + 0.003), (radius - 0.006, -half), (radius - 0.0025, -half + 0.006),
         (radius - 0.0025, half - 0.006), (radius - 0.006, half), (radius - 0.0115, half - 0.003)],
        _ROUND,
    )  # fmt: skip
    lugs, count = [], 24

    def lug(low: float, high: float) -> Mesh:
        sections = []
        for step in range(3):
            angle = (step - 1) * 0.29 * math.pi / count * 2.0
            ring = [(radius - 0.004, low), (radius, low), (radius, high), (radius - 0.004, high)]
            sections.append([(r * math.sin(angle), y, r * math.cos(angle)) for r, y in ring])
        return loft(sections[::-1])

    lugs.append(around(lug(-half + 0.004, -0.002), 1, count))
    lugs.append(around(lug(0.002, half - 0.004), 1, count, math.pi / count))
    return joined(carcass, *lugs)


def shroud(size: Dimensions) -> Mesh:
    """The duct around the propeller, its hub, and five spokes on the inboard side."""
    radius, half = size.wheel_radius - 0.011, size.wheel_width / 2.0
    duct = revolved(
        [(radius - 0.0060, -half + 0.004), (radius, -half + 0.002), (radius, half - 0.002),
         (radius - 0.0060, half - 0.001), (radius - 0.0105, half - 0.008), (radius - 0.0080, 0.0)],
        _ROUND,
    )  # fmt: skip
    hub = disc(0.0200, -half + 0.004, -half + 0.024, 1, 24)
    y = -half + 0.010
    spoke = bar((0.0, y, 0.016), (0.0, y - 0.002, radius - 0.004), 0.014, 0.007, (1.0, 0.0, 0.0))
    return joined(duct, hub, around(spoke, 1, 5))


def propeller(size: Dimensions) -> Mesh:
    """Three twisted blades and a spinner on the outboard side of the spokes."""
    tip, plane = size.wheel_radius - 0.025, 0.010
    blade = []
    stations = ((0.08, 0.012, 52.0), (0.20, 0.020, 40.0), (0.40, 0.026, 28.0), (0.65, 0.024, 19.0), (0.88, 0.017, 14.0),
                (1.0, 0.007, 12.0))  # fmt: skip
    for share, chord, pitch in stations:
        angle = math.radians(pitch)
        section = [(-0.42, -0.02), (0.0, -0.05), (0.58, 0.0), (0.3, 0.07), (-0.2, 0.08)]
        ring = []
        for along, up in section:
            x, y = chord * along, chord * up
            ring.append((x * math.cos(angle) - y * math.sin(angle), plane + x * math.sin(angle) + y * math.cos(angle),
                         share * tip))  # fmt: skip
        blade.append(ring)
    half = size.wheel_width / 2.0
    shaft = disc(0.0085, -half + 0.020, plane + 0.004, 1, 16)
    angles = [2.0 * math.pi * step / 20 for step in range(20)]
    nose = loft(
        [
            [(r * math.sin(angle), y, r * math.cos(angle)) for angle in angles]
            for r, y in (
                (0.0150, plane - 0.006),
                (0.0150, plane + 0.003),
                (0.0115, plane + 0.009),
                (0.005, plane + 0.013),
            )
        ]
    )
    return joined(around(loft(blade), 1, 3), shaft, nose)


#: Name of the file, without its ending -> the function that makes it.
PARTS = {
    "frame": frame,
    "battery": battery,
    "cover": cover,
    "end_band": end_band,
    "skid": skid,
    "frontal_bracket": frontal_bracket,
    "frontal_servo": frontal_servo,
    "sagittal_leg": sagittal_leg,
    "sagittal_servo": sagittal_servo,
    "tyre": tyre,
    "shroud": shroud,
    "propeller": propeller,
}


def main() -> None:
    """Write the meshes into the folder beside this script, or where `--output` says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("meshes"), metavar="DIR")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    size = Dimensions()
    for name, make in PARTS.items():
        text = make(size).obj(f"{name} of M4, written by generate_meshes.py; lengths in m")
        (folder / f"{name}.obj").write_text(text, encoding="utf-8", newline="\n")
    print(f"wrote {len(PARTS)} meshes into {folder}")


if __name__ == "__main__":
    main()
