"""Buildings: boxes with flat or gabled roofs, painted column by column. Windows mirror the picture so far."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.facades import Facade
from dronekeypp.environments.noise import fbm_tile, look
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight
from dronekeypp.environments.specs import SNOW
from dronekeypp.environments.walls import WallPoints, fraction, wall_appearance

_OVERSAMPLING = 4  # columns are cast four times as dense, for clean edges


@dataclass
class _Rays:
    """Where the rays of n fine columns meet the building; every array is (n,).

    Attributes:
        hit: whether the ray meets it.
        near, far: level distance in metres to where the ray enters and leaves.
        side: the wall it enters through, 0 to 3.
        along: metres along that wall.
        near_top, far_top: height of the roof where the ray enters and leaves, metres.
        ridge: level distance to the ridge; -1 where the ray does not cross it.
        across: metres across the ridge that the ray moves per metre.
        slope: how far the roof falls per metre across, where the ray enters. Negative where it rises.
    """

    hit: np.ndarray
    near: np.ndarray
    far: np.ndarray
    side: np.ndarray
    along: np.ndarray
    near_top: np.ndarray
    far_top: np.ndarray
    ridge: np.ndarray
    across: np.ndarray
    slope: np.ndarray

    def picked(self, index: np.ndarray) -> _Rays:
        """Return the rays at `index` (w,), ready to broadcast over rows.

        Lengths become (1, w) float32, `across` and `slope` (1, w). `hit` and `side` stay (w,).
        """
        return _Rays(
            self.hit[index],
            self.near[index][None].astype(np.float32),
            self.far[index][None].astype(np.float32),
            self.side[index],
            self.along[index][None].astype(np.float32),
            self.near_top[index][None].astype(np.float32),
            self.far_top[index][None].astype(np.float32),
            self.ridge[index][None].astype(np.float32),
            self.across[index][None],
            self.slope[index][None],
        )


@dataclass
class Building:
    """A box with a roof. Lengths are in metres.

    Attributes:
        x, y: its centre.
        length, depth: along `heading` and across it.
        height: to the eaves.
        heading: radians.
        facade: its walls and roof.
        rise: from the eaves to the ridge, which runs along `heading`; 0 for a flat roof.
        ground: height of its foot.
        seed: another seed gives other stains and curtains.
        snow: share of white on the roof.
        glow: radiance of a lit window.
        afloat: see `things.Thing`.
    """

    x: float
    y: float
    length: float
    depth: float
    height: float
    heading: float
    facade: Facade
    rise: float = 0.0
    ground: float = 0.0
    seed: int = 0
    snow: float = 0.0
    glow: float = 0.0
    afloat: bool = False

    @property
    def distance(self) -> float:
        """Metres from the camera to the nearest wall."""
        along, across = self._camera()
        return float(np.hypot(max(abs(along) - self.length / 2, 0), max(abs(across) - self.depth / 2, 0)))

    def contains(self, x: float, y: float, margin: float) -> bool:
        """Say whether a ground position lies in the building, or within `margin` metres of it."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        along = (x - self.x) * c + (y - self.y) * s
        across = -(x - self.x) * s + (y - self.y) * c
        return bool(abs(along) < self.length / 2 + margin and abs(across) < self.depth / 2 + margin)

    def corners(self) -> np.ndarray:
        """Return the ground positions of its corners, (4, 2) metres, in order around it."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        box = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [self.length / 2, self.depth / 2]
        return box @ np.array([[c, s], [-s, c]]) + [self.x, self.y]

    def cast(self, shadows: Shadows) -> None:
        if shadows.sun[2] < 0.02:
            return
        foot, fall = self.corners(), shadows.stretch()
        points = [foot, foot + fall * self.height]
        if self.rise:
            ridge = np.array([(foot[0] + foot[3]) / 2, (foot[1] + foot[2]) / 2])
            points.append(ridge + fall * (self.height + self.rise))
        shadows.polygon(cv2.convexHull(np.concatenate(points).astype(np.float32))[:, 0])

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        columns = self._columns(canvas)
        if len(columns) < 2 or self.distance < 0.5:
            return
        count = len(columns) * _OVERSAMPLING
        fine = columns[0] - 0.5 + (np.arange(count) + 0.5) / _OVERSAMPLING
        rays = self._cast_rays(canvas, fine)
        if not rays.hit.any():
            return
        upper, lower = self._row_limits(canvas, rays)
        first = max(0, int(np.floor(upper.min())))
        last = min(canvas.height - 1, int(np.ceil(lower.max())))
        if last <= first:
            return
        rows = np.arange(first, last + 1)
        alpha = np.zeros((len(rows), len(columns)), np.float32)
        for k in range(_OVERSAMPLING):
            above = np.clip(rows[:, None] - upper[k::_OVERSAMPLING] + 0.5, 0, 1)
            below = np.clip(lower[k::_OVERSAMPLING] - rows[:, None] + 0.5, 0, 1)
            alpha += above * below * rays.hit[k::_OVERSAMPLING]
        alpha /= _OVERSAMPLING
        # One ray per column, the first that hits, gives the column its colour.
        first_hit = np.argmax(rays.hit.reshape(-1, _OVERSAMPLING), 1)
        view = rays.picked(first_hit + np.arange(len(columns)) * _OVERSAMPLING)
        radiance = self._shade(canvas, light, columns, rows, view)
        radiance = canvas.haze(radiance, view.near[..., None], columns)
        canvas.paste(radiance.astype(np.float32), alpha, first, columns)

    def _columns(self, canvas: Canvas) -> np.ndarray:
        """Return the whole columns, not wrapped, that the building covers."""
        corners = self.corners()
        middle = np.arctan2(self.y, self.x)
        off = (np.arctan2(corners[:, 1], corners[:, 0]) - middle + np.pi) % (2 * np.pi) - np.pi
        centre = middle + (off.max() + off.min()) / 2
        return canvas.columns(centre, (off.max() - off.min()) / 2 + 2 * canvas.pixel)

    def _cast_rays(self, canvas: Canvas, fine: np.ndarray) -> _Rays:
        """Follow the ray of every fractional column `fine` (n,) through the building."""
        phi = (0.5 - (fine + 0.5) / canvas.width) * 2 * np.pi
        c, s = np.cos(self.heading), np.sin(self.heading)
        # In the building's axes, a along `heading` and b across it, the camera is at (oa, ob) and the ray
        # runs along (da, db).
        oa, ob = self._camera()
        da = np.cos(phi) * c + np.sin(phi) * s
        db = -np.cos(phi) * s + np.sin(phi) * c
        da = np.where(np.abs(da) < 1e-9, 1e-9, da)
        db = np.where(np.abs(db) < 1e-9, 1e-9, db)
        ta = np.sort(np.stack([(-self.length / 2 - oa) / da, (self.length / 2 - oa) / da]), 0)
        tb = np.sort(np.stack([(-self.depth / 2 - ob) / db, (self.depth / 2 - ob) / db]), 0)
        near, far = np.maximum(ta[0], tb[0]), np.minimum(ta[1], tb[1])
        hit = (far > near) & (near > 0.05)
        near, far = np.where(hit, near, 1.0), np.where(hit, far, 2.0)
        end = ta[0] > tb[0]  # enters through an end wall (across `heading`)
        side = np.where(end, np.where(da > 0, 0, 1), np.where(db > 0, 2, 3))
        b_in, b_out = ob + near * db, ob + far * db
        along = np.where(end, b_in + self.depth / 2, oa + near * da + self.length / 2)
        ridge = -ob / db
        ridge = np.where((ridge > near) & (ridge < far) & (self.rise > 0), ridge, -1.0)
        slope = 2 * self.rise / self.depth * np.sign(b_in)
        return _Rays(
            hit, near, far, side, along, self._roof_height(b_in), self._roof_height(b_out), ridge, db, slope
        )

    def _camera(self) -> tuple[float, float]:
        """Return where the camera is, seen from the building's centre: metres along `heading` and across."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return -self.x * c - self.y * s, self.x * s - self.y * c

    def _roof_height(self, across: np.ndarray) -> np.ndarray:
        """Return the metres of the roof above the foot, at positions across the ridge in metres."""
        return self.height + self.rise * np.clip(1 - np.abs(across) / (self.depth / 2), 0, 1)

    def _row_limits(self, canvas: Canvas, rays: _Rays) -> tuple[np.ndarray, np.ndarray]:
        """Return the fractional rows (n,) of the roof's upper edge and of the foot, in every fine column."""
        eye = canvas.eye - self.ground
        with np.errstate(invalid="ignore", divide="ignore"):
            peak = np.maximum((rays.near_top - eye) / rays.near, (rays.far_top - eye) / rays.far)
            at_ridge = (self.height + self.rise - eye) / np.maximum(rays.ridge, 1e-3)
            peak = np.where(rays.ridge > 0, np.maximum(peak, at_ridge), peak)
        upper = np.where(rays.hit, canvas.row(np.arctan(peak)), 1e9)
        lower = np.where(rays.hit, canvas.row(np.arctan(-eye / rays.near)), -1e9)
        return upper, lower

    def _shade(
        self, canvas: Canvas, light: Daylight, columns: np.ndarray, rows: np.ndarray, view: _Rays
    ) -> np.ndarray:
        """Return the radiance (h, w, 3) of the building in these rows (h,) and columns (w,)."""
        tangent = np.tan(canvas.theta[rows]).astype(np.float32)[:, None]
        z = canvas.eye - self.ground + view.near * tangent
        soft = np.maximum(view.near * canvas.pixel, 0.01)
        c, s = np.cos(self.heading), np.sin(self.heading)
        normals = np.array([[-c, -s, 0], [c, s, 0], [s, -c, 0], [-s, c, 0]])[view.side]
        span = np.where(view.side < 2, self.depth, self.length).astype(np.float32)[None]
        points = WallPoints(view.along, z, span, view.near_top, soft, view.side)
        albedo, glass, lit = wall_appearance(self.facade, self.seed, points)
        ambient = 0.5 * light.sky_colour + 0.09 * (light.sun_colour * max(light.sun[2], 0) + light.sky_colour)
        sunny = np.clip(normals @ light.sun, 0, 1)[None, :, None]
        shade = np.clip(0.75 + 0.25 * z / 4, 0.55, 1)[..., None]  # a street is darker down at its foot
        radiance = albedo / np.pi * (sunny * light.sun_colour + shade * ambient)
        if glass.any():
            mirror = self._mirror(canvas, columns, rows, normals, view.along, z)
            radiance = radiance + glass[..., None] * (mirror - radiance)
        radiance += (lit * self.glow)[..., None] * np.array([1.0, 0.72, 0.40])
        if (z > view.near_top).any():  # here the ray passes over the wall and meets the roof
            cover = self._roof_radiance(canvas, light, tangent, view)
            edge = np.clip((z - view.near_top) / soft, 0, 1)[..., None]
            radiance = radiance + edge * (cover - radiance)
        return radiance

    def _roof_radiance(self, canvas: Canvas, light: Daylight, tangent: np.ndarray, view: _Rays) -> np.ndarray:
        """Return the radiance (h, w, 3) of the roof. tangent: (h, 1) of the elevation of every row."""
        eye = canvas.eye - self.ground
        if self.rise:
            # t metres along the ray, the near slope is height + rise - slope * (ob + t * across) metres high.
            c, s = np.cos(self.heading), np.sin(self.heading)
            _, ob = self._camera()
            steepness = tangent + view.slope * view.across
            t = self.height + self.rise - view.slope * ob - eye
            t = t / np.where(np.abs(steepness) < 1e-6, 1e-6, steepness)
            up = np.array([0, 0, 1.0]) * self.depth / 2
            sideways = np.array([-s, c, 0])[None] * np.sign(view.slope)[0][:, None] * self.rise
            normal = (sideways + up) / np.hypot(self.rise, self.depth / 2)
        else:
            t = (self.height - eye) / np.where(np.abs(tangent) < 1e-6, 1e-6, tangent)
            normal = np.tile([0, 0, 1.0], (len(view.side), 1))
        t = np.clip(t, view.near, view.far)
        albedo = self._roof_albedo(eye + t * tangent, view.along, view.near * canvas.pixel)
        direct = np.clip(normal @ light.sun, 0, 1)[None, :, None]
        return albedo / np.pi * (direct * light.sun_colour + 0.9 * light.sky_colour)

    def _roof_albedo(self, z: np.ndarray, along: np.ndarray, soft: np.ndarray) -> np.ndarray:
        """Return the albedo (h, w, 3) of the roof, with courses of tiles and snow.

        Args:
            z: (h, w) metres above the building's foot.
            along: (1, w) metres along the wall below.
            soft: (1, w) metres that a pixel covers.
        """
        roof = np.asarray(self.facade.roof, np.float32)
        if self.snow:
            roof = roof + self.snow * (np.array(SNOW, np.float32) - roof)
        tile = fbm_tile(1024, 1.2, 160)
        rough = look(tile, (along + 0 * z).astype(np.float32), (z * 2.0).astype(np.float32), 9.0)
        sharp = np.clip(1 - soft / 0.08, 0, 1)
        course = np.sin(z * (2 * np.pi / 0.19)) * sharp * (self.rise > 0) * (1 - self.snow)
        return roof * np.exp(0.13 * rough + 0.18 * course)[..., None]

    def _mirror(
        self,
        canvas: Canvas,
        columns: np.ndarray,
        rows: np.ndarray,
        normals: np.ndarray,
        along: np.ndarray,
        z: np.ndarray,
    ) -> np.ndarray:
        """Return what the panes mirror (h, w, 3): the picture so far, at the mirrored azimuth.

        Every pane is set a little askew.

        Args:
            canvas, columns, rows: see `_shade`.
            normals: (w, 3) of the wall in every column.
            along, z: (1, w) and (h, w) metres along the wall and above the foot.
        """
        pitch, storey_height = self.facade.pitch
        phi = (0.5 - (columns + 0.5) / canvas.width) * 2 * np.pi
        wall = np.arctan2(normals[:, 1], normals[:, 0])
        mirrored = (2 * wall - phi + np.pi)[None]
        pane = np.sin(np.floor(along / pitch) * 91.7 + np.floor(z / storey_height) * 57.3 + self.seed)
        askew = fraction(pane * 1758.5453) - 0.5
        theta = np.abs(canvas.theta[rows][:, None]) + 0.02 + 0.035 * askew
        u = (canvas.column(mirrored + 0.05 * askew) % canvas.width).astype(np.float32)
        v = np.clip(canvas.row(theta), 0, canvas.height // 2 - 1).astype(np.float32)
        above = canvas.image[: canvas.height // 2]
        seen = cv2.remap(above, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        brightest = 6 * max(float(np.median(seen)), 1e-3)
        return np.minimum(seen, brightest) * np.array([0.80, 0.86, 0.88], np.float32)
