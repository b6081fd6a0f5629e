"""Describe the drones that a network or a data set knows: their names, and where their hubs are.

A class index means nothing by itself. So a data set says which drone each of its classes is, and a checkpoint
says which drones it was trained on. The two are compared by the drones' names and by the digests of their
hubs.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from dronekeypp.errors import InputError
from dronekeypp.files import digest
from dronekeypp.schema import Digest, Name, Point, Schema, check

# The seven drones of 6DroneSyn, in class order. A checkpoint of the first edition does not name its classes.
FIRST_EDITION = ("Mini3", "Mini2", "Air3", "Air2", "Mav2", "Mav3", "Tello")
SYMMETRY = 0.01  # of the wheelbase: how far hubs may be from left–right symmetric
LARGEST, SMALLEST = 2.0, 0.02  # metres, of the hub that lies farthest from the origin


class ClassEntry(Schema):
    """This is what a checkpoint says of one of its classes, see `DroneClass.to_dict`."""

    name: Name
    label: str | None = None
    hubs: Annotated[list[Point], Field(min_length=4, max_length=4)] | None
    hubs_digest: Digest | None


@dataclass(frozen=True, eq=False)
class DroneClass:
    """This is one class: a drone's name and, where they are known, its propeller hubs.

    Attributes:
        name: the drone's name. A class without a name of its own is called by its number.
        hubs: (4, 3) metres in body axes, in keypoint order: front-left, front-right, rear-right, rear-left.
            None where they are not known.
        label: the name that is shown to people; empty where it is `name`.
    """

    name: str
    hubs: np.ndarray | None = field(default=None, repr=False)
    label: str = ""

    @property
    def title(self) -> str:
        """Return the name that is shown to people."""
        return self.label or self.name

    @property
    def digest(self) -> str | None:
        """Return a digest that tells these hubs from others, or None without hubs.

        It is that of the coordinates in tenths of a millimetre.
        """
        if self.hubs is None:
            return None
        tenths = np.rint(np.round(np.asarray(self.hubs, dtype=float), 5) * 1e4).astype(int)
        return digest(json.dumps(tenths.tolist()).encode())

    @property
    def wheelbase(self) -> float | None:
        """Return the distance in metres from the front-left to the rear-right hub, or None without hubs."""
        return None if self.hubs is None else float(np.linalg.norm(self.hubs[0] - self.hubs[2]))

    @property
    def asymmetry(self) -> float | None:
        """Return by how many metres the hubs miss being left–right symmetric, or None without hubs."""
        if self.hubs is None:
            return None
        mirrored = self.hubs[[1, 0, 3, 2]] * [1, -1, 1]
        return float(np.abs(mirrored - self.hubs).max())

    def to_dict(self) -> dict[str, Any]:
        """Return the class as JSON can hold it, with its hubs rounded to a hundredth of a millimetre."""
        hubs = None if self.hubs is None else np.round(np.asarray(self.hubs, dtype=float), 5).tolist()
        return {"name": self.name, "label": self.title, "hubs": hubs, "hubs_digest": self.digest}

    @classmethod
    def from_dict(cls, values: Any) -> DroneClass:
        """Read what `to_dict` wrote.

        Raises:
            InputError: the values are not those of a class, or the hubs do not have the digest that is
                stored.
        """
        check(ClassEntry, values, "a class of drones")
        hubs = None if values["hubs"] is None else np.array(values["hubs"], dtype=float)
        drone = cls(values["name"], hubs, values.get("label") or "")
        stored = values["hubs_digest"]
        if stored != drone.digest:
            raise InputError(f"the hubs of {drone.name} were changed: their digest is not {stored}")
        return drone


def unnamed(count: int) -> tuple[DroneClass, ...]:
    """Return `count` classes of which nothing is known but their number."""
    return tuple(DroneClass(f"class {number}") for number in range(count))


def are_named(classes: Sequence[DroneClass]) -> bool:
    """Say whether anything is known of classes but their number."""
    return names_of(classes) != names_of(unnamed(len(classes)))


def check_hubs(hubs: np.ndarray, where: str) -> None:
    """Check that four hubs are in metres and in keypoint order.

    Raises:
        InputError: they are not (4, 3) finite numbers, too large or too small for a drone, or in another
            order. The message begins with `where`.
    """
    hubs = np.asarray(hubs)
    if hubs.shape != (4, 3) or not np.isfinite(hubs).all():
        raise InputError(f"{where}: hubs {hubs.shape}, four points of three numbers are needed")
    farthest = float(np.abs(hubs).max())
    if not SMALLEST < farthest < LARGEST:
        raise InputError(f"{where}: a hub {farthest:g} m from the middle: is the unit right?")
    x, y = hubs[:, 0], hubs[:, 1]
    if not (min(x[0], x[1]) > max(x[2], x[3]) and min(y[0], y[3]) > max(y[1], y[2])):
        raise InputError(
            f"{where}: hubs in the order front-left, front-right, rear-right, rear-left, "
            "with x forward and y to the left"
        )


def names_of(classes: Sequence[DroneClass]) -> list[str]:
    """Return the names of classes, in class order."""
    return [drone.name for drone in classes]


def same_drone(a: DroneClass, b: DroneClass) -> bool:
    """Say whether two classes are one drone.

    They are, if they have the same name and, where both know their hubs, the same hubs.
    """
    if a.name != b.name:
        return False
    return a.digest is None or b.digest is None or a.digest == b.digest


def match(classes: Sequence[DroneClass], known: Sequence[DroneClass]) -> list[int | None]:
    """Find each of `classes` among the `known` ones.

    Returns:
        for each of `classes` its index among the known ones, or None where it is not among them.
    """
    indices: list[int | None] = []
    for drone in classes:
        index = next((i for i, other in enumerate(known) if same_drone(drone, other)), None)
        indices.append(index)
    return indices
