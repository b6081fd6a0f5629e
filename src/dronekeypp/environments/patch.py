"""A band of the ground to colour, with the textures that every surface is mixed from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dronekeypp.environments.noise import blade_tile, cell_tile, fbm_tile, look_fading


@dataclass
class Patch:
    """A band of the ground to colour.

    Attributes:
        x, y: (h, w) float32 ground positions in metres.
        footprint: (h,) metres that a pixel of each row covers. Textures finer than it fade.
        sun: (3,) unit vector towards the sun.
        seed: of the place.
    """

    x: np.ndarray
    y: np.ndarray
    footprint: np.ndarray
    sun: np.ndarray
    seed: int

    def noise(self, period: float, slope: float = 1.5, seed: int = 0) -> np.ndarray:
        """Return fractal noise (h, w) that repeats every `period` metres. Mean 0, deviation 1."""
        return look_fading(fbm_tile(1024, slope, 40 + seed), self.x, self.y, period, self.footprint)

    def bump(self, period: float, step: float, slope: float = 1.5, seed: int = 0) -> np.ndarray:
        """Return the light (h, w) on fractal relief: positive where the ground falls towards the sun.

        step: metres between the two heights that are compared.
        """
        tile = fbm_tile(1024, slope, 40 + seed)
        flat = max(float(np.hypot(*self.sun[:2])), 1e-3)
        dx = np.float32(self.sun[0] / flat * step)
        dy = np.float32(self.sun[1] / flat * step)
        height = look_fading(tile, self.x, self.y, period, self.footprint)
        return height - look_fading(tile, self.x + dx, self.y + dy, period, self.footprint)

    def blades(self, period: float, length: float = 0.02, seed: int = 0) -> np.ndarray:
        """Return grass seen from above (h, w). length: of the longest blade, as a share of `period`."""
        return look_fading(blade_tile(2048, 60000, length, seed), self.x, self.y, period, self.footprint)

    def cells(self, period: float, cells: int = 60, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return stones: how far inside its stone a pixel lies, and the shade of the stone, (h, w), mean 0.

        cells: stones along `period`.
        """
        inside, tone = cell_tile(1024, cells, seed)
        inside = look_fading(inside, self.x, self.y, period, self.footprint)
        tone = look_fading(tone, self.x, self.y, period, self.footprint)
        return inside, tone

    def lines(self, across: np.ndarray, pitch: float, width: float, offset: float = 0.0) -> np.ndarray:
        """Return the coverage, 0 to 1, of parallel lines, softened to the pixels' footprint.

        Args:
            across: (h, w) metres across the lines.
            pitch: metres from line to line.
            width: metres of one line.
            offset: metres from `across` = 0 to the first line.
        """
        soft = np.maximum(self.footprint[:, None], 0.008)
        gap = np.abs((across - offset + pitch / 2) % pitch - pitch / 2)
        line = np.clip((width / 2 - gap) / soft + 0.5, 0, 1)
        return line * np.clip(1.4 - 0.9 * soft / pitch, width / pitch, 1)
