"""Provide one reader for each format of boxes, among which `boxes.read_boxes` chooses.

Each yields one `BoxRow` for each box. Every reader raises InputError, naming file and line, for what is not
of its format.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.files import read_json

CSV_COLUMNS = ("frame", "x", "y", "w", "h")


class BoxRow(NamedTuple):
    """Hold one box of a file."""

    where: str  # its file and line, for messages
    frame: int  # the number of its frame, from 0
    box: Sequence[float]  # x, y, w, h in pixels
    score: float  # how sure the detector is, on any scale


# --- YOLO and MOT: numbers in lines -----------------------------------------------------------------------


def read_yolo_folder(
    folder: Path, names: tuple[str, ...], frame_of: Mapping[str, int], width: int, height: int
) -> Iterator[BoxRow]:
    """Read a folder with one label file for each frame.

    Files of other names, such as classes.txt, are passed over.
    """
    for file in sorted(folder.glob("*.txt")):
        frame = _labelled_frame(file.stem, names, frame_of)
        if frame >= 0:
            yield from read_yolo(file, frame, width, height)


def _labelled_frame(stem: str, names: tuple[str, ...], frame_of: Mapping[str, int]) -> int:
    """Return the frame number of a YOLO label file, or -1 if it belongs to none of the footage's frames.

    Detectors call the label files of a video NAME_1, NAME_2 …
    """
    number = re.search(r"_(\d+)$", stem)
    if stem not in frame_of and names[0] == "000000" and number:
        return int(number[1]) - 1
    return frame_of.get(stem, -1)


def read_yolo(path: Path, frame: int, width: int, height: int) -> Iterator[BoxRow]:
    """Read the boxes of one frame: class cx cy w h [confidence [track]], as shares of the frame."""
    for where, values in _lines(path, None):
        if len(values) < 5:
            raise InputError(f"{where}: a YOLO line is class cx cy w h [confidence]")
        cx, cy, w, h = np.array(values[1:5]) * [width, height, width, height]
        score = values[5] if len(values) in (6, 7) else 1.0  # longer lines hold keypoints, not a confidence
        yield BoxRow(where, frame, (cx - w / 2, cy - h / 2, w, h), score)


def read_mot(path: Path) -> Iterator[BoxRow]:
    """Read a MOT file with the columns frame (from 1), id, x, y, w, h[, confidence …]."""
    for where, values in _lines(path, ","):
        if len(values) < 6:
            raise InputError(f"{where}: a MOT line is frame, id, x, y, w, h[, confidence …]")
        if not np.isfinite(values).all():
            raise InputError(f"{where}: not finite")
        if values[0] < 1:
            raise InputError(f"{where}: frame {values[0]:g}; MOT counts from 1")
        score = values[6] if len(values) > 6 else 1.0
        yield BoxRow(where, int(values[0]) - 1, values[2:6], score)


def _lines(path: Path, separator: str | None) -> Iterator[tuple[str, list[float]]]:
    """Yield the place and the numbers of each line that is not empty."""
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        if not line.strip():
            continue
        where = f"{path} line {number}"
        try:
            values = [float(part) for part in line.split(separator)]
        except ValueError:
            raise InputError(f"{where}: not numbers: {line.strip()[:60]!r}") from None
        yield where, values


# --- CSV --------------------------------------------------------------------------------------------------


def read_csv(path: Path, frame_of: Mapping[str, int]) -> Iterator[BoxRow]:
    """Read a table with the header frame, x, y, w, h[, score]."""
    rows = _csv_rows(path)
    # "12" may be a name or a number, but not both in one file.
    by_name = all(row["frame"] in frame_of for row in rows)
    for number, row in enumerate(rows, 2):
        where = f"{path} line {number}"
        try:
            frame = frame_of[row["frame"]] if by_name else int(row["frame"])
            box = [float(row[key]) for key in "xywh"]
            score = float(row.get("score") or 1.0)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"{where}: not a frame of the footage and four numbers: {row}") from None
        yield BoxRow(where, frame, box, score)


def _csv_rows(path: Path) -> list[dict[str, str]]:
    # Excel writes a mark in front, which utf-8-sig takes away.
    with open(path, newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.DictReader(file)
        try:
            header = reader.fieldnames or ()
            if not set(CSV_COLUMNS) <= set(header):
                raise InputError(
                    f"{path}: the header needs frame, x, y, w, h[, score]; "
                    f"it has {', '.join(header) or 'nothing'}"
                )
            return list(reader)
        except csv.Error as error:
            raise InputError(f"{path}: not CSV ({error})") from None


# --- COCO -------------------------------------------------------------------------------------------------


def read_coco(path: Path, frame_of: Mapping[str, int], places: Sequence[tuple[str, str]]) -> Iterator[BoxRow]:
    """Read a COCO list of detections, or a COCO data set with images and annotations.

    `places` holds for every frame its path without suffix, as given and with links resolved.
    """
    content = read_json(path)
    entries, frames = content, {}
    if isinstance(content, dict):
        frames = _frames_of_images(path, content.get("images"), frame_of, places)
        entries = content.get("annotations")
    if not isinstance(entries, list):
        raise InputError(f"{path}: neither a COCO list of detections nor a COCO data set")
    for number, entry in enumerate(entries):
        where = f"{path} entry {number}"
        try:
            frame = _annotated_frame(entry["image_id"], frames, frame_of)
            if frame is None:  # an image of another flight
                continue
            box = [float(value) for value in entry["bbox"]]
            score = float(entry.get("score", 1.0))
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputError(
                f"{where}: needs image_id (a frame of the footage) and bbox [x, y, w, h]"
            ) from None
        yield BoxRow(where, frame, box, score)


def _annotated_frame(
    image_id: Any, frames: Mapping[Any, int | None], frame_of: Mapping[str, int]
) -> int | None:
    """Return the frame that an annotation belongs to.

    Without a list of images, its id is a name or a number.
    """
    if frames:
        return frames[image_id]
    return frame_of[image_id] if isinstance(image_id, str) else int(image_id)


def _frames_of_images(
    path: Path, images: Any, frame_of: Mapping[str, int], places: Sequence[tuple[str, str]]
) -> dict[int | float | str, int | None]:
    """Return {id of an image: the frame of the footage that it is, or None where it is none}.

    Where the images of several flights have a frame's name, those count whose folders are the footage's.
    """
    frames: dict[int | float | str, int | None] = {}
    candidates: dict[int, dict[int | float | str, str]] = {}  # of each frame: {id of an image: its name}
    for image in images if isinstance(images, list) else []:
        if not isinstance(image, dict) or not isinstance(image.get("id"), int | float | str):
            raise InputError(f"{path}: an image without id and file_name: {image!r}")
        file = Path(str(image.get("file_name", "")))
        frame = frame_of.get(file.name, frame_of.get(file.stem))
        frames[image["id"]] = None
        if frame is not None:
            candidates.setdefault(frame, {})[image["id"]] = file.as_posix()
    for frame, name_of in candidates.items():
        chosen = set(name_of.values())
        if len(chosen) > 1:
            chosen = {name for name in chosen if _lies_at(name, places[frame])}
        if len(chosen) != 1:
            raise InputError(
                f"{path}: {len(name_of)} images could be {places[frame][0]}; give file_name with its folders"
            )
        for image_id, name in name_of.items():
            if name in chosen:
                frames[image_id] = frame
    return frames


def _lies_at(name: str, places: tuple[str, str]) -> bool:
    """Tell whether a file_name of COCO ends like one of the places of a frame, folders included."""
    tail = "/" + Path(name).with_suffix("").as_posix().lstrip("/")
    return any(place.endswith(tail) for place in places)
