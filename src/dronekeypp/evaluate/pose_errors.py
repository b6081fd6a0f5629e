"""Compute the errors of a pose that the field reports: ADD, ADD-S, MSSD and MSPD.

Each compares where an estimated pose (R_est, t_est) and the true pose (R, t) put the points x of an object:

    ADD     mean over x of ‖(R_est x + t_est) − (R x + t)‖
    ADD-S   mean over x of min over y of ‖(R_est y + t_est) − (R x + t)‖
    MSSD    min over symmetries S of max over x of ‖(R_est x + t_est) − (R S x + t)‖
    MSPD    the same of their projections, in pixels

Shapes: B poses, M points, S symmetries. Poses are camera←body, lengths metres. A value that is NaN in a pose
is NaN in its error. Shapes that do not fit, and matrices that are no rotations, raise InputError.

References:
    [1] Hinterstoisser et al., "Model Based Training, Detection and Pose Estimation of Texture-Less 3D Objects
        in Heavily Cluttered Scenes", ACCV 2012.
    [2] Xiang et al., "PoseCNN: A Convolutional Neural Network for 6D Object Pose Estimation in Cluttered
        Scenes", RSS 2018, who call the second error of [1] ADD-S.
    [3] Hodaň et al., "BOP Challenge 2020 on 6D Object Localization", ECCV Workshops 2020, Sec. 2.
    [4] Drost et al., "Introducing MVTec ITODD", ICCV Workshops 2017, from where [3] has MSSD.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dronekeypp.camera import check_intrinsics, project
from dronekeypp.checked import as_float64, check_finite, check_shapes, checks
from dronekeypp.errors import InputError
from dronekeypp.rotations import PREDICTED, check_rotation


def _check_poses(
    R_est: np.ndarray, t_est: np.ndarray, R: np.ndarray, t: np.ndarray, points: np.ndarray
) -> None:
    """Check the arguments that all errors have.

    Raises:
        InputError: the shapes do not fit, or a matrix is no rotation. NaN stands for "no pose".
    """
    check_shapes(
        R_est=(R_est, ("B", 3, 3)),
        t_est=(t_est, ("B", 3)),
        R=(R, ("B", 3, 3)),
        t=(t, ("B", 3)),
        points=(points, ("M", 3)),
    )
    check_rotation(R_est, "R_est", PREDICTED, nan=True)
    check_rotation(R, "R", PREDICTED, nan=True)
    if len(points) == 0:
        raise InputError("points: none")
    check_finite("points", as_float64(points, "points"))


def _check_symmetries(symmetries: np.ndarray) -> None:
    """Raise InputError unless symmetries are motions (S, 4, 4)."""
    check_shapes(symmetries=(symmetries, ("S", 4, 4)))
    if len(symmetries) == 0:
        raise InputError("symmetries: none, and the identity is one")
    check_rotation(symmetries[:, :3, :3], "symmetries")
    if (symmetries[:, 3] != [0, 0, 0, 1]).any():
        raise InputError("symmetries: the last row of a motion is (0, 0, 0, 1)")


def _check_mssd(
    R_est: np.ndarray,
    t_est: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    points: np.ndarray,
    symmetries: np.ndarray,
) -> None:
    """Check the arguments of `mssd`."""
    _check_poses(R_est, t_est, R, t, points)
    _check_symmetries(symmetries)


def _check_mspd(
    R_est: np.ndarray,
    t_est: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    K: np.ndarray,
    points: np.ndarray,
    symmetries: np.ndarray,
) -> None:
    """Check the arguments of `mspd`."""
    _check_poses(R_est, t_est, R, t, points)
    check_shapes(t=(t, ("B", 3)), K=(K, ("B", 3, 3)))
    check_intrinsics(K, "K")
    _check_symmetries(symmetries)


@checks(_check_poses)
def add(R_est: np.ndarray, t_est: np.ndarray, R: np.ndarray, t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return ADD: the mean distance of the points in the two poses [1].

    Args:
        R_est, t_est: (B, 3, 3) and (B, 3) estimated poses.
        R, t: (B, 3, 3) and (B, 3) true poses.
        points: (M, 3) of the object, body axes.

    Returns:
        (B,) metres.
    """
    return _distances(R_est, t_est, R, t, points).mean(axis=1)


