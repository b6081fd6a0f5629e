"""Find what is wrong with models/ and models_eval/ of 6DroneSyn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.instances import one_value
from dronekeypp.sixdronesyn.mesh_files import check_mesh
from dronekeypp.sixdronesyn.models import FOLDERS, mesh_path
from dronekeypp.sixdronesyn.ply import read_points

MISSING = "missing; run generate again, it writes what is missing"
MEND = "delete it and run generate again, it writes what is missing"
OFF = 0.02  # millimetres: sizes are rounded to 0.01, and points stored as float32


def model_faults(root: Path, numbers: list[int], folders: tuple[str, ...] = FOLDERS) -> list[str]:
    """Return what is wrong with the meshes and their sizes, one line each.

    Args:
        root: the data set.
        numbers: of its objects, all of which models/models_info.json holds.
        folders: those that the data set has.
    """
    faults = []
    tables = {}
    for folder in folders:
        path = root / folder / "models_info.json"
        if not path.is_file():
            faults.append(f"{path}: {MISSING}")
            continue
        try:
            tables[folder] = bop.read_json(path)
        except InputError as error:
            faults.append(f"{error}; {MEND}")
    for folder in folders:
        if folder in tables and tables[folder] != tables.get(folders[0]):
            faults.append(f"{root / folder / 'models_info.json'}: not that of {folders[0]}/; {MEND}")
        for number in numbers:
            mesh = mesh_path(root / folder, number)
            if not mesh.is_file():
                faults.append(f"{mesh}: {MISSING}")
                continue
            try:
                check_mesh(mesh)
                if folder == folders[0] and folder in tables:
                    where = f"{root / folder / 'models_info.json'} object {number}"
                    faults += _size_faults(where, tables[folder][str(number)], read_points(mesh))
            except InputError as error:
                faults.append(f"{error}; {MEND}")
    return faults


def _size_faults(where: str, entry: dict[str, Any], points: np.ndarray) -> list[str]:
    """Return where BOP's sizes of an object are not those of its points (M, 3), millimetres.

    Raises:
        InputError: one of them is missing, or no number. The message begins with `where`.
    """
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    faults = []
    for axis, least, extent in zip("xyz", low, size, strict=True):
        for key, expected in ((f"min_{axis}", least), (f"size_{axis}", extent)):
            value = one_value(entry, key, 1, where)[0]
            if abs(value - expected) > OFF:
                faults.append(f"{where}: {key} is {value:g}, that of its mesh is {expected:.2f}; {MEND}")
    diameter = one_value(entry, "diameter", 1, where)[0]
    # The largest distance of two points lies between the longest side of their box and its diagonal.
    if not size.max() - OFF <= diameter <= np.linalg.norm(size) + OFF:
        faults.append(f"{where}: diameter {diameter:g} is not that of its mesh; {MEND}")
    return faults
