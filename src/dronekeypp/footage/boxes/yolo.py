"""Read YOLO's text labels, one file a picture: shares of the picture, a line a thing.

    0 0.676 0.493 0.141 0.075                         class cx cy w h
    0 0.676 0.493 0.141 0.075 0.9 7                   … confidence track, as `save_txt save_conf` and `track`
    0 0.676 0.493 0.141 0.075 0.62 0.47 2 …           … keypoints
    0 0.605 0.456 0.746 0.456 0.746 0.531 0.605 0.531 class x1 y1 … x4 y4, an oriented box
    0 0.598 0.456 0.640 0.471 0.668 0.493 …           class x1 y1 x2 y2 …, an outline

Oriented boxes and outlines become the box around them. A file classes.txt, as labelImg writes it, names the
classes. References: https://docs.ultralytics.com/datasets/ with detect, segment, obb and pose, and
`Results.save_txt` of Ultralytics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import BoxFile, BoxRow, Kind, Picture, as_box, as_whole
from dronekeypp.footage.boxes.text import NumberLine, number_lines, read_text, refuse_cut
from dronekeypp.footage.boxes.yolo_lines import meanings

FORMAT = "YOLO"
CLASSES = ("classes", "_classes", "predefined_classes")  # files with the classes' names, one a line
FARTHEST = 2.0  # no share of a picture is larger, a pixel is


def read_yolo(path: Path, files: Sequence[Path], width: int, height: int) -> BoxFile:
    """Read labels, each of one picture.

    A file of a picture that is not of the footage may be anything.

    Args:
        path: the file, or the folder where the files lie.
        files: the label files.
        width, height: the frames' size, pixels.

    Raises:
        InputError: It cannot be told what the lines are.
    """
    content = BoxFile(path, FORMAT, named=True)
    labels = [file for file in files if file.stem not in CLASSES]
    texts, faults = _texts(labels)
    ends = any(text.endswith("\n") for text in texts.values())
    lines: list[NumberLine] = []
    owners: list[int] = []  # of each line: the index of its picture
    for index, file in enumerate(labels):
        if file in texts:
            try:
                refuse_cut(file, texts[file], ends)
                read = number_lines(file, texts[file], None)
                _refuse_pixels(read)
                lines += read
                owners += [index] * len(read)
            except InputError as error:
                faults[file] = str(error)
        content.pictures.append(Picture(file.stem, str(file), None, faults.get(file, "")))
    names = _class_names(files)
    shapes = meanings([NumberLine(line.where, line.values[1:]) for line in lines])
    for line, picture, shape in zip(lines, owners, shapes, strict=True):
        x, y, w, h = shape.box
        pixels = (x * width, y * height, w * width, h * height)
        box = as_box(pixels if any(shape.box) else (), line.where, pixels=False)
        number = as_whole(line.values[0], "class", line.where)
        kind = Kind(str(number), names.get(number))
        track = None if shape.track is None else str(shape.track)
        content.rows.append(BoxRow(line.where, picture, box, shape.score, kind, track))
    return content


def _texts(files: Sequence[Path]) -> tuple[dict[Path, str], dict[Path, str]]:
    """Return the text of each file, and of those that cannot be read what is wrong with them."""
    texts, faults = {}, {}
    for file in files:
        try:
            texts[file] = read_text(file)
        except InputError as error:
            faults[file] = str(error)
    return texts, faults


def _refuse_pixels(lines: Sequence[NumberLine]) -> None:
    """Refuse lines whose box is in pixels, or whose numbers are not finite."""
    for where, values in lines:
        box = values[1:5]
        if not all(map(math.isfinite, values)) or max(map(abs, box), default=0) > FARTHEST:
            raise InputError(
                f"{where}: {box} are not shares of the picture, from 0 to 1, as YOLO writes them"
            )


def _class_names(files: Sequence[Path]) -> Mapping[int, str]:
    """Return the names of the classes by number, where a file beside the labels holds them."""
    for file in files:
        if file.stem in CLASSES:
            names = [name.strip() for name in read_text(file).splitlines()]
            return {number: name for number, name in enumerate(names) if name}
    return {}
