"""Sky: daylight scattered by air and haze, the sun's disc and glare, and clouds with a lit and a shaded side."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.noise import fbm_tile, look, smooth

# Scattering at sea level, 1/m, for R, G, B; scale heights in metres (Nishita et al. 1993; Bruneton and Neyret 2008).
_RAYLEIGH = np.array([5.8e-6, 13.5e-6, 33.1e-6])
_OZONE = np.array([0.65e-6, 1.88e-6, 0.085e-6])
_MIE = 4.0e-6
_EARTH, _TOP = 6.36e6, 6.42e6


@dataclass(frozen=True)
class Clouds:
    """cumulus: share of the sky under heaps, 0..1. cirrus: strength of the thin high veil. cover: 1 is a closed grey
    ceiling.

    base, thickness: metres of the heaps. scale: metres a repeat of their pattern.
    """

    cumulus: float = 0.0
    cirrus: float = 0.0
    cover: float = 0.0
    base: float = 1300.0
    thickness: float = 700.0
    scale: float = 11e3


@dataclass(frozen=True)
class Daylight:
    """What the sky gives the ground. sun: (3,) unit, towards it. sun_colour: irradiance facing it. sky_colour: from
    the upper hemisphere.
    """

    sun: np.ndarray
    sun_colour: np.ndarray
    sky_colour: np.ndarray


def _depths(
    height: np.ndarray, cosine: np.ndarray, steps: int = 10
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Optical lengths (Rayleigh, haze, ozone; metres of sea-level air) from a height towards a direction with this
    cosine to the zenith.
    """
    radius = _EARTH + height
    reach = -radius * cosine + np.sqrt(np.maximum(radius**2 * (cosine**2 - 1) + _TOP**2, 0))
    total = [0.0, 0.0, 0.0]
    for edge in np.linspace(0, 1, steps + 1)[:-1]:
        a, b = edge**2, (edge + 1 / steps) ** 2  # short steps first: the air is dense there
        s = reach * (a + b) / 2
        h = np.maximum(np.sqrt(radius**2 + s**2 + 2 * radius * s * cosine) - _EARTH, 0)
        ds = reach * (b - a)
        total[0] = total[0] + np.exp(-h / 8000) * ds
        total[1] = total[1] + np.exp(-h / 1200) * ds
        total[2] = total[2] + np.maximum(0, 1 - np.abs(h - 25000) / 15000) * ds
    return total[0], total[1], total[2]


def _through(depths: tuple, haze: float) -> np.ndarray:
    air, mist, ozone = (np.asarray(d)[..., None] for d in depths)
    return np.exp(-(_RAYLEIGH * air + 1.1 * _MIE * haze * mist + _OZONE * ozone))


