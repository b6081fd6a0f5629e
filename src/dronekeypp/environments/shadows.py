"""Where the sun reaches the ground: the shadows of everything that stands on it, drawn from above."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np


def _raster() -> np.ndarray:
    return np.zeros((2048, 2048), np.uint8)


@dataclass
class Shadows:
    """Shadows on flat ground, in two square rasters with the camera in their middle.

    While shadows are drawn, 255 is shade. `soften` turns the rasters round: then 255 is lit and 0 is shade.

    Attributes:
        sun: (3,) unit vector towards the sun.
        near, far: (2048, 2048) uint8 rasters, a fine one and a wide one.
        reach: metres from the camera to the edge of the near and of the far raster.
    """

    sun: np.ndarray
    near: np.ndarray = field(default_factory=_raster)
    far: np.ndarray = field(default_factory=_raster)
    reach: tuple[float, float] = (45.0, 420.0)

    def stretch(self) -> np.ndarray:
        """Return where the shadow of a point one metre high falls, (2,) metres from the point's foot."""
        return -self.sun[:2] / max(self.sun[2], 0.04)

    def polygon(self, points: np.ndarray) -> None:
        """Draw a convex shadow with corners at the ground positions `points`, (N, 2) metres."""
        for raster, reach in zip((self.near, self.far), self.reach, strict=True):
            pixels = (points / reach * 0.5 + 0.5) * len(raster)
            if np.abs(pixels).max() < 30000:
                cv2.fillConvexPoly(raster, (pixels * 16).astype(np.int32), 255, cv2.LINE_AA, 4)

    def stamp(self, alpha: np.ndarray, x: float, y: float, height: float) -> None:
        """Draw the shadow of a picture that stands upright with its broad side to the sun.

        Args:
            alpha: (h, w) uint8, 255 where the picture is opaque.
            x, y: the middle of the picture's foot in metres.
            height: metres.
        """
        h, w = alpha.shape
        fall = self.stretch() * height
        flat = np.hypot(*self.sun[:2])
        side = np.array([-self.sun[1], self.sun[0]]) / max(flat, 1e-6) * height / h  # metres per column
        for raster, reach in zip((self.near, self.far), self.reach, strict=True):
            scale = len(raster) / (2 * reach)
            if np.hypot(x, y) > reach + np.hypot(*fall) or np.hypot(x, y) > 3 * reach:
                continue
            base = (np.array([x, y]) + reach) * scale
            down = -fall * scale / h  # raster step for one row downwards in the picture
            matrix = np.array([[side[0] * scale, down[0], 0], [side[1] * scale, down[1], 0]])
            matrix[:, 2] = base - matrix[:, 0] * w / 2 - matrix[:, 1] * h
            corners = matrix[:, :2] @ np.array([[0, w, 0, w], [0, 0, h, h]]) + matrix[:, 2:]
            low = np.clip(np.floor(corners.min(1)).astype(int), 0, len(raster))
            high = np.clip(np.ceil(corners.max(1)).astype(int) + 1, 0, len(raster))
            if (high - low).min() <= 0:
                continue
            matrix[:, 2] -= low
            size = int(high[0] - low[0]), int(high[1] - low[1])
            shade = cv2.warpAffine(alpha, matrix, size, flags=cv2.INTER_LINEAR)
            part = raster[low[1] : high[1], low[0] : high[0]]
            np.maximum(part, shade, out=part)

    def soften(self) -> None:
        """Turn shade into light, 0 into 255, and blur the edges of the near raster."""
        self.near = 255 - cv2.GaussianBlur(self.near, (0, 0), 1.0)
        self.far = 255 - self.far

    def lit(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the share of sunlight, 0 to 1, float32, at ground positions x, y in metres.

        Call `soften` first.
        """
        near = self._sample(self.near, self.reach[0], x, y)
        far = self._sample(self.far, self.reach[1], x, y)
        inside = (np.abs(x) < self.reach[0] * 0.98) & (np.abs(y) < self.reach[0] * 0.98)
        return np.where(inside, near, far).astype(np.float32) / 255

    @staticmethod
    def _sample(raster: np.ndarray, reach: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Look up a raster at ground positions. Outside of it everything is lit."""
        u = (x / reach * 0.5 + 0.5) * len(raster) - 0.5
        v = (y / reach * 0.5 + 0.5) * len(raster) - 0.5
        u = np.clip(u, -10, 4000).astype(np.float32)
        v = np.clip(v, -10, 4000).astype(np.float32)
        return cv2.remap(raster, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(255,))
