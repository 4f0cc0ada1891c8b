"""Objects and commands of meshcat's viewer, which is three.js in the browser, as plain dictionaries.

A command does not know where it goes: packed into bytes, the same one is embedded in a page or sent to a live viewer.
Lengths are in metres, z is up; three.js builds cylinders, cones and lathes about its y axis, so those builders turn
them onto z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Command",
    "Material",
    "Shape",
    "box",
    "capsule",
    "cone",
    "cylinder",
    "ellipsoid",
    "funnel",
    "mesh",
    "pack",
    "pack_in_parts",
    "ring",
    "ring_about_z",
    "set_light",
    "set_object",
    "set_property",
    "set_transform",
    "sphere",
    "typed_array",
]

Command = dict[str, Any]

#: Turns three.js's y axis onto z.
_Y_TO_Z: NDArray[np.float64] = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
_ROUND_SEGMENTS = 40
_LONG = 256  # [bytes] arrays from here on may stand alone in a page
# Codes of typed arrays in the MessagePack dialect of meshcat's viewer.
_EXTENSION_CODES = {np.dtype(np.uint32): 0x16, np.dtype(np.float32): 0x17}


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A three.js geometry and where it stands in its node.

    Attributes:
        data: The geometry, without its identifier.
        matrix: Homogeneous transform from the geometry's axes into the node's, shape (4, 4).
    """

    data: dict[str, Any]
    matrix: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Material:
    """How a surface looks.

    Attributes:
        colour: sRGB hex, such as "#0072B2"; ignored where vertices carry their own colours.
        opacity: 1 is opaque.
        in_front: Drawn over everything else in its plain colour, so that nothing hides or shades it.
        flat: Faces are shaded as planes rather than smoothed.
        vertex_colours: The shape's vertices carry colours.
        see_through: Hides nothing behind it and shows no light and shade, like coloured air.
        yields: Gives way where it lies in the very surface of something else.
    """

    colour: str = "#808080"
    opacity: float = 1.0
    in_front: bool = False
    flat: bool = False
    vertex_colours: bool = False
    see_through: bool = False
    yields: bool = False

    def lower(self, identifier: str) -> dict[str, Any]:
        """The material as three.js reads it, under an identifier."""
        return {
            "uuid": identifier,
            "type": "MeshBasicMaterial" if self.in_front or self.see_through else "MeshPhongMaterial",
            # three.js multiplies the vertices' colours by the material's.
            "color": 0xFFFFFF if self.vertex_colours else int(self.colour.lstrip("#"), 16),
            "shininess": 12,
            "specular": 0x222222,
            "side": 0 if self.in_front else 2,
            # Transparent objects come last in three.js, which is what drawing over everything takes.
            "transparent": self.opacity < 1.0 or self.in_front,
            "opacity": self.opacity,
            "depthTest": not self.in_front,
            "depthWrite": not (self.in_front or self.see_through),
            "polygonOffset": self.yields,
            "polygonOffsetFactor": 2.0 if self.yields else 0.0,
            "polygonOffsetUnits": 4.0 if self.yields else 0.0,
            "flatShading": self.flat,
            "vertexColors": self.vertex_colours,
        }


def typed_array(values: ArrayLike, dtype: type[np.float32 | np.uint32] = np.float32) -> umsgpack.Ext:
    """Pack numbers as a JavaScript typed array.

    Args:
        values: The numbers, any shape; written row by row.
        dtype: float32 or uint32.

    Returns:
        The MessagePack extension that the viewer decodes into a typed array.
    """
    array = np.ascontiguousarray(values, dtype=dtype)
    return umsgpack.Ext(_EXTENSION_CODES[array.dtype], array.astype(array.dtype.newbyteorder("<")).tobytes())


def box(size: Sequence[float]) -> Shape:
    """A box about the origin; size along x, y, z [m]."""
    width, height, depth = (float(length) for length in size)
    return Shape({"type": "BoxGeometry", "width": width, "height": height, "depth": depth}, np.eye(4))


def sphere(radius: float) -> Shape:
    """A ball about the origin; radius [m]."""
    return Shape({"type": "SphereGeometry", "radius": radius, "widthSegments": 28, "heightSegments": 20}, np.eye(4))


def ellipsoid(radii: Sequence[float]) -> Shape:
    """An ellipsoid about the origin; radii along x, y, z [m]."""
    return replace(sphere(1.0), matrix=np.diag([*radii, 1.0]))


def cylinder(radius: float, length: float, *, base_at_origin: bool = False, sides: int = _ROUND_SEGMENTS) -> Shape:
    """A cylinder along z; about the origin, or standing on it [m]."""
    data = {"radiusTop": radius, "radiusBottom": radius, "height": length, "radialSegments": sides}
    return _standing({"type": "CylinderGeometry", **data}, length, base_at_origin)


def cone(radius: float, length: float, *, base_at_origin: bool = False) -> Shape:
    """A cone that points along z; about the middle of its height, or standing on the origin [m]."""
    data = {"radius": radius, "height": length, "radialSegments": _ROUND_SEGMENTS}
    return _standing({"type": "ConeGeometry", **data}, length, base_at_origin)


def funnel(radius: float, height: float) -> Shape:
    """The skin of a cone that opens along z, its tip at the origin; radius at the top [m]."""
    data = {"radiusTop": radius, "radiusBottom": 1e-4 * radius, "height": height, "radialSegments": 48}
    return _standing({"type": "CylinderGeometry", **data, "openEnded": True}, height, True)


