"""Triangle meshes of simple solids, for `generate_meshes.py`: plates, bars, tubes, bodies of revolution, blades."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles, counter-clockwise seen from outside.

    Attributes:
        vertices: Points, shape (n, 3) [m].
        triangles: Indices of points, shape (m, 3).
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]

    def moved(self, offset: Sequence[float]) -> Mesh:
        """The mesh, shifted [m]."""
        return Mesh(self.vertices + np.asarray(offset, dtype=float), self.triangles)

    def turned(self, axis: int, angle: float) -> Mesh:
        """The mesh, turned about a coordinate axis through the origin [rad]."""
        first, second = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = math.cos(angle), math.sin(angle)
        vertices = self.vertices.copy()
        vertices[:, first] = cosine * self.vertices[:, first] - sine * self.vertices[:, second]
        vertices[:, second] = sine * self.vertices[:, first] + cosine * self.vertices[:, second]
        return Mesh(vertices, self.triangles)

    def obj(self, note: str) -> str:
        """The mesh as a Wavefront OBJ file, to a hundredth of a millimetre."""
        lines = [f"# {note}"]
        lines += [f"v {_short(x)} {_short(y)} {_short(z)}" for x, y, z in self.vertices.tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in self.triangles.tolist()]
        return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    """A coordinate without superfluous digits; the first rounding keeps noise from deciding the second."""
    text = f"{round(value, 9):.5f}".rstrip("0")
    text = f"{text}0" if text.endswith(".") else text  # some readers want a digit on either side of the point
    return "0.0" if text == "-0.0" else text


def joined(*parts: Mesh) -> Mesh:
    """One mesh of several."""
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + offset for part, offset in zip(parts, offsets, strict=True)]
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(triangles))


def around(part: Mesh, axis: int, count: int, phase: float = 0.0) -> Mesh:
    """Copies of a mesh, evenly spaced about a coordinate axis."""
    return joined(*(part.turned(axis, phase + 2.0 * math.pi * index / count) for index in range(count)))


def loft(sections: ArrayLike, *, closed: bool = False) -> Mesh:
    """A skin over convex sections that follow each other.

    Args:
        sections: Rings of corners, shape (sections, corners, 3) [m]; seen against the direction in which the sections
            follow each other, the corners run counter-clockwise.
        closed: The last section joins the first; otherwise the ends are covered.

    Returns:
        The mesh.
    """
    rings = np.asarray(sections, dtype=float)
    count, corners = rings.shape[:2]
    triangles: list[tuple[int, int, int]] = []
    for ring in range(count if closed else count - 1):
        here, there = ring * corners, (ring + 1) % count * corners
        for corner in range(corners):
            after = (corner + 1) % corners
            triangles.append((here + corner, here + after, there + after))
            triangles.append((here + corner, there + after, there + corner))
    if not closed:
        last = (count - 1) * corners
        triangles += [(0, corner + 1, corner) for corner in range(1, corners - 1)]
        triangles += [(last, last + corner, last + corner + 1) for corner in range(1, corners - 1)]
    return Mesh(rings.reshape(-1, 3), np.array(triangles))


def box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """A box; edge lengths and centre [m]."""
    x, y, z = (0.5 * float(length) for length in size)
    ring = [(-x, -y), (x, -y), (x, y), (-x, y)]
    return loft([[(*corner, height) for corner in ring] for height in (-z, z)]).moved(centre)


def plate(outline: Sequence[tuple[float, float]], low: float, high: float, axis: int) -> Mesh:
    """A convex outline, extruded along a coordinate axis.

    Args:
        outline: Corners along the two axes that follow the extrusion's axis in x, y, z, x, ..., counter-clockwise [m].
        low: Start of the extrusion [m].
        high: Its end [m].
        axis: 0, 1 or 2.

    Returns:
        The mesh.
    """
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rings = np.empty((2, len(outline), 3))
    for ring, level in zip(rings, (low, high), strict=True):
        ring[:, axis] = level
        ring[:, first], ring[:, second] = np.transpose(outline)
    return loft(rings)


def rounded_rectangle(width: float, height: float, radius: float, steps: int = 4) -> list[tuple[float, float]]:
    """A rectangle about the origin with round corners, counter-clockwise [m]."""
    outline = []
    for quarter, (sign_x, sign_y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        centre = sign_x * (0.5 * width - radius), sign_y * (0.5 * height - radius)
        for step in range(steps + 1):
            angle = (quarter + step / steps) * 0.5 * math.pi
            outline.append((centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)))
    return outline


def two_circles(first: tuple[float, float], second: tuple[float, float], steps: int = 8) -> list[tuple[float, float]]:
    """The convex hull of two circles on the vertical axis, counter-clockwise.

    Args:
        first: Height of the upper circle's centre, and its radius [m].
        second: Those of the lower circle.
        steps: Corners of a quarter circle.

    Returns:
        Corners (across, up) [m].
    """
    # Common tangents touch both circles under this angle above the horizontal.
    lean = math.asin((first[1] - second[1]) / (first[0] - second[0]))
    outline = []
    for (height, radius), start, end in ((first, -lean, math.pi + lean), (second, math.pi + lean, 2 * math.pi - lean)):
        for step in range(2 * steps + 1):
            angle = start + (end - start) * step / (2 * steps)
            outline.append((radius * math.cos(angle), height + radius * math.sin(angle)))
    return outline


def revolved(profile: Sequence[tuple[float, float]], segments: int, axis: int = 1) -> Mesh:
    """A ring: a closed outline turned about a coordinate axis.

    Args:
        profile: Corners (radius, along the axis), counter-clockwise with the radius to the right [m].
        segments: Corners around.
        axis: 0, 1 or 2.

    Returns:
        The mesh.
    """
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rings = np.empty((segments, len(profile), 3))
    for step, ring in enumerate(rings):
        angle = 2.0 * math.pi * step / segments
        for corner, (radius, along) in enumerate(profile):
            ring[corner, axis] = along
            ring[corner, first], ring[corner, second] = radius * math.cos(angle), radius * math.sin(angle)
    return loft(rings[::-1], closed=True)


def disc(radius: float, low: float, high: float, axis: int, segments: int = 20) -> Mesh:
    """A cylinder about a coordinate axis [m]."""
    angles = [2.0 * math.pi * step / segments for step in range(segments)]
    return plate([(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles], low, high, axis)


def bar(start: Vector, end: Vector, width: float, thickness: float, across: Vector) -> Mesh:
    """A bar of rectangular section between two points.

    Args:
        start: Middle of one end [m].
        end: Middle of the other [m].
        width: Along `across` [m].
        thickness: Along the third direction [m].
        across: Roughly the direction of the width.

    Returns:
        The mesh.
    """
    first, last = np.array(start), np.array(end)
    along = (last - first) / np.linalg.norm(last - first)
    side = np.array(across) - (np.array(across) @ along) * along
    side *= 0.5 * width / np.linalg.norm(side)
    up = np.cross(along, side)
    up *= 0.5 * thickness / np.linalg.norm(up)
    ring = np.array([-side - up, side - up, side + up, -side + up])
    return loft([first + ring, last + ring])


def tube(path: Sequence[Vector], radius: float, segments: int = 8) -> Mesh:
    """A round tube in the x-z plane along a path [m]."""
    points = np.array(path)
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    tangents = np.vstack([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sections = []
    for point, tangent in zip(points, tangents, strict=True):
        side = np.array([0.0, 1.0, 0.0])
        up = np.cross(tangent, side)
        angles = [2.0 * math.pi * (step + 0.5) / segments for step in range(segments)]
        sections.append([point + radius * (math.cos(angle) * side + math.sin(angle) * up) for angle in angles])
    return loft(sections)
