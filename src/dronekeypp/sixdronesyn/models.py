"""This module writes models/ of a data set.

It holds a mesh for each drone, and models_info.json with their names, sizes and hubs.
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
from dronekeypp.files import write_json
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.drones import Drone, find_drone
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.own import VARIABLE


def write_models(root: Path, names: Sequence[str], edition: int) -> None:
    """Write what is missing of models/, where the drone names[i] is object i + 1.

    models_info.json comes last: it says that the meshes are all there. What it holds already stays, so a
    drone of somebody's own need not be known here.

    Raises:
        InputError: a drone that is missing in models/ is not known here.
    """
    folder = root / "models"
    path = folder / "models_info.json"
    info = bop.read_json(path) if path.is_file() else {}
    missing = [number for number in range(1, len(names) + 1) if str(number) not in info]
    if not missing:
        return
    folder.mkdir(exist_ok=True)
    for number in missing:
        name = names[number - 1]
        try:
            drone = find_drone(name, edition)
        except InputError:
            raise InputError(
                f"{root}: it holds a drone {name}: set {VARIABLE} to the folder with its file"
            ) from None
        mesh = drone_mesh(drone).body
        body = pv.PolyData(mesh.points * np.float32(bop.MM), mesh.faces)
        body.point_data["rgb"] = mesh.point_data["rgb"]
        body.save(folder / f"obj_{number:06d}.ply", texture="rgb", recompute_normals=False)
        info[str(number)] = model_info(drone)
    write_json(path, info, indent=1)


def model_info(drone: Drone) -> dict[str, Any]:
    """Return a drone's entry of models_info.json.

    It holds its names, BOP's sizes, and its hubs in body axes, all in millimetres.
    """
    points = np.asarray(drone_mesh(drone).body.points, dtype=np.float64) * bop.MM
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
    entry["keypoints"] = [bop.numbers(hub * bop.MM) for hub in drone.hubs]
    return entry
