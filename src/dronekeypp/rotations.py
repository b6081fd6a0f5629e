"""Rotations: the paper's normalised angles, the continuous 6D form, and the geodesic angle between two rotations. Torch, batch first.

The paper predicts three angles in [0, 1] (Sec. III-C) and says neither their order nor their frame. We take R = R_camera←body and read its
angles in the camera's *level frame* (x forward, y left, z up) as intrinsic Z-Y-X: yaw, pitch, roll, each divided by 360°, modulo 1. A flying
drone stays far from the singularity at pitch ±90° there; in raw camera axes it would sit on it.
"""

import math

import torch

from dronekeypp.errors import InputError

# Level frame ← camera: forward = z, left = −x, up = −y.
LEVEL_FROM_CAMERA = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))


def _level(like):
    return torch.tensor(LEVEL_FROM_CAMERA, dtype=like.dtype, device=like.device)


def matrix_to_angles(R):
    """Rotations (…, 3, 3), camera←body, to (yaw, pitch, roll) / 360° in [0, 1): (…, 3). Exactly at pitch ±90° the answer need not give R back."""
    M = _level(R) @ R
    yaw = torch.atan2(M[..., 1, 0], M[..., 0, 0])
    pitch = torch.asin((-M[..., 2, 0]).clamp(-1, 1))
    roll = torch.atan2(M[..., 2, 1], M[..., 2, 2])
    turns = torch.stack([yaw, pitch, roll], -1) / (2 * math.pi) % 1.0
    return torch.where(turns >= 1, torch.zeros_like(turns), turns)  # −1e-9 % 1 rounds to 1.0 in float32


def angles_to_matrix(angles):
    """The inverse: normalised angles (…, 3) to rotations camera←body (…, 3, 3)."""
    c, s = (angles * 2 * math.pi).cos(), (angles * 2 * math.pi).sin()
    (cy, cp, cr), (sy, sp, sr) = c.unbind(-1), s.unbind(-1)
    rows = [
        torch.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], -1),
        torch.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], -1),
        torch.stack([-sp, cp * sr, cp * cr], -1),
    ]
    return _level(angles).T @ torch.stack(rows, -2)


def matrix_to_6d(R):
    """The first two columns of R (…, 3, 3), one after the other: (…, 6) (Zhou et al., CVPR 2019)."""
    return torch.cat([R[..., :, 0], R[..., :, 1]], -1)


def matrix_from_6d(x):
    """Gram–Schmidt on the two columns in x (…, 6): a rotation (…, 3, 3) for any two independent vectors."""
    a, b = x[..., :3], x[..., 3:]
    first = torch.nn.functional.normalize(a, dim=-1)
    second = torch.nn.functional.normalize(b - (first * b).sum(-1, keepdim=True) * first, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], -1)


def towards(ray):
    """The smallest turn (…, 3, 3) that takes the camera's axis (0, 0, 1) to a ray (…, 3) in front of it, of any length.

    With it a rotation is egocentric (camera←body) or allocentric (as the drone looks when the camera is turned to it):
    R = towards(t) @ R_allocentric (Kundu et al., CVPR 2018). The same picture then means the same allocentric rotation anywhere in the frame.
    """
    x, y, z = torch.nn.functional.normalize(ray, dim=-1).unbind(-1)
    k = 1 / (1 + z)  # Rodrigues with axis (−y, x, 0)
    rows = [[1 - k * x * x, -k * x * y, x], [-k * x * y, 1 - k * y * y, y], [-x, -y, z]]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def geodesic_degrees(R1, R2):
    """Eq. 13: the angle of R1ᵀR2 in degrees, (…). Uses atan2, which stays exact at 0° and 180° where arccos loses half the digits."""
    M = R1.transpose(-1, -2) @ R2
    axis = torch.stack(
        [M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]], -1
    )
    trace = M.diagonal(dim1=-2, dim2=-1).sum(-1)
    return torch.rad2deg(torch.atan2(axis.norm(dim=-1), trace - 1))


def check_rotation(R, name="rotation", tolerance=1e-4):
    """Return `R` (…, 3, 3) if it is a rotation.

    Raises:
        InputError: wrong shape, NaN, not orthonormal within `tolerance`, or a reflection (determinant −1).
    """
    M = torch.as_tensor(R, dtype=torch.float64)
    if M.shape[-2:] != (3, 3):
        raise InputError(f"{name}: expected a 3×3 matrix, got shape {tuple(M.shape)}")
    if not torch.isfinite(M).all():
        raise InputError(f"{name}: holds NaN or infinity")
    off = (M.transpose(-1, -2) @ M - torch.eye(3, dtype=M.dtype)).abs()
    if (off > tolerance).any():
        raise InputError(f"{name}: not orthonormal (RᵀR differs from the identity by {off.max():.2g})")
    if (torch.linalg.det(M) < 0).any():
        raise InputError(f"{name}: determinant −1, a reflection; swap two keypoints or flip one axis")
    return R


def best_constant_rotation(R, candidates=256, frames=2048):
    """The rotation (3, 3) with the smallest median geodesic error to R (F, 3, 3), among evenly spaced ones of R and their chordal mean.

    The chordal mean (the rotation nearest to the mean matrix) minimises the mean *squared* chord, not the median; so both compete.
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
