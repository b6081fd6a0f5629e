"""Read transforms.json of instant-ngp, nerfstudio and Blender's NeRF data sets.

`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1` … and `camera_model` are those of
https://docs.nerf.studio/quickstart/data_conventions.html; Blender's sets hold `camera_angle_x` alone. Pixel
centres lie at +0.5, as ours do.
"""

from __future__ import annotations

import math

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras import opencv
from dronekeypp.footage.cameras.keys import Entries
from dronekeypp.footage.cameras.readings import Reading, matrix_of, number, take_size

FOCAL = ("flx", "fly", "cx", "cy")
ANGLES = ("cameraanglex", "cameraangley")
SIGNS = ("flx", "fly", *ANGLES, "transformmatrix")


def recognise(entries: Entries) -> bool:
    """Tell whether entries are those of a transforms.json."""
    return entries.has(*SIGNS)


def read(entries: Entries) -> Reading:
    """Read the camera that all frames share.

    Raises:
        InputError: An entry is missing or not valid, or the frames have several cameras.
    """
    file = entries.file
    keys: dict[str, str] = {}
    distortion, fisheye = opencv.take_distortion(entries, keys)
    size, keys["size"] = take_size(entries)
    if size is None:
        raise InputError(f"{file}: holds no w and h, the size of the pictures; add them")
    if entries.has("flx", "fly") or not entries.has(*ANGLES):
        K = opencv.matrix_from(entries, FOCAL, keys)
        _check_angles(entries, K, size)
    else:
        K = _of_angles(entries, size, keys)
    return Reading("transforms.json", K, 0.5, distortion, fisheye, size, keys)


def _focal_lengths(entries: Entries, size: tuple[int, int]) -> tuple[list[float | None], list[str]]:
    """Return the focal lengths in x and y that the angles of view say, and the entries they are from."""
    focal: list[float | None] = []
    paths = []
    for name, pixels in zip(ANGLES, size, strict=True):
        entry = entries.take(name)
        if entry is None:
            focal.append(None)
            continue
        angle = number(entry.value, f"{entries.file}: {entry.path}")
        if not 0 < angle < math.pi:
            raise InputError(f"{entries.file}: {entry.path} must be between 0 and pi radians, got {angle:g}")
        focal.append(pixels / 2 / math.tan(angle / 2))
        paths.append(entry.path)
    return focal, paths


def _check_angles(entries: Entries, K: np.ndarray, size: tuple[int, int]) -> None:
    """Raise InputError where the angles of view say other focal lengths by more than a thousandth."""
    focal, _ = _focal_lengths(entries, size)
    for of_angle, of_matrix in zip(focal, (K[0, 0], K[1, 1]), strict=True):
        if of_angle is not None and not math.isclose(of_angle, of_matrix, rel_tol=1e-3):
            raise InputError(
                f"{entries.file}: the angles of view say a focal length of {of_angle:.6g}, "
                f"fl_x and fl_y {of_matrix:.6g}; keep the right ones"
            )


def _of_angles(entries: Entries, size: tuple[int, int], keys: dict[str, str]) -> np.ndarray:
    """Return the matrix (3, 3) of the angles of view; without the second, pixels are square."""
    file = entries.file
    focal, paths = _focal_lengths(entries, size)
    if focal[0] is None:
        raise InputError(f"{file}: holds no camera_angle_x")
    centre = [pixels / 2 for pixels in size]
    if entries.has("cx", "cy"):
        given = [entries.take("cx"), entries.take("cy")]
        if None in given:
            raise InputError(f"{file}: holds one of cx and cy only")
        centre = [number(entry.value, f"{file}: {entry.path}") for entry in given]
        paths += [entry.path for entry in given]
    keys["K"] = ", ".join(paths)
    return matrix_of([focal[0], focal[1] or focal[0], *centre], f"{file}: {keys['K']}")
