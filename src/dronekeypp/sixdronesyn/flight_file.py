"""Read a flight of 6DroneSyn, and check it against the digests of its flight.json.

A frame's digests are those of its picture, of its annotation, and of its depth image and masks, as far as the
data set has them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from dronekeypp.classes import DroneClass
from dronekeypp.errors import InputError
from dronekeypp.files import digest
from dronekeypp.schema import Count, Digest, FrameNumber, Name, Schema, read
from dronekeypp.sixdronesyn import bop, depth_files, scenes

NAME = "flight.json"
CHANGED = "the annotation is not the one that was generated (its digest differs)"
MEND = "delete its flight folder and run generate again"


class FlightFile(Schema):
    """This is a flight.json."""

    scene: Count
    motion: Name
    drone: Name
    take: Count
    environment: str
    turn_degrees: Literal[0, 90, 180, 270]
    seed: Count
    fps: Annotated[int, Field(ge=1)]
    digests: dict[FrameNumber, Annotated[list[Digest], Field(min_length=2)]]


def read_flight_file(folder: Path, images: int | None = None) -> dict[str, Any]:
    """Return what flight.json of a flight of 6DroneSyn says.

    Args:
        folder: of the flight.
        images: how many image files a frame of the data set has; None: any number.

    Raises:
        InputError: the file is missing or broken, or a frame has another number of digests.
    """
    path = folder / NAME
    about = read(FlightFile, path, MEND, "missing")
    for number, digests in about["digests"].items():
        if images is not None and len(digests) != 1 + images:
            raise InputError(
                f"{path}: digests.{number} has {len(digests)} digests, a frame {1 + images}; {MEND}"
            )
    return about


def read_own_flight(
    folder: Path,
    models: Mapping[int, DroneClass] | None,
    images: int | None = None,
) -> tuple[list[bop.Frame], dict[str, Any]]:
    """Read a flight of 6DroneSyn: its frames, in order, and its flight.json.

    Args:
        folder: of the flight.
        models: as in `bop.frames_from`.
        images: as in `read_flight_file`.

    Raises:
        InputError: a file is missing or broken, or an annotation is not the one that was generated.
    """
    about = read_flight_file(folder, images)
    entries = bop.read_entries(folder)
    frames = bop.frames_of(folder, entries, models, (scenes.WIDTH, scenes.HEIGHT))
    numbers = sorted(int(number) for number in about["digests"])
    if numbers != list(entries):
        other = sorted(set(numbers) ^ set(entries))[0]
        raise InputError(f"{folder}: {NAME} and {bop.SCENE_FILES[1]} differ in frame {other}; {MEND}")
    for number, (camera, truths, infos) in entries.items():
        entry = (camera, truths[0], infos[0])
        if len(truths) > 1 or frame_digest(entry) != about["digests"][str(number)][1]:
            raise InputError(f"{folder} frame {number}: {CHANGED}; {MEND}")
    return frames, about


def annotation_digest(entry: Any) -> str:
    """Return the digest of anything JSON can hold."""
    return digest(json.dumps(entry, separators=(",", ":")).encode())


def frame_digest(entry: tuple[dict, dict, dict]) -> str:
    """Return the digest of a frame's (camera, truth, info).

    What is counted in its masks does not belong to it: that follows from the renderer, the rest does not.
    """
    camera, truth, info = entry
    if "px_count_all" in info:
        info = {key: value for key, value in info.items() if key not in depth_files.counts(0, 0)}
    return annotation_digest((camera, truth, info))
