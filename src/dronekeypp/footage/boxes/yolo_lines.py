"""Tell what the numbers of YOLO's lines mean: boxes, keypoints, outlines; scores and tracks behind them.

The lines do not say it. How many numbers there are leaves several readings, and a wrong one gives a wrong box
without a word. So all lines of a folder are looked at together, as one program wrote them, and what stays
unclear is refused. In this module a line is its numbers behind the class.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.text import NumberLine

FEWEST = 12  # numbers of a box with keypoints: four of two coordinates each
SLACK = 0.01  # of the picture: so far may a box or an outline reach over its edge by rounding
BEYOND = 0.5  # and so far the corner of an oriented box
MARGIN = 0.1  # of a box: so far may a keypoint lie outside it
TIGHT = 0.5  # keypoints fill at least so much of their box, in width or height
FAR = 2.5  # an outline with a size for a point is at least so many times as large as without


class Meaning(NamedTuple):
    """Hold what a line says: a box (x, y, w, h) in shares of the picture, a score and a track where given."""

    box: tuple[float, float, float, float]
    score: float | None
    track: int | None


def meanings(lines: Sequence[NumberLine]) -> list[Meaning]:
    """Return what each line of a folder says.

    Raises:
        InputError: A line has too few numbers, or it stays unclear what they are.
    """
    for where, values in lines:
        if len(values) < 4:
            raise InputError(f"{where}: a YOLO line is class cx cy w h [confidence]")
    short = [line for line in lines if _is_plain(line.values)]
    long = [line for line in lines if not _is_plain(line.values)]
    fifth = [line.values[4] for line in short if len(line.values) == 5]
    tracked = any(value > 1 for value in fifth) and all(map(_is_track, fifth))
    have_keypoints = _have_keypoints(long)
    even = [line.values for line in long if len(line.values) % 2 == 0]
    odd = [line.values[-1] for line in long if len(line.values) % 2]
    even_tail = 2 if even and all(_is_tail(values[-2:]) for values in even) else 0
    odd_tracked = any(value > 1 for value in odd) and all(map(_is_track, odd))
    found = []
    for line in lines:
        values = line.values
        if _is_plain(values):
            found.append(_meaning(line, _corner_box(values), values[4:], tracked))
        elif have_keypoints:
            found.append(_meaning(line, _corner_box(values), _behind_keypoints(values), False))
        else:
            count = len(values) - (1 if len(values) % 2 else even_tail)
            if min(values[:count]) < -BEYOND or max(values[:count]) > 1 + BEYOND:
                raise InputError(f"{line.where}: neither a box, nor keypoints, nor an outline in shares")
            found.append(_meaning(line, _around(values[:count]), values[count:], odd_tracked))
    return found


def _meaning(line: NumberLine, box: tuple[float, ...], tail: Sequence[float], tracked: bool) -> Meaning:
    """Return a box with what stands behind it: a score and a track, or one of both."""
    score, track = (tail[0] if tail else None), (tail[1] if len(tail) > 1 else None)
    if len(tail) == 1 and tracked:
        score, track = None, tail[0]
    if score is not None and not 0 <= score <= 1:
        raise InputError(f"{line.where}: the confidence {score:g} does not lie between 0 and 1")
    return Meaning(tuple(box), score, None if track is None else int(track))


def _is_plain(values: Sequence[float]) -> bool:
    """Tell whether a line is a box, alone or with a confidence and a track."""
    return len(values) < 6 or (len(values) == 6 and _is_tail(values[4:]))


def _is_track(value: float) -> bool:
    return value >= 1 and value == int(value)


def _is_tail(values: Sequence[float]) -> bool:
    """Tell whether two numbers can be a confidence and a track."""
    return 0 <= values[0] <= 1 and _is_track(values[1])


def _corner_box(values: Sequence[float]) -> tuple[float, float, float, float]:
    """Return a box from its centre and its size, which are the first four numbers."""
    cx, cy, w, h = values[:4]
    return cx - w / 2, cy - h / 2, w, h


def _around(values: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the box around points x1, y1, x2, y2 …"""
    points = np.reshape(values, (-1, 2))
    (x, y), (high_x, high_y) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return x, y, high_x - x, high_y - y


# --- keypoints or outlines? ---------------------------------------------------------------------------------


