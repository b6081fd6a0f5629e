"""Doubt boxes that can be read without an error, and may mean something else.

Corners x1, y1, x2, y2 where x, y, w, h belong, boxes of smaller pictures or in per cent, and pictures of a
video that were taken every n-th and numbered one after the other: each of these makes wrong poses without a
sign of it. What cannot be right is refused; what may be is said in the closing line.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from dronekeypp.errors import InputError

ENOUGH = 3  # boxes: fewer lie anywhere by chance
BEYOND = 0.1  # of the frame: so far do boxes reach over its edge that cannot be the drone's


def check_corners(path: str | Path, boxes: np.ndarray, size: tuple[int, int], centred: bool) -> list[str]:
    """Find out whether boxes are corners that were written where a place and a size belong.

    The second of two corners lies right of and below the first, so every box would be wider than its x and
    higher than its y.

    Args:
        path: the file or the option, for messages.
        boxes: (N, 4) all boxes of the file as they were read, x, y, w, h in pixels of the frames.
        size: width and height of the frames, pixels.
        centred: whether the file gives the centre of a box in place of its corner.

    Returns:
        What to say of them; nothing, if they are no corners.

    Raises:
        InputError: They are. Each would lie in the frame as two corners, and one reaches far over its edge.
    """
    if len(boxes) == 0:
        return []
    low, sides = boxes[:, :2], boxes[:, 2:]
    first = low + sides / 2 if centred else low
    if not np.all((first >= 0) & (sides > first) & (sides <= size)):
        return []
    wanted = "the centre and the size cx, cy, w, h" if centred else "a corner and the size x, y, w, h"
    reach = (low + sides - size) / size
    if reach.max() > BEYOND:
        raise InputError(f"{path}: its boxes seem to be two corners x1, y1, x2, y2; {wanted} are needed")
    if len(boxes) < ENOUGH:
        return []
    return [f"are its boxes two corners x1, y1, x2, y2? They are read as {wanted}"]


def remark_on_quarter(boxes: np.ndarray, size: tuple[int, int]) -> list[str]:
    """Return what to say of boxes (N, 4) of pictures of unknown size, all in the frames' upper left quarter.

    `size` is the frames' width and height, pixels.
    """
    ends = boxes[:, :2] + boxes[:, 2:]
    if len(boxes) < ENOUGH or np.any(ends > np.array(size) / 2):
        return []
    return ["all boxes lie in the upper left quarter of the frames: are they of smaller pictures, or in %?"]


def remark_on_outside(outside: int) -> list[str]:
    """Return what to say of so many boxes with their centre outside the frame. Detectors give none."""
    if outside < ENOUGH:
        return []
    return [f"{outside} boxes lie outside the frames: are all of them of another resolution?"]


def remark_on_first(numbers: Collection[int], first: int, format_says: int | None) -> list[str]:
    """Return what to say of frame numbers of a format that counts from 0, if the first of them is 1."""
    if format_says == 0 and first == 0 and min(numbers) == 1:
        return [
            "its frame numbers begin with 1 and were counted from 0; if they count from 1: --count-from 1"
        ]
    return []


def remark_on_sampling(numbers: Collection[int], first: int, frames: int) -> list[str]:
    """Return what to say of pictures of a video whose numbers have no gap and end before the video does.

    Args:
        numbers: those of the pictures.
        first: the number of the first frame.
        frames: how many the video has.
    """
    low, high = min(numbers), max(numbers)
    if low != first or high - low < 1 or len(set(numbers)) != high - low + 1 or high - first >= frames - 1:
        return []
    return [
        f"its pictures are numbered {low} to {high} without a gap, the video has {frames} frames: "
        "if they were taken every n-th, the poses are of other frames"
    ]