def capsule(radius: float, length: float) -> Shape:
    """A cylinder of that length along z, about the origin, with round ends [m]."""
    angles = np.linspace(-np.pi / 2.0, np.pi / 2.0, 16)
    offsets = np.where(angles < 0.0, -length / 2.0, length / 2.0)
    profile = zip(radius * np.cos(angles), radius * np.sin(angles) + offsets, strict=True)
    points = [{"x": float(x), "y": float(y)} for x, y in profile]
    return Shape({"type": "LatheGeometry", "points": points, "segments": _ROUND_SEGMENTS}, _Y_TO_Z)


def ring(radius: float, thickness: float) -> Shape:
    """A torus about the y axis: mean radius and radius of its section [m]."""
    data = {"radius": radius, "tube": thickness, "radialSegments": 10, "tubularSegments": 64}
    return Shape({"type": "TorusGeometry", **data}, _Y_TO_Z)


def ring_about_z(radius: float, thickness: float, *, height: float = 0.0) -> Shape:
    """A torus about the z axis at a height; mean radius and radius of its section [m]."""
    matrix = np.eye(4)
    matrix[2, 3] = height
    return replace(ring(radius, thickness), matrix=matrix)


def mesh(
    vertices: ArrayLike, triangles: ArrayLike, colours: ArrayLike | None = None, normals: ArrayLike | None = None
) -> Shape:
    """A triangle mesh.

    Args:
        vertices: Points, shape (n, 3) [m].
        triangles: Indices of points, counter-clockwise seen from outside, shape (m, 3).
        colours: Linear RGB in [0, 1] of each vertex, shape (n, 3), or None.
        normals: Unit normals of the vertices, shape (n, 3); None leaves them to the viewer.

    Returns:
        The shape.
    """
    attributes = {"position": _attribute(vertices, np.float32)}
    if normals is not None:
        attributes["normal"] = _attribute(normals, np.float32)
    if colours is not None:
        attributes["color"] = _attribute(colours, np.float32)
    index = typed_array(np.ravel(np.asarray(triangles)), np.uint32)
    data = {"attributes": attributes, "index": {"type": "Uint32Array", "array": index}}
    return Shape({"type": "BufferGeometry", "data": data}, np.eye(4))


def set_object(path: str, shape: Shape, material: Material) -> Command:
    """Put a shape into a node; path is absolute, such as "/robot/base/plate"."""
    geometry, surface = f"{path}#geometry", f"{path}#material"
    return {
        "type": "set_object",
        "path": path,
        "object": {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": geometry, **shape.data}],
            "materials": [material.lower(surface)],
            "object": {
                "uuid": path,
                "type": "Mesh",
                "geometry": geometry,
                "material": surface,
                "matrix": _columns(shape.matrix),
            },
        },
    }


def set_light(path: str, light: dict[str, Any]) -> Command:
    """Put a light into a node, given as three.js writes it (type, color, intensity, position as a matrix, shadow)."""
    return {
        "type": "set_object",
        "path": path,
        "object": {"metadata": {"version": 4.5, "type": "Object"}, "object": {"uuid": path, **light}},
    }


def set_transform(path: str, matrix: NDArray[np.float64]) -> Command:
    """Place a node in its parent; homogeneous transform, shape (4, 4)."""
    return {"type": "set_transform", "path": path, "matrix": _columns(matrix)}


def set_property(path: str, name: str, value: object) -> Command:
    """Set a property of a node; each one lengthens a page for good, so this is for the set-up only."""
    return {"type": "set_property", "path": path, "property": name, "value": value}


def pack(command: Command) -> bytes:
    """The command in the bytes that the viewer reads; numbers are rounded to single precision."""
    return bytes(umsgpack.packb(command, force_float_precision="single"))


def pack_in_parts(command: Command) -> list[bytes]:
    """The same bytes, cut so that whatever is long and may come again stands alone: meshes, instants.

    Args:
        command: The command.

    Returns:
        Parts that make up `pack(command)` when they are joined.
    """
    whole = pack(command)
    parts, place = [], 0
    for array in _long_arrays(command):
        packed = bytes(umsgpack.packb(array))
        start = whole.index(packed, place)
        parts += [whole[place:start], packed]
        place = start + len(packed)
    return [part for part in [*parts, whole[place:]] if part]


def _long_arrays(value: object) -> Iterator[umsgpack.Ext]:
    """Typed arrays within a command, in the order in which they are packed."""
    if isinstance(value, umsgpack.Ext):
        if len(value.data) >= _LONG:
            yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from _long_arrays(item)
    elif isinstance(value, list):
        for item in value:
            yield from _long_arrays(item)


def _columns(matrix: NDArray[np.float64]) -> list[float]:
    """A matrix column by column, as three.js keeps it."""
    return [float(entry) for entry in np.asarray(matrix).T.ravel()]


def _standing(data: dict[str, Any], length: float, base_at_origin: bool) -> Shape:
    matrix = _Y_TO_Z.copy()
    if base_at_origin:
        matrix[2, 3] = length / 2.0
    return Shape(data, matrix)


def _attribute(values: ArrayLike, dtype: type[np.float32]) -> dict[str, Any]:
    return {"itemSize": 3, "type": "Float32Array", "array": typed_array(values, dtype), "normalized": False}
