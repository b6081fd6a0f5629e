"""Backgrounds: a 360° panorama that can be looked into in any direction, and the light it throws on a drone.

A panorama is an equirectangular 2:1 image. World axes have z up; the middle column looks along +x. Pixel (u, v),
centres at +0.5, shows

    azimuth   phi   = (0.5 - u / W) 2 pi      counter-clockwise about z,
    elevation theta = (0.5 - v / H) pi,
    direction = (cos theta cos phi, cos theta sin phi, sin theta).

Sec. IV of the paper turns each of its 22 environments by four quarter turns about z. `turn` does that everywhere
below.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.errors import InputError

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_LIGHT_HEIGHT = 256  # the light is estimated on a copy this high: 0.7 degrees a pixel
_LOOKUP_WIDTH = 1024  # cv2.remap takes at most 32766 samples a row


@dataclass(frozen=True)
class SunLight:
    """Light for a matte surface: radiance = albedo * (sun_colour * max(0, n.direction) + ambient(n)), linear RGB.

    ambient(n) blends `ground_colour` (n straight down) into `sky_colour` (n straight up) by (1 + n_z) / 2. A radiance
    of 1 is a white pixel; the power 1/2.2 makes a pixel value of it. direction: (3,) unit, world axes, towards the
    sun. Colours: (3,) float. `sun_colour` is near zero under a covered sky.
    """

    direction: np.ndarray
    sun_colour: np.ndarray
    sky_colour: np.ndarray
    ground_colour: np.ndarray


class Panorama:
    """An equirectangular image with lookups. `image`: (H, 2H, 3) uint8 RGB."""

    def __init__(self, image: np.ndarray):
        image = np.asarray(image)
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise InputError(
                f"a panorama must be a (H, 2H, 3) uint8 RGB array, got {image.dtype} {image.shape}; convert it first"
            )
        if image.shape[0] < 8 or image.shape[1] != 2 * image.shape[0]:
            raise InputError(
                f"a panorama must be twice as wide as high (equirectangular, 2:1), got {image.shape[1]}x{image.shape[0]}; "
                "export it as a full 360x180 degree image"
            )
        self.image = np.ascontiguousarray(image)

    @property
    def height(self) -> int:
        return self.image.shape[0]

    def sample(self, directions: np.ndarray, turn: int = 0) -> np.ndarray:
        """Colours seen along world directions, bicubic, seamless across the back seam.

        directions: (..., 3) float, any length but zero, world axes (z up). turn: quarter turns of the environment
        about z, counter-clockwise. Returns (..., 3) uint8.
        """
        directions = np.asarray(directions, np.float32)
        if directions.shape[-1:] != (3,):
            raise InputError(
                f"directions must end in 3 components, got shape {directions.shape}; pass (..., 3) vectors"
            )
        lead = directions.shape[:-1]
        flat = directions.reshape(-1, 3)
        if len(lead) == 2 and max(lead) < 32767:
            columns, rows = self._pixels(flat, turn)
            return self._remap(columns.reshape(lead), rows.reshape(lead))
        count = len(flat)
        columns, rows = (
            np.resize(c, (-(-count // _LOOKUP_WIDTH), _LOOKUP_WIDTH)) for c in self._pixels(flat, turn)
        )
        parts = [self._remap(columns[i : i + 8192], rows[i : i + 8192]) for i in range(0, len(columns), 8192)]
        return np.concatenate(parts).reshape(-1, 3)[:count].reshape(*lead, 3)

    def _pixels(self, flat: np.ndarray, turn: int) -> tuple[np.ndarray, np.ndarray]:
        """Array positions (column, row), pixel centres at whole numbers, of (N, 3) directions."""
        height, width = self.image.shape[:2]
        x, y, z = (np.ascontiguousarray(flat[:, i]) for i in range(3))
        # numpy, not cv2.cartToPolar: that one rounds the last few elements of an array differently, and a pixel must not depend on its neighbours
        elevation = np.arctan2(z, np.hypot(x, y))
        columns = np.arctan2(y, x)
        columns *= np.float32(-width / (2 * np.pi))
        columns += np.float32(((turn % 4) / 4 + 0.5) * width - 0.5)  # BORDER_WRAP takes care of the rest
        rows = elevation
        rows *= np.float32(-height / np.pi)
        rows += np.float32(0.5 * height - 0.5)
        np.clip(
            rows, 1, height - 2, out=rows
        )  # at a pole: the cubic's neighbours must not wrap to the other one
        return columns, rows

    def _remap(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return cv2.remap(self.image, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)

    def light(self, turn: int = 0) -> SunLight:
        """The light of this environment, estimated from its pixels alone, so that it also works for any photograph.

        Direction: luminance-weighted centroid of the brightest 0.1 % of the upper hemisphere, around its peak.
        Strength: how far the peak stands out of the sky around it; a photograph clips the sun, so its true power is
        not in the pixels. Colour: a sun seen through more air is redder. Ambient: cosine-weighted means of the upper
        and of the lower hemisphere.
        """
        base = self._light
        quarter = turn % 4
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter]
        x, y, z = base.direction
        return SunLight(
            np.array([cosine * x - sine * y, sine * x + cosine * y, z]),
            base.sun_colour,
            base.sky_colour,
            base.ground_colour,
        )

    @cached_property
    def _light(self) -> SunLight:
        small = cv2.resize(self.image, (2 * _LIGHT_HEIGHT, _LIGHT_HEIGHT), interpolation=cv2.INTER_AREA)
        linear = (small.astype(np.float32) / 255) ** 2.2
        directions, area = _sphere(_LIGHT_HEIGHT)
        half = _LIGHT_HEIGHT // 2
        sky_colour = _cosine_mean(linear[:half], directions[:half, :, 2], area[:half])
        ground_colour = _cosine_mean(linear[half:], -directions[half:, :, 2], area[half:])

        # A wide blur beside a narrow one: the sun sits in its glow, a white wall or a cloud's rim does not.
        # The ground is blurred in with it, so that a bright horizon does not count double.
        luminance = linear @ _LUMINANCE
        pad = 64
        wide = cv2.copyMakeBorder(luminance, 0, 0, pad, pad, cv2.BORDER_WRAP)
        score = (
            cv2.GaussianBlur(wide, (0, 0), 1.2)
            + 0.5 * cv2.GaussianBlur(wide, (0, 0), 3)
            + 0.3 * cv2.GaussianBlur(wide, (0, 0), 8)
        )
        score, luminance = score[:half, pad:-pad], luminance[:half]
        up, weight = directions[:half], area[:half]
        order = np.argsort(score, axis=None)[::-1]
        covered = np.cumsum(weight.ravel()[order])
        bright = order[: max(1, int(np.searchsorted(covered, 1e-3 * covered[-1])))]
        peak = up.reshape(-1, 3)[bright[0]]
        near = up.reshape(-1, 3)[bright] @ peak > np.cos(np.radians(15))
        bright = bright[near]
        gain = luminance.ravel()[bright] * weight.ravel()[bright] + 1e-12  # a black sky still has a direction
        direction = (up.reshape(-1, 3)[bright] * gain[:, None]).sum(0)
        direction = direction / np.linalg.norm(direction)

        # Strength: peak against the ring 20 to 50 degrees around it; both are clipped at 1.
        cosine = up @ direction
        ring = (cosine < np.cos(np.radians(20))) & (cosine > np.cos(np.radians(50))) & (up[..., 2] > 0.03)
        around = float(np.average(luminance[ring], weights=weight[ring])) if ring.any() else 1.0
        contrast = np.clip((float(luminance.ravel()[bright].mean()) - around) / 0.5, 0, 1)
        blueness = 1 - float(sky_colour[0] / max(sky_colour[2], 1e-6))
        contrast *= np.clip(
            0.35 + 3 * blueness, 0, 1
        )  # a grey sky is a covered one, however bright its brightest patch
        air = 1 / (direction[2] + 0.05)  # air mass, roughly
        reddening = np.exp(-np.array([0.06, 0.12, 0.25]) * air * 0.6)
        tint = reddening / (reddening @ _LUMINANCE)
        strength = (
            2.4 * contrast * float(sky_colour @ _LUMINANCE) * np.clip(0.35 + 1.6 * direction[2], 0.35, 1.0)
        )
        return SunLight(direction.astype(np.float64), strength * tint, sky_colour, ground_colour)


def load_panorama(path: str | Path) -> Panorama:
    """Read an equirectangular JPEG or PNG.

    Raises InputError, naming the file, where it is missing, cannot be decoded, or is not 2:1.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such panorama; give the path of an equirectangular JPEG or PNG")
    data = np.frombuffer(path.read_bytes(), np.uint8)
    image = None
    if len(data):
        try:
            image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        except cv2.error:  # some broken headers raise instead of giving None
            image = None
    if image is None:
        raise InputError(
            f"{path}: not a readable image; replace the file, or remove it from the environments folder"
        )
    try:
        return Panorama(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _sphere(height: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (H, 2H, 3) of the pixel centres and the solid angle (H, 2H) of each, float32."""
    theta = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    phi = (0.5 - (np.arange(2 * height) + 0.5) / (2 * height)) * 2 * np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    directions = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], -1)
    area = np.cos(theta) * (np.pi / height) ** 2
    return directions.astype(np.float32), area.astype(np.float32)


def _cosine_mean(linear: np.ndarray, cosine: np.ndarray, area: np.ndarray) -> np.ndarray:
    weight = cosine * area
    return (np.einsum("hwc,hw->c", linear, weight) / weight.sum()).astype(np.float64)
