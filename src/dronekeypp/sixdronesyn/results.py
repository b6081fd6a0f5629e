"""Write poses in BOP's results format, which its toolkit scores.

A line holds scene_id, im_id, obj_id, score, R, t and time: R row by row, t in millimetres, time in seconds
for the whole image. The toolkit reads method, data set and split from the file's name:
METHOD_DATASET-SPLIT.csv.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dronekeypp.classes import DroneClass, names_of
from dronekeypp.sixdronesyn.bop import MM

HEADER = "scene_id,im_id,obj_id,score,R,t,time"
UNKNOWN_TIME = -1.0  # as BOP writes it


@dataclass(frozen=True, eq=False)
class Estimate:
    """This is one estimated pose.

    Attributes:
        scene, image, number: of the scene, of the image in it, and of the object.
        score: how sure the method is, the larger the surer.
        R, t: (3, 3) and (3,) camera←body, metres.
        seconds: for the whole image, or UNKNOWN_TIME.
    """

    scene: int
    image: int
    number: int
    score: float
    R: np.ndarray
    t: np.ndarray
    seconds: float = UNKNOWN_TIME


def results_csv(estimates: Iterable[Estimate]) -> str:
    """Return estimates as a results file."""
    lines = [HEADER]
    for estimate in estimates:
        seconds = "-1" if estimate.seconds < 0 else f"{estimate.seconds:.5f}"
        lines.append(
            f"{estimate.scene},{estimate.image},{estimate.number},{estimate.score:.4f},"
            f"{_numbers_text(estimate.R)},{_numbers_text(MM * estimate.t)},{seconds}"
        )
    return "\n".join(lines) + "\n"


def _numbers_text(values: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in np.asarray(values).ravel())


def object_numbers(drones: Sequence[DroneClass], objects: Mapping[int, DroneClass]) -> list[int]:
    """Return the object number of each class of a network in a data set.

    Classes and objects are compared by name. A drone that the data set does not have gets a number behind its
    last object, which is no object of it. Where nothing is known of the objects, a class has its index plus
    1.

    Args:
        drones: the classes of the network.
        objects: the objects of the data set, by number; {} where nothing is known of them.
    """
    number_of = {drone.name: number for number, drone in objects.items()}
    numbers, free = [], max(objects, default=0) + 1
    for name in names_of(drones):
        if name in number_of:
            numbers.append(number_of[name])
        else:
            numbers.append(free)
            free += 1
    return numbers
