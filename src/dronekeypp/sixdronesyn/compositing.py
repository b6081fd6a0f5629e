"""This module lays a drawn drone over a panorama.

Full frames and crops go through the same steps: the panorama is sampled at the frame's own pixels, and the
drone is drawn finer and averaged. So a crop is the picture that the full frame would give there.
"""

from typing import Unpack

import cv2
import numpy as np

from dronekeypp.camera import Numbers, crop_image
from dronekeypp.sixdronesyn.render import DroneRenderer, View


def composite(drone: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Lay a drone (H, W, 4), premultiplied RGBA, over a background (H, W, 3) RGB; all uint8."""
    alpha = drone[..., 3:].astype(np.uint16)
    return (drone[..., :3] + ((255 - alpha) * background + 127) // 255).clip(0, 255).astype(np.uint8)


def directions(K: np.ndarray, camera_R: np.ndarray, x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
    """Return world directions (y1 − y0, x1 − x0, 3) of the full frame's pixel centres in a window, float32.

    The window holds the columns x0 to x1 − 1 and the rows y0 to y1 − 1. `camera_R` (3, 3) is camera←world.
    """
    x, y = np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5)
    v = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], -1)
    return (v @ camera_R).astype(np.float32)


def window_around(square: np.ndarray, width: int, height: int) -> tuple[int, int, int]:
    """Return the whole pixels (x, y, side) of a frame that hold `square` and one pixel around it.

    The frame has `width` × `height` pixels. Interpolation at the edge of the square reads the pixels next to
    it.
    """
    side = int(min(np.ceil(square[2]) + 3, width, height))
    corner = np.floor(square[:2]).astype(int) - 1
    return int(np.clip(corner[0], 0, width - side)), int(np.clip(corner[1], 0, height - side)), side


def draw_crop(
    renderer: DroneRenderer,
    background: np.ndarray,
    square: Numbers,
    window: tuple[int, int, int],
    size: int,
    **view: Unpack[View],
) -> np.ndarray:
    """Draw the crop `square`, `size` pixels wide.

    Args:
        renderer: a `DroneRenderer`.
        background: (side, side, 3) uint8, the panorama at the frame's own pixels in `window`.
        square: (x, y, side) in full-frame pixels.
        window: the whole pixels around it, from `window_around`.
        size: side of the crop in pixels.
        view: the other arguments of `DroneRenderer.draw`.

    Returns:
        (size, size, 3) uint8 RGB.
    """
    local = np.array([square[0] - window[0], square[1] - window[1], square[2]])
    if square[2] >= size:
        # The camera has more pixels than the crop: average.
        drone = cv2.resize(renderer.draw(square=square, **view), (size, size), interpolation=cv2.INTER_AREA)
        return composite(drone, crop_image(background, local, size))
    # The camera has fewer: draw at the camera's own pixels and enlarge, as a cut from the full frame would.
    side = window[2]
    drone = cv2.resize(renderer.draw(square=window, **view), (side, side), interpolation=cv2.INTER_AREA)
    return crop_image(composite(drone, background), local, size)


def draw_frame(
    renderer: DroneRenderer, background: np.ndarray, square: Numbers, **view: Unpack[View]
) -> np.ndarray:
    """Draw the full frame, (H, W, 3) uint8 RGB.

    Args:
        renderer: a `DroneRenderer`; its picture of the square is averaged down to the frame's pixels.
        background: (H, W, 3) uint8, the panorama behind the whole frame. It is left as it is.
        square: (x, y, side), the whole pixels that hold the drone.
        view: the other arguments of `DroneRenderer.draw`.
    """
    x, y, side = int(square[0]), int(square[1]), int(square[2])
    drone = cv2.resize(renderer.draw(square=square, **view), (side, side), interpolation=cv2.INTER_AREA)
    picture = background.copy()
    picture[y : y + side, x : x + side] = composite(drone, picture[y : y + side, x : x + side])
    return picture
