"""Your own drones beside the seven: a folder of NAME.json files, each with a mesh, named by the environment variable DRONEKEYPP_DRONES.

    {"name": "Racer", "mesh": "racer.stl", "mesh_unit": "mm", "hubs": [[0.08, 0.1, 0.02], ...], "propeller_diameter": 0.13, "mass": 0.4}

name: letters and digits, new. mesh: any file that PyVista reads (STL, PLY, OBJ …), beside the JSON, in body axes (x forward, y left, z up); its
unit is "m" (the default) or "mm"; without propellers, which are drawn. hubs: the four centres of the propeller discs, (4, 3) metres, same axes,
in the order front-left, front-right, rear-right, rear-left. propeller_diameter: metres. mass: kg. If you like, also: label (shown to people),
motor_radius (metres), body_mm (length, width, height), hull_rgb, propeller_rgb, tip_rgb (0 to 255; a mesh with colours of its own, a point array
"RGB" or "rgb", keeps them). The variable is read once, when the list of drones is first imported.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.files import digest, read_json

VARIABLE = "DRONEKEYPP_DRONES"
MOST = 3  # a flight's folder number has one digit for the drone, and seven are taken
NEEDED = ("name", "mesh", "hubs", "propeller_diameter", "mass")
UNITS = {"m": 1.0, "mm": 1e-3}
DEFAULTS: dict[str, Any] = {
    "mesh_unit": "m", "motor_radius": 0.01, "hull_rgb": (90, 92, 96), "trim_rgb": (50, 50, 54), "propeller_rgb": (60, 60, 64),
    "tip_rgb": (60, 60, 64),
}  # fmt: skip


def read(taken: tuple[str, ...]) -> list[dict[str, Any]]:
    """The fields of `Drone` for every file of the folder that VARIABLE names, in the order of their names; [] without the variable.

    Raises:
        InputError: no such folder, too many drones, a field missing, unknown or impossible, a name that is taken, a mesh that is not there.
    """
    if not os.environ.get(VARIABLE):
        return []
    folder = Path(os.environ[VARIABLE])
    if not folder.is_dir():
        raise InputError(f"{VARIABLE}={folder}: no such folder")
    found: list[dict[str, Any]] = []
    for path in sorted(folder.glob("*.json")):
        fields = one(path)
        if fields["name"] in (*taken, *(other["name"] for other in found)):
            raise InputError(f"{path}: there is a drone {fields['name']!r} already; choose another name")
        found.append({**fields, "index": len(taken) + len(found)})
    if not found or len(found) > MOST:
        raise InputError(f"{VARIABLE}={folder}: {len(found)} drones; 1 to {MOST} NAME.json files are read")
    return found


def one(path: Path) -> dict[str, Any]:
    """The fields of one file."""
    given = read_json(path)
    if not isinstance(given, dict):
        raise InputError(f"{path}: not the fields of a drone but a {type(given).__name__}")
    missing = [key for key in NEEDED if key not in given]
    unknown = [key for key in given if key not in (*NEEDED, *DEFAULTS, "label", "body_mm")]
    if missing or unknown:
        raise InputError(f"{path}: {'lacks ' + missing[0] if missing else 'unknown field ' + unknown[0]}")
    given = {**DEFAULTS, "label": given["name"], **given}
    if not (isinstance(given["name"], str) and given["name"].isalnum()):
        raise InputError(f"{path}: name {given['name']!r}: letters and digits only")
    if str(given["mesh_unit"]) not in UNITS:
        raise InputError(f"{path}: mesh_unit {given['mesh_unit']!r}: m or mm")
    mesh = path.parent / str(given["mesh"])
    if not mesh.is_file():
        raise InputError(f"{path}: mesh {mesh} not found")
    try:
        hubs = np.array(given["hubs"], dtype=float)
        diameter, mass, motor = (float(given[key]) for key in ("propeller_diameter", "mass", "motor_radius"))
        colours = {
            key: tuple(int(v) for v in given[key])
            for key in ("hull_rgb", "trim_rgb", "propeller_rgb", "tip_rgb")
        }
        body = tuple(float(v) for v in given.get("body_mm") or 1000 * np.ptp(hubs, axis=0) + 20)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: {error}") from None
    check_hubs(path, hubs)
    if not (
        0.01 < diameter < 1
        and 0.01 < mass < 50
        and 0 < motor < diameter
        and len(body) == 3
        and all(1 < v < 5000 for v in body)
    ):
        raise InputError(
            f"{path}: propeller_diameter and motor_radius in metres, mass in kg, body_mm three lengths in millimetres"
        )
    if any(len(c) != 3 or not all(0 <= v <= 255 for v in c) for c in colours.values()):
        raise InputError(f"{path}: a colour is three numbers, 0 to 255")
    hubs.setflags(write=False)
    return {
        "name": given["name"], "label": str(given["label"]), "body_mm": body, "wheelbase": float(np.linalg.norm(hubs[0] - hubs[2])),
        "propeller_diameter": diameter, "mass": mass, "motor_radius": motor, **colours, "hubs": hubs, "mesh": mesh.resolve(),
        "mesh_scale": UNITS[given["mesh_unit"]], "digest": digest(path.read_bytes() + mesh.read_bytes()),
    }  # fmt: skip


def check_hubs(path: Path, hubs: np.ndarray) -> None:
    """Raise InputError unless they are four hubs in metres, in the order front-left, front-right, rear-right, rear-left."""
    if hubs.shape != (4, 3) or not np.isfinite(hubs).all():
        raise InputError(f"{path}: hubs {hubs.shape}, four points of three numbers are needed")
    if np.abs(hubs).max() > 2:
        raise InputError(f"{path}: a hub {np.abs(hubs).max():g} m from the middle: hubs are in metres")
    x, y = hubs[:, 0], hubs[:, 1]
    if not (min(x[0], x[1]) > max(x[2], x[3]) and min(y[0], y[3]) > max(y[1], y[2])):
        raise InputError(
            f"{path}: hubs in the order front-left, front-right, rear-right, rear-left, with x forward and y to the left"
        )
