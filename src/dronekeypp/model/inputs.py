"""Check what a network is asked about: the crop, the camera, the square, and a truth that is given to it.

Every network answers any numbers with a pose. So before a network is asked, and while it does not train, the
usual slips are refused by name: pictures of 0 to 255, a transposed camera matrix, that of the crop, squares
in shares of the frame, keypoints in pixels.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from dronekeypp.camera import check_intrinsics
from dronekeypp.checked import check_shapes, tracing
from dronekeypp.errors import InputError

INPUTS = ("image", "K", "square", "keypoints", "label")  # what any network may be asked with
BRIGHTEST, DARKEST = 1.1, -0.1  # of a picture in [0, 1], with some room for resizing that overshoots
SMALLEST_SIDE = 2.0  # pixels of a square that can show a drone; one in shares of the frame has less than 1
# How far a square may lie from the principal point, in distances of that point from the frame's corner.
FARTHEST = 2.4
KEYPOINTS = (-2.0, 3.0)  # crop units; a hub outside of the crop is not far from it


def check_call(network: nn.Module, args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
    """Check the arguments of a network's call; `PoseNetwork` has it as a hook that runs before `forward`.

    In training only the shapes are checked: `train.fit` checks the first batch. While a graph is recorded
    nothing is.

    Raises:
        InputError: an argument does not fit. The message names it.
    """
    if tracing():
        return
    try:
        inputs = _signature(type(network)).bind(network, *args, **kwargs).arguments
    except TypeError:
        return  # Python says itself which argument is missing
    given = {name: inputs.get(name) for name in INPUTS}
    config = network.config
    check_input_shapes(given, getattr(config, "image_size", "S"))
    if network.training or not network.checks_inputs:
        return
    check_placed(given, network)
    check_values(given, getattr(config, "classes", None))


@functools.cache
def _signature(kind: type[nn.Module]) -> inspect.Signature:
    return inspect.signature(kind.forward)


@contextlib.contextmanager
def without_checks(network: Any) -> Iterator[None]:
    """Ask a network without a look at the values, where whoever asks has checked them already."""
    before = getattr(network, "checks_inputs", None)
    if before is None:
        yield
        return
    network.checks_inputs = False
    try:
        yield
    finally:
        network.checks_inputs = before


def check_input_shapes(given: dict[str, Any], size: int | str) -> None:
    """Check that the arguments of a network's call are tensors of its shapes.

    Args:
        given: image, K, square, keypoints and label; None where one is not given.
        size: the side of the crop that the network takes, pixels.

    Raises:
        InputError: one is no tensor, or its shape does not fit.
    """
    for name, value in given.items():
        if value is not None and not torch.is_tensor(value):
            raise InputError(
                f"{name} is a {type(value).__name__}; the network takes tensors (torch.as_tensor)"
            )
    shapes = {"K": ("B", 3, 3), "square": ("B", 3), "image": ("B", 3, size, size)}
    shapes |= {"keypoints": ("B", 4, 2), "label": ("B",)}
    check_shapes(**{name: (given.get(name), shape) for name, shape in shapes.items()})


def check_placed(given: dict[str, Any], network: nn.Module) -> None:
    """Check that the arguments have the type of the network's weights, and lie on their device.

    Raises:
        InputError: one has another, or lies elsewhere.
    """
    weights = next(network.parameters(), None)
    if weights is None:
        return
    for name, value in given.items():
        if value is None:
            continue
        if value.device != weights.device:
            raise InputError(f"{name} lies on {value.device}, the network on {weights.device}")
        if name == "label" or torch.is_autocast_enabled(weights.device.type):
            continue
        if value.dtype != weights.dtype:
            hint = "; a picture is RGB in [0, 1]: divide by 255" if value.dtype == torch.uint8 else ""
            raise InputError(f"{name} is {value.dtype}, the network's weights are {weights.dtype}{hint}")


def check_values(given: dict[str, Any], classes: int | None) -> None:
    """Check the values of a network's arguments.

    They are fetched from the GPU at once.

    Args:
        given: image, K, square, keypoints and label; None where one is not given.
        classes: how many classes the network knows, or None.

    Raises:
        InputError: the picture is not in [0, 1], a camera matrix is none or not that of the frames that the
            squares are in, a square has no side, keypoints are not in crop units, or a label is no class.
    """
    K, square, image = given["K"], given["square"], given.get("image")
    keypoints, label = given.get("keypoints"), given.get("label")
    if K.device.type == "meta" or len(K) == 0:
        return
    facts = [K.detach().flatten(), square.detach().flatten()]
    for value in (image, keypoints):
        if value is not None:
            facts.append(torch.stack(value.detach().aminmax()))
    numbers = torch.cat([fact.double() for fact in facts]).cpu().numpy()
    B = len(K)
    matrices, squares = numbers[: 9 * B].reshape(B, 3, 3), numbers[9 * B : 12 * B].reshape(B, 3)
    limits = iter(numbers[12 * B :].reshape(-1, 2))
    if image is not None:
        _check_picture(*next(limits))
    _check_camera_and_square(matrices, squares)
    if keypoints is not None:
        low, high = next(limits)
        if not KEYPOINTS[0] <= low <= high <= KEYPOINTS[1]:
            raise InputError(
                f"keypoints lie between {low:g} and {high:g}: crop units are needed, "
                "0 to 1 across the square (camera.to_crop)"
            )
    if label is not None:
        check_label(label, classes)


def _check_picture(low: float, high: float) -> None:
    """Raise InputError unless a picture with this darkest and brightest value is in [0, 1]."""
    if DARKEST <= low <= high <= BRIGHTEST:
        return
    mend = "divide by 255" if high > 3 else "the network normalises pictures itself"
    raise InputError(f"image lies between {low:g} and {high:g}: RGB in [0, 1] is needed; {mend}")


def _check_camera_and_square(K: np.ndarray, square: np.ndarray) -> None:
    """Check camera matrices (B, 3, 3) and squares (B, 3).

    Where a frame ends is not known. But its middle lies near the principal point. So a square that is many
    times as far from that point as the frame's corner, which is at 0, is in the pixels of another frame.

    Raises:
        InputError: a matrix is none, a square has no side, or the two are not of one frame.
    """
    check_intrinsics(K, "K")
    if not np.isfinite(square).all():
        raise InputError("square holds NaN or infinity")
    least = square[:, 2].min()
    if least < SMALLEST_SIDE:
        raise InputError(
            f"square has a side of {least:g}: (x, y, side) in pixels of the full frame, "
            f"at least {SMALLEST_SIDE:g}"
        )
    centre = K[:, :2, 2]
    away = np.abs(square[:, :2] + square[:, 2:] / 2 - centre)
    far = (away > FARTHEST * np.abs(centre)).any(axis=1)
    if far.any():
        i = int(far.argmax())
        x, y, side = square[i]
        raise InputError(
            f"square ({x:g}, {y:g}, {side:g}) is far from the principal point ({K[i, 0, 2]:g}, "
            f"{K[i, 1, 2]:g}) of K: both are of the full frame, at one resolution, and K is not that of the "
            "crop (of a frame cut from a larger one, give both in pixels of the larger)"
        )


def check_label(label: Tensor, classes: int | None) -> None:
    """Check that labels are class indices.

    Args:
        label: (B,).
        classes: how many there are; None: any number.

    Raises:
        InputError: they are not whole numbers, or too large.
    """
    if label.is_floating_point() or label.is_complex() or label.dtype == torch.bool:
        raise InputError(f"label is {label.dtype}, class indices are needed (torch.int64)")
    low, high = int(label.min()), int(label.max())
    if low < 0 or (classes is not None and high >= classes):
        raise InputError(f"label from {low} to {high}: the network has the classes 0 to {classes - 1}")
