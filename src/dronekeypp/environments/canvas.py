"""The picture being painted: an equirectangular canvas of linear radiance, back to front, and the camera that
develops it.
"""

from __future__ import annotations

import cv2
import numpy as np


class Canvas:
    """`image`: (H, 2H, 3) float32 linear radiance. `phi` (W,), `theta` (H,): azimuth and elevation of the pixel
    centres, radians.
    """

    def __init__(self, height: int, eye: float):
        self.height, self.width, self.eye = height, 2 * height, eye
        self.theta = ((0.5 - (np.arange(height) + 0.5) / height) * np.pi).astype(np.float32)
        self.phi = ((0.5 - (np.arange(self.width) + 0.5) / self.width) * 2 * np.pi).astype(np.float32)
        self.image = np.zeros((height, self.width, 3), np.float32)
        self.pixel = np.pi / height  # radians
        self.airlight = np.zeros(
            (self.width, 3), np.float32
        )  # colour of the haze in every direction; the sky sets it
        self.visibility = 20e3  # metres at which 1/e of the contrast is left

    def column(self, azimuth: float) -> float:
        """Fractional column of an azimuth (pixel centres at whole numbers); may lie outside, `paste` wraps."""
        return (0.5 - azimuth / (2 * np.pi)) * self.width - 0.5

    def row(self, elevation: np.ndarray | float) -> np.ndarray | float:
        return (0.5 - elevation / np.pi) * self.height - 0.5

    def columns(self, centre: float, half: float) -> np.ndarray:
        """Whole columns, unwrapped, that cover azimuth centre +- half."""
        half = min(half, np.pi - self.pixel)
        return np.arange(
            int(np.floor(self.column(centre + half))), int(np.ceil(self.column(centre - half))) + 1
        )

    def haze(self, colour: np.ndarray, distance: np.ndarray | float, columns: np.ndarray) -> np.ndarray:
        """Aerial perspective: colour (h, w, 3) at a distance (broadcasts to (h, w, 1)) seen through the air of these
        columns.
        """
        keep = np.exp(-np.asarray(distance, np.float32) / self.visibility)
        air = self.airlight[columns % self.width]
        return colour * keep + air * (1 - keep)

    def paste(self, colour: np.ndarray, alpha: np.ndarray, top: int, columns: np.ndarray) -> None:
        """Lay colour (h, w, 3) over the picture with alpha (h, w), first row `top`, at unwrapped whole columns."""
        first, last = max(0, -top), min(len(alpha), self.height - top)
        if last <= first:
            return
        start = int(columns[0]) % self.width
        done = 0
        while done < len(columns):  # at most two runs: up to the seam, and from it
            run = min(len(columns) - done, self.width - start)
            part = self.image[top + first : top + last, start : start + run]
            a = alpha[first:last, done : done + run, None]
            part += a * (colour[first:last, done : done + run] - part)
            done, start = done + run, 0

    def develop(
        self, exposure: float, rng: np.random.Generator, grain: float = 0.006, warmth: float = 0.0
    ) -> np.ndarray:
        """A photograph of it, uint8: exposure, a film-like curve, sRGB, a little softness and grain. In bands, to
        stay small in memory.
        """
        out = np.empty(self.image.shape, np.uint8)
        gain = exposure * np.array([1 + warmth, 1, 1 - warmth], np.float32)
        for top in range(0, self.height, 256):
            band = self.image[top : top + 256] * gain
            band = _curve(band)
            coarse = rng.standard_normal((band.shape[0], band.shape[1]), dtype=np.float32)
            coarse = cv2.GaussianBlur(coarse, (0, 0), 0.7) * 1.9
            noise = coarse[..., None] * np.float32(grain)
            band += noise * (1.2 - band)  # shadows are noisier
            out[top : top + 256] = np.clip(band * 255 + 0.5, 0, 255).astype(np.uint8)
        return out


def _curve(x: np.ndarray) -> np.ndarray:
    """Radiance to [0, 1] display values: a gentle toe and shoulder (middle grey 0.18 stays near 118/255), highlights
    lose their colour.
    """
    peak = x.max(-1, keepdims=True)
    x = x + np.clip(peak - 1.2, 0, 6) * 0.12 * (peak - x) / np.maximum(
        peak, 1e-6
    )  # overexposed colours drift to white
    x = np.maximum(x, 0)
    x = x * (1 + 0.22 * x) / (1 + 0.55 * x + 0.22 * x * x) * 1.12
    x = np.minimum(x, 1.0)
    y = np.where(x < 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-6), 1 / 2.4) - 0.055)
    return y + 0.3 * (y * y * (3 - 2 * y) - y)
