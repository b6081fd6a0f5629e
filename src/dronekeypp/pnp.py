"""Perspective-n-Point for four coplanar propeller hubs: both poses that fit, best first.

Four hubs of a left–right symmetric drone always lie in one plane. Seen from far away such a plane has two poses with nearly the same picture
(the "flip"), and noise decides which of them reprojects better. So a solver here returns both.
"""

from typing import NamedTuple

import cv2
import numpy as np

from dronekeypp.camera import check_intrinsics, project, rays
from dronekeypp.errors import InputError


class Solution(NamedTuple):
    """One pose: `R` (3, 3) camera←body, `t` (3,) metres in the camera frame, `error_px` the RMS reprojection error."""

    R: np.ndarray
    t: np.ndarray
    error_px: float


def _plane_frame(hubs):
    """Rotation (3, 3) plane←body and origin (3,) such that the hubs have z = 0: IPPE can be silently wrong elsewhere."""
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


def solve_pnp(hubs, pixels, K):
    """Poses of a coplanar object, lowest reprojection error first.

    Args:
        hubs: (P, 3) points in body axes, metres, P ≥ 4, coplanar.
        pixels: (P, 2) their full-frame pixels.
        K: (3, 3) camera matrix.

    Returns:
        list of `Solution`, distinct poses only: normally two, one where the two coincide, none where OpenCV's closed form (IPPE) finds none in
        front of the camera: rarely with good keypoints near by, in some per cent of the frames with noisy or far ones (notebook 02). The poses
        are IPPE's as they are; whoever wants the last pixel refines them (`cv2.solvePnPRefineLM`).

    Raises:
        InputError: wrong shapes, NaN, points on a line or off the plane, a bad camera matrix.
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
    seen = np.ascontiguousarray(
        rays(pixels, K)[:, :2]
    )  # OpenCV knows no skew, and wants its memory in one piece
    axes, origin = _plane_frame(hubs)
    found = []
    for turn in (
        np.eye(3),
        np.diag([1.0, -1.0, -1.0]),
    ):  # the plane seen from its other side: IPPE sometimes finds only one of the two
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
            found.append(Solution(R, t, error))
    found.sort(key=lambda s: s.error_px)
    distinct = []
    for s in found:
        if all(
            np.abs(s.R - other.R).max() > 1e-3 or np.abs(s.t - other.t).max() > 1e-4 for other in distinct
        ):
            distinct.append(s)
    return distinct
