"""Sky: scattered daylight, the sun's disc and glare, and clouds with a lit and a shaded side."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.atmosphere import scattered, sunlight_at_ground
from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.noise import fbm_tile, look, smooth
from dronekeypp.environments.specs import Clouds

_CUMULUS_STEPS = 14


@dataclass(frozen=True)
class Daylight:
    """What the sky gives the ground.

    Attributes:
        sun: (3,) unit vector towards the sun.
        sun_colour: (3,) irradiance of a surface that faces the sun.
        sky_colour: (3,) irradiance of level ground from the sky without the sun.
    """

    sun: np.ndarray
    sun_colour: np.ndarray
    sky_colour: np.ndarray


class Sky:
    """Paints the upper half of a canvas and holds the light that the rest of the scene needs.

    Args:
        azimuth, elevation: of the sun, radians.
        haze: 1 for clean air, 8 for murky air.
        clouds: the clouds.
        seed: another seed gives other clouds.

    Attributes:
        table: radiance of the clear sky, see `atmosphere.scattered`.
        overcast: (3,) mean radiance of a closed ceiling.
        light: the daylight.
    """

    def __init__(self, azimuth: float, elevation: float, haze: float, clouds: Clouds, seed: int) -> None:
        self.azimuth = azimuth
        self.elevation = elevation
        self.clouds = clouds
        self.seed = seed
        self.table = (38 * scattered(elevation, haze)).astype(np.float32)
        sun = np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        direct = 18 * sunlight_at_ground(max(sun[2], 0.005), haze)
        if elevation < 0:
            direct *= 0
        theta = np.linspace(0, 1, len(self.table)) ** 2 * np.pi / 2
        weight = np.sin(theta) * np.cos(theta) * np.gradient(theta)
        clear = 2 * np.pi * np.einsum("r,rc->c", weight, self.table.mean(1))
        grey = (direct * max(sun[2], 0.05) * 0.55 + clear * 0.9).mean() * np.array([0.96, 1.0, 1.05])
        self.overcast = grey / np.pi * 0.9
        sun_colour = direct * (1 - clouds.cover) ** 2
        sky_colour = clear * (1 - clouds.cover) + grey * clouds.cover
        self.light = Daylight(sun, sun_colour, sky_colour)

    def clear(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Return the radiance (h, w, 3) of the cloudless sky at elevations and azimuths (h, w) in radians."""
        away = np.abs((phi - self.azimuth + np.pi) % (2 * np.pi) - np.pi)
        rows = np.sqrt(np.clip(theta, 0, None) / (np.pi / 2)) * (self.table.shape[0] - 1)
        columns = away / np.pi * (self.table.shape[1] - 1)
        rows = rows.astype(np.float32)
        columns = columns.astype(np.float32)
        return cv2.remap(self.table, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def paint(self, canvas: Canvas) -> None:
        """Fill the canvas from a little under the horizon upwards, and set its airlight."""
        ground = _ground_row(canvas)
        theta, phi = canvas.theta[:ground], canvas.phi
        cover = self.clouds.cover
        veil, opacity = self._veil(canvas)
        for top in range(0, ground, 128):
            t, p = np.meshgrid(theta[top : top + 128], phi, indexing="ij")
            band = self.clear(t, p)
            band *= 1 - cover
            if cover:
                band += cover * self._ceiling(t, p)
            glare = self._glare(t, p) * (1 - cover) ** 3
            band += glare
            a = opacity[top : top + 128, :, None]
            band += a * (veil[top : top + 128] - band)
            band += 0.25 * glare * a  # the sun shines through thin cloud, and the lens glares all the same
            canvas.image[top : top + len(band)] = band
        canvas.airlight = self._airlight(canvas)

    @staticmethod
    def _airlight(canvas: Canvas) -> np.ndarray:
        """Return the colour of the haze (width, 3): the sky low above the horizon, blurred along it."""
        low = canvas.height // 2 - max(2, round(canvas.height * 1.2 / 180))
        air = canvas.image[low - 2 : low + 1].mean(0)
        wide = np.concatenate([air, air, air])  # three times, so that the blur closes at the seam
        air = cv2.GaussianBlur(wide[None], (0, 0), canvas.width / 40)[0, canvas.width : 2 * canvas.width]
        return np.minimum(air, 2.5 * np.median(air, 0)).astype(np.float32)

    def _sun_cosine(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Return the cosine of the angle between these directions and the sun."""
        level = np.cos(theta) * np.cos(self.elevation) * np.cos(phi - self.azimuth)
        return np.sin(theta) * np.sin(self.elevation) + level

    def _glare(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Return the radiance (h, w, 3) of the sun's disc and of the glare around it."""
        angle = np.degrees(np.arccos(np.clip(self._sun_cosine(theta, phi), -1, 1)))
        disc = 60 * smooth(0.55, 0.22, angle) + 1.1 / (0.35 + angle**2) + 0.045 * np.exp(-angle / 5)
        colour = self.light.sun_colour * 0.8 + 0.2 * self.light.sun_colour.max()
        return (disc[..., None] * colour).astype(np.float32)

    def _ceiling(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Return the radiance (h, w, 3) of a closed grey ceiling.

        It is mottled, brighter overhead (CIE overcast sky: 1 + 2 sin) and a little brighter where the sun is.
        """
        up = np.sin(np.maximum(theta, 0.0))
        x, y = _overhead(1500 / np.maximum(up + 0.035, 0.02), theta, phi)
        tile = fbm_tile(1024, 1.7, self.seed + 5)
        warp = look(tile, x + 900, y, 21000) * 700
        mottle = look(tile, x + warp, y, 9000) * 0.6 + look(tile, x, y + warp, 2900) * 0.3
        mottle *= smooth(0.0, 0.25, up)
        glow = 0.55 * np.exp((self._sun_cosine(theta, phi) - 1) * 5)
        level = (1 + 1.4 * up) / 2.0 * (1 + 0.17 * mottle) * (0.9 + glow)
        tint = self.overcast * (1 + 0.05 * np.clip(mottle, -2, 2)[..., None] * np.array([1, 0.3, -0.8]))
        return (level[..., None] * tint).astype(np.float32)

    def _veil(self, canvas: Canvas) -> tuple[np.ndarray, np.ndarray]:
        """Draw cirrus and cumulus together. They are soft, so they are drawn at half size.

        Returns:
            Colour (h, width, 3) and opacity (h, width) of the rows down to a little under the horizon; one
            column of zeros where the sky has neither.
        """
        ground = _ground_row(canvas)
        if not (self.clouds.cumulus or self.clouds.cirrus):
            return np.zeros((ground, 1, 3), np.float32), np.zeros((ground, 1), np.float32)
        rows = max(8, ground // 2)
        columns = max(16, canvas.width // 2)
        colour = np.zeros((rows, columns, 3), np.float32)
        opacity = np.zeros((rows, columns), np.float32)
        phi = ((0.5 - (np.arange(columns) + 0.5) / columns) * 2 * np.pi).astype(np.float32)
        step = ground / rows
        theta = ((0.5 - ((np.arange(rows) + 0.5) * step) / canvas.height) * np.pi).astype(np.float32)
        for top in range(0, rows, 96):
            t, p = np.meshgrid(theta[top : top + 96], phi, indexing="ij")
            band_colour, band_opacity = self._veil_band(t, p)
            colour[top : top + 96] = band_colour
            opacity[top : top + 96] = band_opacity
        # The jitter of `_cumulus` leaves grain.
        colour = cv2.GaussianBlur(colour, (0, 0), 0.8)
        opacity = cv2.GaussianBlur(opacity, (0, 0), 0.8)
        size = (canvas.width, ground)
        opacity = np.clip(cv2.resize(opacity, size, interpolation=cv2.INTER_CUBIC), 0, 1)
        return cv2.resize(colour, size, interpolation=cv2.INTER_LINEAR), opacity

    def _veil_band(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return colour (h, w, 3) and opacity (h, w) of cumulus in front of cirrus."""
        if self.clouds.cirrus:
            colour, opacity = self._cirrus(theta, phi)
        else:
            colour = np.zeros((*theta.shape, 3), np.float32)
            opacity = np.zeros_like(theta)
        if not self.clouds.cumulus:
            return colour, opacity
        heap_colour, heap = self._cumulus(theta, phi)
        behind = opacity * (1 - heap)
        total = heap + behind
        colour = (heap_colour * heap[..., None] + colour * behind[..., None]) / np.maximum(total, 1e-4)[
            ..., None
        ]
        return colour, total

    def _cirrus(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return colour (h, w, 3) and opacity (h, w) of streaks of thin high cloud."""
        up = np.sin(np.maximum(theta, 0.001))
        x, y = _overhead(8000 / (up + 0.06), theta, phi)
        tile = fbm_tile(1024, 1.6, self.seed + 3)
        bend = look(tile, x, y, 90e3) * 4000
        streak = look(tile, x * 0.35 + bend, y * 1.3 + bend * 0.6, 30e3) * 0.7
        streak = streak + look(tile, x * 0.5, y + bend, 9e3) * 0.35
        patch = smooth(-0.6, 1.2, look(tile, y, x, 70e3))
        opacity = self.clouds.cirrus * smooth(-0.3, 2.2, streak) * patch * smooth(0.0, 0.1, up)
        bright = 0.10 + 0.12 * np.exp((self._sun_cosine(theta, phi) - 1) * 4)
        sun = self.light.sun_colour
        colour = bright[..., None] * (sun + 0.15 * sun.mean()) + 0.5 * self.light.sky_colour / np.pi
        return colour.astype(np.float32), opacity.astype(np.float32)

    def _cumulus(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return colour (h, w, 3) and opacity (h, w) of heaps with flat bases and billowing tops.

        Each ray is marched from the heaps' base to their top. The side away from the sun lies in shade.
        """
        clouds = self.clouds
        # The earth's curve brings far clouds down to the horizon, but not through it.
        up = np.sin(np.maximum(theta, 0.012)) + 0.008
        broad = fbm_tile(1024, 2.1, self.seed + 1)
        fine = fbm_tile(1024, 1.5, self.seed + 2)
        threshold = np.quantile(broad[::8, ::8], 1 - clouds.cumulus)
        level_sun = self.light.sun[:2]
        towards = (level_sun / max(float(np.linalg.norm(level_sun)), 1e-6) * 220).astype(np.float32)
        direct = self.light.sun_colour
        ambient = self.light.sky_colour / np.pi
        phase = (0.11 + 0.25 * np.exp((self._sun_cosine(theta, phi) - 1) * 9))[..., None].astype(np.float32)
        clear = np.ones_like(theta)  # share of the ray that no cloud has covered yet
        colour = np.zeros((*theta.shape, 3), np.float32)
        cx = np.cos(theta) * np.cos(phi) / up
        cy = np.cos(theta) * np.sin(phi) / up
        rng = np.random.default_rng((self.seed, len(theta), int(1e6 * abs(theta[0, 0]))))
        jitter = rng.random(theta.shape, dtype=np.float32)  # hides the slices
        for i in range(_CUMULUS_STEPS):
            level = (i + jitter) / _CUMULUS_STEPS  # 0 at the base, 1 at the top
            z = clouds.base + level * clouds.thickness
            x = (z * cx).astype(np.float32)
            y = (z * cy).astype(np.float32)
            detail = look(fine, x + 0.6 * z, y - 0.4 * z, clouds.scale * 0.11) * 0.13
            detail = detail + look(fine, x - z, y, clouds.scale * 0.031) * 0.06
            heap = look(broad, x, y, clouds.scale) - threshold + detail
            density = np.clip(heap - 1.1 * level**1.3 - 0.02, 0, None) * smooth(0, 0.12, level)
            sunward = look(broad, x + towards[0], y + towards[1], clouds.scale) - threshold + detail * 1.3
            shade = np.clip(sunward - 1.1 * level**1.3, 0, None) + 0.25 * np.clip(heap - level, 0, None)
            lit = np.exp(-3.2 * shade)[..., None]
            tone = phase * (0.12 + 0.95 * lit) * 1.5 * direct + (0.35 + 0.55 * level[..., None]) * ambient
            a = 1 - np.exp(-density * (26 / _CUMULUS_STEPS) * np.minimum(1 / up, 6).astype(np.float32))
            colour += (clear * a)[..., None] * tone.astype(np.float32)
            clear *= 1 - a
        opacity = 1 - clear
        colour /= np.maximum(opacity, 1e-3)[..., None]
        # Far clouds drown in the air between.
        contrast = np.exp(-(clouds.base / up) / 32e3).astype(np.float32)[..., None]
        colour = colour * contrast + self.clear(theta, phi) * (1 - contrast)
        return colour, (opacity * smooth(0.006, 0.05, theta)).astype(np.float32)


def _ground_row(canvas: Canvas) -> int:
    """Return the row, a little under the horizon, down to which the sky is painted."""
    return canvas.height // 2 + max(2, canvas.height // 64)


def _overhead(reach: np.ndarray, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions x, y in metres, float32, of points `reach` metres away in these directions."""
    x = (reach * np.cos(theta) * np.cos(phi)).astype(np.float32)
    y = (reach * np.cos(theta) * np.sin(phi)).astype(np.float32)
    return x, y
