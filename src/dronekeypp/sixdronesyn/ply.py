"""Read the points and the faces of a mesh in a PLY file.

VTK reads whole meshes, but it ends the process where a file is cut off, and its import needs graphics
libraries that a machine for training may lack. Points are a plain table, and faces are lists.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dronekeypp.errors import InputError

TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2"},
    **{"ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
HEADER_END = b"end_header"
CORNERS = ("vertex_indices", "vertex_index")  # what the property of a face is called that names its points


@dataclass(frozen=True)
class Header:
    """This is what the header of a PLY file says.

    Attributes:
        layout: "ascii", or a key of BYTE_ORDERS.
        elements: (name, how many there are, its properties) in the order of the file. A property is (name,
            NumPy type), or of a list (name, type of its length, type of its entries).
    """

    layout: str
    elements: tuple[tuple[str, int, tuple[tuple[str, ...], ...]], ...]


def read_points(path: Path) -> np.ndarray:
    """Return the points (M, 3) of a PLY file, ASCII or binary, in the unit of the file.

    Raises:
        InputError: it is missing, not a PLY file that begins with its vertices, cut off, or holds no point,
            or a point that is not finite. The message names the file.
    """
    try:
        header, body = _open(path)
        _, count, columns = header.elements[0]
        if count > len(body.strip() if header.layout == "ascii" else body):
            raise ValueError(f"{count} points in {len(body)} bytes")
        if header.layout == "ascii":
            lines = io.StringIO(body.decode("ascii"))
            rows = np.loadtxt(lines, comments=None, max_rows=count, ndmin=2)
            names = [column[0] for column in columns]
            points = rows[:, [names.index(axis) for axis in "xyz"]]
        else:
            table = np.frombuffer(body, _row(header, columns), count)
            points = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
        if points.shape != (count, 3) or not np.isfinite(points).all():
            raise ValueError("points are missing, or not finite")
    except (ValueError, KeyError, IndexError) as error:
        raise _broken(path, error) from None
    return points


def read_faces(path: Path) -> np.ndarray:
    """Return the points that the faces of a PLY file name, one face after the other, (N,), from 0.

    Raises:
        InputError: as `read_points`; or the faces do not come next, or are cut off.
    """
    try:
        header, body = _open(path)
        if len(header.elements) < 2 or header.elements[1][0] != "face":
            raise ValueError("no faces behind its vertices")
        (_, points, columns), (_, faces, properties) = header.elements[:2]
        if header.layout == "ascii":
            lines = body.decode("ascii").splitlines()[points : points + faces]
            rows = [[float(word) for word in line.split()] for line in lines]
            corners = _corners_of_rows(rows, properties)
        else:
            start = points * _row(header, columns).itemsize
            corners = _corners_of_bytes(body[start:], faces, properties, BYTE_ORDERS[header.layout])
        if len(corners) != faces:
            raise ValueError(f"{len(corners)} of {faces} faces")
        return np.concatenate(corners) if corners else np.zeros(0, int)
    except (ValueError, KeyError, IndexError) as error:
        raise _broken(path, error) from None


def _open(path: Path) -> tuple[Header, bytes]:
    """Return the header of a PLY file, and what comes behind it.

    Raises:
        InputError: the file is missing.
        ValueError, KeyError, IndexError: the header is not that of a file that begins with its vertices.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: not found") from None
    text, end, body = content.partition(HEADER_END)
    header = _read_header(text.decode("ascii"))
    if not end or not header.elements or header.elements[0][1] < 1:
        raise ValueError("no header, or no point")
    return header, body[body.find(b"\n") + 1 :]


def _broken(path: Path, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [""])[0]
    return InputError(f"{path}: not a whole PLY file that begins with its vertices ({reason})")


def _row(header: Header, columns: Sequence[tuple[str, ...]]) -> np.dtype:
    """Return the type of a row of a table in a binary file."""
    order = BYTE_ORDERS[header.layout]
    if any(len(column) > 2 for column in columns):
        raise ValueError("a vertex holds a list")
    return np.dtype([(name, order + kind) for name, kind in columns])


def _corners_of_rows(rows: Sequence[Sequence[float]], properties: Sequence[tuple]) -> list[np.ndarray]:
    """Return the points that each face names, from the numbers in its line."""
    corners = []
    for row in rows:
        place, found = 0, None
        for name, *kinds in properties:
            length = int(row[place]) if len(kinds) == 2 else 0
            if len(kinds) == 2 and (length < 0 or place + 1 + length > len(row)):
                raise ValueError("a face is cut off")
            if name in CORNERS:
                found = np.array(row[place + 1 : place + 1 + length], int)
            place += 1 + length
        if found is None:
            raise ValueError("faces without corners")
        corners.append(found)
    return corners


def _corners_of_bytes(body: bytes, faces: int, properties: Sequence[tuple], order: str) -> list[np.ndarray]:
    """Return the points that each face names, from the bytes of all faces."""
    if len(properties) == 1 and properties[0][0] in CORNERS and len(properties[0]) == 3:
        _, length, entry = properties[0]
        triangle = np.dtype([("count", order + length), ("corners", order + entry, 3)])
        if len(body) >= faces * triangle.itemsize:
            table = np.frombuffer(body, triangle, faces)
            if (table["count"] == 3).all():  # as most meshes have them, and a thousand times quicker
                return list(table["corners"].astype(int))
    corners, place = [], 0
    for _ in range(faces):
        found = None
        for name, *kinds in properties:
            length = 1
            if len(kinds) == 2:
                count = np.frombuffer(body, order + kinds[0], 1, place)
                length, place = int(count[0]), place + count.itemsize
            if length < 0:
                raise ValueError("a face is cut off")
            values = np.frombuffer(body, order + kinds[-1], length, place)
            place += values.nbytes
            if name in CORNERS:
                found = values.astype(int)
        if found is None:
            raise ValueError("faces without corners")
        corners.append(found)
    return corners


def _read_header(text: str) -> Header:
    """Return what the header of a PLY file says.

    Raises:
        ValueError, KeyError, IndexError: the header is not that of a file that begins with its vertices.
    """
    lines = [line.split() for line in text.splitlines() if line.strip()]
    if not lines or lines[0] != ["ply"]:
        raise ValueError("it does not begin with ply")
    layout = ""
    elements: list[tuple[str, int, list[tuple[str, ...]]]] = []
    for words in lines[1:]:
        if words[0] == "format":
            layout = words[1]
        elif words[0] == "element":
            if not elements and words[1] != "vertex":
                raise ValueError(f"it begins with {words[1]}")
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            kinds = words[2:4] if words[1] == "list" else words[1:2]
            elements[-1][2].append((words[-1], *(TYPES[kind] for kind in kinds)))
    if layout != "ascii" and layout not in BYTE_ORDERS:
        raise ValueError(f"format {layout!r}")
    return Header(layout, tuple((name, count, tuple(columns)) for name, count, columns in elements))
