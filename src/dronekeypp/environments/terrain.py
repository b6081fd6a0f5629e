"""The ground: flat around the camera, then rolling into hills and mountains, seen by marching every column of the
picture outwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.noise import fbm_tile, look, smooth
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight
from dronekeypp.environments.surfaces import GRAIN, SURFACES, Patch

_NEAR, _FAR, _STEPS = 12.0, 40e3, 460


@dataclass(frozen=True)
class Relief:
    """hills: metres of rise and their width; they start `flat` metres from the camera. mountains: metres, starting
    `beyond` metres away, within `sector` degrees of azimuth `facing`. woods: share of the hills under trees.
    woods_colour: albedo. snow_line: metres above which it is white.
    """

    hills: float = 6.0
    width: float = 900.0
    flat: float = 90.0
    mountains: float = 0.0
    beyond: float = 5000.0
    facing: float = 0.0
    sector: float = 360.0
    woods: float = 0.35
    woods_colour: tuple[float, float, float] = (0.030, 0.050, 0.016)
    snow_line: float = 1e9
    rock_colour: tuple[float, float, float] = (0.16, 0.145, 0.13)


@dataclass(frozen=True)
class Strip:
    """A road, path or water across the base surface: `width` metres about the line at `offset` metres left of the
    camera, running along `heading` degrees. wobble: metres its edge wanders. marks: "road" (centre and edge lines),
    "bays" (parking), "". kerb: width of a light border. length: metres along `heading`, centred.
    """

    surface: str
    heading: float = 0.0
    offset: float = 0.0
    width: float = 6.0
    wobble: float = 0.0
    marks: str = ""
    kerb: float = 0.0
    length: float = 60e3


class Terrain:
    """Paints everything below the skyline."""

    def __init__(self, relief: Relief, surface: str, strips: tuple[Strip, ...], light: Daylight, seed: int):
        self.relief, self.surface, self.strips, self.light, self.seed = relief, surface, strips, light, seed
        self.water: np.ndarray | None = None  # (rows below the horizon, W) share of water, once painted

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Metres above the ground at the camera, without trees."""
        r = self.relief
        distance = np.hypot(x, y)
        tile = fbm_tile(1024, 1.9, 100 + self.seed)
        rise = smooth(r.flat, r.flat + 2.2 * r.width, distance)
        rolling = look(tile, x + 0.37 * r.width, y, r.width * 5.3) * 0.5 + 0.25
        height = r.hills * rise * rolling + 0.5 * r.hills * smooth(r.flat, 6 * r.width, distance)
        if r.mountains:
            azimuth = np.degrees(np.arctan2(y, x))
            off = np.abs((azimuth - r.facing + 180) % 360 - 180)
            there = smooth(r.beyond * 0.55, r.beyond * 1.3, distance) * smooth(
                r.sector / 2 + 12, r.sector / 2 - 12, off
            )
            broad = look(tile, x, y + 3000, r.beyond * 3.1)
            crest = 1 - np.abs(look(fbm_tile(1024, 1.75, 101 + self.seed), x, y, r.beyond * 2.2)) * 0.75
            height = height + there * r.mountains * np.clip(0.42 + 0.22 * broad + 0.42 * crest, 0, None)
        for strip in self.strips:
            if strip.surface == "water":
                height = height * (1 - self.share(strip, x, y, soft=6.0))
        return height

    def share(
        self, strip: Strip, x: np.ndarray, y: np.ndarray, soft: np.ndarray | float = 0.02
    ) -> np.ndarray:
        """How much of (x, y) lies in a strip, 0..1, softened over `soft` metres."""
        across, along = self.across(strip, x, y)
        if strip.wobble:
            tile = fbm_tile(1024, 1.9, 120)
            across = across + strip.wobble * 0.5 * look(tile, along, across * 0.3, 40 + 12 * strip.wobble)
        soft = np.maximum(soft, 0.01 + 0.1 * strip.wobble)
        inside = np.clip((strip.width / 2 - np.abs(across)) / soft + 0.5, 0, 1)
        if strip.length < 50e3:  # rounded ends
            bulge = strip.length / 2 - 0.3 * strip.width * (2 * across / strip.width) ** 2
            inside = inside * np.clip((bulge - np.abs(along)) / soft + 0.5, 0, 1)
        return inside

    @staticmethod
    def across(strip: Strip, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, s = np.float32(np.cos(np.radians(strip.heading))), np.float32(np.sin(np.radians(strip.heading)))
        return (y * c - x * s - np.float32(strip.offset)).astype(np.float32), (x * c + y * s).astype(
            np.float32
        )

    def paint(self, canvas: Canvas, shadows: Shadows) -> None:
        phi, columns = canvas.phi, canvas.width
        distance = np.geomspace(_NEAR, _FAR, _STEPS).astype(np.float32)
        slope, seen, light = self._march(canvas, distance, phi)
        top = max(0, int(np.floor(canvas.row(np.arctan(float(seen.max()))))) - 1)
        self.water = np.zeros((canvas.height - canvas.height // 2, canvas.width), np.float16)
        skyline = np.arctan(seen[-1])
        for first in range(top, canvas.height, 64):
            theta = canvas.theta[first : first + 64]
            tangent = np.tan(np.maximum(theta, -1.5607))
            below = tangent < -canvas.eye / _NEAR
            near = np.broadcast_to(
                canvas.eye / np.maximum(-tangent, 1e-6)[:, None], (len(theta), columns)
            ).astype(np.float32)
            if below.all():
                self._band(canvas, shadows, first, near, np.ones_like(near), None, below[:, None])
                continue
            index = np.empty((columns, len(theta)), np.float32)
            for c in range(columns):
                column = seen[:, c]
                k = np.clip(column.searchsorted(tangent), 1, _STEPS - 1)
                low = column[k - 1]
                index[c] = k - 1 + np.clip((tangent - low) / np.maximum(column[k] - low, 1e-9), 0, 1)
            index = np.minimum(index.T, _STEPS - 1.001)
            cover = np.clip((skyline - theta[:, None]) / canvas.pixel + 0.5, 0, 1)  # 0 above the skyline
            whole = index.astype(np.int32)
            part = index - whole
            reach = 1 / (
                (1 - part) / distance[whole] + part / distance[whole + 1]
            )  # a plane's tangent is linear in 1 / distance
            reach = np.where(below[:, None], near, reach).astype(np.float32)
            place = np.repeat(np.arange(columns, dtype=np.float32)[None], len(theta), 0)
            maps = [
                cv2.remap(m, place, index, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for m in light
            ]
            self._band(canvas, shadows, first, reach, cover, maps, below[:, None])

    def _march(
        self, canvas: Canvas, distance: np.ndarray, phi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """On a polar grid (distance, azimuth): tangent of elevation, its running maximum, and maps (sunlit, skylit,
        wooded, bare, snowy).
        """
        r = self.relief
        d, p = np.meshgrid(distance, phi, indexing="ij")
        x, y = d * np.cos(p), d * np.sin(p)
        height = self.height(x, y)
        ground = height.copy()
        tile = fbm_tile(1024, 1.2, 130 + self.seed)
        mask = look(fbm_tile(1024, 1.5, 131 + self.seed), x, y, 3.1 * r.width + 400)
        limit = np.quantile(
            fbm_tile(1024, 1.5, 131 + self.seed)[::8, ::8], 1 - np.clip(r.woods, 0.001, 0.999)
        )
        wooded = smooth(limit - 0.08, limit + 0.08, mask + 0.12 * look(tile, x, y, 90)) * smooth(
            max(r.flat * 1.1, 300), max(r.flat * 1.3, 340) + 60, d
        )
        treeline = min(r.snow_line, 1900) if r.snow_line > 0 else 1500
        wooded *= smooth(treeline * 0.95, treeline * 0.7, height)
        for strip in self.strips:
            wooded *= 1 - self.share(strip, x, y, soft=4.0)
        canopy = 10 + 2.5 * look(tile, x, y, 130) + 1.5 * look(fbm_tile(1024, 1.0, 132, 12, 60), x, y, 260)
        height = height + wooded * np.maximum(canopy, 0)
        away = np.gradient(height, axis=0) / np.gradient(distance)[:, None]
        around = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / (2 * d * (phi[1] - phi[0]))
        steep = np.hypot(away, around)
        limit = np.minimum(1, 1.6 / np.maximum(steep, 1e-6))
        away, around = away * limit, around * limit
        nx = -away * np.cos(p) + around * np.sin(p)
        ny = -away * np.sin(p) - around * np.cos(p)
        up = 1 / np.sqrt(1 + nx * nx + ny * ny)
        sun = self.light.sun
        sunlit = np.clip((nx * sun[0] + ny * sun[1] + sun[2]) * up, 0, 1)
        soft = 0.25 + 0.6 * max(float(sun[2]), 0.0)  # a wood's edge is no wall: leaves face every way
        sunlit = sunlit + 0.6 * wooded * (soft - sunlit)
        slope_ground = np.abs(np.gradient(ground, axis=0) / np.gradient(distance)[:, None])
        bare = smooth(0.45, 0.8, slope_ground + 0.1 * look(tile, x, y, 900)) * smooth(40, 160, ground)
        bare = np.maximum(bare, smooth(1300, 1900, ground)) if r.snow_line > 0 else bare * 0.5
        snowy = np.zeros_like(d)  # a snow line under 0 means that the surface itself is snow
        if r.snow_line > 0:
            snowy = smooth(
                r.snow_line * 0.85, r.snow_line * 1.1, ground + 90 * look(tile, x, y, 700)
            ) * smooth(1.3, 0.7, slope_ground)
        tangent = ((height - canvas.eye) / d).astype(np.float32)
        seen = np.maximum.accumulate(tangent, 0) + np.arange(_STEPS, dtype=np.float32)[:, None] * 1e-8
        maps = [
            m.astype(np.float32)
            for m in (sunlit, 0.5 + 0.5 * up, smooth(0.02, 0.3, wooded), bare * (1 - wooded), snowy)
        ]
        return tangent, seen, maps

    def _band(self, canvas, shadows, first, reach, cover, maps, below) -> None:
        if maps is None:  # the flat foreground
            maps = [np.zeros((1, 1), np.float32)] * 5
        sunlit, skylit, wooded, bare, snowy = maps
        phi = canvas.phi[None]
        x, y = reach * np.cos(phi), reach * np.sin(phi)
        middle = np.median(reach, 1)
        footprint = middle * canvas.pixel * np.clip(middle / canvas.eye, 1, 30) ** 0.25
        patch = Patch(x, y, footprint, self.light.sun, self.seed)
        albedo = SURFACES[self.surface](patch)
        # What stands on the ground (blades, stones) keeps a grain at any distance.
        rng = np.random.default_rng((self.seed, first, 5))
        grain = cv2.GaussianBlur(
            rng.standard_normal(x.shape, dtype=np.float32), (0, 0), sigmaX=0.6, sigmaY=0.9
        )
        albedo *= np.exp(GRAIN.get(self.surface, 0.2) * grain)[..., None]
        water = np.zeros_like(x)
        for strip in self.strips:
            share = self.share(strip, x, y, soft=footprint[:, None])
            if not share.any():
                continue
            if strip.surface == "water":
                water = np.maximum(water, share)
                continue
            albedo += share[..., None] * (self._strip(strip, patch) - albedo)
        r = self.relief
        if wooded.any():
            # Crowns are seen from the side: their texture stands upright, in metres along the horizon and up.
            rise = reach * np.tan(canvas.theta[first : first + len(reach)])[:, None]
            side = Patch(
                (phi * reach).astype(np.float32),
                rise.astype(np.float32),
                middle * canvas.pixel,
                self.light.sun,
                self.seed,
            )
            rough = np.exp(
                0.5 * side.noise(17, 0.8, 60)
                + 0.3 * side.noise(75, 1.1, 63)
                + 0.2 * patch.noise(310, 0.8, 61)
            )
            shade = np.asarray(r.woods_colour, np.float32) * rough[..., None]
            albedo += wooded[..., None] * (shade - albedo)
        if bare.any():
            rough = np.exp(0.3 * patch.noise(900, 0.8, 62))
            albedo += bare[..., None] * (np.asarray(r.rock_colour, np.float32) * rough[..., None] - albedo)
        if snowy.any():
            albedo += snowy[..., None] * (np.array([0.78, 0.8, 0.84], np.float32) - albedo)
        sun = np.where(below, max(self.light.sun[2], 0.0), sunlit) * shadows.lit(x, y)
        sky = np.where(below, 1.0, skylit)
        radiance = (
            albedo / np.pi * (sun[..., None] * self.light.sun_colour + sky[..., None] * self.light.sky_colour)
        )
        columns = np.arange(canvas.width)
        radiance = canvas.haze(radiance, reach[..., None], columns).astype(np.float32)
        canvas.paste(radiance, cover, first, columns)
        offset = first - canvas.height // 2
        if water.any() and offset + len(water) > 0:
            keep = max(0, -offset)
            self.water[offset + keep : offset + len(water)] = (water * cover)[keep:]

    def _strip(self, strip: Strip, patch: Patch) -> np.ndarray:
        colour = SURFACES[strip.surface](patch)
        across, along = self.across(strip, patch.x, patch.y)
        worn = np.clip(
            0.9 + 0.25 * patch.noise(1.3, 0.8, 70) - 0.3 * smooth(0.2, 1.5, patch.noise(9, 1.2, 71)), 0, 1
        )
        paint = np.zeros_like(across)
        soft = np.maximum(patch.footprint[:, None], 0.01)

        def bar(distance, half):
            return np.clip((half - np.abs(distance)) / soft + 0.5, 0, 1)

        if strip.marks == "road":
            dashes = np.clip((1.5 - np.abs((along + 4.5) % 9 - 4.5)) / soft + 0.5, 0, 1)
            paint = bar(across, 0.07) * dashes + bar(np.abs(across) - strip.width / 2 + 0.35, 0.07)
        elif strip.marks == "bays":
            lane = np.abs((across + 8.5) % 17 - 8.5)  # 7 m of lane, 5 m of bay on both sides of it
            in_bay = np.clip((lane - 3.5) / soft + 0.5, 0, 1)
            paint = np.maximum(patch.lines(along, 2.6, 0.12) * in_bay, bar(lane - 8.5, 0.06))
        if strip.marks:
            colour = colour + (np.clip(paint, 0, 1) * worn * 0.85)[..., None] * (
                np.array([0.62, 0.62, 0.60], np.float32) - colour
            )
        if strip.kerb:
            edge = bar(np.abs(across) - strip.width / 2, strip.kerb)
            colour = colour + edge[..., None] * (np.array([0.36, 0.35, 0.335], np.float32) - colour)
        return colour

    def paint_water(self, canvas: Canvas, waves: float, deep: tuple[float, float, float]) -> None:
        """Mirror what is already painted above the horizon in the water. waves: slope of the ripples, about 0.01
        (calm) to 0.15.
        """
        if self.water is None or not self.water.any():
            return
        half = canvas.height // 2
        rows = np.flatnonzero(self.water.any(1))
        limit = 9 * float(np.median(canvas.image[half // 2 : half : 8, ::8]))  # the sun's image, clipped
        for first in range(rows[0], rows[-1] + 1, 64):
            share = self.water[first : min(first + 64, rows[-1] + 1)].astype(np.float32)
            theta = canvas.theta[half + first : half + first + len(share)][:, None]
            reach = canvas.eye / np.tan(np.maximum(-theta, 2e-4))
            x, y = (
                (reach * np.cos(canvas.phi)).astype(np.float32),
                (reach * np.sin(canvas.phi)).astype(np.float32),
            )
            footprint = (
                reach[:, 0] * canvas.pixel * np.sqrt(np.clip(reach[:, 0] / canvas.eye, 1, 16))
            ).astype(np.float32)
            patch = Patch(x, y, footprint, self.light.sun, self.seed)
            ripple = [
                patch.noise(1.4, 1.0, 80) + patch.noise(6.7, 1.2, 81) + 0.7 * patch.noise(47, 1.3, 82)
                for patch in (patch, _moved(patch))
            ]
            # What no pixel resolves still tilts the mirror: jitter it instead, finer with distance.
            rng = np.random.default_rng((self.seed, first, 3))
            hidden = cv2.GaussianBlur(
                rng.standard_normal(x.shape, dtype=np.float32),
                (0, 0),
                sigmaX=3.0,
                sigmaY=0.7,
                borderType=cv2.BORDER_REFLECT,
            )
            hidden *= smooth(0.0, 0.5, footprint)[:, None] * 1.8
            tilt = np.float32(waves) * (ripple[0] + hidden)
            column = np.arange(canvas.width, dtype=np.float32)[None] + np.float32(0.8 * waves) * ripple[
                1
            ] / canvas.pixel * np.minimum(1, -theta * 8)
            mirror = 0
            for spread in (-1.3, -0.4, 0.4, 1.3):  # a pixel holds many small waves
                up = np.abs(-theta + 1.6 * tilt + (0.8 + 0.9 * spread) * waves)
                row = np.clip((0.5 - up / np.pi) * canvas.height - 0.5, 0, half - 1).astype(np.float32)
                seen = cv2.remap(
                    canvas.image[:half],
                    column.astype(np.float32),
                    row,
                    cv2.INTER_LINEAR,
                    borderMode=cv2.BORDER_WRAP,
                )
                mirror = mirror + 0.25 * np.minimum(seen, limit)
            facing = np.clip(np.sin(np.clip(-theta + tilt, 0.03, 1.5)), 0, 1)
            fresnel = (0.02 + 0.98 * (1 - facing) ** 5)[..., None]
            body = (
                np.asarray(deep, np.float32)
                * (self.light.sun_colour * max(self.light.sun[2], 0) + self.light.sky_colour)
                / np.pi
            )
            colour = (fresnel * mirror + (1 - fresnel) * body).astype(np.float32)
            canvas.paste(colour, share, half + first, np.arange(canvas.width))


def _moved(patch: Patch) -> Patch:
    return Patch(patch.x + 13.7, patch.y - 5.1, patch.footprint, patch.sun, patch.seed)
