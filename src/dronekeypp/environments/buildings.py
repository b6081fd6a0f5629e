"""Buildings: boxes with flat or gabled roofs, cast column by column, with facades of windows that mirror what is
already painted.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.noise import fbm_tile, look, smooth
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight

_OVER = 4  # columns are cast four times as dense, for clean edges


@dataclass(frozen=True)
class Facade:
    """Walls. wall: albedo. window: (width, height) metres; pitch: (along, storey). sill: height of the window's foot
    above its floor. glass: mirror strength. bands: "", "brick", "panel", "ribs", "plaster", "open" (a bare concrete
    frame). lit: share of lit windows at dusk.
    """

    wall: tuple[float, float, float] = (0.4, 0.37, 0.32)
    window: tuple[float, float] = (1.3, 1.5)
    pitch: tuple[float, float] = (3.0, 3.1)
    sill: float = 0.95
    glass: float = 0.35
    bands: str = "plaster"
    roof: tuple[float, float, float] = (0.28, 0.12, 0.08)
    frame: float = 0.07
    plinth: float = 0.6
    lit: float = 0.25


FACADES: dict[str, Facade] = {
    "plaster": Facade((0.38, 0.34, 0.275)),
    "white": Facade((0.47, 0.455, 0.43), (1.2, 1.35), (3.2, 2.9), roof=(0.10, 0.095, 0.095)),
    "ochre": Facade((0.37, 0.265, 0.145), (1.1, 1.7), (2.7, 3.4), roof=(0.30, 0.14, 0.085)),
    "brick": Facade((0.25, 0.115, 0.075), (1.15, 1.6), (2.6, 3.2), bands="brick", roof=(0.14, 0.12, 0.115)),
    "old_brick": Facade((0.20, 0.10, 0.07), (1.5, 2.0), (3.4, 3.9), bands="brick", roof=(0.11, 0.10, 0.10)),
    "stone": Facade((0.33, 0.30, 0.25), (1.2, 2.1), (2.9, 4.0), bands="panel", roof=(0.12, 0.125, 0.13)),
    "glass": Facade(
        (0.16, 0.17, 0.18),
        (1.38, 3.2),
        (1.5, 3.6),
        sill=0.2,
        glass=0.75,
        bands="",
        frame=0.04,
        plinth=0.3,
        lit=0.4,
    ),
    "office": Facade(
        (0.36, 0.36, 0.36), (2.5, 1.9), (2.9, 3.5), sill=0.9, glass=0.5, bands="panel", frame=0.05, lit=0.4
    ),
    "slab": Facade((0.44, 0.43, 0.41), (1.8, 1.45), (3.1, 2.8), bands="panel"),
    "shed": Facade(
        (0.36, 0.39, 0.41), (2.2, 0.9), (9.0, 9.0), sill=4.2, bands="ribs", roof=(0.3, 0.31, 0.32), plinth=0.9
    ),
    "red_shed": Facade(
        (0.26, 0.06, 0.045),
        (1.0, 1.0),
        (5.0, 7.0),
        sill=1.2,
        bands="ribs",
        roof=(0.2, 0.19, 0.185),
        plinth=0.3,
    ),
    "timber": Facade(
        (0.16, 0.095, 0.055), (1.0, 1.1), (2.6, 2.7), bands="ribs", roof=(0.13, 0.11, 0.10), plinth=0.8
    ),
    "frame": Facade(
        (0.34, 0.335, 0.32),
        (4.2, 2.75),
        (4.7, 3.3),
        sill=0.0,
        glass=0.0,
        bands="open",
        frame=0.0,
        plinth=0.0,
        lit=0.0,
    ),
    "wall": Facade(
        (0.36, 0.345, 0.32), (0.0, 0.0), (9.0, 9.0), bands="panel", roof=(0.34, 0.33, 0.31), plinth=0.0
    ),
    "stand": Facade(
        (0.40, 0.40, 0.40),
        (5.4, 2.4),
        (6.0, 4.6),
        sill=1.4,
        glass=0.25,
        bands="open",
        roof=(0.55, 0.56, 0.57),
        plinth=1.5,
    ),
    "hedge": Facade(
        (0.035, 0.06, 0.02), (0.0, 0.0), (9.0, 9.0), bands="hedge", roof=(0.045, 0.08, 0.025), plinth=0.0
    ),
    "container": Facade(
        (0.20, 0.07, 0.04), (0.0, 0.0), (9.0, 9.0), bands="ribs", roof=(0.2, 0.08, 0.05), plinth=0.0
    ),
}


@dataclass
class Building:
    """A box: centre (x, y), length along `heading` (radians), depth across, height to the eaves; `rise`: of the gable
    above, 0 for a flat roof.
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
    glow: float = 0.0  # radiance of a lit window

    @property
    def distance(self) -> float:
        """To the nearest wall."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        a, b = -self.x * c - self.y * s, self.x * s - self.y * c
        return float(np.hypot(max(abs(a) - self.length / 2, 0), max(abs(b) - self.depth / 2, 0)))

    def corners(self) -> np.ndarray:
        c, s = np.cos(self.heading), np.sin(self.heading)
        box = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [self.length / 2, self.depth / 2]
        return box @ np.array([[c, s], [-s, c]]) + [self.x, self.y]

    def cast(self, shadows: Shadows) -> None:
        if shadows.sun[2] < 0.02:
            return
        foot, fall = self.corners(), shadows.stretch()
        points = [foot, foot + fall * self.height]
        if self.rise:
            ridge = np.array([(foot[0] + foot[3]) / 2, (foot[1] + foot[2]) / 2]) + fall * (
                self.height + self.rise
            )
            points.append(ridge)
        shadows.polygon(cv2.convexHull(np.concatenate(points).astype(np.float32))[:, 0])

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        corners = self.corners()
        middle = np.arctan2(self.y, self.x)
        off = (np.arctan2(corners[:, 1], corners[:, 0]) - middle + np.pi) % (2 * np.pi) - np.pi
        centre, half = middle + (off.max() + off.min()) / 2, (off.max() - off.min()) / 2 + 2 * canvas.pixel
        columns = canvas.columns(centre, half)
        if len(columns) < 2 or self.distance < 0.5:
            return
        fine = (columns[0] - 0.5 + (np.arange(len(columns) * _OVER) + 0.5) / _OVER).astype(np.float64)
        hit, near, far, side, along, profile = self._cast_columns(canvas, fine)
        if not hit.any():
            return
        eye, top_z = canvas.eye - self.ground, self.height
        with np.errstate(invalid="ignore", divide="ignore"):
            peak = np.maximum((profile[0] - eye) / near, (profile[1] - eye) / far)
            peak = np.where(
                profile[3] > 0,
                np.maximum(peak, (top_z + self.rise - eye) / np.maximum(profile[3], 1e-3)),
                peak,
            )
        upper = np.where(hit, canvas.row(np.arctan(peak)), 1e9)
        lower = np.where(hit, canvas.row(np.arctan(-eye / near)), -1e9)
        first = int(np.floor(upper.min()))
        last = min(canvas.height - 1, int(np.ceil(lower.max())))
        first = max(0, first)
        if last <= first:
            return
        rows = np.arange(first, last + 1)
        pick = np.argmax(hit.reshape(-1, _OVER), 1) + np.arange(len(columns)) * _OVER
        alpha = np.zeros((len(rows), len(columns)), np.float32)
        for k in range(_OVER):
            u, low, h = upper[k::_OVER], lower[k::_OVER], hit[k::_OVER]
            alpha += np.clip(rows[:, None] - u + 0.5, 0, 1) * np.clip(low - rows[:, None] + 0.5, 0, 1) * h
        alpha /= _OVER
        tangent = np.tan(canvas.theta[rows]).astype(np.float32)[:, None]
        values = [v[pick][None].astype(np.float32) for v in (near, far, along, profile[0], profile[2])]
        radiance = self._shade(canvas, light, columns, rows, tangent, side[pick], values, fine[pick])
        radiance = canvas.haze(radiance, values[0][..., None], columns)
        canvas.paste(radiance.astype(np.float32), alpha, first, columns)

    def _cast_columns(self, canvas: Canvas, fine: np.ndarray):
        """Along every column's ray: does it hit, distance in and out, which wall (0..3), metres along the wall, roof
        heights.
        """
        phi = (0.5 - (fine + 0.5) / canvas.width) * 2 * np.pi
        c, s = np.cos(self.heading), np.sin(self.heading)
        da, db = np.cos(phi) * c + np.sin(phi) * s, -np.cos(phi) * s + np.sin(phi) * c
        oa, ob = -self.x * c - self.y * s, self.x * s - self.y * c
        da, db = (np.where(np.abs(d) < 1e-9, 1e-9, d) for d in (da, db))
        ta = np.sort(np.stack([(-self.length / 2 - oa) / da, (self.length / 2 - oa) / da]), 0)
        tb = np.sort(np.stack([(-self.depth / 2 - ob) / db, (self.depth / 2 - ob) / db]), 0)
        near, far = np.maximum(ta[0], tb[0]), np.minimum(ta[1], tb[1])
        hit = (far > near) & (near > 0.05)
        near, far = np.where(hit, near, 1.0), np.where(hit, far, 2.0)
        end = ta[0] > tb[0]  # enters through an end wall (across `heading`)
        side = np.where(end, np.where(da > 0, 0, 1), np.where(db > 0, 2, 3))
        b_in, b_out = ob + near * db, ob + far * db
        along = np.where(end, b_in + self.depth / 2, oa + near * da + self.length / 2)

        def roof(b):
            return self.height + self.rise * np.clip(1 - np.abs(b) / (self.depth / 2), 0, 1)

        ridge = -ob / db
        ridge = np.where((ridge > near) & (ridge < far) & (self.rise > 0), ridge, -1.0)
        # Coefficient of the near slope: its height is eaves + rise - k (ob + t db).
        k = 2 * self.rise / self.depth * np.sign(b_in)
        self._slope = (ob, db, k)
        return hit, near, far, side, along, (roof(b_in), roof(b_out), np.arange(len(fine)), ridge)

    def _shade(self, canvas, light, columns, rows, tangent, side, values, where):
        near, far, along, wall_top, index = values
        eye = canvas.eye - self.ground
        z = eye + near * tangent
        soft = np.maximum(near * canvas.pixel, 0.01)
        c, s = np.cos(self.heading), np.sin(self.heading)
        normals = np.array([[-c, -s, 0], [c, s, 0], [s, -c, 0], [-s, c, 0]])[side]
        span = np.where(side < 2, self.depth, self.length).astype(np.float32)[None]
        albedo, glass, lit = self._facade(along, z, span, wall_top, soft, side)
        ambient = 0.5 * light.sky_colour + 0.09 * (light.sun_colour * max(light.sun[2], 0) + light.sky_colour)
        sunny = np.clip(normals @ light.sun, 0, 1)[None, :, None]
        shade = np.clip(0.75 + 0.25 * z / 4, 0.55, 1)[..., None]  # a street is darker down at its foot
        radiance = albedo / np.pi * (sunny * light.sun_colour + shade * ambient)
        if glass.any():
            radiance = radiance + glass[..., None] * (
                self._mirror(canvas, columns, rows, normals, along, z) - radiance
            )
        radiance += (lit * self.glow)[..., None] * np.array([1.0, 0.72, 0.40])
        # The roof, where the ray passes over the wall.
        over = z > wall_top
        if over.any():
            ob, db, k = self._slope
            db, k = db[index[0].astype(int)][None], k[index[0].astype(int)][None]
            if self.rise:
                t = (self.height + self.rise - k * ob - eye) / np.where(
                    np.abs(tangent + k * db) < 1e-6, 1e-6, tangent + k * db
                )
                up = np.array([0, 0, 1.0]) * self.depth / 2
                sign = np.sign(k)[0][:, None]
                normal = (np.array([-s, c, 0])[None] * sign * self.rise + up) / np.hypot(
                    self.rise, self.depth / 2
                )
            else:
                t = (self.height - eye) / np.where(np.abs(tangent) < 1e-6, 1e-6, tangent)
                normal = np.tile([0, 0, 1.0], (len(columns), 1))
            t = np.clip(t, near, far)
            roof_z = eye + t * tangent
            roof = self._roof(roof_z, along, near * canvas.pixel)
            direct = np.clip(normal @ light.sun, 0, 1)[None, :, None]
            cover = roof / np.pi * (direct * light.sun_colour + 0.9 * light.sky_colour)
            edge = np.clip((z - wall_top) / soft, 0, 1)[..., None]
            radiance = radiance + edge * (cover - radiance)
        return radiance

    def _roof(self, z, along, soft):
        roof = np.asarray(self.facade.roof, np.float32)
        if self.snow:
            roof = roof + self.snow * (np.array([0.78, 0.8, 0.84], np.float32) - roof)
        tile = fbm_tile(1024, 1.2, 160)
        rough = look(tile, (along + 0 * z).astype(np.float32), (z * 2.0).astype(np.float32), 9.0)
        course = (
            np.sin(z * (2 * np.pi / 0.19))
            * np.clip(1 - soft / 0.08, 0, 1)
            * (self.rise > 0)
            * (1 - self.snow)
        )
        return roof * np.exp(0.13 * rough + 0.18 * course)[..., None]

    def _facade(self, along, z, span, top, soft, side):
        """Albedo (h, w, 3), glass 0..1 (h, w) and lit windows 0..1 (h, w)."""
        f = self.facade
        s = along + 0 * z
        tile = fbm_tile(1024, 1.3, 161)
        phase = 17.0 * self.seed + 31.0 * side[None]
        grime = look(tile, (s + phase).astype(np.float32), z.astype(np.float32), 23.0)
        streak = look(tile, (s * 3 + phase).astype(np.float32), (z * 0.25).astype(np.float32), 19.0)
        tone = 0.07 * grime + 0.05 * streak
        if f.bands == "hedge":
            leaves = look(
                fbm_tile(1024, 0.35, 162), (s + phase).astype(np.float32), z.astype(np.float32), 4.0
            )
            tone = 0.55 * leaves + 0.25 * grime
        elif f.bands == "brick":
            course = np.floor(z / 0.075)
            joint = np.maximum(
                _line(z, 0.075, 0.012, soft), _line(s + (course % 2) * 0.12, 0.24, 0.012, soft)
            )
            which = np.sin(np.floor((s + (course % 2) * 0.12) / 0.24) * 12.99 + course * 78.2) * 43758.5
            tone = (
                tone + 0.35 * (which - np.floor(which) - 0.5) * np.clip(1.2 - soft / 0.1, 0, 1) + 0.5 * joint
            )
        elif f.bands == "ribs":
            tone = tone + 0.16 * np.sin(s * (2 * np.pi / 0.3)) * np.clip(1 - soft / 0.14, 0, 1)
        elif f.bands == "panel":
            joint = np.maximum(_line(s, f.pitch[0], 0.04, soft), _line(z, f.pitch[1], 0.04, soft))
            tone = tone - 0.35 * joint
        albedo = np.asarray(f.wall, np.float32) * np.exp(tone)[..., None]
        low = smooth(f.plinth + 0.03, f.plinth - 0.03, z) * (f.plinth > 0)
        albedo = albedo * (1 - 0.45 * low)[..., None]
        cornice = np.clip((0.35 - np.abs(top - 0.2 - z)) / soft, 0, 1) * (
            f.bands not in ("hedge", "ribs", "open")
        )
        albedo = (
            albedo
            * (
                1
                + 0.18 * cornice
                - 0.35 * np.clip((0.12 - np.abs(top - 0.62 - z)) / soft, 0, 1) * (cornice < 1)
            )[..., None]
        )
        nothing = np.zeros_like(z)
        if f.window[0] <= 0:
            return albedo, nothing, nothing
        count = np.maximum(1, np.floor((span - 0.8) / f.pitch[0]))
        margin = (span - count * f.pitch[0]) / 2
        column = (s - margin) / f.pitch[0]
        storey = (z - 0.15) / f.pitch[1]
        du = (column - np.floor(column) - 0.5) * f.pitch[0]
        dv = (storey - np.floor(storey)) * f.pitch[1] - f.sill - f.window[1] / 2
        inside = (
            (column > 0)
            & (column < count)
            & (np.floor(storey) >= 0)
            & ((np.floor(storey) + 1) * f.pitch[1] <= top - 0.25 + 0.05 * (f.bands == "open"))
        )
        hole = (
            np.clip((f.window[0] / 2 - np.abs(du)) / soft + 0.5, 0, 1)
            * np.clip((f.window[1] / 2 - np.abs(dv)) / soft + 0.5, 0, 1)
            * inside
        )
        fade = np.clip(1.5 - soft / (0.5 * f.pitch[0]), 0, 1)
        hole = hole * fade + (1 - fade) * 0.3 * inside
        pane = np.clip((f.window[0] / 2 - f.frame - np.abs(du)) / soft + 0.5, 0, 1) * np.clip(
            (f.window[1] / 2 - f.frame - np.abs(dv)) / soft + 0.5, 0, 1
        )
        if f.frame and f.bands != "":
            pane = pane * (1 - np.clip((f.frame / 2 - np.abs(du)) / soft + 0.5, 0, 1) * (f.window[0] > 0.9))
        seed = self.seed * 7.3 + side[None] * 3.1
        random = np.sin(np.floor(column) * 127.1 + np.floor(storey) * 311.7 + seed) * 43758.5453
        random = random - np.floor(random)
        # The reveal throws a shadow from above; rooms are dark, some behind a curtain.
        reveal = 1 - 0.5 * np.clip((dv - f.window[1] / 2 + 0.22) / 0.1, 0, 1)
        if f.bands == "open":
            depth = 0.035 + 0.10 * np.clip(0.5 - dv / f.window[1], 0, 1) * (0.5 + random)
            room = depth[..., None] * np.array([1.0, 0.97, 0.92])
        else:
            curtain = (random > 0.62) * smooth(-0.5, 0.3, dv / f.window[1] + (random - 0.8) * 3)
            room = (0.025 + 0.28 * curtain * (random > 0.62))[..., None] * np.array([1.0, 0.98, 0.93])
        rim = (
            np.array([0.55, 0.54, 0.52])
            if sum(f.wall) < 1.2 and f.bands == "brick" or f.bands == "plaster"
            else np.asarray(f.wall) * 0.55
        )
        rim = rim if f.bands != "open" else np.asarray(f.wall)
        opening = rim + pane[..., None] * (room - rim)
        albedo = albedo + hole[..., None] * (opening * reveal[..., None] - albedo)
        lit = hole * pane * (np.modf(random * 7.77)[0] < f.lit) * (0.35 + 0.65 * np.modf(random * 3.3)[0])
        return albedo, hole * pane * f.glass * (f.bands != "open"), lit

    def _mirror(self, canvas, columns, rows, normals, along, z):
        """What the panes reflect: the picture so far, at the mirrored azimuth; every pane is set a little askew."""
        f = self.facade
        phi = (0.5 - (columns + 0.5) / canvas.width) * 2 * np.pi
        wall = np.arctan2(normals[:, 1], normals[:, 0])
        mirrored = (2 * wall - phi + np.pi)[None]
        pane = (
            np.sin(np.floor(along / f.pitch[0]) * 91.7 + np.floor(z / f.pitch[1]) * 57.3 + self.seed)
            * 1758.5453
        )
        pane = pane - np.floor(pane) - 0.5
        theta = np.abs(canvas.theta[rows][:, None]) + 0.02 + 0.035 * pane
        u = (canvas.column(mirrored + 0.05 * pane) % canvas.width).astype(np.float32)
        v = np.clip(canvas.row(theta), 0, canvas.height // 2 - 1).astype(np.float32)
        seen = cv2.remap(
            canvas.image[: canvas.height // 2], u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        return np.minimum(seen, 6 * max(float(np.median(seen)), 1e-3)) * np.array(
            [0.80, 0.86, 0.88], np.float32
        )


def _line(x, pitch, width, soft):
    gap = np.abs((x + pitch / 2) % pitch - pitch / 2)
    return np.clip((width / 2 - gap) / soft + 0.5, 0, 1) * np.clip(1.4 - soft / pitch, width / pitch, 1)
