"""Solve Perspective-n-Point for the four coplanar propeller hubs of a drone.

Four hubs of a left–right symmetric drone always lie in one plane. Seen from far away, such a plane has two
poses with nearly the same picture (the "flip"), and noise decides which of them reprojects better. So the
solver here returns both, the better one first.
"""

from typing import NamedTuple

import cv2
import numpy as np

from dronekeypp.camera import check_intrinsics, project, rays
from dronekeypp.errors import InputError

# IPPE gives useless poses of a plane that is tilted about exactly one of its own axes, as a drone is that is
# seen from straight behind. After a turn in the plane by 0.7 rad these are no longer the axes of the drone.
ODD_TURN = np.array([[np.cos(0.7), -np.sin(0.7), 0], [np.sin(0.7), np.cos(0.7), 0], [0, 0, 1]])


class Solution(NamedTuple):
    """This is one of the poses that `solve_pnp` returns.

    Attributes:
        R: (3, 3) rotation camera←body.
        t: (3,) translation in the camera frame, metres.
        error_px: root mean square of the reprojection errors, pixels.
    """

    R: np.ndarray
    t: np.ndarray
    error_px: float


def _plane_frame(hubs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frame in which the hubs (P, 3) have z = 0.

    IPPE, the solver below, can be silently wrong in any other frame.

    Returns:
        the rotation plane←body (3, 3) and the origin (3,) in body axes.

    Raises:
        InputError: the hubs lie on one line, or not in one plane.
    """
    origin = hubs.mean(axis=0)
    _, singular, axes = np.linalg.svd(hubs - origin)
    if singular[1] < 1e-6:
        raise InputError("PnP: the points lie on one line; a pose needs a plane")
    if singular[2] > 0.02 * singular[1]:
        raise InputError(
            "PnP: the points are not coplanar; this solver is for the four propeller hubs of a drone"
        )
    if np.linalg.det(axes) < 0:
        axes[2] *= -1
    return axes, origin


def check_coplanar(hubs: np.ndarray) -> None:
    """Check that points (P, 3) lie in a plane and not on a line, as `solve_pnp` needs them.

    Raises:
        InputError: they do not.
    """
    _plane_frame(np.asarray(hubs, dtype=np.float64))


def solve_pnp(hubs: np.ndarray, pixels: np.ndarray, K: np.ndarray) -> list[Solution]:
    """Return the poses of a coplanar object, the lowest reprojection error first.

    The poses are those of OpenCV's closed form (IPPE), without any refinement. Whoever wants the last pixel
    refines them with `cv2.solvePnPRefineLM`.

    Args:
        hubs: (P, 3) coplanar points in body axes, metres, with P ≥ 4.
        pixels: (P, 2) full-frame pixels of the points.
        K: (3, 3) camera matrix.

    Returns:
        A list of distinct poses. Normally there are two, and one where the two coincide. The list is empty
        where IPPE finds no pose in front of the camera: that is rare with good keypoints near the camera, and
        happens in some per cent of the frames with noisy or far ones (notebook 02).

    Raises:
        InputError: a shape is wrong, a value is NaN or infinite, the points lie on a line or not in a plane,
            or the camera matrix is no pinhole matrix.
    """
    hubs, pixels = np.asarray(hubs, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    K = np.asarray(check_intrinsics(K), dtype=np.float64)
    if hubs.ndim != 2 or hubs.shape[1] != 3 or len(hubs) < 4 or pixels.shape != (len(hubs), 2):
        raise InputError(
            f"PnP: expected points (P, 3) and pixels (P, 2) with P ≥ 4, got {hubs.shape} and {pixels.shape}"
        )
    if not (np.isfinite(hubs).all() and np.isfinite(pixels).all()):
        raise InputError("PnP: points or pixels hold NaN or infinity")
    if K.shape != (3, 3):
        raise InputError(f"PnP: one camera matrix (3, 3) at a time, got {K.shape}")
    # Rays instead of pixels, because OpenCV knows no skew; and it wants its memory in one piece.
    seen = np.ascontiguousarray(rays(pixels, K)[:, :2])
    axes, origin = _plane_frame(hubs)
    solutions = []
    # The second turn shows the plane from its other side: IPPE sometimes finds only one of the two poses.
    for turn in (ODD_TURN, np.diag([1.0, -1.0, -1.0]) @ ODD_TURN):
        flat = (hubs - origin) @ axes.T @ turn.T
        flat[:, 2] = 0
        try:
            _, rotations, translations, _ = cv2.solvePnPGeneric(
                flat, seen, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
            )
        except cv2.error:
            continue
        for rvec, tvec in zip(rotations or (), translations or (), strict=True):
            if rvec is None or not (np.isfinite(rvec).all() and np.isfinite(tvec).all()):
                continue
            R = cv2.Rodrigues(rvec)[0] @ turn @ axes
            t = tvec.ravel() - R @ origin
            placed = hubs @ R.T + t
            if (placed[:, 2] <= 0).any():
                continue
            error = float(np.sqrt(((project(placed, K) - pixels) ** 2).sum(-1).mean()))
            solutions.append(Solution(R, t, error))
    solutions.sort(key=lambda s: s.error_px)
    distinct = []
    for s in solutions:
        if all(
            np.abs(s.R - other.R).max() > 1e-3 or np.abs(s.t - other.t).max() > 1e-4 for other in distinct
        ):
            distinct.append(s)
    return distinct