def _have_keypoints(lines: Sequence[NumberLine]) -> bool:
    """Tell whether long lines are boxes with keypoints. Otherwise they are outlines.

    Every line votes. At least half must speak for one of both, and none for the other.

    Raises:
        InputError: It is not clear.
    """
    if not lines:
        return False
    votes = np.array([_vote(line.values) for line in lines])
    if votes.max() <= 0 and votes.mean() <= -0.5:
        return False
    if votes.min() >= 0 and votes.mean() >= 0.5:
        return True
    unclear = lines[int(np.argmin(np.abs(votes)))]
    raise InputError(
        f"{unclear.where}: {len(unclear.values)} numbers behind the class may be an outline, or a box with "
        "keypoints, and all lines together do not tell; write class cx cy w h only"
    )


def _vote(values: Sequence[float]) -> int:
    """Return 1 where a line looks like a box with keypoints, -1 where like an outline, 0 where unclear."""
    readings = [keypoints for keypoints, _ in _keypoint_readings(values)]
    if not readings:
        return -1
    coordinates = values[: len(values) - len(values) % 2]
    if any(np.any(keypoints[:, 2:] == 2) for keypoints in readings):  # visible, in labels by hand
        return 1
    if min(coordinates) < -SLACK or max(coordinates[:-2]) > 1 + SLACK:
        return 1
    fits = any(_fit_their_box(values, keypoints) for keypoints in readings)
    odd = _is_odd_outline(np.reshape(coordinates, (-1, 2)))
    return int(fits and odd) - int(not fits and not odd)


def _keypoint_readings(values: Sequence[float]) -> list[tuple[np.ndarray, list[float]]]:
    """Return the ways to read keypoints behind a box: (keypoints (K, 2 or 3), what follows them).

    Those with four keypoints come first.
    """
    readings = []
    for parts in (3, 2):
        for rest in (0, 1, 2):
            count = len(values) - 4 - rest
            tail = list(values[len(values) - rest :])
            possible = rest == 0 or (rest == 1 and (0 <= tail[0] <= 1 or _is_track(tail[0])))
            possible = possible or (rest == 2 and _is_tail(tail))
            if len(values) - rest >= FEWEST and count % parts == 0 and possible:
                readings.append((np.reshape(values[4 : 4 + count], (-1, parts)), tail))
    return sorted(readings, key=lambda reading: len(reading[0]) != 4)


def _behind_keypoints(values: Sequence[float]) -> list[float]:
    """Return the confidence and the track behind keypoints. A track alone is none: it may be a confidence."""
    tail = _keypoint_readings(values)[0][1]
    return [] if len(tail) == 1 and tail[0] > 1 else tail


def _fit_their_box(values: Sequence[float], keypoints: np.ndarray) -> bool:
    """Tell whether keypoints lie in their box and fill it, and the box lies in the picture."""
    x, y, w, h = _corner_box(values)
    if min(w, h) <= 0 or min(x, y) < -SLACK or max(x + w, y + h) > 1 + SLACK:
        return False
    if keypoints.shape[1] == 3 and not np.all((keypoints[:, 2] >= 0) & (keypoints[:, 2] <= 1)):
        return False
    seen = keypoints[np.any(keypoints[:, :2] != 0, axis=1), :2]  # what is not visible is written as 0 0
    if len(seen) < 2:
        return False
    places = (seen - [x, y]) / [w, h]  # 0 to 1 inside the box
    inside = places.min() >= -MARGIN and places.max() <= 1 + MARGIN
    return bool(inside and np.ptp(places, axis=0).max() >= TIGHT)


def _is_odd_outline(points: np.ndarray) -> bool:
    """Tell whether points (P, 2) would be a strange outline.

    It is, if it crosses itself, or if its second point, which may be the size of a box, lies far off.
    """
    without, whole = np.ptp(points[2:], axis=0), np.ptp(points[1:], axis=0)
    if np.hypot(*whole) > FAR * np.hypot(*without):
        return True
    return _crosses_itself(points)


def _crosses_itself(points: np.ndarray) -> bool:
    """Tell whether two sides of a closed outline (P, 2) cross."""
    starts, ends = points, np.roll(points, -1, axis=0)

    def side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Return on which side of the line from a to b the point c lies: the sign of the area."""
        area = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
        area = area - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        return np.where(np.abs(area) < 1e-9, 0, np.sign(area))

    a, b = starts[:, None], ends[:, None]
    c, d = starts[None], ends[None]
    crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return bool(crossing.any())
