"""Things that stand on the ground: plants, lines (poles, wires, fences) and small meshes (cars, boats). All at true
size and distance.

Every thing has `distance` (metres, for painting far ones first), `cast(shadows)` and `paint(canvas, light)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.plants import Model
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight


@dataclass
class Plant:
    """One plant. x, y, ground: its foot in metres; height: metres. colour: (3,) albedo of its leaves; snow: share of
    white on what looks up.
    """

    model: Model
    x: float
    y: float
    height: float
    colour: np.ndarray
    ground: float = 0.0
    mirrored: bool = False
    snow: float = 0.0

    @property
    def distance(self) -> float:
        return float(np.hypot(self.x, self.y))

    def cast(self, shadows: Shadows) -> None:
        if shadows.sun[2] > 0.02 and self.height > 0.25:
            alpha = self.model.levels[min(2, len(self.model.levels) - 1)][1][..., 2]
            shadows.stamp(np.ascontiguousarray(alpha), self.x, self.y, self.height)

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        distance = max(self.distance, 0.3)
        azimuth = np.arctan2(self.y, self.x)
        bottom = np.arctan((self.ground - canvas.eye) / distance)
        top = np.arctan((self.ground + self.height - canvas.eye) / distance)
        rows = int(round((top - bottom) / canvas.pixel))
        columns = int(round(rows * self.model.aspect))
        if rows < 2 or columns < 2:
            return
        normal, openness, leaf, tone, alpha = self.model.sized(rows, columns, self.mirrored)
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
        viewer = np.array([-np.cos(azimuth), -np.sin(azimuth), 0])
        sun = np.array([light.sun @ right, light.sun @ viewer, light.sun[2]], np.float32)
        facing = normal @ sun
        # Sun through the leaf: yellower and weaker than off it.
        through = np.clip(-facing, 0, 1) * leaf * 0.75
        front = np.clip(facing, 0, 1)
        reach = np.clip(openness * 1.35, 0, 1)[..., None]
        bark = np.asarray(self.model.kind.bark, np.float32)
        albedo = (bark + leaf[..., None] * (self.colour.astype(np.float32) - bark)) * tone[..., None]
        if self.snow:
            white = (
                np.clip((normal[..., 2:] - 0.15) * 3, 0, 1)
                * np.clip(openness[..., None] * 2 - 0.5, 0, 1)
                * self.snow
            )
            albedo = albedo + white * (np.array([0.78, 0.8, 0.84], np.float32) - albedo)
        shine = np.array([1.15, 1.1, 0.55], np.float32)
        radiance = albedo * reach * (front[..., None] + through[..., None] * shine) * light.sun_colour
        radiance += (
            albedo * (0.10 + 0.75 * openness[..., None]) * (0.72 + 0.28 * normal[..., 2:]) * light.sky_colour
        )
        radiance += (
            albedo * 0.05 * np.clip(1 - normal[..., 2:], 0, 2) * light.sun_colour * max(light.sun[2], 0)
        )  # off the ground
        gloss = 0.012 * leaf[..., None] * reach * np.clip(normal[..., 2:], 0, 1) * light.sky_colour
        radiance = (radiance / np.pi + gloss).astype(np.float32)
        first = int(round(canvas.row(top) + 0.5))
        left = int(round(canvas.column(azimuth) + 0.5 - columns / 2))
        columns = left + np.arange(columns)
        canvas.paste(canvas.haze(radiance, distance, columns).astype(np.float32), alpha, first, columns)


@dataclass
class Lines:
    """Round bars and wires. ends: (N, 2, 3) metres. thick: (N,) metres. colour: (3,) albedo. glow: (3,) radiance it
    sends out itself.
    """

    ends: np.ndarray
    thick: np.ndarray
    colour: tuple[float, float, float] = (0.18, 0.18, 0.18)
    glow: tuple[float, float, float] = (0.0, 0.0, 0.0)
    afloat: bool = False

    @property
    def distance(self) -> float:
        return float(np.median(np.hypot(self.ends[..., 0], self.ends[..., 1])))

    def cast(self, shadows: Shadows) -> None:
        fall = shadows.stretch()
        side = np.array([-shadows.sun[1], shadows.sun[0]]) / max(float(np.hypot(*shadows.sun[:2])), 1e-6)
        if shadows.sun[2] < 0.02:
            return
        for (a, b), thick in zip(self.ends, self.thick, strict=True):
            if min(np.hypot(a[0], a[1]), np.hypot(b[0], b[1])) > 150 or thick < 0.03:
                continue
            p, q = a[:2] + fall * max(a[2], 0), b[:2] + fall * max(b[2], 0)
            wide = side * thick / 2
            shadows.polygon(np.stack([p - wide, p + wide, q + wide, q - wide]))

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        order = np.argsort(-np.hypot(self.ends[..., 0], self.ends[..., 1]).mean(1))
        for i in order:
            self._bar(canvas, light, self.ends[i, 0], self.ends[i, 1], float(self.thick[i]))

    def _bar(
        self, canvas: Canvas, light: Daylight, a: np.ndarray, b: np.ndarray, thick: float, depth: int = 0
    ) -> None:
        azimuths = [np.arctan2(p[1], p[0]) for p in (a, b)]
        turn = (azimuths[1] - azimuths[0] + np.pi) % (2 * np.pi) - np.pi
        if abs(turn) > 0.12 and depth < 6:  # straight lines bend in this projection: halve until they do not
            middle = (a + b) / 2
            self._bar(canvas, light, a, middle, thick, depth + 1)
            self._bar(canvas, light, middle, b, thick, depth + 1)
            return
        distance = np.hypot(*((a + b) / 2)[:2])
        if distance < 0.4:
            return
        u0, u1 = canvas.column(azimuths[0]), canvas.column(azimuths[0] + turn)
        v0, v1 = (canvas.row(np.arctan2(p[2] - canvas.eye, np.hypot(p[0], p[1]))) for p in (a, b))
        half = 0.5 * thick / np.hypot(distance, ((a + b) / 2)[2] - canvas.eye) / canvas.pixel
        pad = half + 2
        columns = np.arange(int(np.floor(min(u0, u1) - pad)), int(np.ceil(max(u0, u1) + pad)) + 1)
        rows = np.arange(int(np.floor(min(v0, v1) - pad)), int(np.ceil(max(v0, v1) + pad)) + 1)
        rows = rows[(rows >= 0) & (rows < canvas.height)]
        if not len(rows) or len(columns) >= canvas.width:
            return
        du, dv = u1 - u0, v1 - v0
        length = max(np.hypot(du, dv), 1e-6)
        x, y = columns[None] - u0, rows[:, None] - v0
        along = np.clip((x * du + y * dv) / length**2, 0, 1)
        away = np.hypot(x - along * du, y - along * dv)
        alpha = np.clip(half - away + 0.5, 0, 1) if half > 0.5 else np.clip(1 - away, 0, 1) * 2 * half
        across = np.clip((x * -dv + y * du) / length / max(half, 0.5), -1, 1)
        azimuth = azimuths[0]
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
        viewer = np.array([-np.cos(azimuth), -np.sin(azimuth), 0])
        sideways = right * (-dv / length) + np.array([0, 0, -1]) * (du / length)
        facing = across * (light.sun @ sideways) + np.sqrt(1 - across**2) * (light.sun @ viewer)
        albedo = np.asarray(self.colour, np.float32)
        radiance = (
            albedo
            / np.pi
            * (
                np.clip(facing, 0, 1)[..., None] * light.sun_colour
                + 0.7 * light.sky_colour
                + 0.06 * light.sun_colour
            )
        )
        radiance = radiance + np.asarray(self.glow, np.float32)
        canvas.paste(
            canvas.haze(radiance.astype(np.float32), distance, columns).astype(np.float32),
            alpha.astype(np.float32),
            int(rows[0]),
            columns,
        )


@dataclass
class Mesh:
    """Flat polygons. faces: list of (N, 3) metres; colours: list of (3,) albedo; gloss: list of mirror strength 0..1
    (glass, car paint).
    """

    faces: list[np.ndarray]
    colours: list[tuple[float, float, float]]
    gloss: list[float]
    afloat: bool = False

    @property
    def distance(self) -> float:
        return float(np.hypot(*np.concatenate(self.faces)[:, :2].mean(0)))

    def cast(self, shadows: Shadows) -> None:
        if shadows.sun[2] < 0.02:
            return
        for face in self.faces:
            points = face[:, :2] + shadows.stretch() * face[:, 2:]
            shadows.polygon(cv2.convexHull(points.astype(np.float32))[:, 0] if points.ndim == 2 else points)

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        points = np.concatenate(self.faces)
        middle = np.arctan2(points[:, 1].mean(), points[:, 0].mean())
        azimuth = (np.arctan2(points[:, 1], points[:, 0]) - middle + np.pi) % (2 * np.pi) - np.pi + middle
        elevation = np.arctan2(points[:, 2] - canvas.eye, np.hypot(points[:, 0], points[:, 1]))
        u, v = canvas.column(azimuth), canvas.row(elevation)
        left, top = int(np.floor(u.min())) - 1, max(0, int(np.floor(v.min())) - 1)
        width, height = int(np.ceil(u.max())) + 2 - left, min(canvas.height, int(np.ceil(v.max())) + 2) - top
        if not (2 < width < canvas.width // 2 and height > 2):
            return
        over = 4
        colour, alpha = (
            np.zeros((height * over, width * over, 3), np.float32),
            np.zeros((height * over, width * over), np.uint8),
        )
        starts = np.cumsum([0] + [len(f) for f in self.faces])
        centre = points.mean(0)
        order = sorted(range(len(self.faces)), key=lambda i: -float(np.linalg.norm(self.faces[i].mean(0))))
        for i in order:
            face = self.faces[i]
            normal = np.cross(face[1] - face[0], face[2] - face[0])
            normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
            towards = np.array([0, 0, canvas.eye]) - face.mean(0)
            if normal @ (face.mean(0) - centre) < 0:
                normal = -normal
            if normal @ towards < 0 and len(self.faces) > 2:
                continue
            view = towards / np.linalg.norm(towards)
            albedo = np.asarray(self.colours[i])
            ambient = (
                light.sky_colour * (0.5 + 0.5 * normal[2]) + 0.12 * (0.5 - 0.5 * normal[2]) * light.sun_colour
            )
            tone = albedo / np.pi * (max(0.0, float(normal @ light.sun)) * light.sun_colour + ambient)
            bounce = 2 * (normal @ view) * normal - view
            fresnel = self.gloss[i] * (0.08 + 0.7 * (1 - abs(float(normal @ view))) ** 4)
            mirror = light.sky_colour / np.pi * (1.0 if bounce[2] > 0.05 else 0.35)
            spark = max(0.0, float(bounce @ light.sun)) ** 80 * light.sun_colour * 0.6 * self.gloss[i]
            s = slice(starts[i], starts[i + 1])
            pixels = np.stack([(u[s] - left + 0.5) * over, (v[s] - top + 0.5) * over], -1)
            value = (tone * (1 - fresnel) + fresnel * mirror + spark).tolist()
            cv2.fillPoly(colour, [(pixels * 16).astype(np.int32)], value, cv2.LINE_8, 4)
            cv2.fillPoly(alpha, [(pixels * 16).astype(np.int32)], 255, cv2.LINE_8, 4)
        cover = alpha.astype(np.float32) / 255
        colour = cv2.resize(colour * cover[..., None], (width, height), interpolation=cv2.INTER_AREA)
        cover = cv2.resize(cover, (width, height), interpolation=cv2.INTER_AREA)
        columns = left + np.arange(width)
        colour = colour / np.maximum(cover, 1e-3)[..., None]
        canvas.paste(canvas.haze(colour, self.distance, columns).astype(np.float32), cover, top, columns)
