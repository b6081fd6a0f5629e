"""Model the pinhole camera: projection, rays (Eq. 6), square crops and mirror images.

Pixels are (x right, y down), and pixel centres lie at +0.5: the top-left pixel covers [0, 1] × [0, 1]. Camera
axes are those of OpenCV: x right, y down, z forward.

`project`, `rays`, `to_crop`, `from_crop` and the functions `mirror_…` take numpy arrays or torch tensors of
one dtype, with the batch dimensions first. The functions for one box or one picture (`square_around`,
`clamp_square`, `crop_intrinsics`, `crop_image`) take numpy arrays, one box or picture at a time.

A *square* is (x, y, side) in full-frame pixels: the top-left corner and the side of a crop. Crop units run
from 0 to 1 across the square. Keypoints in crop units go back to full-frame pixels before their rays are
computed, so cutting a crop never changes a ray.
"""

from collections.abc import Sequence
from typing import TypeVar

import cv2
import numpy as np
import torch

from dronekeypp.checked import as_float64, check_ends, checks
from dronekeypp.errors import InputError

Array = TypeVar("Array", np.ndarray, torch.Tensor)
Numbers = Sequence[float] | np.ndarray

# The paper says neither how large the crop is nor how it is cut. We take a square around the box, whose side
# is 1.15 to 1.3 times the longer side of the box.
CROP_MARGIN = (1.15, 1.3)


def check_intrinsics(K: Array, name: str = "camera matrix") -> Array:
    """Check pinhole camera matrices and return them unchanged.

    Args:
        K: (…, 3, 3) camera matrix, pixels.
        name: what an error message calls the matrix.

    Raises:
        InputError: the shape is wrong, a value is NaN or infinite, a focal length is not positive, the matrix
            is not upper triangular, or its last row is not (0, 0, 1).
    """
    k = as_float64(K, name)
    if k.shape[-2:] != (3, 3):
        raise InputError(f"{name}: expected a 3×3 matrix, got shape {k.shape}")
    if not np.isfinite(k).all():
        raise InputError(f"{name}: holds NaN or infinity")
    if (k[..., 0, 0] <= 0).any() or (k[..., 1, 1] <= 0).any():
        raise InputError(f"{name}: focal lengths must be positive pixels")
    if (np.abs(k[..., 2, :] - [0, 0, 1]) > 1e-9).any() or (np.abs(k[..., 1, 0]) > 1e-9).any():
        raise InputError(f"{name}: the rows must be [fx s cx], [0 fy cy], [0 0 1]; is it transposed?")
    return K


def intrinsics(
    focal: float, width: float, height: float, centre: tuple[float, float] | None = None
) -> np.ndarray:
    """Build the camera matrix (3, 3) of a pinhole camera with a focal length in pixels.

    The principal point is `centre` (x, y) in pixels. Without `centre` it is the middle of the frame.

    Raises:
        InputError: a number is not finite, or the focal length or a side is not positive.
    """
    for name, value in (("focal", focal), ("width", width), ("height", height)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name}={value}: pixels, above 0")
    cx, cy = (width / 2, height / 2) if centre is None else centre
    return np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])


def _check_points(points: Array, K: Array) -> None:
    """Check the arguments of `project`."""
    check_ends("points", points, 3)
    _check_camera(K)


def _check_pixels(pixels: Array, K: Array) -> None:
    """Check the arguments of `rays`."""
    check_ends("pixels", pixels, 2)
    _check_camera(K)


def _check_camera(K: Array) -> None:
    """Check a camera matrix: the shape of a tensor, and of an array the values too.

    Tensors come from networks, which look at the values before they begin (`model.inputs`).
    """
    check_ends("K", K, 3, 3)
    if not torch.is_tensor(K):
        check_intrinsics(K, "K")


def _check_to_crop(pixels: Array, square: Array) -> None:
    """Check the arguments of `to_crop`."""
    check_ends("pixels", pixels, 2)
    _check_squares(square)


def _check_from_crop(units: Array, square: Array) -> None:
    """Check the arguments of `from_crop`."""
    check_ends("units", units, 2)
    _check_squares(square)


