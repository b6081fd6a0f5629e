"""Read the shapes that the errors of BOP are measured on: points, diameter and symmetries of each object.

They come from models_eval/ of a data set, as in BOP's toolkit, or from models/ where that is not there:

    models_info.json    for each object `diameter`, and where it has any `symmetries_discrete` (4×4 matrices,
                        row by row) and `symmetries_continuous` ({"axis", "offset"}: turns about a line)
    obj_000001.ply, …   the points of its mesh

All lengths on disk are in millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.instances import one_value
from dronekeypp.sixdronesyn.ply import read_points

# Between two turns about a continuous symmetry axis, the farthest point moves by at most this share of the
# diameter (the toolkit's max_sym_disc_step).
LARGEST_STEP = 0.01


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """This is what is known of the shape of one object, in metres and body axes.

    Attributes:
        points: (M, 3) the points of its mesh.
        diameter: the largest distance between two of them, as models_info.json gives it.
        symmetries: (S, 4, 4) the motions that leave it as it is. The first is the identity.
    """

    points: np.ndarray
    diameter: float
    symmetries: np.ndarray

    @property
    def symmetric(self) -> bool:
        """Tell whether it looks the same from more than one side."""
        return len(self.symmetries) > 1


def models_folder(root: str | Path) -> Path:
    """Return models_eval/ of a data set, or models/ where the former has no models_info.json."""
    evaluated = Path(root) / "models_eval"
    return evaluated if (evaluated / "models_info.json").is_file() else Path(root) / "models"


def read_shapes(root: str | Path, numbers: Iterable[int]) -> tuple[dict[int, ObjectShape], str]:
    """Read the shapes of the objects with these numbers.

    Returns:
        the shapes by object number, and "". Where one of the objects has no mesh or no diameter, there are no
        shapes, and the text says what is missing.

    Raises:
        InputError: a file is there and broken. The message names it.
    """
    folder = models_folder(root)
    path = folder / "models_info.json"
    table = bop.read_json(path) if path.is_file() else {}
    shapes = {}
    for number in sorted(numbers):
        mesh = folder / f"obj_{number:06d}.ply"
        entry = table.get(str(number)) if isinstance(table, dict) else None
        if not mesh.is_file():
            return {}, f"{mesh} is not there"
        if not isinstance(entry, dict) or entry.get("diameter") is None:
            return {}, f"{path} has no diameter of object {number}"
        where = f"{path} object {number}"
        diameter = float(one_value(entry, "diameter", 1, where)[0])
        if diameter <= 0:
            raise InputError(f"{where}: diameter {diameter:g} is not above 0")
        shapes[number] = ObjectShape(
            points=read_points(mesh) / bop.MM,
            diameter=diameter / bop.MM,
            symmetries=symmetries_of(entry, where),
        )
    return shapes, ""


def symmetries_of(entry: dict[str, Any], where: str) -> np.ndarray:
    """Return the symmetries (S, 4, 4) of an object, in metres, the identity first.

    Every discrete symmetry is followed by every turn about every continuous one. A continuous symmetry is
    taken in ⌈π / LARGEST_STEP⌉ equal turns, as BOP's toolkit does.

    Args:
        entry: the object's entry of models_info.json.
        where: the beginning of a message.

    Raises:
        InputError: a symmetry is malformed.
    """
    discrete = [np.eye(4)]
    for values in _listed(entry, "symmetries_discrete", where):
        motion = one_value({"symmetries_discrete": values}, "symmetries_discrete", 16, where).reshape(4, 4)
        check_rotation(motion[:3, :3], f"{where}: symmetries_discrete")
        discrete.append(_motion(motion[:3, :3], motion[:3, 3] / bop.MM))
    turns = []
    for values in _listed(entry, "symmetries_continuous", where):
        if not isinstance(values, dict):
            raise InputError(f"{where}: symmetries_continuous needs an axis and an offset")
        turns += _turns_about(
            one_value(values, "axis", 3, where), one_value(values, "offset", 3, where), where
        )
    motions = []
    for symmetry in discrete:
        for turn in turns or [np.eye(4)]:
            motions.append(turn @ symmetry)
    return np.stack(motions)


def _listed(entry: dict[str, Any], key: str, where: str) -> list:
    """Return the list under a key, or [] where there is none."""
    values = entry.get(key) or []
    if not isinstance(values, list):
        raise InputError(f"{where}: {key} is not a list")
    return values


def _turns_about(axis: np.ndarray, offset: np.ndarray, where: str) -> list[np.ndarray]:
    """Return the turns (4, 4), in metres, about a line along `axis` through `offset` (millimetres)."""
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise InputError(f"{where}: the axis of symmetries_continuous has no length")
    count = math.ceil(math.pi / LARGEST_STEP)
    turns = []
    for angle in 2 * math.pi / count * np.arange(count):
        R = Rotation.from_rotvec(angle * axis / length).as_matrix()
        turns.append(_motion(R, (offset - R @ offset) / bop.MM))
    return turns


def _motion(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the motion x → R x + t as a matrix (4, 4)."""
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = R, t
    return motion
