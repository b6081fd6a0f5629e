"""Tell what the numbers of YOLO's lines mean: boxes, keypoints, outlines; scores and tracks behind them.

The lines do not say it. How many numbers there are leaves several readings, and a wrong one gives a wrong box
without a word. So all lines of a folder are looked at together, as one program wrote them, and what stays
unclear is refused. In this module a line is its numbers behind the class, and the tail of a line is what
follows the numbers of the shape: nothing, a confidence, a track, or both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.keypoints import keypoint_shape
from dronekeypp.footage.boxes.text import NumberLine

LONGEST_BOX = 6  # numbers: cx cy w h confidence track
SHORTEST_OUTLINE = 8  # numbers: four corners
BEYOND = 0.5  # of the picture: so far may the corner of an oriented box lie outside it


class Meaning(NamedTuple):
    """Hold what a line says: a box (x, y, w, h) in shares of the picture, a score and a track where given."""

    box: tuple[float, float, float, float]
    score: float | None
    track: int | None


class _Split(NamedTuple):
    """Hold a line, its box in shares, and its tail."""

    where: str
    box: tuple[float, float, float, float]
    tail: list[float]


def meanings(lines: Sequence[NumberLine]) -> list[Meaning]:
    """Return what each line of a folder says.

    Raises:
        InputError: A line has too few numbers, or others than the rest, or it stays unclear what they are.
    """
    for where, values in lines:
        if len(values) < 4 or LONGEST_BOX < len(values) < SHORTEST_OUTLINE:
            raise InputError(
                f"{where}: {len(values)} numbers behind the class; "
                "a YOLO line is class cx cy w h [confidence [track]]"
            )
    boxes = [line for line in lines if len(line.values) <= LONGEST_BOX]
    long = [line for line in lines if len(line.values) > LONGEST_BOX]
    per_box = keypoint_shape(long)
    if per_box:
        split_long = [_split_at(line, 4 + per_box) for line in long]
    else:
        split_long = _split_outlines(long)
    found = _read_tails([_split_at(line, 4) for line in boxes])
    found |= _read_tails(split_long)
    return [found[line.where] for line in lines]


def _split_at(line: NumberLine, count: int) -> _Split:
    """Split a line behind its first `count` numbers, which begin with the box's centre and size."""
    cx, cy, w, h = line.values[:4]
    return _Split(line.where, (cx - w / 2, cy - h / 2, w, h), line.values[count:])


def _split_outlines(lines: Sequence[NumberLine]) -> list[_Split]:
    """Split outlines x1 y1 x2 y2 … from their tails. The box is the one around all points.

    An outline has an even count of numbers. So an odd one tells of one number behind it, and an even one of
    none or two.
    """
    even = [line.values for line in lines if len(line.values) % 2 == 0]
    both = bool(even) and all(_is_confidence(values[-2]) and _is_track(values[-1]) for values in even)
    found = []
    for where, values in lines:
        count = len(values) - (1 if len(values) % 2 else 2 * both)
        points = np.reshape(values[:count], (-1, 2))
        if count < SHORTEST_OUTLINE or points.min() < -BEYOND or points.max() > 1 + BEYOND:
            raise InputError(f"{where}: neither a box, nor keypoints, nor an outline, in shares")
        (x, y), (high_x, high_y) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        found.append(_Split(where, (x, y, high_x - x, high_y - y), values[count:]))
    return found


def _read_tails(lines: Sequence[_Split]) -> dict[str, Meaning]:
    """Return the meaning of lines of one shape, by their places.

    A program writes the confidence for every line or for none. A tracker writes a track for those lines that
    have one.

    Raises:
        InputError: The tails of the lines are not of one program.
    """
    counts = {len(line.tail) for line in lines}
    ones = [line.tail[0] for line in lines if len(line.tail) == 1]
    # Confidences of 1 and tracks of 1 look the same. Alone they matter to nobody.
    tracks_alone = 2 not in counts and all(map(_is_track, ones)) and (0 in counts or any(n > 1 for n in ones))
    found = {}
    for where, box, tail in lines:
        score, track = (tail[0] if tail else None), (tail[1] if len(tail) == 2 else None)
        if len(tail) == 1 and tracks_alone:
            score, track = None, tail[0]
        if score is not None and not _is_confidence(score):
            raise InputError(f"{where}: the confidence {score:g} does not lie between 0 and 1")
        if track is not None and not _is_track(track):
            raise InputError(f"{where}: the track {track:g} is no whole number from 1")
        mixed = 0 in counts and score is not None
        if mixed or (len(tail) == 1 and 2 in counts and _is_track(tail[0])):
            raise InputError(
                f"{where}: {4 + len(tail)} numbers of a box, other lines have more or fewer; "
                "is one missing? Write the confidence for all or for none"
            )
        found[where] = Meaning(box, score, None if track is None else int(track))
    return found


def _is_confidence(value: float) -> bool:
    return 0 <= value <= 1


def _is_track(value: float) -> bool:
    return value >= 1 and value == int(value)