def _check_squares(square: Array) -> None:
    """Check squares: the shape of a tensor, and of an array the sides too; see `_check_camera`."""
    check_ends("square", square, 3)
    if not torch.is_tensor(square) and not (np.asarray(square)[..., 2] > 0).all():
        raise InputError("square: (x, y, side), and the side must be positive pixels")


@checks(_check_points)
def project(points: Array, K: Array) -> Array:
    """Project points in camera axes to pixels.

    Args:
        points: (…, P, 3) metres, camera axes.
        K: (…, 3, 3) camera matrix, pixels.

    Returns:
        (…, P, 2) pixels.

    Raises:
        InputError: a shape does not fit, or K is an array and no camera matrix.
    """
    p = points @ K.swapaxes(-1, -2)
    return p[..., :2] / p[..., 2:]


@checks(_check_pixels)
def rays(pixels: Array, K: Array) -> Array:
    """Compute the rays of pixels by Eq. 6: v_k = A⁻¹ [y_k, 1]ᵀ.

    Args:
        pixels: (…, P, 2) full-frame pixels.
        K: (…, 3, 3) full-frame camera matrix A.

    Returns:
        (…, P, 3) directions in camera axes with z = 1. They are not unit vectors, exactly as the paper writes
        them.

    Raises:
        InputError: a shape does not fit, or K is an array and no camera matrix.
    """
    y = (pixels[..., 1] - K[..., 1, 2, None]) / K[..., 1, 1, None]
    x = (pixels[..., 0] - K[..., 0, 2, None] - K[..., 0, 1, None] * y) / K[..., 0, 0, None]
    stack = np.stack if isinstance(x, np.ndarray) else torch.stack
    return stack([x, y, x * 0 + 1], -1)


def _check_box(box: Numbers, margin: float = 1.2) -> None:
    """Check the arguments of `square_around`."""
    _numbers("box", box, 4)
    if not (np.isfinite(margin) and margin > 0):
        raise InputError(f"margin={margin}: the side of the square over that of the box, above 0")


@checks(_check_box)
def square_around(box: Numbers, margin: float = 1.2) -> np.ndarray:
    """Return the square around a box, with the same centre.

    Args:
        box: (x, y, w, h), pixels.
        margin: the side of the square over the longer side of the box.

    Returns:
        (3,) x, y and side of the square, pixels.

    Raises:
        InputError: the box is not four finite numbers or has no area, or the margin is not positive.
    """
    x, y, w, h = (float(v) for v in box)
    if not np.isfinite([x, y, w, h]).all() or w <= 0 or h <= 0:
        raise InputError(
            f"box {tuple(round(v, 2) for v in (x, y, w, h))}: width and height must be positive pixels"
        )
    side = margin * max(w, h)
    return np.array([x + w / 2 - side / 2, y + h / 2 - side / 2, side])


def check_square(square: Numbers, name: str = "crop square") -> tuple[float, float, float]:
    """Return x, y and side of one square.

    Raises:
        InputError: they are not three finite numbers, or the side is not positive.
    """
    x, y, side = _numbers(name, square, 3)
    if not np.isfinite([x, y, side]).all() or side <= 0:
        raise InputError(f"{name} {(x, y, side)}: the side must be positive pixels")
    return x, y, side


def _check_size(size: int) -> None:
    """Raise InputError unless the side of a crop, in its own pixels, is positive."""
    if not (np.isfinite(size) and size >= 1):
        raise InputError(f"size={size}: the crop's side in pixels, at least 1")


def _numbers(name: str, values: Numbers, count: int) -> list[float]:
    """Return a box or a square as a list of floats, or raise InputError unless it has `count` numbers."""
    array = as_float64(values, name)
    if array.shape != (count,):
        raise InputError(f"{name} has shape {array.shape}, {count} numbers are needed")
    return array.tolist()


def clamp_square(square: Numbers, width: float, height: float) -> np.ndarray:
    """Move a square (x, y, side) inside a frame of `width` × `height` pixels.

    A camera sees nothing outside its frame. The square is shrunk only where it is larger than the frame.

    Raises:
        InputError: the square is not three finite numbers, or its side or one of the frame is not positive.
    """
    left, top, length = check_square(square)
    if not (width > 0 and height > 0):
        raise InputError(f"a frame of {width}×{height} pixels")
    side = float(min(length, width, height))
    x = min(max(left + (length - side) / 2, 0.0), width - side)
    y = min(max(top + (length - side) / 2, 0.0), height - side)
    return np.array([x, y, side])


