"""Read a camera matrix with names around it: OpenCV's YAML, XML and JSON of all ages, and plain JSON.

OpenCV's calibration sample (samples/cpp/tutorial_code/calib3d/camera_calibration) writes `camera_matrix`,
`distortion_coefficients`, `image_width`, `image_height` and `fisheye_model`; OpenCV 2 wrote `Camera_Matrix`
and `image_Width`. The plain form is {"camera_matrix": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]}, with
`dist_coeffs`, `image_width` and `image_height` where they are known. Pixel centres are counted from 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras import lens_models
from dronekeypp.footage.cameras.keys import Entries
from dronekeypp.footage.cameras.readings import (
    FOCAL,
    Reading,
    check_coefficients,
    intrinsics_matrix,
    matrix_of,
    number,
    numbers,
    take_named_coefficients,
    take_size,
)

MATRIX = ("cameramatrix", "k", "kmatrix", "intrinsicmatrix", "intrinsics", "mtx")
DISTORTION = (
    *("distortioncoefficients", "distcoeffs", "distcoeff", "distcoefs", "distcoef", "d", "kc", "distortion"),
    *("distortioncoeffs", "distortioncoeff", "distortioncoefs", "distortioncoef", "dist", "lensdistortion"),
    *("distortionparameters", "distortionparams", "distortionvector", "coefficients", "coeffs", "coefs"),
)
# What OpenCV's sample writes beside the matrix. With it, a file without distortion was cut off.
OF_THE_SAMPLE = ("calibrationtime", "nrofframes", "flags", "flagvalue")


def read(entries: Entries) -> Reading:
    """Read the matrix, the distortion, the size and the lens model under any of their names.

    Raises:
        InputError: There is no matrix, or a part is not valid.
    """
    file = entries.file
    found = entries.take(*MATRIX)
    if found is None:
        example = '"camera_matrix": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]'
        raise InputError(
            f"{file}: holds no camera_matrix; write OpenCV's calibration format, or JSON with {example}"
        )
    K = intrinsics_matrix(found.value, f"{file}: {found.path}")
    keys = {"K": found.path}
    _check_focal(entries, K, found.path)
    distortion, fisheye = take_distortion(entries, keys)
    by_a_program = entries.of_ros or entries.has(*OF_THE_SAMPLE)
    if distortion is None and by_a_program and not keys["distortion"]:
        raise InputError(
            f"{file}: holds no distortion_coefficients, which calibrations of OpenCV and ROS write; "
            "was it written whole? If the lens has none, add distortion_coefficients: [0, 0, 0, 0]"
        )
    size, keys["size"] = take_size(entries)
    return Reading("OpenCV", K, 0.0, distortion, fisheye, size, keys)


def _check_focal(entries: Entries, K: np.ndarray, path: str) -> None:
    """Raise InputError where fx, fy, cx or cy stand beside the matrix and say something else."""
    for name, value in zip(FOCAL, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), strict=True):
        entry = entries.take(name)
        if entry is not None and not np.isclose(number(entry.value, f"{entries.file}: {entry.path}"), value):
            raise InputError(f"{entries.file}: {entry.path} and {path} differ; keep the right one")


def take_distortion(entries: Entries, keys: dict[str, str]) -> tuple[np.ndarray | None, bool]:
    """Return the coefficients, or None, and whether they are a fisheye's.

    The entries they are from are written to `keys`.

    Raises:
        InputError: Entries are missing, not valid, or contradict each other.
    """
    file = entries.file
    lens, lens_entries = lens_models.take_lens(entries)
    if lens_entries:
        keys["lens"] = ", ".join(entry.path for entry in lens_entries)
    fisheye = lens == lens_models.FISHEYE
    denominator = lens_models.is_rational(lens_entries)
    named, named_keys = take_named_coefficients(entries, fisheye, denominator)
    listed = entries.take(*DISTORTION)
    values, where = named, named_keys
    if listed is not None:
        if named is not None:
            raise InputError(f"{file}: {listed.path} and {named_keys}: keep one of them")
        values, where = numbers(listed.value, f"{file}: {listed.path}").ravel(), listed.path
        if not lens_entries and values.any() and _is_column_of_four(listed.value):
            raise InputError(
                f"{file}: {where}: four coefficients in a column, as cv2.fisheye writes them; name the lens: "
                '"model": "fisheye", or "plumb_bob" for k1, k2, p1, p2'
            )
        if len(values):
            check_coefficients(values, fisheye, f"{file}: {where}")
        else:
            values = None
    if values is None and lens not in (lens_models.PINHOLE, lens_models.NONE):
        raise InputError(f"{file}: {keys['lens']} names a lens model, but there are no coefficients of it")
    if values is not None and values.any():
        lens_models.check_not_empty(entries)
    if values is not None and values.any() and lens == lens_models.NONE:
        raise InputError(f"{file}: {where} are not 0, but {keys['lens']} says that there is no distortion")
    keys["distortion"] = where
    return values, fisheye


def _is_column_of_four(value: Any) -> bool:
    """Tell whether a list has four rows of one number.

    cv2.fisheye.calibrate returns its coefficients so, and cv2.calibrateCamera one row of five.
    """
    return isinstance(value, list) and np.shape(value) == (4, 1)


def matrix_from(entries: Entries, names: tuple[str, str, str, str], keys: dict[str, str]) -> np.ndarray:
    """Return the matrix (3, 3) of four entries with the names of fx, fy, cx and cy.

    Raises:
        InputError: One is missing or no number.
    """
    values, paths = [], []
    for name in names:
        entry = entries.take(name)
        if entry is None:
            raise InputError(f"{entries.file}: holds no {name}; give {', '.join(names)} of the whole frame")
        values.append(number(entry.value, f"{entries.file}: {entry.path}"))
        paths.append(entry.path)
    keys["K"] = ", ".join(paths)
    return matrix_of(values, f"{entries.file}: {keys['K']}")
