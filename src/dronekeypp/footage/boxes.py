"""Read boxes of the drone, one for each frame, from the files that detectors and annotation tools write."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.box_formats import BoxRow, read_coco, read_csv, read_mot, read_yolo, read_yolo_folder

SLIVER = 1.0  # pixels: what a detector leaves of a box at the frame's edge


def read_boxes(
    path: str | Path, names: tuple[str, ...], width: int, height: int, folder: str | Path = "."
) -> dict[int, np.ndarray]:
    """Read one box for each frame.

    Of several boxes in a frame the most confident counts. The format follows from the file:
        COCO    .json: a list of detections, or a data set with images and annotations
        YOLO    a folder with one .txt a frame, named like the frame, or NAME_1.txt, NAME_2.txt … for a video;
                one .txt without commas for one image. A line: class cx cy w h [confidence], shares of the
                frame
        MOT     .txt with commas: frame, id, x, y, w, h, confidence …, frames from 1
        CSV     .csv with a header: frame (all file names, or all numbers from 0), x, y, w, h[, score]

    Args:
        path: the file or folder of boxes.
        names: the footage's frames (`Footage.names`).
        width, height: the frames' size, pixels.
        folder: where the footage lies (`Footage.folder`). Of a COCO data set of several flights, those images
            are meant that lie there.

    Returns:
        {frame number: box (x, y, w, h) in pixels}, in the order of the frames.

    Raises:
        InputError: The path is not found, it is not one of these formats, or a line is not valid (the message
            names the line).
    """
    path = Path(path)
    best: dict[int, tuple[float, np.ndarray]] = {}
    for row in _rows(path, names, width, height, folder):
        box = check_box(row.box, width, height, row.where)
        if box[2:].min() < SLIVER:
            continue
        if row.frame < 0:
            raise InputError(f"{row.where}: frame {row.frame}; the first is number 0")
        if not np.isfinite(row.score):
            raise InputError(f"{row.where}: the score is {row.score}")
        if row.frame >= len(names):
            continue
        if row.frame not in best or row.score > best[row.frame][0]:
            best[row.frame] = (row.score, box)
    if not best:
        raise InputError(
            f"{path}: no box for any of the {len(names)} frames; "
            f"the first is number 0 and is called {names[0]}"
        )
    return {frame: best[frame][1] for frame in sorted(best)}


def _rows(
    path: Path, names: tuple[str, ...], width: int, height: int, folder: str | Path
) -> Iterable[BoxRow]:
    """Yield all boxes of a file or folder, by its format."""
    frame_of = {name: number for number, name in enumerate(names)}
    for number, name in enumerate(names):
        frame_of[Path(name).stem] = number
    if path.is_dir():
        return read_yolo_folder(path, names, frame_of, width, height)
    if not path.is_file():
        raise InputError(f"{path}: boxes not found")
    if path.suffix.lower() == ".json":
        return read_coco(path, frame_of, _places(folder, names))
    if path.suffix.lower() == ".csv":
        return read_csv(path, frame_of)
    if "," in path.read_text(errors="replace").split("\n", 1)[0]:
        return read_mot(path)
    return read_yolo(path, 0, width, height)


def _places(folder: str | Path, names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return for every frame its path without suffix, as given and with links resolved."""
    given, resolved = Path(os.path.abspath(folder)), Path(folder).resolve()
    places = []
    for name in names:
        as_given = (given / name).with_suffix("").as_posix()
        places.append((as_given, (resolved / name).with_suffix("").as_posix()))
    return places


def check_box(box: Sequence[float] | np.ndarray, width: int, height: int, where: str) -> np.ndarray:
    """Return the box (x, y, w, h) as a float64 array (4,).

    Raises:
        InputError: The box is not finite, has no area, or lies wholly outside the frame of `width` × `height`
            pixels. The message begins with `where`.
    """
    box = np.array(box, dtype=np.float64)
    if box.shape != (4,) or not np.isfinite(box).all() or box[2] <= 0 or box[3] <= 0:
        raise InputError(
            f"{where}: a box needs four finite numbers, width and height above 0, got {box.tolist()}"
        )
    if np.abs(box).max() <= 1:
        raise InputError(f"{where}: {box.tolist()} are shares of the frame; pixels are needed")
    if box[0] >= width or box[1] >= height or box[0] + box[2] <= 0 or box[1] + box[3] <= 0:
        raise InputError(f"{where}: the box {box.tolist()} lies outside the {width}×{height} frame")
    return box
