"""Convert rotations between their forms, and measure the angle between two of them.

The forms are the paper's normalised angles, the 6D form and the rotation vector (the exponential map). The
functions take torch tensors with the batch dimensions first.

The paper predicts three angles in [0, 1] (Sec. III-C) and says neither their order nor their frame. Our R is
camera←body, and we read its angles in the camera's *level frame* (x forward, y left, z up). They are
intrinsic Z-Y-X angles: yaw, pitch and roll, each divided by 360°, modulo 1. Such angles have a singularity at
pitch ±90°. In the level frame a flying drone stays far from it; in raw camera axes it would sit on it.
"""

import math

import numpy as np
import torch
from torch import Tensor

from dronekeypp.checked import as_float64, check_ends, checks
from dronekeypp.errors import InputError

# Level frame ← camera: forward = z, left = −x, up = −y.
LEVEL_FROM_CAMERA = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))

# By how much an entry of RᵀR of a predicted rotation may differ from the identity. Networks answer in float32
# or less.
PREDICTED = 1e-2


def to_level(M: Tensor) -> Tensor:
    """Return LEVEL_FROM_CAMERA @ M for matrices M (…, 3, n).

    It takes rows and no matrix: a matrix made anew in every call would be copied from the CPU, which a CUDA
    graph cannot hold.
    """
    right, down, forward = M.unbind(-2)
    return torch.stack([forward, -right, -down], -2)


def from_level(M: Tensor) -> Tensor:
    """Return the transpose of LEVEL_FROM_CAMERA, times matrices M (…, 3, n); see `to_level`."""
    forward, left, up = M.unbind(-2)
    return torch.stack([-left, -up, forward], -2)


def matrix_to_angles(R: Tensor) -> Tensor:
    """Convert rotations to the paper's normalised angles.

    Args:
        R: (…, 3, 3) rotations camera←body.

    Returns:
        (…, 3) yaw, pitch and roll in the level frame, each divided by 360°, in [0, 1). Exactly at pitch ±90°
        they need not give R back.
    """
    M = to_level(R)
    yaw = torch.atan2(M[..., 1, 0], M[..., 0, 0])
    pitch = torch.asin((-M[..., 2, 0]).clamp(-1, 1))
    roll = torch.atan2(M[..., 2, 1], M[..., 2, 2])
    turns = torch.stack([yaw, pitch, roll], -1) / (2 * math.pi) % 1.0
    # −1e-9 % 1 rounds to 1.0 in float32.
    return torch.where(turns >= 1, torch.zeros_like(turns), turns)


def angles_to_matrix(angles: Tensor) -> Tensor:
    """Convert normalised angles (…, 3) to rotations camera←body (…, 3, 3).

    This is the inverse of `matrix_to_angles`.
    """
    c, s = (angles * 2 * math.pi).cos(), (angles * 2 * math.pi).sin()
    (cy, cp, cr), (sy, sp, sr) = c.unbind(-1), s.unbind(-1)
    rows = [
        torch.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], -1),
        torch.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], -1),
        torch.stack([-sp, cp * sr, cp * cr], -1),
    ]
    return from_level(torch.stack(rows, -2))


def matrix_to_6d(R: Tensor) -> Tensor:
    """Return the 6D form (…, 6) of rotations (…, 3, 3) (Zhou et al., CVPR 2019).

    It is the first column of R, followed by the second.
    """
    return torch.cat([R[..., :, 0], R[..., :, 1]], -1)


def matrix_from_6d(x: Tensor) -> Tensor:
    """Make rotations (…, 3, 3) from their 6D form (…, 6) by Gram–Schmidt.

    Any two independent vectors give a rotation; they need not be orthogonal or of unit length.
    """
    a, b = x[..., :3], x[..., 3:]
    first = torch.nn.functional.normalize(a, dim=-1)
    second = torch.nn.functional.normalize(b - (first * b).sum(-1, keepdim=True) * first, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], -1)


def towards(ray: Tensor) -> Tensor:
    """Return the smallest turn that takes the camera's axis (0, 0, 1) to a ray.

    With it a rotation can be egocentric (camera←body) or allocentric, which is how the drone looks when the
    camera is turned to it: R = towards(t) @ R_allocentric (Kundu et al., CVPR 2018). The same picture then
    means the same allocentric rotation anywhere in the frame.

    Args:
        ray: (…, 3) a direction in front of the camera, of any length.

    Returns:
        (…, 3, 3) rotations.
    """
    x, y, z = torch.nn.functional.normalize(ray, dim=-1).unbind(-1)
    k = 1 / (1 + z)  # Rodrigues' formula with the axis (−y, x, 0)
    rows = [[1 - k * x * x, -k * x * y, x], [-k * x * y, 1 - k * y * y, y], [-x, -y, z]]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def from_rotation_vector(v: Tensor) -> Tensor:
    """Convert rotation vectors to rotations by Rodrigues' formula.

    Args:
        v: (B, 3) axis times angle, radians.

    Returns:
        (B, 3, 3) rotations. They depend smoothly on v, at 0 too.
    """
    angle = (v.square().sum(dim=1) + 1e-16).sqrt()[:, None, None]  # (B, 1, 1)
    W = cross_matrix(v)
    eye = torch.eye(3, dtype=v.dtype, device=v.device)
    return eye + angle.sin() / angle * W + (1 - angle.cos()) / angle.square() * (W @ W)


def cross_matrix(v: Tensor) -> Tensor:
    """Return the matrices (…, 3, 3) of cross products with v (…, 3): cross_matrix(v) @ x = v × x."""
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))


