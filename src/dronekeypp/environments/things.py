"""Things that stand on the ground, at their true size and distance.

Plants, lines (poles, wires, fences) and small meshes (cars, boats) are here; buildings have a module of their
own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.plants import Model
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight
from dronekeypp.environments.specs import SNOW, Colour

_OVERSAMPLING = 4  # meshes are drawn this many times larger, for smooth edges


class Thing(Protocol):
    """What the scene needs of everything that stands on the ground.

    Attributes:
        afloat: whether it lies on water.
    """

    afloat: bool

    @property
    def distance(self) -> float:
        """Metres from the camera. Far things are painted first."""
        ...

    def cast(self, shadows: Shadows) -> None:
        """Draw the thing's shadow."""
        ...

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        """Paint the thing."""
        ...


def _view_axes(azimuth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return two level unit vectors (3,) at an azimuth: to the right in the picture, and to the camera."""
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    viewer = np.array([-np.cos(azimuth), -np.sin(azimuth), 0])
    return right, viewer


@dataclass
class Plant:
    """One plant.

    Attributes:
        model: its picture.
        x, y, ground: its foot, metres.
        height: metres.
        colour: (3,) albedo of its leaves.
        mirrored: whether left and right are swapped.
        snow: share of white on what looks up.
    """

    model: Model
    x: float
    y: float
    height: float
    colour: np.ndarray
    ground: float = 0.0
    mirrored: bool = False
    snow: float = 0.0
    afloat: bool = False

    @property
    def distance(self) -> float:
        return float(np.hypot(self.x, self.y))

    def cast(self, shadows: Shadows) -> None:
        if shadows.sun[2] > 0.02 and self.height > 0.25:
            _, matter = self.model.levels[min(2, len(self.model.levels) - 1)]
            shadows.stamp(np.ascontiguousarray(matter[..., 2]), self.x, self.y, self.height)

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        distance = max(self.distance, 0.3)
        azimuth = np.arctan2(self.y, self.x)
        bottom = np.arctan((self.ground - canvas.eye) / distance)
        top = np.arctan((self.ground + self.height - canvas.eye) / distance)
        rows = int(round((top - bottom) / canvas.pixel))
        width = int(round(rows * self.model.aspect))
        if rows < 2 or width < 2:
            return
        normal, openness, leaf, tone, alpha = self.model.sized(rows, width, self.mirrored)
        radiance = self._radiance(light, azimuth, normal, openness, leaf, tone)
        first = int(round(canvas.row(top) + 0.5))
        left = int(round(canvas.column(azimuth) + 0.5 - width / 2))
        columns = left + np.arange(width)
        canvas.paste(canvas.haze(radiance, distance, columns).astype(np.float32), alpha, first, columns)

    def _radiance(
        self,
        light: Daylight,
        azimuth: float,
        normal: np.ndarray,
        openness: np.ndarray,
        leaf: np.ndarray,
        tone: np.ndarray,
    ) -> np.ndarray:
        """Light the picture. The arrays are those of `Model.sized`; returns (h, w, 3) float32."""
        right, viewer = _view_axes(azimuth)
        sun = np.array([light.sun @ right, light.sun @ viewer, light.sun[2]], np.float32)
        facing = normal @ sun
        up = normal[..., 2:]
        sky = openness[..., None]
        # Sun through the leaf: yellower and weaker than off it.
        through = np.clip(-facing, 0, 1) * leaf * 0.75
        front = np.clip(facing, 0, 1)
        reach = np.clip(openness * 1.35, 0, 1)[..., None]
        bark = np.asarray(self.model.kind.bark, np.float32)
        albedo = (bark + leaf[..., None] * (self.colour.astype(np.float32) - bark)) * tone[..., None]
        if self.snow:
            white = np.clip((up - 0.15) * 3, 0, 1) * np.clip(sky * 2 - 0.5, 0, 1) * self.snow
            albedo = albedo + white * (np.array(SNOW, np.float32) - albedo)
        shine = np.array([1.15, 1.1, 0.55], np.float32)
        radiance = albedo * reach * (front[..., None] + through[..., None] * shine) * light.sun_colour
        radiance += albedo * (0.10 + 0.75 * sky) * (0.72 + 0.28 * up) * light.sky_colour
        # Sunlight off the ground.
        radiance += albedo * 0.05 * np.clip(1 - up, 0, 2) * light.sun_colour * max(light.sun[2], 0)
        gloss = 0.012 * leaf[..., None] * reach * np.clip(up, 0, 1) * light.sky_colour
        return (radiance / np.pi + gloss).astype(np.float32)


@dataclass
class Lines:
    """Round bars and wires.

    Attributes:
        ends: (N, 2, 3) metres, both ends of every bar.
        thick: (N,) metres.
        colour: albedo.
        glow: radiance that the bars send out themselves.
        afloat: whether they stand on a boat.
    """

    ends: np.ndarray
    thick: np.ndarray
    colour: Colour = (0.18, 0.18, 0.18)
    glow: Colour = (0.0, 0.0, 0.0)
    afloat: bool = False

    @property
    def distance(self) -> float:
        return float(np.median(np.hypot(self.ends[..., 0], self.ends[..., 1])))

    def cast(self, shadows: Shadows) -> None:
        if shadows.sun[2] < 0.02:
            return
        fall = shadows.stretch()
        side = np.array([-shadows.sun[1], shadows.sun[0]]) / max(float(np.hypot(*shadows.sun[:2])), 1e-6)
        for (a, b), thick in zip(self.ends, self.thick, strict=True):
            if min(np.hypot(a[0], a[1]), np.hypot(b[0], b[1])) > 150 or thick < 0.03:
                continue
            p = a[:2] + fall * max(a[2], 0)
            q = b[:2] + fall * max(b[2], 0)
            half = side * thick / 2
            shadows.polygon(np.stack([p - half, p + half, q + half, q - half]))

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        far_first = np.argsort(-np.hypot(self.ends[..., 0], self.ends[..., 1]).mean(1))
        for i in far_first:
            self._bar(canvas, light, self.ends[i, 0], self.ends[i, 1], float(self.thick[i]))

    def _bar(
        self, canvas: Canvas, light: Daylight, a: np.ndarray, b: np.ndarray, thick: float, depth: int = 0
    ) -> None:
        """Paint the bar from a to b, (3,) metres. depth: how often it was halved already."""
        azimuth = np.arctan2(a[1], a[0])
        turn = (np.arctan2(b[1], b[0]) - azimuth + np.pi) % (2 * np.pi) - np.pi
        middle = (a + b) / 2
        if abs(turn) > 0.12 and depth < 6:  # straight lines bend in this projection: halve until they do not
            self._bar(canvas, light, a, middle, thick, depth + 1)
            self._bar(canvas, light, middle, b, thick, depth + 1)
            return
        distance = np.hypot(*middle[:2])
        if distance < 0.4:
            return
        u0, u1 = canvas.column(azimuth), canvas.column(azimuth + turn)
        v0 = canvas.row(np.arctan2(a[2] - canvas.eye, np.hypot(a[0], a[1])))
        v1 = canvas.row(np.arctan2(b[2] - canvas.eye, np.hypot(b[0], b[1])))
        half = 0.5 * thick / np.hypot(distance, middle[2] - canvas.eye) / canvas.pixel
        pad = half + 2
        columns = np.arange(int(np.floor(min(u0, u1) - pad)), int(np.ceil(max(u0, u1) + pad)) + 1)
        rows = np.arange(int(np.floor(min(v0, v1) - pad)), int(np.ceil(max(v0, v1) + pad)) + 1)
        rows = rows[(rows >= 0) & (rows < canvas.height)]
        if not len(rows) or len(columns) >= canvas.width:
            return
        du, dv = u1 - u0, v1 - v0
        length = max(np.hypot(du, dv), 1e-6)
        x = columns[None] - u0
        y = rows[:, None] - v0
        along = np.clip((x * du + y * dv) / length**2, 0, 1)
        away = np.hypot(x - along * du, y - along * dv)
        if half > 0.5:
            alpha = np.clip(half - away + 0.5, 0, 1)
        else:  # thinner than a pixel
            alpha = np.clip(1 - away, 0, 1) * 2 * half
        across = np.clip((x * -dv + y * du) / length / max(half, 0.5), -1, 1)
        right, viewer = _view_axes(azimuth)
        sideways = right * (-dv / length) + np.array([0, 0, -1]) * (du / length)
        facing = across * (light.sun @ sideways) + np.sqrt(1 - across**2) * (light.sun @ viewer)
        received = np.clip(facing, 0, 1)[..., None] * light.sun_colour
        received = received + 0.7 * light.sky_colour + 0.06 * light.sun_colour
        radiance = np.asarray(self.colour, np.float32) / np.pi * received
        radiance = (radiance + np.asarray(self.glow, np.float32)).astype(np.float32)
        radiance = canvas.haze(radiance, distance, columns).astype(np.float32)
        canvas.paste(radiance, alpha.astype(np.float32), int(rows[0]), columns)


@dataclass
class Mesh:
    """Flat polygons.

    Attributes:
        faces: the polygons, each (N, 3) metres.
        colours: albedo of every polygon.
        gloss: strength of every polygon's mirror, 0 to 1 (glass, car paint).
        afloat: whether it is a boat.
    """

    faces: list[np.ndarray]
    colours: list[Colour]
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
            shadows.polygon(cv2.convexHull(points.astype(np.float32))[:, 0])

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        points = np.concatenate(self.faces)
        middle = np.arctan2(points[:, 1].mean(), points[:, 0].mean())
        azimuth = (np.arctan2(points[:, 1], points[:, 0]) - middle + np.pi) % (2 * np.pi) - np.pi + middle
        elevation = np.arctan2(points[:, 2] - canvas.eye, np.hypot(points[:, 0], points[:, 1]))
        u, v = canvas.column(azimuth), canvas.row(elevation)
        left = int(np.floor(u.min())) - 1
        top = max(0, int(np.floor(v.min())) - 1)
        width = int(np.ceil(u.max())) + 2 - left
        height = min(canvas.height, int(np.ceil(v.max())) + 2) - top
        if not (2 < width < canvas.width // 2 and height > 2):
            return
        pixels = np.stack([(u - left + 0.5) * _OVERSAMPLING, (v - top + 0.5) * _OVERSAMPLING], -1)
        colour = np.zeros((height * _OVERSAMPLING, width * _OVERSAMPLING, 3), np.float32)
        alpha = np.zeros(colour.shape[:2], np.uint8)
        self._fill(colour, alpha, pixels, canvas.eye, light)
        cover = alpha.astype(np.float32) / 255
        colour = cv2.resize(colour * cover[..., None], (width, height), interpolation=cv2.INTER_AREA)
        cover = cv2.resize(cover, (width, height), interpolation=cv2.INTER_AREA)
        columns = left + np.arange(width)
        colour = colour / np.maximum(cover, 1e-3)[..., None]
        canvas.paste(canvas.haze(colour, self.distance, columns).astype(np.float32), cover, top, columns)

    def _fill(
        self, colour: np.ndarray, alpha: np.ndarray, pixels: np.ndarray, eye: float, light: Daylight
    ) -> None:
        """Fill the faces that look at the camera into `colour` (h, w, 3) and `alpha` (h, w), far ones first.

        pixels: (points of all faces, 2) positions in `colour`, in the order of the faces.
        """
        centre = np.concatenate(self.faces).mean(0)
        stops = np.cumsum([len(face) for face in self.faces])
        distances = np.array([np.linalg.norm(face.mean(0)) for face in self.faces])
        for i in np.argsort(-distances, kind="stable"):
            face = self.faces[i]
            normal = np.cross(face[1] - face[0], face[2] - face[0])
            normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
            towards = np.array([0, 0, eye]) - face.mean(0)
            if normal @ (face.mean(0) - centre) < 0:
                normal = -normal
            if normal @ towards < 0 and len(self.faces) > 2:
                continue
            radiance = self._radiance(i, normal, towards / np.linalg.norm(towards), light).tolist()
            polygon = (pixels[stops[i] - len(face) : stops[i]] * 16).astype(np.int32)  # sixteenths of a pixel
            cv2.fillPoly(colour, [polygon], radiance, cv2.LINE_8, 4)
            cv2.fillPoly(alpha, [polygon], 255, cv2.LINE_8, 4)

    def _radiance(self, i: int, normal: np.ndarray, view: np.ndarray, light: Daylight) -> np.ndarray:
        """Return the radiance (3,) of face `i`. normal: (3,) unit. view: (3,) unit, towards the camera."""
        albedo = np.asarray(self.colours[i])
        above = light.sky_colour * (0.5 + 0.5 * normal[2])
        ambient = above + 0.12 * (0.5 - 0.5 * normal[2]) * light.sun_colour
        tone = albedo / np.pi * (max(0.0, float(normal @ light.sun)) * light.sun_colour + ambient)
        bounce = 2 * (normal @ view) * normal - view
        fresnel = self.gloss[i] * (0.08 + 0.7 * (1 - abs(float(normal @ view))) ** 4)
        mirror = light.sky_colour / np.pi * (1.0 if bounce[2] > 0.05 else 0.35)
        spark = max(0.0, float(bounce @ light.sun)) ** 80 * light.sun_colour * 0.6 * self.gloss[i]
        return tone * (1 - fresnel) + fresnel * mirror + spark
