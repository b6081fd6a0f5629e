"""This module gives a 360° background in any direction, and the light it throws on a drone.

A panorama is an equirectangular image, twice as wide as high. World axes have z up; the middle column looks
along +x. Pixel (u, v), with pixel centres at +0.5, shows

    azimuth   phi   = (0.5 - u / W) 2 pi      counter-clockwise about z,
    elevation theta = (0.5 - v / H) pi,
    direction = (cos theta cos phi, cos theta sin phi, sin theta).

Sec. IV of the paper turns each of its 22 environments by four quarter turns about z. The argument `turn` does
that everywhere below.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from dronekeypp.errors import InputError

MOST_PIXELS = 200_000_000  # of a panorama: cv2.remap takes no more than 32766 a row
MOST_BYTES = 2**30  # of its file
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_LIGHT_HEIGHT = 256  # the light is estimated on a copy this high: 0.7 degrees a pixel
_LOOKUP_WIDTH = 1024  # samples a row: cv2.remap takes at most 32766
_LOOKUP_ROWS = 8192  # rows of samples that one call of it gets


@dataclass(frozen=True)
class SunLight:
    """Describe the light on a matt surface by a sun, a sky and a ground, in linear RGB.

    The radiance of a surface with the normal n is

        albedo * (sun_colour * max(0, n.direction) + ambient(n)).

    ambient(n) blends `ground_colour` (n points straight down) into `sky_colour` (n points straight up) by
    (1 + n_z) / 2. A radiance of 1 is a white pixel; the power 1/2.2 turns a radiance into a pixel value.

    `direction` is a unit vector (3,) in world axes towards the sun. The colours are (3,) float. `sun_colour`
    is near zero under a covered sky.
    """

    direction: np.ndarray
    sun_colour: np.ndarray
    sky_colour: np.ndarray
    ground_colour: np.ndarray


class Panorama:
    """A panorama is an equirectangular image that can be looked into in any direction.

    Args:
        image: (H, 2H, 3) uint8 RGB.

    Raises:
        InputError: the image has another shape or another type.
    """

    def __init__(self, image: np.ndarray) -> None:
        image = np.asarray(image)
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise InputError(
                "a panorama must be a (H, 2H, 3) uint8 RGB array, "
                f"got {image.dtype} {image.shape}; convert it first"
            )
        height, width = image.shape[:2]
        if height < 8 or width != 2 * height:
            raise InputError(
                "a panorama must be twice as wide as high (equirectangular, 2:1), "
                f"got {width}x{height}; export it as a full 360x180 degree image"
            )
        self.image = np.ascontiguousarray(image)

    @property
    def height(self) -> int:
        """Return the height of the image in pixels."""
        return self.image.shape[0]

    def sample(self, directions: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return the colours seen along world directions, (..., 3) uint8.

        The lookup is bicubic and has no seam.

        Args:
            directions: (..., 3) float in world axes (z up), of any length but zero.
            turn: quarter turns of the environment about z, counter-clockwise.

        Raises:
            InputError: `directions` do not end in 3 components.
        """
        directions = np.asarray(directions, np.float32)
        if directions.shape[-1:] != (3,):
            raise InputError(
                f"directions must end in 3 components, got shape {directions.shape}; pass (..., 3) vectors"
            )
        batch = directions.shape[:-1]
        columns, rows = self._pixels(directions.reshape(-1, 3), turn)
        if len(batch) == 2 and max(batch) < 32767:
            return self._remap(columns.reshape(batch), rows.reshape(batch))
        # cv2.remap wants a small table: fill whole rows, and repeat the samples to fill the last one
        count = len(columns)
        table = (-(-count // _LOOKUP_WIDTH), _LOOKUP_WIDTH)
        columns, rows = np.resize(columns, table), np.resize(rows, table)
        pieces = []
        for start in range(0, len(columns), _LOOKUP_ROWS):
            stop = start + _LOOKUP_ROWS
            pieces.append(self._remap(columns[start:stop], rows[start:stop]))
        return np.concatenate(pieces).reshape(-1, 3)[:count].reshape(*batch, 3)

    def _pixels(self, directions: np.ndarray, turn: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the array positions (columns, rows) of directions (N, 3).

        Pixel centres are at whole numbers.
        """
        height, width = self.image.shape[:2]
        x = np.ascontiguousarray(directions[:, 0])
        y = np.ascontiguousarray(directions[:, 1])
        z = np.ascontiguousarray(directions[:, 2])
        # Not cv2.cartToPolar: it rounds the last few elements of an array differently, and a pixel must not
        # depend on its neighbours.
        rows = np.arctan2(z, np.hypot(x, y))
        columns = np.arctan2(y, x)
        columns *= np.float32(-width / (2 * np.pi))
        columns += np.float32(((turn % 4) / 4 + 0.5) * width - 0.5)  # BORDER_WRAP takes care of the rest
        rows *= np.float32(-height / np.pi)
        rows += np.float32(0.5 * height - 0.5)
        # at a pole the neighbours that the cubic reads must not wrap around to the other pole
        np.clip(rows, 1, height - 2, out=rows)
        return columns, rows

    def _remap(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return cv2.remap(self.image, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)

    def light(self, turn: int = 0) -> SunLight:
        """Return the light of this environment after `turn` quarter turns.

        It is estimated from the pixels alone, so that it also works for any photograph.

        - Direction: the luminance-weighted centroid of the brightest 0.1 % of the upper hemisphere, around
          its peak.
        - Strength: how far the peak stands out of the sky around it. A photograph clips the sun, so the true
          power of the sun is not in the pixels.
        - Colour: a sun that is seen through more air is redder.
        - Ambient: the cosine-weighted means of the upper and of the lower hemisphere.
        """
        base = self._light
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn % 4]
        x, y, z = base.direction
        return SunLight(
            direction=np.array([cosine * x - sine * y, sine * x + cosine * y, z]),
            sun_colour=base.sun_colour,
            sky_colour=base.sky_colour,
            ground_colour=base.ground_colour,
        )

    @cached_property
    def _light(self) -> SunLight:
        """Return the light without any turn."""
        small = cv2.resize(self.image, (2 * _LIGHT_HEIGHT, _LIGHT_HEIGHT), interpolation=cv2.INTER_AREA)
        linear = (small.astype(np.float32) / 255) ** 2.2
        directions, area = _sphere(_LIGHT_HEIGHT)
        half = _LIGHT_HEIGHT // 2
        sky_colour = _cosine_mean(linear[:half], directions[:half, :, 2], area[:half])
        ground_colour = _cosine_mean(linear[half:], -directions[half:, :, 2], area[half:])

        luminance = linear @ _LUMINANCE
        score = _sun_score(luminance)[:half]
        luminance, up, weight = luminance[:half], directions[:half], area[:half]
        bright = _brightest(score, up, weight)
        # a black sky must still have a direction
        gain = luminance.ravel()[bright] * weight.ravel()[bright] + 1e-12
        direction = (up.reshape(-1, 3)[bright] * gain[:, None]).sum(0)
        direction = direction / np.linalg.norm(direction)

        # Strength: the peak against the ring 20 to 50 degrees around it; both are clipped at 1.
        cosine = up @ direction
        ring = (cosine < np.cos(np.radians(20))) & (cosine > np.cos(np.radians(50))) & (up[..., 2] > 0.03)
        around = float(np.average(luminance[ring], weights=weight[ring])) if ring.any() else 1.0
        contrast = np.clip((float(luminance.ravel()[bright].mean()) - around) / 0.5, 0, 1)
        # a grey sky is a covered one, however bright its brightest patch
        blueness = 1 - float(sky_colour[0] / max(sky_colour[2], 1e-6))
        contrast *= np.clip(0.35 + 3 * blueness, 0, 1)
        height_factor = np.clip(0.35 + 1.6 * direction[2], 0.35, 1.0)
        strength = 2.4 * contrast * float(sky_colour @ _LUMINANCE) * height_factor

        air = 1 / (direction[2] + 0.05)  # air mass, roughly
        reddening = np.exp(-np.array([0.06, 0.12, 0.25]) * air * 0.6)
        tint = reddening / (reddening @ _LUMINANCE)
        return SunLight(direction.astype(np.float64), strength * tint, sky_colour, ground_colour)


def load_panorama(path: str | Path) -> Panorama:
    """Read an equirectangular JPEG or PNG.

    Raises:
        InputError: the file, which the message names, is missing, cannot be decoded, or is not 2:1.
    """
    path = Path(path)
    check_size(path)
    data = np.frombuffer(path.read_bytes(), np.uint8)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
    except cv2.error:  # some broken headers raise instead of giving None
        image = None
    if image is None:
        raise InputError(f"{path}: not a readable image; replace the file")
    try:
        return Panorama(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check_size(path: Path) -> None:
    """Check a panorama's file by its header, before memory is asked for.

    Raises:
        InputError: the file, which the message names, is missing, not an image, or too large.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such panorama; give the path of an equirectangular JPEG or PNG")
    try:
        with warnings.catch_warnings(), Image.open(path) as header:
            warnings.simplefilter("ignore")  # Pillow warns of large pictures
            width, height = header.size
    except Image.DecompressionBombError:
        width, height = None, None
    except Exception:  # Pillow raises anything on broken headers
        raise InputError(f"{path}: not a readable image; replace the file") from None
    if width is None or width * height > MOST_PIXELS or path.stat().st_size > MOST_BYTES:
        size = "too many" if width is None else f"{width}x{height}"
        raise InputError(f"{path}: {size} pixels; make it smaller, at most 20000x10000 are read")


def _sphere(height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (H, 2H, 3) of the pixel centres and the solid angle (H, 2H) of each, float32."""
    theta = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    phi = (0.5 - (np.arange(2 * height) + 0.5) / (2 * height)) * 2 * np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    directions = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], -1)
    area = np.cos(theta) * (np.pi / height) ** 2
    return directions.astype(np.float32), area.astype(np.float32)


def _cosine_mean(linear: np.ndarray, cosine: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the mean colour (3,) of an image (H, W, 3), weighted by `cosine` and `area` (H, W)."""
    weight = cosine * area
    return (np.einsum("hwc,hw->c", linear, weight) / weight.sum()).astype(np.float64)


def _sun_score(luminance: np.ndarray) -> np.ndarray:
    """Return how much each pixel of a whole panorama (H, W) looks like the sun.

    A narrow blur is added to wide ones: the sun sits in its glow, while a white wall or the rim of a cloud
    does not. The ground is blurred in with the sky, so that a bright horizon does not count double.
    """
    pad = 64  # columns repeated on both sides, because the image closes around the observer
    wide = cv2.copyMakeBorder(luminance, 0, 0, pad, pad, cv2.BORDER_WRAP)
    score = (
        cv2.GaussianBlur(wide, (0, 0), 1.2)
        + 0.5 * cv2.GaussianBlur(wide, (0, 0), 3)
        + 0.3 * cv2.GaussianBlur(wide, (0, 0), 8)
    )
    return score[:, pad:-pad]


def _brightest(score: np.ndarray, directions: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return flat indices of the pixels with the highest score that cover 0.1 % of the area, best first.

    Only those within 15 degrees of the best one count.
    """
    order = np.argsort(score, axis=None)[::-1]
    covered = np.cumsum(area.ravel()[order])
    bright = order[: max(1, int(np.searchsorted(covered, 1e-3 * covered[-1])))]
    peak = directions.reshape(-1, 3)[bright[0]]
    near = directions.reshape(-1, 3)[bright] @ peak > np.cos(np.radians(15))
    return bright[near]
