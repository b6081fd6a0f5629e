"""Water: a mirror of what is already painted, tilted by ripples."""

from __future__ import annotations

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.noise import smooth
from dronekeypp.environments.patch import Patch
from dronekeypp.environments.sky import Daylight
from dronekeypp.environments.specs import Colour

_ROWS = 64  # rows that are painted at once


def paint_water(
    canvas: Canvas, share: np.ndarray, light: Daylight, waves: float, deep: Colour, seed: int
) -> None:
    """Mirror in the water what is already painted above the horizon.

    Args:
        canvas: the picture so far.
        share: (rows below the horizon, width) share of water, `Terrain.water`.
        light: the daylight.
        waves: slope of the ripples, about 0.01 (calm) to 0.15.
        deep: colour that the water has of its own.
        seed: of the place.
    """
    if not share.any():
        return
    half = canvas.height // 2
    rows = np.flatnonzero(share.any(1))
    brightest = 9 * float(
        np.median(canvas.image[half // 2 : half : 8, ::8])
    )  # the sun's image is cut to this
    body = np.asarray(deep, np.float32) * (light.sun_colour * max(light.sun[2], 0) + light.sky_colour) / np.pi
    for first in range(rows[0], rows[-1] + 1, _ROWS):
        band = share[first : min(first + _ROWS, rows[-1] + 1)].astype(np.float32)
        theta = canvas.theta[half + first : half + first + len(band)][:, None]
        reach = canvas.eye / np.tan(np.maximum(-theta, 2e-4))
        x = (reach * np.cos(canvas.phi)).astype(np.float32)
        y = (reach * np.sin(canvas.phi)).astype(np.float32)
        stretch = np.sqrt(np.clip(reach[:, 0] / canvas.eye, 1, 16))
        footprint = (reach[:, 0] * canvas.pixel * stretch).astype(np.float32)
        patch = Patch(x, y, footprint, light.sun, seed)
        moved = Patch(x + 13.7, y - 5.1, footprint, light.sun, seed)
        # What no pixel resolves still tilts the mirror: it becomes jitter, finer with distance.
        rng = np.random.default_rng((seed, first, 3))
        hidden = rng.standard_normal(x.shape, dtype=np.float32)
        hidden = cv2.GaussianBlur(hidden, (0, 0), sigmaX=3.0, sigmaY=0.7, borderType=cv2.BORDER_REFLECT)
        hidden *= smooth(0.0, 0.5, footprint)[:, None] * 1.8
        tilt = np.float32(waves) * (_ripples(patch) + hidden)
        sideways = np.float32(0.8 * waves) * _ripples(moved) / canvas.pixel * np.minimum(1, -theta * 8)
        column = (np.arange(canvas.width, dtype=np.float32)[None] + sideways).astype(np.float32)
        mirror = 0
        for spread in (-1.3, -0.4, 0.4, 1.3):  # a pixel holds many small waves
            up = np.abs(-theta + 1.6 * tilt + (0.8 + 0.9 * spread) * waves)
            row = np.clip((0.5 - up / np.pi) * canvas.height - 0.5, 0, half - 1).astype(np.float32)
            seen = cv2.remap(canvas.image[:half], column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
            mirror = mirror + 0.25 * np.minimum(seen, brightest)
        facing = np.clip(np.sin(np.clip(-theta + tilt, 0.03, 1.5)), 0, 1)
        fresnel = (0.02 + 0.98 * (1 - facing) ** 5)[..., None]
        colour = (fresnel * mirror + (1 - fresnel) * body).astype(np.float32)
        canvas.paste(colour, band, half + first, np.arange(canvas.width))


def _ripples(patch: Patch) -> np.ndarray:
    """Return waves of three sizes, (h, w)."""
    return patch.noise(1.4, 1.0, 80) + patch.noise(6.7, 1.2, 81) + 0.7 * patch.noise(47, 1.3, 82)