def scattered(elevation: float, haze: float, rows: int = 72, columns: int = 91) -> np.ndarray:
    """Clear sky radiance for a unit sun (3 channels): rows by sqrt(elevation / 90 deg), columns by angle from the
    sun's azimuth, 0..180 deg.
    """
    theta = (np.linspace(0, 1, rows) ** 2 * np.pi / 2)[:, None]
    away = np.linspace(0, np.pi, columns)[None]
    up = np.maximum(np.sin(theta), 1e-3) * np.ones_like(away)
    cosine = np.sin(theta) * np.sin(elevation) + np.cos(theta) * np.cos(elevation) * np.cos(away)
    rayleigh_phase = 3 / (16 * np.pi) * (1 + cosine**2)
    g = 0.78
    mie_phase = (
        3
        / (8 * np.pi)
        * (1 - g * g)
        * (1 + cosine**2)
        / ((2 + g * g) * np.power(1 + g * g - 2 * g * cosine, 1.5))
    )
    reach = -_EARTH * up + np.sqrt(_EARTH**2 * (up**2 - 1) + _TOP**2)
    radiance = np.zeros((rows, columns, 3))
    path = [0.0, 0.0, 0.0]
    steps = 20
    for i in range(steps):
        a, b = (i / steps) ** 2, ((i + 1) / steps) ** 2
        s, ds = reach * (a + b) / 2, reach * (b - a)
        radius = np.sqrt(_EARTH**2 + s**2 + 2 * _EARTH * s * up)
        h = np.maximum(radius - _EARTH, 0)
        air, mist = np.exp(-h / 8000) * ds, np.exp(-h / 1200) * ds
        ozone = np.maximum(0, 1 - np.abs(h - 25000) / 15000) * ds
        seen = _through((path[0] + air / 2, path[1] + mist / 2, path[2] + ozone / 2), haze)
        path = [path[0] + air, path[1] + mist, path[2] + ozone]
        sun_up = (
            _EARTH * np.sin(elevation) + s * cosine
        ) / radius  # cosine of the sun's zenith angle over there
        lit = _through(_depths(h, np.maximum(sun_up, -0.1)), haze) * smooth(-0.12, 0.02, sun_up)[..., None]
        # Light scattered more than once, roughly: an even glow that follows the sunlight of the layer.
        again = 0.03 * (lit.mean(-1, keepdims=True) * 0.5 + lit * 0.5 + 0.02)
        single_air = air[..., None] * _RAYLEIGH
        single_mist = (mist * _MIE * haze)[..., None]
        radiance += seen * (
            single_air * (rayleigh_phase[..., None] * lit + again)
            + single_mist * (mie_phase[..., None] * lit + again)
        )
    return radiance