@checks(_check_to_crop)
def to_crop(pixels: Array, square: Array) -> Array:
    """Convert full-frame pixels (…, P, 2) to crop units.

    Crop units run from 0 to 1 across the square (…, 3).

    Raises:
        InputError: a shape does not fit, or the square is an array and its side is not positive.
    """
    return (pixels - square[..., None, :2]) / square[..., None, 2:]


@checks(_check_from_crop)
def from_crop(units: Array, square: Array) -> Array:
    """Convert crop units (…, P, 2) to full-frame pixels.

    This is the inverse of `to_crop`.

    Raises:
        InputError: as `to_crop` raises it.
    """
    return units * square[..., None, 2:] + square[..., None, :2]


def crop_intrinsics(K: np.ndarray, square: Numbers, size: int) -> np.ndarray:
    """Return the camera matrix (3, 3) of a crop that is `size` pixels wide.

    A point has the same ray under this matrix as under K; only its pixel numbers differ.

    Raises:
        InputError: K is no camera matrix, or the square or the size has no positive side.
    """
    check_intrinsics(K, "K")
    x, y, side = check_square(square)
    _check_size(size)
    scale = size / side
    to_pixels = np.array([[scale, 0, -scale * x], [0, scale, -scale * y], [0, 0, 1]])
    return to_pixels @ np.asarray(K, dtype=np.float64)


def crop_image(image: np.ndarray, square: Numbers, size: int) -> np.ndarray:
    """Cut a square out of an image and resize it.

    The cut is exact to a fraction of a pixel. Outside the frame the edge pixels are repeated. Where the crop
    makes the picture smaller, it is sampled more finely and then averaged, so that thin propellers do not
    alias.

    Args:
        image: (H, W, C).
        square: (x, y, side), pixels of `image`.
        size: side of the result, pixels.

    Returns:
        (size, size, C).

    Raises:
        InputError: the image is no picture, the square is not finite, or a side is not positive.
    """
    if getattr(image, "ndim", None) not in (2, 3) or 0 in image.shape:
        raise InputError(f"image: a picture (H, W, C) is needed, got {getattr(image, 'shape', type(image))}")
    x, y, side = check_square(square)
    _check_size(size)
    fine = max(1, int(np.ceil(side / size - 0.25)))
    step = side / (size * fine)
    # OpenCV puts the first pixel's centre at 0; ours lies at +0.5.
    affine = np.array([[step, 0, x + step / 2 - 0.5], [0, step, y + step / 2 - 0.5]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(
        image, affine, (size * fine, size * fine), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    return cut if fine == 1 else cv2.resize(cut, (size, size), interpolation=cv2.INTER_AREA)


# The keypoints in the order that a mirror gives them: front-left and front-right change places, and so do
# rear-right and rear-left.
MIRRORED_KEYPOINTS = [1, 0, 3, 2]


def mirror_image(image: Array) -> Array:
    """Return pictures (…, 3, S, S) as a mirror shows them, with left and right exchanged."""
    return np.flip(image, -1) if isinstance(image, np.ndarray) else image.flip(-1)


def mirror_keypoints(keypoints: Array) -> Array:
    """Return keypoints (…, 4, 2) in crop units as the same crop shows them in a mirror.

    Left and right are exchanged, and so are the names of the left and the right hubs.
    """
    swapped = keypoints[..., MIRRORED_KEYPOINTS, :]
    stack = np.stack if isinstance(keypoints, np.ndarray) else torch.stack
    return stack([1 - swapped[..., 0], swapped[..., 1]], -1)


def mirror_square(square: Array, K: Array) -> Array:
    """Return the square (…, 3) of a crop as it is seen in a mirror, in pixels.

    The mirror is held at x = 0 of a camera K (…, 3, 3). The mirrored crop lies on the other side of the
    principal point. K itself stays as it is.
    """
    x, y, side = square[..., 0], square[..., 1], square[..., 2]
    stack = np.stack if isinstance(square, np.ndarray) else torch.stack
    return stack([2 * K[..., 0, 2] - x - side, y, side], -1)
