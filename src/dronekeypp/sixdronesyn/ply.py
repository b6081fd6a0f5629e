"""Read the points of a mesh in a PLY file.

VTK reads whole meshes, but it ends the process where a file is cut off, and its import needs graphics
libraries that a machine for training may lack. Only points are needed here, which are a plain table.
"""

from __future__ import annotations

import io
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


def read_points(path: Path) -> np.ndarray:
    """Return the points (M, 3) of a PLY file, ASCII or binary, in the unit of the file.

    Raises:
        InputError: it is missing, not a PLY file that begins with its vertices, cut off, or holds no point,
            or a point that is not finite. The message names the file.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: not found") from None
    header, end, body = content.partition(HEADER_END)
    body = body[body.find(b"\n") + 1 :]
    try:
        layout, count, columns = _read_header(header.decode("ascii"))
        if not end or count < 1:
            raise ValueError("no header, or no point")
        if count > len(body.strip() if layout == "ascii" else body):
            raise ValueError(f"{count} points in {len(body)} bytes")
        if layout == "ascii":
            lines = io.StringIO(body.decode("ascii"))
            rows = np.loadtxt(lines, comments=None, max_rows=count, ndmin=2)
            names = [name for name, _ in columns]
            points = rows[:, [names.index(axis) for axis in "xyz"]]
        else:
            dtype = np.dtype([(name, BYTE_ORDERS[layout] + kind) for name, kind in columns])
            table = np.frombuffer(body, dtype, count)
            points = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
        if points.shape != (count, 3) or not np.isfinite(points).all():
            raise ValueError("points are missing, or not finite")
    except (ValueError, KeyError, IndexError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: not a whole PLY file that begins with its vertices ({reason})") from None
    return points


def _read_header(text: str) -> tuple[str, int, list[tuple[str, str]]]:
    """Return the layout of a PLY file, the number of its vertices, and their columns (name, NumPy type).

    Raises:
        ValueError, KeyError, IndexError: the header is not that of such a file.
    """
    lines = [line.split() for line in text.splitlines() if line.strip()]
    if not lines or lines[0] != ["ply"]:
        raise ValueError("it does not begin with ply")
    layout, count, columns = "", 0, []
    elements = 0
    for words in lines[1:]:
        if words[0] == "format":
            layout = words[1]
        elif words[0] == "element":
            elements += 1
            if elements == 1:
                if words[1] != "vertex":
                    raise ValueError(f"it begins with {words[1]}")
                count = int(words[2])
        elif words[0] == "property" and elements == 1:
            columns.append((words[2], TYPES[words[1]]))
    if layout != "ascii" and layout not in BYTE_ORDERS:
        raise ValueError(f"format {layout!r}")
    return layout, count, columns
