"""Tell whether YOLO's long lines are boxes with keypoints, or outlines.

Lines are their numbers behind the class.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.text import NumberLine

USUAL = 4  # keypoints of a drone: of several readings, the one with so many is taken
FEWEST = 3  # keypoints
SLACK = 0.01  # of the picture: so far may a box reach over its edge by rounding
MARGIN = 0.1  # of a box: so far may a keypoint lie outside it
TIGHT = 0.5  # keypoints fill at least so much of their box, in width or height
FAR = 2.5  # an outline with a size for a point is at least so many times as large as without
VISIBLE = 2  # COCO's mark of a visible keypoint

Shape = tuple[int, int]  # how many keypoints, and of how many numbers each


def keypoint_shape(lines: Sequence[NumberLine]) -> int:
    """Return how many numbers of each line are keypoints, behind the four of the box; 0 for outlines.

    Every line votes. At least half must speak for keypoints or for outlines, and none for the other.

    Raises:
        InputError: It is not clear.
    """
    if not lines:
        return 0
    votes = np.array([_vote(line.values) for line in lines])
    if votes.max() <= 0 and votes.mean() <= -0.5:
        return 0
    shapes = set.intersection(*[set(_shapes(line.values)) for line in lines])
    if shapes and votes.min() >= 0 and votes.mean() >= 0.5:
        count, numbers = min(shapes, key=lambda shape: (shape[0] != USUAL, shape))
        return count * numbers
    unclear = lines[int(np.argmin(votes * votes[np.argmax(np.abs(votes))]))]
    raise InputError(
        f"{unclear.where}: {len(unclear.values)} numbers behind the class may be an outline, or a box with "
        "keypoints, and all lines together do not tell; write class cx cy w h only"
    )


def _shapes(values: Sequence[float]) -> list[Shape]:
    """Return which keypoints a line can have, with nothing, a confidence, a track, or both behind them."""
    shapes = []
    for numbers in (3, 2):
        for tail in (0, 1, 2):
            count, rest = divmod(len(values) - 4 - tail, numbers)
            ends = values[len(values) - tail :]
            possible = tail == 0 or ends[-1] == int(ends[-1]) or (tail == 1 and 0 <= ends[0] <= 1)
            # Fewer numbers could be an oriented box, which geometry does not tell from keypoints.
            if rest == 0 and count >= FEWEST and count * numbers >= 2 * USUAL and possible:
                shapes.append((count, numbers))
    return shapes


def _vote(values: Sequence[float]) -> int:
    """Return 1 where a line looks like a box with keypoints, -1 where like an outline, 0 where unclear."""
    readings = []
    for count, numbers in _shapes(values):
        readings.append(np.reshape(values[4 : 4 + count * numbers], (count, numbers)))
    if not readings:
        return -1
    if any(_are_marked(keypoints) for keypoints in readings):
        return 1
    fits = any(_fit_their_box(values, keypoints) for keypoints in readings)
    tails = (1,) if len(values) % 2 else (0, 2)  # an outline has two numbers a point
    odd = all(_is_odd_outline(np.reshape(values[: len(values) - tail], (-1, 2))) for tail in tails)
    return int(fits and odd) - int(not fits and not odd)


def _are_marked(keypoints: np.ndarray) -> bool:
    """Tell whether keypoints (K, 2 or 3) have the marks 0, 1 or 2 of labels by hand, some of them 2."""
    marks = keypoints[:, 2:]
    return bool(np.isin(marks, range(VISIBLE + 1)).all() and np.any(marks == VISIBLE))


def _fit_their_box(values: Sequence[float], keypoints: np.ndarray) -> bool:
    """Tell whether keypoints (K, 2 or 3) lie in their box and fill it, and the box lies in the picture."""
    cx, cy, w, h = values[:4]
    low, size = np.array([cx - w / 2, cy - h / 2]), np.array([w, h])
    if size.min() <= 0 or low.min() < -SLACK or (low + size).max() > 1 + SLACK:
        return False
    if keypoints.shape[1] == 3 and not np.all((keypoints[:, 2] >= 0) & (keypoints[:, 2] <= 1)):
        return False
    seen = keypoints[np.any(keypoints[:, :2] != 0, axis=1), :2]  # what is not visible is written as 0 0
    if len(seen) < 2:
        return False
    places = (seen - low) / size  # 0 to 1 inside the box
    inside = places.min() >= -MARGIN and places.max() <= 1 + MARGIN
    return bool(inside and np.ptp(places, axis=0).max() >= TIGHT)


def _is_odd_outline(points: np.ndarray) -> bool:
    """Tell whether points (P, 2) would be a strange outline.

    It is, if it crosses itself, or if its second point, which may be the size of a box, lies far off.
    """
    without, whole = np.ptp(points[2:], axis=0), np.ptp(points[1:], axis=0)
    return bool(np.hypot(*whole) > FAR * np.hypot(*without)) or _crosses_itself(points)


def _crosses_itself(points: np.ndarray) -> bool:
    """Tell whether two sides of a closed outline (P, 2) cross."""
    starts, ends = points, np.roll(points, -1, axis=0)
    a, b = starts[:, None], ends[:, None]
    c, d = starts[None], ends[None]
    apart = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
    return bool(apart.any())


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return on which side of the line from a to b the point c lies, all (…, 2): 1, -1, or 0 on the line."""
    area = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
    area = area - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    return np.where(np.abs(area) < 1e-9, 0, np.sign(area))
