"""Where the sun reaches the ground: shadows of everything that stands on it, drawn from above."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np


@dataclass
class Shadows:
    """Sunlight left on flat ground, as two square rasters about the camera: 1 lit, 0 shaded."""

    sun: np.ndarray
    near: np.ndarray = field(default_factory=lambda: np.zeros((2048, 2048), np.uint8))
    far: np.ndarray = field(default_factory=lambda: np.zeros((2048, 2048), np.uint8))
    reach: tuple[float, float] = (45.0, 420.0)

    def stretch(self) -> np.ndarray:
        """Ground displacement (2,) of the shadow of a point one metre high."""
        return -self.sun[:2] / max(self.sun[2], 0.04)

    def polygon(self, points: np.ndarray) -> None:
        """points: (N, 2) ground positions of a convex shadow."""
        for raster, reach in zip((self.near, self.far), self.reach, strict=True):
            pixels = (points / reach * 0.5 + 0.5) * len(raster)
            if np.abs(pixels).max() < 30000:
                cv2.fillConvexPoly(raster, (pixels * 16).astype(np.int32), 255, cv2.LINE_AA, 4)

    def stamp(self, alpha: np.ndarray, x: float, y: float, height: float) -> None:
        """The shadow of a picture (h, w) standing upright at (x, y), `height` metres high, broadside to the sun.
        alpha: uint8.
        """
        fall = self.stretch() * height
        flat = np.hypot(*self.sun[:2])
        side = (
            np.array([-self.sun[1], self.sun[0]]) / max(flat, 1e-6) * height / alpha.shape[0]
        )  # metres a column
        h, w = alpha.shape
        for raster, reach in zip((self.near, self.far), self.reach, strict=True):
            scale = len(raster) / (2 * reach)
            if np.hypot(x, y) > reach + np.hypot(*fall) or np.hypot(x, y) > 3 * reach:
                continue
            base = (np.array([x, y]) + reach) * scale
            down = -fall * scale / h  # raster step a row downwards in the picture
            matrix = np.array([[side[0] * scale, down[0], 0], [side[1] * scale, down[1], 0]])
            matrix[:, 2] = base - matrix[:, 0] * w / 2 - matrix[:, 1] * h
            corners = matrix[:, :2] @ np.array([[0, w, 0, w], [0, 0, h, h]]) + matrix[:, 2:]
            low = np.clip(np.floor(corners.min(1)).astype(int), 0, len(raster))
            high = np.clip(np.ceil(corners.max(1)).astype(int) + 1, 0, len(raster))
            if (high - low).min() <= 0:
                continue
            matrix[:, 2] -= low
            shade = cv2.warpAffine(
                alpha, matrix, (int(high[0] - low[0]), int(high[1] - low[1])), flags=cv2.INTER_LINEAR
            )
            part = raster[low[1] : high[1], low[0] : high[0]]
            np.maximum(part, shade, out=part)

    def soften(self) -> None:
        self.near = 255 - cv2.GaussianBlur(self.near, (0, 0), 1.0)
        self.far = 255 - self.far

    def lit(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        out = []
        for raster, reach in zip((self.near, self.far), self.reach, strict=True):
            u, v = ((c / reach * 0.5 + 0.5) * len(raster) - 0.5 for c in (x, y))
            u, v = np.clip(u, -10, 4000).astype(np.float32), np.clip(v, -10, 4000).astype(np.float32)
            out.append(
                cv2.remap(raster, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(255,))
            )
        inside = (np.abs(x) < self.reach[0] * 0.98) & (np.abs(y) < self.reach[0] * 0.98)
        return np.where(inside, out[0], out[1]).astype(np.float32) / 255
