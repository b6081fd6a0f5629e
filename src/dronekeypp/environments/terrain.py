"""The ground: flat around the camera, then hills and mountains. Every column is marched from near to far."""

from __future__ import annotations

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.noise import fbm_tile, look, smooth
from dronekeypp.environments.patch import Patch
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight
from dronekeypp.environments.specs import SNOW, Relief, Strip
from dronekeypp.environments.strips import strip_albedo, strip_blocks, strip_share
from dronekeypp.environments.surfaces import GRAIN, SURFACES

_NEAR, _FAR, _STEPS = 12.0, 40e3, 460  # the march, in metres; nearer than that the ground is flat
_ROWS = 64  # rows that are painted at once


class Terrain:
    """Paints everything below the skyline.

    Attributes:
        relief, surface, strips: what the ground is, see `specs.Environment`.
        light: the daylight.
        seed: of the place.
        water: (rows below the horizon, width) float16 share of water, once painted. None before.
    """

    def __init__(
        self, relief: Relief, surface: str, strips: tuple[Strip, ...], light: Daylight, seed: int
    ) -> None:
        self.relief = relief
        self.surface = surface
        self.strips = strips
        self.light = light
        self.seed = seed
        self.water: np.ndarray | None = None

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height in metres (h, w) at positions x, y (h, w), without trees; 0 at the camera."""
        r = self.relief
        distance = np.hypot(x, y)
        tile = fbm_tile(1024, 1.9, 100 + self.seed)
        rise = smooth(r.flat, r.flat + 2.2 * r.width, distance)
        rolling = look(tile, x + 0.37 * r.width, y, r.width * 5.3) * 0.5 + 0.25
        height = r.hills * rise * rolling + 0.5 * r.hills * smooth(r.flat, 6 * r.width, distance)
        if r.mountains:
            height = height + self._mountains(x, y, distance, tile)
        for strip in self.strips:
            if strip.surface == "water":
                height = height * (1 - strip_share(strip, x, y, soft=6.0))
        return height

    def _mountains(self, x: np.ndarray, y: np.ndarray, distance: np.ndarray, tile: np.ndarray) -> np.ndarray:
        """Return the metres (h, w) that the mountains add."""
        r = self.relief
        azimuth = np.degrees(np.arctan2(y, x))
        off = np.abs((azimuth - r.facing + 180) % 360 - 180)
        in_sector = smooth(r.sector / 2 + 12, r.sector / 2 - 12, off)
        share = smooth(r.beyond * 0.55, r.beyond * 1.3, distance) * in_sector
        broad = look(tile, x, y + 3000, r.beyond * 3.1)
        crest = 1 - np.abs(look(fbm_tile(1024, 1.75, 101 + self.seed), x, y, r.beyond * 2.2)) * 0.75
        return share * r.mountains * np.clip(0.42 + 0.22 * broad + 0.42 * crest, 0, None)

    def height_at(self, x: float, y: float) -> float:
        """Return the metres of one point above the ground at the camera, in the precision of x and y."""
        return float(self.height(np.array([[x]]), np.array([[y]]))[0, 0])

    def is_blocked(self, x: float, y: float, margin: float) -> bool:
        """Say whether a point lies on a road, a path or water, or within `margin` metres of one."""
        return any(strip_blocks(strip, x, y, margin) for strip in self.strips)

    def paint(self, canvas: Canvas, shadows: Shadows) -> None:
        """Paint the ground onto the canvas and set `water`."""
        phi, columns = canvas.phi, canvas.width
        distance = np.geomspace(_NEAR, _FAR, _STEPS).astype(np.float32)
        seen, light = self._march(canvas, distance, phi)
        top = max(0, int(np.floor(canvas.row(np.arctan(float(seen.max()))))) - 1)
        self.water = np.zeros((canvas.height - canvas.height // 2, canvas.width), np.float16)
        skyline = np.arctan(seen[-1])
        for first in range(top, canvas.height, _ROWS):
            theta = canvas.theta[first : first + _ROWS]
            tangent = np.tan(np.maximum(theta, -1.5607))
            below = tangent < -canvas.eye / _NEAR
            near = canvas.eye / np.maximum(-tangent, 1e-6)[:, None]
            near = np.broadcast_to(near, (len(theta), columns)).astype(np.float32)
            if below.all():  # the flat foreground
                light_maps = [np.zeros((1, 1), np.float32)] * 5
                self._band(canvas, shadows, first, near, np.ones_like(near), light_maps, below[:, None])
                continue
            index = _first_hit(seen, tangent)
            cover = np.clip((skyline - theta[:, None]) / canvas.pixel + 0.5, 0, 1)  # 0 above the skyline
            whole = index.astype(np.int32)
            part = index - whole
            # The tangent of a plane is linear in 1 / distance.
            reach = 1 / ((1 - part) / distance[whole] + part / distance[whole + 1])
            reach = np.where(below[:, None], near, reach).astype(np.float32)
            column = np.repeat(np.arange(columns, dtype=np.float32)[None], len(theta), 0)
            light_maps = []
            for polar in light:
                light_maps.append(
                    cv2.remap(polar, column, index, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                )
            self._band(canvas, shadows, first, reach, cover, light_maps, below[:, None])

    def _march(
        self, canvas: Canvas, distance: np.ndarray, phi: np.ndarray
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """March outwards on a polar grid of distances (n,) and azimuths (w,).

        Returns:
            The running maximum of the tangent of elevation, (n, w), and five (n, w) float32 maps: sunlit,
            skylit, wooded, bare, snowy.
        """
        r = self.relief
        d, p = np.meshgrid(distance, phi, indexing="ij")
        x, y = d * np.cos(p), d * np.sin(p)
        ground = self.height(x, y)
        tile = fbm_tile(1024, 1.2, 130 + self.seed)
        wooded = self._wooded(x, y, d, ground, tile)
        canopy = 10 + 2.5 * look(tile, x, y, 130) + 1.5 * look(fbm_tile(1024, 1.0, 132, 12, 60), x, y, 260)
        height = ground + wooded * np.maximum(canopy, 0)
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
        slope = np.abs(np.gradient(ground, axis=0) / np.gradient(distance)[:, None])
        bare = smooth(0.45, 0.8, slope + 0.1 * look(tile, x, y, 900)) * smooth(40, 160, ground)
        if r.snow_line > 0:
            bare = np.maximum(bare, smooth(1300, 1900, ground))
            snowy = smooth(r.snow_line * 0.85, r.snow_line * 1.1, ground + 90 * look(tile, x, y, 700))
            snowy = snowy * smooth(1.3, 0.7, slope)
        else:  # the surface itself is snow
            bare = bare * 0.5
            snowy = np.zeros_like(d)
        tangent = ((height - canvas.eye) / d).astype(np.float32)
        # The small slope makes the maximum rise strictly, for the search in `_first_hit`.
        seen = np.maximum.accumulate(tangent, 0) + np.arange(_STEPS, dtype=np.float32)[:, None] * 1e-8
        maps = [sunlit, 0.5 + 0.5 * up, smooth(0.02, 0.3, wooded), bare * (1 - wooded), snowy]
        return seen, [values.astype(np.float32) for values in maps]

    def _wooded(
        self, x: np.ndarray, y: np.ndarray, distance: np.ndarray, ground: np.ndarray, tile: np.ndarray
    ) -> np.ndarray:
        """Return the share of trees, 0 to 1: on hills, below the tree line, not on strips."""
        r = self.relief
        woods_tile = fbm_tile(1024, 1.5, 131 + self.seed)
        mask = look(woods_tile, x, y, 3.1 * r.width + 400)
        limit = np.quantile(woods_tile[::8, ::8], 1 - np.clip(r.woods, 0.001, 0.999))
        in_wood = smooth(limit - 0.08, limit + 0.08, mask + 0.12 * look(tile, x, y, 90))
        wooded = in_wood * smooth(max(r.flat * 1.1, 300), max(r.flat * 1.3, 340) + 60, distance)
        tree_line = min(r.snow_line, 1900) if r.snow_line > 0 else 1500
        wooded *= smooth(tree_line * 0.95, tree_line * 0.7, ground)
        for strip in self.strips:
            wooded *= 1 - strip_share(strip, x, y, soft=4.0)
        return wooded

    def _band(
        self,
        canvas: Canvas,
        shadows: Shadows,
        first: int,
        reach: np.ndarray,
        cover: np.ndarray,
        light_maps: list[np.ndarray],
        below: np.ndarray,
    ) -> None:
        """Paint a band of rows.

        Args:
            canvas, shadows: see `paint`.
            first: the band's first row.
            reach: (h, w) level distance to the ground in metres.
            cover: (h, w) opacity, 0 above the skyline.
            light_maps: sunlit, skylit, wooded, bare and snowy, (h, w) or (1, 1).
            below: (h, 1) where the ground is the flat foreground.
        """
        sunlit, skylit, wooded, bare, snowy = light_maps
        phi = canvas.phi[None]
        x, y = reach * np.cos(phi), reach * np.sin(phi)
        middle = np.median(reach, 1)
        footprint = middle * canvas.pixel * np.clip(middle / canvas.eye, 1, 30) ** 0.25
        patch = Patch(x, y, footprint, self.light.sun, self.seed)
        albedo = SURFACES[self.surface](patch)
        # What stands on the ground (blades, stones) keeps a grain at any distance.
        rng = np.random.default_rng((self.seed, first, 5))
        grain = rng.standard_normal(x.shape, dtype=np.float32)
        grain = cv2.GaussianBlur(grain, (0, 0), sigmaX=0.6, sigmaY=0.9)
        albedo *= np.exp(GRAIN.get(self.surface, 0.2) * grain)[..., None]
        water = np.zeros_like(x)
        for strip in self.strips:
            share = strip_share(strip, x, y, soft=footprint[:, None])
            if not share.any():
                continue
            if strip.surface == "water":
                water = np.maximum(water, share)
                continue
            albedo += share[..., None] * (strip_albedo(strip, patch) - albedo)
        if wooded.any():
            rise = reach * np.tan(canvas.theta[first : first + len(reach)])[:, None]
            upright = Patch(
                (phi * reach).astype(np.float32),
                rise.astype(np.float32),
                middle * canvas.pixel,
                self.light.sun,
                self.seed,
            )
            woods = self._woods_albedo(patch, upright)
            albedo += wooded[..., None] * (woods - albedo)
        if bare.any():
            rough = np.exp(0.3 * patch.noise(900, 0.8, 62))
            rock = np.asarray(self.relief.rock_colour, np.float32) * rough[..., None]
            albedo += bare[..., None] * (rock - albedo)
        if snowy.any():
            albedo += snowy[..., None] * (np.array(SNOW, np.float32) - albedo)
        sun = np.where(below, max(self.light.sun[2], 0.0), sunlit) * shadows.lit(x, y)
        sky = np.where(below, 1.0, skylit)
        light = sun[..., None] * self.light.sun_colour + sky[..., None] * self.light.sky_colour
        radiance = albedo / np.pi * light
        columns = np.arange(canvas.width)
        radiance = canvas.haze(radiance, reach[..., None], columns).astype(np.float32)
        canvas.paste(radiance, cover, first, columns)
        offset = first - canvas.height // 2
        if water.any() and offset + len(water) > 0:
            skipped = max(0, -offset)
            self.water[offset + skipped : offset + len(water)] = (water * cover)[skipped:]

    def _woods_albedo(self, patch: Patch, upright: Patch) -> np.ndarray:
        """Return the albedo (h, w, 3) of woods.

        Crowns are seen from the side, so their texture stands upright: x of `upright` are metres along the
            horizon,
        y are metres up.
        """
        near = 0.5 * upright.noise(17, 0.8, 60) + 0.3 * upright.noise(75, 1.1, 63)
        rough = np.exp(near + 0.2 * patch.noise(310, 0.8, 61))
        return np.asarray(self.relief.woods_colour, np.float32) * rough[..., None]


def _first_hit(seen: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Find where each ray first meets the ground.

    Args:
        seen: (n, w) rising tangents of elevation along every column, from near to far.
        tangent: (h,) tangent of the elevation of every row.

    Returns:
        (h, w) float32 fractional index into the n steps.
    """
    steps, columns = seen.shape
    index = np.empty((columns, len(tangent)), np.float32)
    for c in range(columns):
        column = seen[:, c]
        k = np.clip(column.searchsorted(tangent), 1, steps - 1)
        low = column[k - 1]
        index[c] = k - 1 + np.clip((tangent - low) / np.maximum(column[k] - low, 1e-9), 0, 1)
    return np.minimum(index.T, steps - 1.001)
