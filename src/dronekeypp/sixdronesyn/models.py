"""This module writes models/ and models_eval/ of a data set, both in millimetres.

models/ holds the mesh of each drone with colours and normals, and models_info.json with their names, sizes
and hubs. models_eval/ holds the same drones with fewer triangles, as BOP's scripts measure them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

from dronekeypp.errors import InputError
from dronekeypp.files import make_folder, remove_unfinished, write_beside, write_json, writing_beside
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.annotation import MM, numbers
from dronekeypp.sixdronesyn.drones import Drone, find_drone
from dronekeypp.sixdronesyn.mesh_files import check_mesh
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.own import VARIABLE

FOLDERS = (bop.MODELS, "models_eval")
EVAL_TRIANGLES = 4500  # about 2,300 points; the seven then change by 1 mm at most


def write_models(root: Path, names: Sequence[str], edition: int) -> None:
    """Write what is missing or torn of models/ and models_eval/, where the drone names[i] is object i + 1.

    What the models_info.json of models/ holds already stays, so a drone of somebody's own need not be known
    here, unless one of its meshes is missing. The first edition has no models_eval/.

    The models_info.json of models/ is written last. Then a killed run has not listed what it lacks.

    Raises:
        InputError: a drone of which something is missing is not known here, or models_info.json is broken.
    """
    folders = [root / name for name in FOLDERS]
    if edition == 1:
        folders = folders[:1]
    path = folders[0] / "models_info.json"
    info = bop.read_json(path) if path.is_file() else {}
    if not isinstance(info, dict):
        raise InputError(f"{path}: not a table of objects; delete it and run generate again")
    known = ["models_info.json"]
    for number in range(1, len(names) + 1):
        known.append(mesh_path(Path(), number).name)
    for folder in folders:
        make_folder(folder)
        remove_unfinished(folder, known)
    missing = []
    for number in range(1, len(names) + 1):
        meshes = [mesh_path(folder, number) for folder in folders]
        entry = info.get(str(number))
        described = isinstance(entry, dict) and entry.get("name") == names[number - 1]
        if not described or not all(is_whole(mesh) for mesh in meshes):
            missing.append(number)
    for number in missing:
        name = names[number - 1]
        try:
            drone = find_drone(name, edition)
        except InputError:
            raise InputError(
                f"{root}: it holds a drone {name}: set {VARIABLE} to the folder with its file"
            ) from None
        body = drone_mesh(drone).body
        if edition == 1:
            _write_first_edition(mesh_path(folders[0], number), body)
        else:
            write_ply(mesh_path(folders[0], number), body)
            write_ply(mesh_path(folders[1], number), simplified(body))
        info[str(number)] = model_info(drone)
    for folder in reversed(folders):
        path = folder / "models_info.json"
        if not _holds(path, info):
            write_json(path, info, indent=1)


def mesh_path(folder: Path, number: int) -> Path:
    """Return the mesh of an object in models/ or models_eval/."""
    return folder / f"obj_{number:06d}.ply"


def is_whole(mesh: Path) -> bool:
    """Tell whether a mesh is there and all of it can be read."""
    try:
        check_mesh(mesh)
    except InputError:
        return False
    return True


def _holds(path: Path, info: dict[str, Any]) -> bool:
    """Tell whether a models_info.json is there and holds `info`."""
    try:
        return bop.read_json(path) == info
    except InputError:
        return False


def write_ply(path: Path, mesh: pv.PolyData) -> None:
    """Write a mesh in metres as a binary PLY file in millimetres.

    Every point has its normal and, where the mesh has `rgb`, its colour. VTK's own writer knows no normals.

    Args:
        path: the file.
        mesh: triangles with the point arrays `Normals` and, if it is coloured, `rgb`.
    """
    columns = {}
    for axis, values in zip("xyz", np.asarray(mesh.points).T * MM, strict=True):
        columns[axis] = values
    for axis, values in zip("xyz", np.asarray(mesh.point_data["Normals"]).T, strict=True):
        columns[f"n{axis}"] = values
    types = dict.fromkeys(columns, "<f4")
    if "rgb" in mesh.point_data:
        for colour, values in zip(
            ("red", "green", "blue"), np.asarray(mesh.point_data["rgb"]).T, strict=True
        ):
            columns[colour], types[colour] = values, "u1"
    points = np.empty(mesh.n_points, dtype=list(types.items()))
    for name, values in columns.items():
        points[name] = values
    faces = np.empty(mesh.n_cells, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.regular_faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {mesh.n_points}"]
    for name, kind in types.items():
        header.append(f"property {'uchar' if kind == 'u1' else 'float'} {name}")
    header += [f"element face {mesh.n_cells}", "property list uchar int vertex_indices", "end_header", ""]
    write_beside(path, "\n".join(header).encode() + points.tobytes() + faces.tobytes())


def simplified(mesh: pv.PolyData) -> pv.PolyData:
    """Return a mesh with at most about EVAL_TRIANGLES triangles, without colours, with normals."""
    plain = pv.PolyData(mesh.points, mesh.faces)
    # Points that lie on each other become one; else every hard edge would open.
    plain = plain.clean(tolerance=1e-6, absolute=True, lines_to_points=False, polys_to_lines=False)
    plain = plain.triangulate()
    if plain.n_cells > EVAL_TRIANGLES:
        plain = plain.decimate(1 - EVAL_TRIANGLES / plain.n_cells)
    return plain.compute_normals(cell_normals=False, auto_orient_normals=False)


def _write_first_edition(path: Path, mesh: pv.PolyData) -> None:
    """Write a mesh in metres as the first edition has it: in millimetres, without normals."""
    body = pv.PolyData(mesh.points * np.float32(MM), mesh.faces)
    body.point_data["rgb"] = mesh.point_data["rgb"]
    with writing_beside(path) as beside:
        body.save(beside, texture="rgb", recompute_normals=False)
        check_mesh(beside)  # VTK says nothing of a full disk


def model_info(drone: Drone) -> dict[str, Any]:
    """Return a drone's entry of models_info.json.

    It holds its names, BOP's sizes, its hubs in body axes and its propellers' diameter, all in millimetres.
    """
    points = np.asarray(drone_mesh(drone).body.points, dtype=np.float64) * MM
    low, size = points.min(0), np.ptp(points, axis=0)
    corners = points[ConvexHull(points).vertices]
    entry: dict[str, Any] = {
        "name": drone.name,
        "label": drone.label,
        "diameter": round(float(pdist(corners).max()), 2),
    }
    for axis, value in zip("xyz", low, strict=True):
        entry[f"min_{axis}"] = round(float(value), 2)
    for axis, value in zip("xyz", size, strict=True):
        entry[f"size_{axis}"] = round(float(value), 2)
    entry["keypoints"] = [numbers(hub * MM) for hub in drone.hubs]
    entry["propeller_diameter"] = round(drone.propeller_diameter * MM, 2)
    return entry