class Sky:
    """Paints the upper half of a canvas and tells the rest of the scene about its light.

    azimuth, elevation: of the sun, radians. haze: 1 is clean air, 8 is murky.
    """

    def __init__(self, azimuth: float, elevation: float, haze: float, clouds: Clouds, seed: int):
        self.azimuth, self.elevation, self.clouds, self.seed = azimuth, elevation, clouds, seed
        self.table = (38 * scattered(elevation, haze)).astype(np.float32)
        sun = np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        direct = 18 * _through(_depths(np.zeros(1), np.full(1, max(sun[2], 0.005))), haze)[0]
        if elevation < 0:
            direct *= 0
        theta = np.linspace(0, 1, len(self.table)) ** 2 * np.pi / 2
        weight = np.sin(theta) * np.cos(theta) * np.gradient(theta)
        clear = 2 * np.pi * np.einsum("r,rc->c", weight, self.table.mean(1))
        grey = (direct * max(sun[2], 0.05) * 0.55 + clear * 0.9).mean() * np.array([0.96, 1.0, 1.05])
        self.overcast = grey / np.pi * 0.9  # mean radiance of a closed ceiling
        self.light = Daylight(
            sun, direct * (1 - clouds.cover) ** 2, clear * (1 - clouds.cover) + grey * clouds.cover
        )

    def clear(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Radiance (..., 3) of the cloudless sky in these directions (2-D arrays)."""
        away = np.abs((phi - self.azimuth + np.pi) % (2 * np.pi) - np.pi)
        rows = np.sqrt(np.clip(theta, 0, None) / (np.pi / 2)) * (self.table.shape[0] - 1)
        columns = away / np.pi * (self.table.shape[1] - 1)
        return cv2.remap(
            self.table,
            columns.astype(np.float32),
            rows.astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )

    def paint(self, canvas: Canvas) -> None:
        """Fill everything from a little under the horizon upwards; set the canvas's airlight."""
        ground = canvas.height // 2 + max(2, canvas.height // 64)
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
        low = canvas.height // 2 - max(2, round(canvas.height * 1.2 / 180))
        air = canvas.image[low - 2 : low + 1].mean(0)
        wide = np.concatenate([air, air, air])
        air = cv2.GaussianBlur(wide[None], (0, 0), canvas.width / 40)[0, canvas.width : 2 * canvas.width]
        canvas.airlight = np.minimum(air, 2.5 * np.median(air, 0)).astype(np.float32)

    def _glare(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        cosine = np.sin(theta) * np.sin(self.elevation) + np.cos(theta) * np.cos(self.elevation) * np.cos(
            phi - self.azimuth
        )
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        disc = 60 * smooth(0.55, 0.22, angle) + 1.1 / (0.35 + angle**2) + 0.045 * np.exp(-angle / 5)
        return (disc[..., None] * (self.light.sun_colour * 0.8 + 0.2 * self.light.sun_colour.max())).astype(
            np.float32
        )

    def _ceiling(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Grey closed cloud: brighter overhead (CIE: 1 + 2 sin), mottled, a hint of where the sun is."""
        up = np.sin(np.maximum(theta, 0.0))
        reach = 1500 / np.maximum(up + 0.035, 0.02)
        x, y = (
            (reach * np.cos(theta) * np.cos(phi)).astype(np.float32),
            (reach * np.cos(theta) * np.sin(phi)).astype(np.float32),
        )
        tile = fbm_tile(1024, 1.7, self.seed + 5)
        warp = look(tile, x + 900, y, 21000) * 700
        mottle = look(tile, x + warp, y, 9000) * 0.6 + look(tile, x, y + warp, 2900) * 0.3
        mottle *= smooth(0.0, 0.25, up)
        cosine = np.sin(theta) * np.sin(self.elevation) + np.cos(theta) * np.cos(self.elevation) * np.cos(
            phi - self.azimuth
        )
        glow = 0.55 * np.exp((cosine - 1) * 5)
        level = (1 + 1.4 * up) / 2.0 * (1 + 0.17 * mottle) * (0.9 + glow)
        tint = self.overcast * (1 + 0.05 * np.clip(mottle, -2, 2)[..., None] * np.array([1, 0.3, -0.8]))
        return (level[..., None] * tint).astype(np.float32)

    def _veil(self, canvas: Canvas) -> tuple[np.ndarray, np.ndarray]:
        """Cirrus and cumulus together: colour (h, W, 3), opacity (h, W), of the rows above the horizon (soft, so at
        half size).
        """
        ground = canvas.height // 2 + max(2, canvas.height // 64)
        clouds = self.clouds
        if not (clouds.cumulus or clouds.cirrus):
            return np.zeros((ground, 1, 3), np.float32), np.zeros((ground, 1), np.float32)
        rows, columns = max(8, ground // 2), max(16, canvas.width // 2)
        colour = np.zeros((rows, columns, 3), np.float32)
        opacity = np.zeros((rows, columns), np.float32)
        phi = ((0.5 - (np.arange(columns) + 0.5) / columns) * 2 * np.pi).astype(np.float32)
        step = ground / rows
        theta = ((0.5 - ((np.arange(rows) + 0.5) * step) / canvas.height) * np.pi).astype(np.float32)
        for top in range(0, rows, 96):
            t, p = np.meshgrid(theta[top : top + 96], phi, indexing="ij")
            c, a = (
                self._cirrus(t, p)
                if clouds.cirrus
                else (np.zeros((*t.shape, 3), np.float32), np.zeros_like(t))
            )
            if clouds.cumulus:
                heap, b = self._cumulus(t, p)
                total = b + a * (1 - b)
                c = (heap * b[..., None] + c * (a * (1 - b))[..., None]) / np.maximum(total, 1e-4)[..., None]
                a = total
            colour[top : top + 96], opacity[top : top + 96] = c, a
        size = (canvas.width, ground)
        colour, opacity = (
            cv2.GaussianBlur(c, (0, 0), 0.8) for c in (colour, opacity)
        )  # the march's jitter leaves grain
        opacity = np.clip(cv2.resize(opacity, size, interpolation=cv2.INTER_CUBIC), 0, 1)
        return cv2.resize(colour, size, interpolation=cv2.INTER_LINEAR), opacity

    def _cirrus(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        up = np.sin(np.maximum(theta, 0.001))
        reach = 8000 / (up + 0.06)
        x, y = (
            (reach * np.cos(theta) * np.cos(phi)).astype(np.float32),
            (reach * np.cos(theta) * np.sin(phi)).astype(np.float32),
        )
        tile = fbm_tile(1024, 1.6, self.seed + 3)
        bend = look(tile, x, y, 90e3) * 4000
        streak = (
            look(tile, x * 0.35 + bend, y * 1.3 + bend * 0.6, 30e3) * 0.7
            + look(tile, x * 0.5, y + bend, 9e3) * 0.35
        )
        patch = smooth(-0.6, 1.2, look(tile, y, x, 70e3))
        opacity = self.clouds.cirrus * smooth(-0.3, 2.2, streak) * patch * smooth(0.0, 0.1, up)
        cosine = np.sin(theta) * np.sin(self.elevation) + np.cos(theta) * np.cos(self.elevation) * np.cos(
            phi - self.azimuth
        )
        bright = 0.10 + 0.12 * np.exp((cosine - 1) * 4)
        sun = self.light.sun_colour
        colour = bright[..., None] * (sun + 0.15 * sun.mean()) + 0.5 * self.light.sky_colour / np.pi
        return colour.astype(np.float32), opacity.astype(np.float32)

    def _cumulus(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heaps between two heights, marched from below: flat bases, billowing tops, the side away from the sun in
        shade.
        """
        clouds = self.clouds
        up = (
            np.sin(np.maximum(theta, 0.012)) + 0.008
        )  # the earth's curve brings far clouds down to, not through, the horizon
        broad, fine = fbm_tile(1024, 2.1, self.seed + 1), fbm_tile(1024, 1.5, self.seed + 2)
        threshold = np.quantile(broad[::8, ::8], 1 - clouds.cumulus)
        towards = (self.light.sun[:2] / max(float(np.linalg.norm(self.light.sun[:2])), 1e-6) * 220).astype(
            np.float32
        )
        direct, ambient = self.light.sun_colour, self.light.sky_colour / np.pi
        cosine = np.sin(theta) * np.sin(self.elevation) + np.cos(theta) * np.cos(self.elevation) * np.cos(
            phi - self.azimuth
        )
        phase = (0.11 + 0.25 * np.exp((cosine - 1) * 9))[..., None].astype(np.float32)
        clear = np.ones_like(theta)
        colour = np.zeros((*theta.shape, 3), np.float32)
        cx, cy = np.cos(theta) * np.cos(phi) / up, np.cos(theta) * np.sin(phi) / up
        steps = 14
        rng = np.random.default_rng((self.seed, len(theta), int(1e6 * abs(theta[0, 0]))))
        jitter = rng.random(theta.shape, dtype=np.float32)  # hides the slices
        for i in range(steps):
            level = (i + jitter) / steps
            z = clouds.base + level * clouds.thickness
            x, y = (z * cx).astype(np.float32), (z * cy).astype(np.float32)
            detail = (
                look(fine, x + 0.6 * z, y - 0.4 * z, clouds.scale * 0.11) * 0.13
                + look(fine, x - z, y, clouds.scale * 0.031) * 0.06
            )
            heap = look(broad, x, y, clouds.scale) - threshold + detail
            density = np.clip(heap - 1.1 * level**1.3 - 0.02, 0, None) * smooth(0, 0.12, level)
            sunward = look(broad, x + towards[0], y + towards[1], clouds.scale) - threshold + detail * 1.3
            shade = np.clip(sunward - 1.1 * level**1.3, 0, None) + 0.25 * np.clip(heap - level, 0, None)
            lit = np.exp(-3.2 * shade)[..., None]
            tone = phase * (0.12 + 0.95 * lit) * 1.5 * direct + (0.35 + 0.55 * level[..., None]) * ambient
            a = 1 - np.exp(-density * (26 / steps) * np.minimum(1 / up, 6).astype(np.float32))
            colour += (clear * a)[..., None] * tone.astype(np.float32)
            clear *= 1 - a
        opacity = 1 - clear
        colour /= np.maximum(opacity, 1e-3)[..., None]
        # Far clouds drown in the air between.
        keep = np.exp(-(clouds.base / up) / 32e3).astype(np.float32)
        behind = self.clear(theta, phi)
        colour = colour * keep[..., None] + behind * (1 - keep[..., None])
        return colour, (opacity * smooth(0.006, 0.05, theta)).astype(np.float32)