@checks(_check_poses)
def adds(
    R_est: np.ndarray, t_est: np.ndarray, R: np.ndarray, t: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return ADD-S: the mean distance to the nearest point, for an object with a symmetry [1, 2].

    The mean goes over the points in the true pose. Nearest is taken among the points in the estimated pose.

    Args:
        R_est, t_est: (B, 3, 3) and (B, 3) estimated poses.
        R, t: (B, 3, 3) and (B, 3) true poses.
        points: (M, 3) of the object, body axes.

    Returns:
        (B,) metres.
    """
    # A motion keeps distances, so the true points are moved into the body axes of the estimate. There the
    # other points stand still, and one tree does for all poses.
    inverse = R_est.swapaxes(1, 2)
    shift = (inverse @ (t - t_est)[:, :, None])[:, :, 0]  # (B, 3)
    moved = _placed(points, inverse @ R, shift)  # (B, M, 3)
    tree = cKDTree(points)
    errors = np.full(len(t), np.nan)
    known = np.isfinite(moved).all(axis=(1, 2))
    if known.any():
        errors[known] = tree.query(moved[known])[0].mean(axis=1)
    return errors


@checks(_check_mssd)
def mssd(
    R_est: np.ndarray,
    t_est: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    points: np.ndarray,
    symmetries: np.ndarray,
) -> np.ndarray:
    """Return MSSD, the maximum symmetry-aware surface distance [3, 4].

    It is the largest distance of a point in the two poses, for the symmetry that makes it least.

    Args:
        R_est, t_est: (B, 3, 3) and (B, 3) estimated poses.
        R, t: (B, 3, 3) and (B, 3) true poses.
        points: (M, 3) of the object, body axes.
        symmetries: (S, 4, 4) motions that leave the object as it is, among them the identity.

    Returns:
        (B,) metres.
    """
    errors = np.full(len(t), np.inf)
    for symmetry in symmetries:
        R_same, t_same = _after(symmetry, R, t)
        largest = _distances(R_est, t_est, R_same, t_same, points).max(axis=1)
        errors = np.minimum(errors, largest)
    return errors


@checks(_check_mspd)
def mspd(
    R_est: np.ndarray,
    t_est: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    K: np.ndarray,
    points: np.ndarray,
    symmetries: np.ndarray,
) -> np.ndarray:
    """Return MSPD, the maximum symmetry-aware projection distance [3].

    It is the largest distance of a point's projections in the two poses, for the symmetry that makes it
    least. As in BOP's toolkit, a point behind the camera is divided by its negative depth.

    Args:
        R_est, t_est: (B, 3, 3) and (B, 3) estimated poses.
        R, t: (B, 3, 3) and (B, 3) true poses.
        K: (B, 3, 3) camera matrices of the full frames, pixels.
        points: (M, 3) of the object, body axes.
        symmetries: (S, 4, 4) motions that leave the object as it is, among them the identity.

    Returns:
        (B,) pixels of the full frame.
    """
    pixels_est = project(_placed(points, R_est, t_est), K)  # (B, M, 2)
    errors = np.full(len(t), np.inf)
    for symmetry in symmetries:
        pixels = project(_placed(points, *_after(symmetry, R, t)), K)
        largest = np.linalg.norm(pixels_est - pixels, axis=2).max(axis=1)
        errors = np.minimum(errors, largest)
    return errors


def _placed(points: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the points (M, 3) in each of the poses (B, 3, 3), (B, 3): (B, M, 3)."""
    return points @ R.swapaxes(1, 2) + t[:, None]


def _distances(
    R_est: np.ndarray, t_est: np.ndarray, R: np.ndarray, t: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return how far each point in the one pose is from itself in the other: (B, M)."""
    return np.linalg.norm(_placed(points, R_est - R, t_est - t), axis=2)


def _after(symmetry: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses (R, t) of an object that a symmetry (4, 4) has moved first."""
    return R @ symmetry[:3, :3], R @ symmetry[:3, 3] + t
