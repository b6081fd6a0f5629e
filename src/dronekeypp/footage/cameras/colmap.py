"""Read cameras.txt of COLMAP (https://colmap.github.io/format.html and src/colmap/sensor/models.h).

A line is CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]. Pixel centres lie at +0.5, as ours do.
"""

from __future__ import annotations

import re

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras.readings import MOST_PIXELS, Reading, matrix_of

# By model: which parameters are fx, fy, cx and cy; how many coefficients follow; where they go in OpenCV's
# order; whether it is a fisheye's.
MODELS = {
    "SIMPLE_PINHOLE": ((0, 0, 1, 2), 0, (), False),
    "PINHOLE": ((0, 1, 2, 3), 0, (), False),
    "SIMPLE_RADIAL": ((0, 0, 1, 2), 1, (0,), False),
    "RADIAL": ((0, 0, 1, 2), 2, (0, 1), False),
    "OPENCV": ((0, 1, 2, 3), 4, (0, 1, 2, 3), False),
    "FULL_OPENCV": ((0, 1, 2, 3), 8, (0, 1, 2, 3, 4, 5, 6, 7), False),
    "OPENCV_FISHEYE": ((0, 1, 2, 3), 4, (0, 1, 2, 3), True),
    "SIMPLE_RADIAL_FISHEYE": ((0, 0, 1, 2), 1, (0,), True),
    "RADIAL_FISHEYE": ((0, 0, 1, 2), 2, (0, 1), True),
}


def recognise(text: str) -> bool:
    """Tell whether the first line that is no comment begins as a camera of COLMAP does."""
    lines = _lines(text)
    return bool(lines) and re.match(r"\d+\s+[A-Za-z][A-Za-z_]*\s+\S+\s+\S+", lines[0][1]) is not None


def _lines(text: str) -> list[tuple[int, str]]:
    """Return the lines that are no comments, with their numbers."""
    lines = []
    for n, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            lines.append((n, line.strip()))
    return lines


def read(text: str, file: object) -> Reading:
    """Read the one camera of a cameras.txt; several lines must say the same of it.

    Raises:
        InputError: A line is not valid, or its model is not read, or there are several cameras.
    """
    readings = [_read_line(line, f"{file}: line {n}") for n, line in _lines(text)]
    numbers = [line.split()[0] for _, line in _lines(text)]
    if len(set(numbers)) < len(numbers):
        raise InputError(f"{file}: a camera's number comes twice; keep one line")
    if not all(reading.same(readings[0]) for reading in readings):
        raise InputError(
            f"{file}: holds {len(readings)} cameras; keep the line of the one that took the footage"
        )
    return readings[0]


def _read_line(line: str, where: str) -> Reading:
    words = line.split()
    model = words[1] if len(words) > 1 else ""
    if model not in MODELS:
        raise InputError(f"{where}: {model!r:.40} is not read; undistort with COLMAP, and give its PINHOLE")
    focal, count, order, fisheye = MODELS[model]
    parameters = max(focal) + 1 + count
    if len(words) != 4 + parameters:
        raise InputError(f"{where}: {model} has {parameters} parameters, not {len(words) - 4}")
    try:
        width, height = int(words[2]), int(words[3])
        values = np.array([float(word) for word in words[4:]])
    except ValueError:
        raise InputError(f"{where}: not numbers behind {model}") from None
    if not np.isfinite(values).all() or not 1 <= min(width, height) <= max(width, height) <= MOST_PIXELS:
        raise InputError(f"{where}: width and height must be positive, and every parameter finite")
    K = matrix_of([values[i] for i in focal], where)
    distortion = None
    if count:
        distortion = np.zeros(max(4, count))
        distortion[list(order)] = values[-count:]
    keys = {"K": model, "size": "WIDTH, HEIGHT", "distortion": model, "lens": model}
    return Reading("COLMAP", K, 0.5, distortion, fisheye, (width, height), keys)
