"""The pinhole camera: projection, rays (Eq. 6), and square crops that never change a ray.

Pixels are (x right, y down) with pixel centres at +0.5: the top-left pixel covers [0, 1] × [0, 1]. Camera axes are OpenCV's: x right,
y down, z forward. `project`, `rays`, `to_crop` and `from_crop` take numpy arrays or torch tensors of one dtype, batch dimensions first; what is
about one box or one picture (`square_around`, `clamp_square`, `crop_intrinsics`, `crop_image`) takes numpy, one at a time.

A *square* is (x, y, side) in full-frame pixels: the top-left corner and the side of a crop. Crop units run from 0 to 1 across it.
"""

import cv2
import numpy as np
import torch

from dronekeypp.errors import InputError

# The paper says neither how large the crop is nor how it is cut. We take a square around the box, 1.15 to 1.3 times its longer side.
CROP_MARGIN = (1.15, 1.3)


def check_intrinsics(K, name="camera matrix"):
    """Return `K` if it is a finite 3×3 (batched: …×3×3) upper-triangular pinhole matrix.

    Raises:
        InputError: wrong shape, NaN, focal length not positive, or a last row that is not (0, 0, 1).
    """
    k = np.asarray(K, dtype=np.float64)
    if k.shape[-2:] != (3, 3):
        raise InputError(f"{name}: expected a 3×3 matrix, got shape {k.shape}")
    if not np.isfinite(k).all():
        raise InputError(f"{name}: holds NaN or infinity")
    if (k[..., 0, 0] <= 0).any() or (k[..., 1, 1] <= 0).any():
        raise InputError(f"{name}: focal lengths must be positive pixels")
    if (np.abs(k[..., 2, :] - [0, 0, 1]) > 1e-9).any() or (np.abs(k[..., 1, 0]) > 1e-9).any():
        raise InputError(f"{name}: the rows must be [fx s cx], [0 fy cy], [0 0 1]; is it transposed?")
    return K


def intrinsics(focal, width, height, centre=None):
    """Pinhole matrix (3, 3) for a focal length in pixels; the principal point is the frame's middle unless `centre` (x, y) is given."""
    cx, cy = (width / 2, height / 2) if centre is None else centre
    return np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])


def project(points, K):
    """Project points (…, P, 3) in camera axes (metres) with K (…, 3, 3) to pixels (…, P, 2)."""
    p = points @ K.swapaxes(-1, -2)
    return p[..., :2] / p[..., 2:]


def rays(pixels, K):
    """Eq. 6: v_k = A⁻¹ [y_k, 1]ᵀ.

    Args:
        pixels: (…, P, 2) full-frame pixels.
        K: (…, 3, 3) full-frame camera matrix A.

    Returns:
        (…, P, 3) directions in camera axes with z = 1: not unit vectors, exactly as the paper writes them.
    """
    y = (pixels[..., 1] - K[..., 1, 2, None]) / K[..., 1, 1, None]
    x = (pixels[..., 0] - K[..., 0, 2, None] - K[..., 0, 1, None] * y) / K[..., 0, 0, None]
    stack = np.stack if isinstance(x, np.ndarray) else torch.stack
    return stack([x, y, x * 0 + 1], -1)


def square_around(box, margin=1.2):
    """The square (x, y, side) around a box (x, y, w, h), its side `margin` times the box's longer side, same centre.

    Raises:
        InputError: a box that is not finite or has no area.
    """
    x, y, w, h = (float(v) for v in box)
    if not np.isfinite([x, y, w, h]).all() or w <= 0 or h <= 0:
        raise InputError(
            f"box {tuple(round(v, 2) for v in (x, y, w, h))}: width and height must be positive pixels"
        )
    side = margin * max(w, h)
    return np.array([x + w / 2 - side / 2, y + h / 2 - side / 2, side])


def clamp_square(square, width, height):
    """Move `square` (x, y, side) inside the frame, shrinking it only where it is larger than the frame: a camera sees nothing outside."""
    side = float(min(square[2], width, height))
    x = min(max(float(square[0]) + (float(square[2]) - side) / 2, 0.0), width - side)
    y = min(max(float(square[1]) + (float(square[2]) - side) / 2, 0.0), height - side)
    return np.array([x, y, side])


def to_crop(pixels, square):
    """Full-frame pixels (…, P, 2) to crop units (0 to 1 across the square (…, 3))."""
    return (pixels - square[..., None, :2]) / square[..., None, 2:]


def from_crop(units, square):
    """Crop units (…, P, 2) back to full-frame pixels: the inverse of `to_crop`."""
    return units * square[..., None, 2:] + square[..., None, :2]


def crop_intrinsics(K, square, size):
    """The camera matrix (3, 3) of the crop itself, `size` pixels wide: the same rays, other pixel numbers."""
    x, y, side = (float(v) for v in square)
    scale = size / side
    return np.array([[scale, 0, -scale * x], [0, scale, -scale * y], [0, 0, 1]]) @ np.asarray(
        K, dtype=np.float64
    )


def crop_image(image, square, size):
    """Cut `square` (x, y, side) out of `image` (H, W, C) and resize it to (size, size, C); outside the frame the edge is repeated.

    Sub-pixel exact. Where the crop shrinks the picture it samples finer and averages, so that thin propellers do not alias.
    """
    x, y, side = (float(v) for v in square)
    if not np.isfinite([x, y, side]).all() or side <= 0:
        raise InputError(f"crop square {(x, y, side)}: the side must be positive pixels")
    fine = max(1, int(np.ceil(side / size - 0.25)))
    step = side / (size * fine)
    # OpenCV counts pixel centres from 0; ours lie at +0.5
    affine = np.array([[step, 0, x + step / 2 - 0.5], [0, step, y + step / 2 - 0.5]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(
        image, affine, (size * fine, size * fine), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    return cut if fine == 1 else cv2.resize(cut, (size, size), interpolation=cv2.INTER_AREA)


def mirror_keypoints(keypoints):
    """Keypoints (B, 4, 2) in crop units as the same crop shows them in a mirror: left is right, and left and right hubs change names."""
    swapped = keypoints[:, [1, 0, 3, 2]]  # FL, FR, RR, RL
    stack = np.stack if isinstance(keypoints, np.ndarray) else torch.stack
    return stack([1 - swapped[..., 0], swapped[..., 1]], -1)
