"""Tell a camera that a lens may have from numbers that went wrong on their way."""

from __future__ import annotations

import cv2
import numpy as np

from dronekeypp.errors import InputError

SHORTEST, LONGEST = 0.05, 1000  # focal length over the frame's side: 169° of view, and 0.06°
MOST_UNEQUAL = 3  # fx over fy, or fy over fx; an anamorphic lens has 2
REMARKABLE_UNEQUAL = 1.2
MOST_SKEW = 0.1  # over fx: a pixel that leans by 6 degrees
MOST_BENDING = 2.5  # a point half way to the frame's edge may be seen at that many times its distance
# The principal point over the middle of the frame; in the middle it is 1. A real lens is off by a tenth. The
# matrix of a frame twice as large has 2, that of 1920×1080 on frames of 1280×720 has 1.5, on both axes.
FARTHEST = (-1, 3)  # half a frame outside of the frame
MIDDLE = (0.6, 1.4)
BOTH_AXES = (0.85, 1.15)


def check_plausible(
    K: np.ndarray,
    distortion: np.ndarray | None,
    fisheye: bool,
    size: tuple[int, int],
    where: str,
    centred: bool = True,
    size_is_known: bool = True,
) -> list[str]:
    """Check that a lens may have such numbers.

    Args:
        K: (3, 3) camera matrix, pixels, of frames of this size.
        distortion: coefficients, or None.
        fisheye: whether they are those of cv2.fisheye.
        size: (width, height) of the frames.
        where: how a message begins.
        centred: whether the principal point must lie near the frame, as that of a crop need not.
        size_is_known: whether the file says that the matrix is that of this size. If it does not, a
            principal point far from the middle is a matrix of another resolution, and is refused, because
            every pose would be wrong without a sign of it.

    Returns:
        What is unusual, in words, to be printed.

    Raises:
        InputError: A focal length, the skew, the principal point or the distortion is beyond any lens.
    """
    (fx, skew, cx), (_, fy, cy) = K[0], K[1]
    width, height = size
    for focal, side, name in ((fx, width, "wide"), (fy, height, "high")):
        if not SHORTEST < focal / side < LONGEST:
            raise InputError(
                f"{where}: a focal length of {focal:g} pixels for a frame {side} {name}: "
                "is the matrix in pixels of the whole frame?"
            )
    unequal = max(fx / fy, fy / fx)
    if unequal > MOST_UNEQUAL:
        raise InputError(f"{where}: focal lengths of {fx:g} and {fy:g} pixels: no lens has pixels so unequal")
    if abs(skew) > MOST_SKEW * fx:
        raise InputError(f"{where}: a skew of {skew:g} beside a focal length of {fx:g}: no sensor leans so")
    remarks = []
    if unequal > REMARKABLE_UNEQUAL:
        remarks.append(f"NOTE: fx and fy differ by {100 * (unequal - 1):.0f} %")
    if centred:
        off = (2 * cx / width, 2 * cy / height)
        _check_principal_point(off, (cx, cy), size, where, size_is_known)
        if not all(BOTH_AXES[0] <= value <= BOTH_AXES[1] for value in off):
            remarks.append(f"NOTE: the principal point is far from the middle of {width}x{height}")
    if distortion is not None:
        _check_bending(K, distortion, fisheye, size, where)
    return remarks


def _check_principal_point(
    off: tuple[float, float],
    centre: tuple[float, float],
    size: tuple[int, int],
    where: str,
    size_is_known: bool,
) -> None:
    """Raise InputError where the principal point is not one of such frames."""
    point, frame = f"the principal point ({centre[0]:g}, {centre[1]:g})", f"{size[0]}×{size[1]}"
    if not all(FARTHEST[0] <= value <= FARTHEST[1] for value in off):
        raise InputError(f"{where}: {point} is far outside a frame of {frame}")
    if size_is_known:
        return
    outside = not all(MIDDLE[0] <= value <= MIDDLE[1] for value in off)
    smaller, larger = max(off) < BOTH_AXES[0], min(off) > BOTH_AXES[1]
    if outside or smaller or larger:
        raise InputError(
            f"{where}: {point} is far from the middle of frames of {frame}: of another resolution? "
            "Add the size that the camera was calibrated at (image_width, image_height)"
        )


def _check_bending(
    K: np.ndarray, distortion: np.ndarray, fisheye: bool, size: tuple[int, int], where: str
) -> None:
    """Raise InputError where points half way to the frame's edge are seen far from where they are.

    Near the edge, the polynomials of good calibrations may go astray; half way they may not.
    """
    half = np.array([size[0] / 4 / K[0, 0], size[1] / 4 / K[1, 1]])
    around = np.array([[1.0, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]])
    angles = half * around  # (8, 2), image plane at distance 1; of a fisheye lens radians
    radii = np.linalg.norm(angles, axis=1)
    with np.errstate(all="ignore"):
        if fisheye:
            powers = radii[:, None] ** np.array([2, 4, 6, 8])
            seen = radii * (1 + powers @ distortion)
            offset = np.abs(seen - radii)
        else:
            points = np.concatenate([angles, np.ones((8, 1))], axis=1)
            pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), distortion)
            seen = np.linalg.norm(pixels[:, 0], axis=1)
            offset = np.linalg.norm(pixels[:, 0] - angles, axis=1)
        good = (seen < MOST_BENDING * radii) & (seen * MOST_BENDING > radii) & (offset < radii)
    if not good.all():
        listed = ", ".join(f"{value:g}" for value in distortion)
        raise InputError(f"{where}: distortion {listed}: no lens bends the picture so far")
