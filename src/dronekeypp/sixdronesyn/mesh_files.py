"""Check a mesh file before VTK reads it.

VTK ends the process where a face names a point that is not there, or where a file is cut off. So STL, PLY and
OBJ are read here first, as far as that takes: the points are finite, and every face names points that are
there. A file of any other format is tried in a process of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.ply import read_faces, read_points

MOST_BYTES = 2**28  # of a mesh file: millions of triangles
MOST_SECONDS = 120  # for a mesh of another format
STL_HEADER, STL_TRIANGLE = 84, 50  # bytes
_TRY = """
import sys
import dronekeypp.sixdronesyn, pyvista
mesh = pyvista.read(sys.argv[1]).extract_surface(algorithm="dataset_surface").triangulate()
mesh.compute_normals(cell_normals=False, split_vertices=True, feature_angle=38.0, auto_orient_normals=True)
"""


def check_mesh(path: Path) -> None:
    """Check that VTK can read a mesh file.

    Raises:
        InputError: it is missing, too large, cut off or not a mesh, a point is not finite, or a face names a
            point that is not there. The message names the file.
    """
    if not path.is_file():
        raise InputError(f"{path}: not found")
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: more than {MOST_BYTES >> 20} MB; make the mesh coarser")
    check = {".stl": _check_stl, ".ply": _check_ply, ".obj": _check_obj}.get(path.suffix.lower(), _try)
    check(path)


def _check_faces(path: Path, corners: np.ndarray, points: int) -> None:
    """Check the points (N,) that faces name, counted from 0.

    Raises:
        InputError: there are none, or one of them is not among the `points`.
    """
    if not len(corners):
        raise InputError(f"{path}: not a mesh: it has no faces")
    if corners.min() < 0 or corners.max() >= points:
        wrong = corners[(corners < 0) | (corners >= points)][0]
        raise InputError(f"{path}: a face names point {wrong}, and there are {points}; export the mesh again")


def _check_points(path: Path, points: np.ndarray) -> None:
    """Raise InputError unless every number of the points is finite."""
    if not np.isfinite(points).all():
        raise InputError(f"{path}: a point is not finite; export the mesh again")


def _check_ply(path: Path) -> None:
    points = read_points(path)
    _check_faces(path, read_faces(path), len(points))


def _check_stl(path: Path) -> None:
    """Check a binary STL file by its length, or the numbers of an ASCII one."""
    content = path.read_bytes()
    count = int.from_bytes(content[STL_HEADER - 4 : STL_HEADER], "little")
    if len(content) >= STL_HEADER and len(content) == STL_HEADER + STL_TRIANGLE * count and count:
        kind = np.dtype([("vectors", "<f4", (4, 3)), ("attribute", "<u2")])  # the normal and three corners
        _check_points(path, np.frombuffer(content, kind, count, STL_HEADER)["vectors"][:, 1:])
        return
    words = content.split()
    corners = [i for i, word in enumerate(words) if word.lower() == b"vertex"]
    whole = words[:1] == [b"solid"] and b"endsolid" in words
    if not whole or not corners or words.count(b"endfacet") * 3 != len(corners):
        raise InputError(f"{path}: not a whole STL file; export the mesh again")
    try:
        points = np.array([words[i + 1 : i + 4] for i in corners], dtype=float)
    except ValueError:
        raise InputError(f"{path}: a vertex is not three numbers; export the mesh again") from None
    _check_points(path, points)


def _check_obj(path: Path) -> None:
    """Check the vertices and faces of a Wavefront OBJ file. Negative numbers count from the last vertex."""
    points: list[list[float]] = []
    corners: list[int] = []
    with open(path, encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            try:
                if words[:1] == ["v"]:
                    points.append([float(word) for word in words[1:4]])
                    if len(points[-1]) < 3:
                        raise ValueError
                elif words[:1] == ["f"]:
                    for word in words[1:]:
                        place = int(word.partition("/")[0])
                        corners.append(place - 1 if place > 0 else len(points) + place if place else -1)
            except ValueError:
                raise InputError(f"{path} line {number}: neither a vertex nor a face") from None
    _check_points(path, np.array(points))
    _check_faces(path, np.array(corners), len(points))


def _try(path: Path) -> None:
    """Let another process read a mesh: if VTK ends it, this one goes on."""
    command = [sys.executable, "-c", _TRY, os.fspath(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=MOST_SECONDS)
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: takes more than {MOST_SECONDS} s to read; save it as STL or PLY") from None
    if done.returncode != 0:
        raise InputError(f"{path}: not a mesh that PyVista reads; save it as STL, PLY or OBJ")
