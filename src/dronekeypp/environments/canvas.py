"""The picture being painted: an equirectangular canvas of linear radiance, and the camera that develops it.

Things are painted from far to near, so that near things cover far ones.
"""

from __future__ import annotations

import cv2
import numpy as np


class Canvas:
    """An equirectangular picture of linear radiance.

    Attributes:
        height, width: pixels. The width is twice the height.
        eye: height of the camera above the ground in metres.
        image: (height, width, 3) float32 linear radiance.
        theta: (height,) float32 elevation of the pixel centres in radians. The first row looks up.
        phi: (width,) float32 azimuth of the pixel centres in radians. It falls from left to right.
        pixel: radians that one pixel covers.
        airlight: (width, 3) float32 colour of the haze in every direction. The sky sets it.
        visibility: metres at which 1/e of the contrast is left.
    """

    def __init__(self, height: int, eye: float) -> None:
        self.height = height
        self.width = 2 * height
        self.eye = eye
        self.theta = ((0.5 - (np.arange(height) + 0.5) / height) * np.pi).astype(np.float32)
        self.phi = ((0.5 - (np.arange(self.width) + 0.5) / self.width) * 2 * np.pi).astype(np.float32)
        self.image = np.zeros((height, self.width, 3), np.float32)
        self.pixel = np.pi / height
        self.airlight = np.zeros((self.width, 3), np.float32)
        self.visibility = 20e3

    def column(self, azimuth: np.ndarray | float) -> np.ndarray | float:
        """Return the fractional column of an azimuth in radians. Pixel centres lie at whole numbers.

        The column may lie outside the picture; `paste` wraps it.
        """
        return (0.5 - azimuth / (2 * np.pi)) * self.width - 0.5

    def row(self, elevation: np.ndarray | float) -> np.ndarray | float:
        """Return the fractional row of an elevation in radians. Pixel centres lie at whole numbers."""
        return (0.5 - elevation / np.pi) * self.height - 0.5

    def columns(self, centre: float, half: float) -> np.ndarray:
        """Return the whole columns, not wrapped, that cover the azimuths centre - half to centre + half."""
        half = min(half, np.pi - self.pixel)
        first = int(np.floor(self.column(centre + half)))
        last = int(np.ceil(self.column(centre - half)))
        return np.arange(first, last + 1)

    def haze(self, colour: np.ndarray, distance: np.ndarray | float, columns: np.ndarray) -> np.ndarray:
        """Mix a colour with the light of the air in front of it (aerial perspective).

        Args:
            colour: (h, w, 3) radiance.
            distance: metres; it broadcasts to (h, w, 1).
            columns: (w,) whole columns, which may lie outside the picture.
        """
        left_over = np.exp(-np.asarray(distance, np.float32) / self.visibility)
        air = self.airlight[columns % self.width]
        return colour * left_over + air * (1 - left_over)

    def paste(self, colour: np.ndarray, alpha: np.ndarray, top: int, columns: np.ndarray) -> None:
        """Lay a colour over the picture.

        Args:
            colour: (h, w, 3) radiance.
            alpha: (h, w) opacity from 0 to 1.
            top: the row of the picture where the first row of `colour` goes. Rows outside are cut off.
            columns: (w,) consecutive whole columns. Columns outside wrap to the other side.
        """
        first = max(0, -top)
        last = min(len(alpha), self.height - top)
        if last <= first:
            return
        start = int(columns[0]) % self.width
        done = 0
        while done < len(columns):  # at most two runs: one up to the seam, and one from it
            run = min(len(columns) - done, self.width - start)
            part = self.image[top + first : top + last, start : start + run]
            opacity = alpha[first:last, done : done + run, None]
            part += opacity * (colour[first:last, done : done + run] - part)
            done += run
            start = 0

    def develop(self, exposure: float, rng: np.random.Generator, grain: float = 0.006) -> np.ndarray:
        """Take a photograph of the canvas: exposure, a curve like film's, sRGB and soft grain.

        The work goes in bands of rows, which needs little memory.

        Args:
            exposure: factor on the radiance.
            rng: draws the grain.
            grain: strength of the grain.

        Returns:
            (height, width, 3) uint8 RGB.
        """
        photograph = np.empty(self.image.shape, np.uint8)
        for top in range(0, self.height, 256):
            band = _curve(self.image[top : top + 256] * np.float32(exposure))
            coarse = rng.standard_normal((band.shape[0], band.shape[1]), dtype=np.float32)
            coarse = cv2.GaussianBlur(coarse, (0, 0), 0.7) * 1.9
            noise = coarse[..., None] * np.float32(grain)
            band += noise * (1.2 - band)  # shadows are noisier
            photograph[top : top + 256] = np.clip(band * 255 + 0.5, 0, 255).astype(np.uint8)
        return photograph


def _curve(x: np.ndarray) -> np.ndarray:
    """Turn radiance (..., 3) into display values from 0 to 1.

    The curve has a gentle toe and shoulder: middle grey, 0.18, stays near 118/255. Highlights lose their
        colour.
    """
    peak = x.max(-1, keepdims=True)
    # Overexposed colours drift to white.
    x = x + np.clip(peak - 1.2, 0, 6) * 0.12 * (peak - x) / np.maximum(peak, 1e-6)
    x = np.maximum(x, 0)
    x = x * (1 + 0.22 * x) / (1 + 0.55 * x + 0.22 * x * x) * 1.12
    x = np.minimum(x, 1.0)
    y = np.where(x < 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-6), 1 / 2.4) - 0.055)
    return y + 0.3 * (y * y * (3 - 2 * y) - y)
