"""Read drones of your own: a folder of NAME.json files, named by the variable DRONEKEYPP_DRONES.

    {"name": "Racer", "mesh": "racer.stl", "mesh_unit": "mm", "hubs": [[0.08, 0.1, 0.02], ...],
     "propeller_diameter": 0.13, "mass": 0.4}

name: letters and digits, not yet taken, and not that of a random quadrotor ("Quad17"). mesh: a file beside
the JSON that PyVista reads (STL, PLY, OBJ …), in body axes (x forward, y left, z up) and without propellers,
which are drawn. mesh_unit: "m" (the default) or "mm". hubs: the four centres of the propeller discs, (4, 3)
metres, in the same axes, in the order front-left, front-right, rear-right, rear-left; they are left–right
symmetric and lie in one plane. propeller_diameter: metres. mass: kg.

If you like, also: label (shown to people), motor_radius (metres), body_mm (length, width, height), hull_rgb,
trim_rgb, propeller_rgb, tip_rgb (0 to 255; a mesh with colours of its own, a point array "RGB" or "rgb",
keeps them).

The variable is read once, when the list of drones is first imported. Another file in the folder changes
neither the frames nor the class of a drone: a data set numbers its own drones in the order in which it met
them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from dronekeypp import classes, schema
from dronekeypp.classes import LARGEST, SYMMETRY, DroneClass
from dronekeypp.errors import InputError
from dronekeypp.files import digest
from dronekeypp.pnp import check_coplanar
from dronekeypp.schema import Name, Point, Schema
from dronekeypp.sixdronesyn import quadrotors

VARIABLE = "DRONEKEYPP_DRONES"
UNITS = {"m": 1.0, "mm": 1e-3}
DEFAULTS: dict[str, Any] = {
    "mesh_unit": "m",
    "motor_radius": 0.01,
    "hull_rgb": (90, 92, 96),
    "trim_rgb": (50, 50, 54),
    "propeller_rgb": (60, 60, 64),
    "tip_rgb": (60, 60, 64),
}
Colour = Annotated[list[Annotated[int, Field(ge=0, le=255)]], Field(min_length=3, max_length=3)]
COLOURS = ("hull_rgb", "trim_rgb", "propeller_rgb", "tip_rgb")
# A propeller's diameter over the distance of neighbouring hubs; above 1 discs overlap, at two heights.
MOST_OVERLAP = 1.5


class OwnDrone(Schema):
    """This is a NAME.json; the docstring of the module says what its fields are."""

    name: Name
    mesh: Name
    hubs: Annotated[list[Point], Field(min_length=4, max_length=4)]
    propeller_diameter: float
    mass: float
    label: str = ""
    mesh_unit: Literal["m", "mm"] = "m"
    motor_radius: float = 0
    body_mm: Point | None = None
    hull_rgb: Colour = []
    trim_rgb: Colour = []
    propeller_rgb: Colour = []
    tip_rgb: Colour = []


def read(taken: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the fields of `Drone` for every file of the folder that VARIABLE names, in order of names.

    Without the variable there are none. `taken` are the names of the seven.

    Raises:
        InputError: no such folder, a field that is missing, unknown or impossible, a name that is taken, a
            mesh that is not there.
    """
    if not os.environ.get(VARIABLE):
        return []
    folder = Path(os.environ[VARIABLE])
    if not folder.is_dir():
        raise InputError(f"{VARIABLE}={folder}: no such folder")
    drones: list[dict[str, Any]] = []
    names = list(taken)
    for path in sorted(folder.glob("*.json")):
        fields = read_drone(path)
        if fields["name"] in names:
            raise InputError(f"{path}: there is a drone {fields['name']!r} already; choose another name")
        drones.append({**fields, "index": len(names)})
        names.append(fields["name"])
    if not drones:
        raise InputError(f"{VARIABLE}={folder}: no drone; NAME.json files are read")
    return drones


def read_drone(path: Path) -> dict[str, Any]:
    """Return the fields of one file.

    Raises:
        InputError: a field is missing, unknown or impossible. The message names the file.
    """
    given = schema.read(OwnDrone, path)
    given = {**DEFAULTS, "label": given["name"], **given}
    if not given["name"].isalnum():
        raise InputError(f"{path}: name {given['name']!r}: letters and digits only")
    if quadrotors.number_of(given["name"]) is not None:
        raise InputError(f"{path}: name {given['name']!r}: that is a random quadrotor's; choose another name")
    mesh = path.parent / given["mesh"]
    if not mesh.is_file():
        raise InputError(f"{path}: mesh {mesh} not found")
    hubs = np.array(given["hubs"], dtype=float)
    check_hubs(path, hubs)
    diameter, mass, motor = (float(given[key]) for key in ("propeller_diameter", "mass", "motor_radius"))
    colours = {key: tuple(given[key]) for key in COLOURS}
    if given.get("body_mm") is None:
        body = tuple(float(v) for v in 1000 * np.ptp(hubs, axis=0) + 20)
    else:
        body = tuple(float(v) for v in given["body_mm"])
    possible = 0.01 < diameter < 1 and 0.01 < mass < 50 and 0 < motor < diameter / 2
    if not (possible and all(1 < v < 5000 for v in body)):
        raise InputError(
            f"{path}: propeller_diameter and motor_radius in metres, mass in kg, "
            "body_mm three lengths in millimetres"
        )
    beside = hubs[[1, 2, 3, 0]]  # of each hub the next one around the drone
    least = float(np.linalg.norm(hubs - beside, axis=1).min())
    if diameter > MOST_OVERLAP * least:
        raise InputError(
            f"{path}: propeller_diameter {diameter:g} m, and two hubs are {least:.3g} m apart: "
            "the propellers are larger than the drone"
        )
    hubs.setflags(write=False)
    return {
        "name": given["name"],
        "label": given["label"],
        "body_mm": body,
        "wheelbase": float(np.linalg.norm(hubs[0] - hubs[2])),
        "propeller_diameter": diameter,
        "mass": mass,
        "motor_radius": motor,
        **colours,
        "hubs": hubs,
        "mesh": mesh.resolve(),
        "mesh_scale": UNITS[given["mesh_unit"]],
        "digest": digest(path.read_bytes() + mesh.read_bytes()),
    }


def check_hubs(path: Path, hubs: np.ndarray) -> None:
    """Check hubs in body axes, metres.

    Raises:
        InputError: they are not four hubs in metres, in the right order, in one plane and left–right
            symmetric to a hundredth of the wheelbase. The message begins with `path`.
    """
    if hubs.shape == (4, 3) and np.abs(hubs).max() > LARGEST:
        raise InputError(f"{path}: a hub {np.abs(hubs).max():g} m from the middle: hubs are in metres")
    classes.check_hubs(hubs, str(path))
    try:
        check_coplanar(hubs)
    except InputError:
        centred = hubs - hubs.mean(axis=0)
        normal = np.linalg.svd(centred)[2][2]  # of the plane that fits them best
        off = 1000 * np.abs(centred @ normal).max()
        raise InputError(f"{path}: hubs are {off:.1f} mm from lying in one plane: PnP needs one") from None
    drone = DroneClass(path.stem, hubs)
    if drone.asymmetry > SYMMETRY * drone.wheelbase:
        raise InputError(
            f"{path}: hubs are {1000 * drone.asymmetry:.1f} mm from left–right symmetric: "
            "left and right need the same x and z, and y of opposite signs"
        )