def chord(R: Tensor, R0: Tensor) -> Tensor:
    """Return the turn from R0 to R as a vector: its axis times 2 sin(angle / 2).

    For small turns this is nearly the rotation vector, and it stays bounded for large ones.

    Args:
        R: (B, 3, 3) rotations.
        R0: (B, 3, 3) rotations.

    Returns:
        (B, 3).
    """
    M = R @ R0.transpose(1, 2)
    # The axis times sin(angle).
    axis = torch.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], dim=1) / 2
    half = ((1 + M.diagonal(dim1=1, dim2=2).sum(dim=1)) / 4).clamp(min=1e-3).sqrt()  # cos(angle / 2)
    return axis / half[:, None]


def mirror_rotation(R: Tensor) -> Tensor:
    """Return rotations camera←body (…, 3, 3) of drones that are seen in a mirror.

    The mirror is held at x = 0 of the camera. A drone is its own mirror image with left and right exchanged.
    So R becomes S R S' with S = diag(-1, 1, 1) in camera axes and S' = diag(1, -1, 1) in body axes, which is
    again a rotation.
    """
    S = torch.tensor([-1.0, 1.0, 1.0], dtype=R.dtype, device=R.device)
    body = torch.tensor([1.0, -1.0, 1.0], dtype=R.dtype, device=R.device)
    return S[:, None] * R * body


def mirror_points(points: Tensor) -> Tensor:
    """Return points (…, 3) in camera axes as they are seen in a mirror at x = 0 of the camera."""
    return points * torch.tensor([-1.0, 1.0, 1.0], dtype=points.dtype, device=points.device)


def _check_pair(R1: Tensor, R2: Tensor) -> None:
    """Check the arguments of `geodesic_degrees`."""
    check_ends("R1", R1, 3, 3)
    check_ends("R2", R2, 3, 3)
    # One against many is meant; one frame of a batch of one against many is a slip.
    if R1.ndim == R2.ndim and R1.shape != R2.shape and 1 not in (len(R1), len(R2)):
        raise InputError(f"R1 has shape {tuple(R1.shape)}, R2 {tuple(R2.shape)}: not as many rotations")
    if torch.is_grad_enabled() and (R1.requires_grad or R2.requires_grad):
        return  # a loss in training knows its rotations
    check_rotation(R1, "R1", PREDICTED, nan=True)
    check_rotation(R2, "R2", PREDICTED, nan=True)


@checks(_check_pair)
def geodesic_degrees(R1: Tensor, R2: Tensor) -> Tensor:
    """Return the angle between rotations in degrees, as in Eq. 13: the angle of R1ᵀR2.

    It is computed with atan2, which stays exact at 0° and 180°, where arccos loses half the digits.

    Args:
        R1: (…, 3, 3) rotations.
        R2: (…, 3, 3) rotations.

    Returns:
        (…) degrees, from 0 to 180; NaN for a rotation that holds NaN.

    Raises:
        InputError: the shapes do not fit, or there is a matrix that is no rotation. A loss, through which
            gradients go, does not look.
    """
    M = R1.transpose(-1, -2) @ R2
    axis = torch.stack(
        [M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]], -1
    )
    trace = M.diagonal(dim1=-2, dim2=-1).sum(-1)
    return torch.rad2deg(torch.atan2(axis.norm(dim=-1), trace - 1))


def check_rotation(
    R: Tensor | np.ndarray, name: str = "rotation", tolerance: float = 1e-4, nan: bool = False
) -> Tensor | np.ndarray:
    """Check rotations (…, 3, 3) and return them unchanged.

    Args:
        R: the rotations.
        name: what an error message calls them.
        tolerance: by how much an entry of RᵀR may differ from the identity.
        nan: whether a matrix that holds NaN or infinity, such as that of a frame without a pose, is passed
            over.

    Raises:
        InputError: the shape is wrong, a value is NaN or infinite, R is not orthonormal, or it is a
            reflection (determinant −1).
    """
    M = as_float64(R, name)
    if M.shape[-2:] != (3, 3):
        raise InputError(f"{name}: expected a 3×3 matrix, got shape {M.shape}")
    finite = np.isfinite(M).all(axis=(-2, -1))
    if not (nan or finite.all()):
        raise InputError(f"{name}: holds NaN or infinity")
    M = M[finite]  # (F, 3, 3)
    off = np.abs(M.swapaxes(-1, -2) @ M - np.eye(3)).max(initial=0)
    if off > tolerance:
        raise InputError(f"{name}: not orthonormal (RᵀR differs from the identity by {off:.2g})")
    if (np.linalg.det(M) < 0).any():
        raise InputError(f"{name}: determinant −1, a reflection; swap two keypoints or flip one axis")
    return R


def best_constant_rotation(R: Tensor, candidates: int = 256, frames: int = 2048) -> Tensor:
    """Return the one rotation that has the smallest median geodesic error to many.

    The candidates are evenly spaced rotations of R and the chordal mean. The chordal mean is the rotation
    nearest to the mean matrix. It minimises the mean *squared* chord and not the median, so it is only one
    candidate among the others.

    Args:
        R: (F, 3, 3) rotations.
        candidates: about how many rotations of R are tried.
        frames: about how many evenly spaced rotations of R the median is taken over.

    Returns:
        (3, 3) the rotation.
    """
    u, _, vh = torch.linalg.svd(R.double().mean(dim=0))
    mean = (
        u
        @ torch.diag(torch.tensor([1.0, 1.0, float(torch.sign(torch.det(u @ vh)))], dtype=torch.double))
        @ vh
    )
    tried = torch.cat([mean[None], R[:: max(1, len(R) // candidates)].double()])  # (C, 3, 3)
    judged = R[:: max(1, len(R) // frames)].double()
    medians = torch.stack([geodesic_degrees(one[None], judged).median() for one in tried])
    return tried[medians.argmin()].to(R.dtype)
