"""Keep the folder that a run writes to: its settings, its journal of frames, and the poses for BOP."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp.classes import DroneClass, names_of
from dronekeypp.errors import InputError
from dronekeypp.files import holds_nothing, read_json, remove_unfinished, write_beside, write_json
from dronekeypp.footage import BopScene
from dronekeypp.sixdronesyn.results import Estimate, results_csv

JOURNAL, POSES, SETTINGS = "frames.csv", "poses.csv", "settings.json"
VIDEO, PICTURE, TRAJECTORY = "overlay.mp4", "overlay.png", "trajectory.png"
FILES = (JOURNAL, POSES, SETTINGS, VIDEO, PICTURE, TRAJECTORY)  # all that a run writes
GOOD = "ok"  # the status of a frame with a pose; any other says why there is none

BOX = ("box_x", "box_y", "box_w", "box_h")
KEYPOINTS = ("kp0_x", "kp0_y", "kp1_x", "kp1_y", "kp2_x", "kp2_y", "kp3_x", "kp3_y")
ROTATION = ("R00", "R01", "R02", "R10", "R11", "R12", "R20", "R21", "R22")
TRANSLATION = ("tx", "ty", "tz")
SIGMAS = ("turn_sigma_deg", "shift_sigma_m")
COLUMNS = (
    *("frame", "name", "status", *BOX, "drone", "score", "doubt_px"),
    *(*KEYPOINTS, *ROTATION, *TRANSLATION, "seconds", *SIGMAS),
)
Row = dict[str, str]  # of the journal, by column; a column without a value is empty


@dataclass(frozen=True)
class Pose:
    """Hold what was found in one frame, in full-frame pixels and metres.

    All values are those of the undistorted frame, but for the box, which is the one that was given.

    Attributes:
        frame: the frame's number, from 0.
        box: (4,) x, y, w, h in pixels.
        drone: the class's name.
        score: the class's probability.
        doubt_px: by how many pixels the keypoints move when the crop is mirrored (`mirror_doubt`).
        keypoints: (4, 2) pixels.
        R: (3, 3) camera←body.
        t: (3,) metres, camera axes.
        seconds: the network's time for this frame, beside other frames.
        turn_sigma_deg, shift_sigma_m: the deviations that a network with pose="geometric" claims for R and t
            (root of the trace), in degrees and metres; NaN for any other network.
    """

    frame: int
    box: np.ndarray
    drone: str
    score: float
    doubt_px: float
    keypoints: np.ndarray
    R: np.ndarray
    t: np.ndarray
    seconds: float
    turn_sigma_deg: float
    shift_sigma_m: float


def check_folder(out: Path) -> dict[str, Any]:
    """Return the settings of the run in the folder `out`, or {} for an empty folder.

    Raises:
        InputError: The folder holds anything else. Then we may not write to it.
    """
    settings = read_json(out / SETTINGS, mend="choose another folder") if (out / SETTINGS).is_file() else {}
    if isinstance(settings, dict) and {"checkpoint", "footage"} <= settings.keys():
        return settings
    if not holds_nothing(out, FILES):
        raise InputError(f"{out} is not empty and not a run of predict: choose another folder")
    return {}


def begin(out: Path, settings: dict[str, Any], drones: Sequence[DroneClass]) -> int:
    """Take up the run in `out`, or begin one: write the settings, and the journal as far as it is whole.

    Returns:
        The number of frames in the journal.

    Raises:
        InputError: The run was begun with other settings, or the folder holds something else.
    """
    old = check_folder(out)
    remove_unfinished(out, FILES)
    journal = out / JOURNAL
    begun = journal.is_file() and journal.read_bytes().count(b"\n") > 1  # more than its header
    for name, value in settings.items():
        if name == "drones" and name not in old:  # an older run did not write down the network's drones
            continue
        if begun and old.get(name) != value:
            raise InputError(f"{out} was begun with another {name}; choose another folder, or remove it")
    rows = read_journal(journal, names_of(drones)) if begun else []
    write_json(out / SETTINGS, settings, indent=1)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_beside(journal, text.getvalue().encode(errors="surrogateescape"))
    return len(rows)


def read_journal(path: Path, drones: Sequence[str]) -> list[Row]:
    """Read the rows of a journal as far as they are whole, in order and can be read.

    Args:
        path: the journal.
        drones: the names of the network's drones. A row with another name ends the journal.

    Raises:
        InputError: The file is not a journal.
    """
    with open(path, newline="", encoding="utf-8", errors="surrogateescape") as file:
        text = file.read()
    table = csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1]))
    if tuple(table.fieldnames or COLUMNS) != COLUMNS:
        raise InputError(f"{path} is not a journal of predict: choose another folder")
    rows: list[Row] = []
    try:
        for row in table:
            complete = None not in row and None not in row.values()
            if not complete or row["frame"] != str(len(rows)):
                break
            pose = to_pose(row)
            if pose and not (pose.drone in drones and _is_finite(pose)):
                break
            if pose is None and any(row[column] for column in KEYPOINTS):
                break  # its status is not the one that was written
            rows.append(row)
    except (ValueError, csv.Error):
        pass  # what cannot be read is done again
    return rows


def _is_finite(pose: Pose) -> bool:
    """Tell whether all numbers of a pose are, but for deviations that were not claimed."""
    numbers = (pose.box, pose.score, pose.doubt_px, pose.keypoints, pose.R, pose.t, pose.seconds)
    return all(np.isfinite(value).all() for value in numbers)


def to_pose(row: Row) -> Pose | None:
    """Turn a row of the journal into numbers, or return None where the frame has no pose.

    Raises:
        ValueError: A number cannot be read.
    """
    if row["status"] != GOOD:
        return None

    def numbers(columns: Sequence[str]) -> np.ndarray:
        return np.array([float(row[column]) for column in columns])

    return Pose(
        frame=int(row["frame"]),
        box=numbers(BOX),
        drone=row["drone"],
        score=float(row["score"]),
        doubt_px=float(row["doubt_px"]),
        keypoints=numbers(KEYPOINTS).reshape(4, 2),
        R=numbers(ROTATION).reshape(3, 3),
        t=numbers(TRANSLATION),
        seconds=float(row["seconds"]),
        turn_sigma_deg=float(row["turn_sigma_deg"] or "nan"),
        shift_sigma_m=float(row["shift_sigma_m"] or "nan"),
    )


def bop_results(poses: Sequence[Pose], numbers: Mapping[str, int], scene: BopScene | None = None) -> str:
    """Return poses in BOP's results format.

    Args:
        poses: the poses.
        numbers: the object number of each drone, by its name.
        scene: the scene of a BOP data set that they are of. Without one, the scene is 0 and images have the
            footage's frame numbers.
    """
    estimates = []
    for pose in poses:
        estimates.append(
            Estimate(
                scene=scene.number if scene else 0,
                image=scene.images[pose.frame] if scene else pose.frame,
                number=numbers[pose.drone],
                score=pose.score,
                R=pose.R,
                t=pose.t,
                seconds=pose.seconds,
            )
        )
    return results_csv(estimates)
