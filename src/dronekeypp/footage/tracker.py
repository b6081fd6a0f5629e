"""Carry one box from the first frame through the footage."""

from __future__ import annotations

import contextlib
import ctypes

import cv2
import numpy as np

from dronekeypp.errors import InputError


class Tracker:
    """A tracker carries a first-frame box through the footage with OpenCV's MIL, which needs no model file.

    It follows what looks most alike, and does not notice when the drone is gone: look at the overlay.

    Args:
        box: (x, y, w, h) in the first frame, pixels.
    """

    def __init__(self, box: np.ndarray) -> None:
        self.box = np.asarray(box, dtype=np.float64)
        self.tracker: cv2.TrackerMIL | None = None  # begins at the first frame

    def follow(self, image: np.ndarray) -> np.ndarray | None:
        """Return the box (x, y, w, h) in this frame (H, W, 3), or None where the tracker gives up.

        The first call takes the box as it was given.

        Raises:
            InputError: Less than two pixels of the first box lie in the frame.
        """
        picture = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        if self.tracker is None:
            self._begin(picture)
            return self.box
        followed, box = self.tracker.update(picture)
        return np.array(box, dtype=np.float64) if followed and min(box[2:]) > 0 else None

    def _begin(self, picture: np.ndarray) -> None:
        height, width = picture.shape[:2]
        low = np.clip(np.round(self.box[:2]), 0, None).astype(int)
        high = np.minimum(np.round(self.box[:2] + self.box[2:]), (width, height)).astype(int)
        if (high - low).min() < 2:
            raise InputError(f"box {self.box.tolist()}: nothing of it to track in the {width}×{height} frame")
        with contextlib.suppress(TypeError, OSError, AttributeError):  # not on Windows
            ctypes.CDLL(None).srand(0)  # MIL draws from the C library: the same box gives the same path
        self.tracker = cv2.TrackerMIL_create()
        self.tracker.init(picture, (*low.tolist(), *(high - low).tolist()))
