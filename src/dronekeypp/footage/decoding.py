"""Decode one picture, whatever it is: never more memory than a picture of a camera needs."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, TiffImagePlugin

MOST_PIXELS = 200_000_000  # of a picture: the largest sensors have 150 million
MOST_BYTES = 2**29  # of its file
# Deeper pictures are stretched between these shares of their values; hot and dead pixels lie outside.
DARKEST, BRIGHTEST = 0.1, 99.9  # per cent
HEADER = 2048  # bytes
SEVERAL_PICTURES = ("WEBP", "PNG", "AVIF", "TIFF")  # that Pillow tells the number of
TIFF_KIND, TIFF_REDUCED = 254, 1  # the tag NewSubfileType, and its bit of smaller versions
MOST_PAGES = 1000  # of a TIFF that are looked at
# Width and height of pictures that Pillow does not know: Radiance (.hdr), coloured PFM, and PAM.
TEXT_HEADER = re.compile(
    rb"\A#\?(?:RADIANCE|RGBE)[^\0]*?\n[-+][XY] (\d{1,9}) [-+][XY] (\d{1,9})\n"
    rb"|\AP[Ff7]\s+(?:WIDTH\s+)?(\d{1,9})\s+(?:HEIGHT\s+)?(\d{1,9})\s"
)


def read_picture(path: Path) -> np.ndarray | None:
    """Read an image file as (H, W, 3) uint8 RGB.

    Pictures of more than 8 bits, of thermal cameras for example, are stretched from their darkest to their
    brightest value, since those of 10 to 14 bits would be nearly black otherwise.

    Returns:
        The picture, or None if it is missing, broken, no plain file but a pipe or a device, or too large for
        a picture of a camera.
    """
    try:
        if not path.is_file() or path.stat().st_size > MOST_BYTES:
            return None
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError:
        return None
    if not data.size or _pixels(path, bytes(data[:HEADER])) > MOST_PIXELS:
        return None
    image = _decode(data)
    return None if image is None else cv2.cvtColor(_to_8_bits(image), cv2.COLOR_BGR2RGB)


def count_pictures(path: Path) -> int:
    """Return how many pictures an image file holds: an animated WebP, PNG or AVIF, or a TIFF of many pages.

    It is 1 where nobody can tell. Smaller versions of a picture in the same TIFF do not count, nor do the
    second pictures that phones hide in a JPEG.
    """
    try:
        with warnings.catch_warnings(), Image.open(path) as image:
            warnings.simplefilter("ignore")
            if image.format not in SEVERAL_PICTURES:
                return 1
            if image.format != "TIFF":
                return image.n_frames
            count = 0
            for page in range(min(image.n_frames, MOST_PAGES)):
                image.seek(page)
                kind = image.tag_v2.get(TIFF_KIND, 0)
                count += not kind & TIFF_REDUCED
            return max(count, 1)
    except Exception:  # Pillow raises anything on broken files; reading them says so
        return 1


def _decode(data: np.ndarray) -> np.ndarray | None:
    """Return the picture (H, W, 3) in a file's bytes, BGR with all its bits, or None where it is broken."""
    for flags in (
        cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH,
        cv2.IMREAD_ANYDEPTH,
    ):  # OpenCV has no grey float TIFF
        try:
            image = cv2.imdecode(data, flags)
        except cv2.error:
            continue
        if image is not None:
            return image if image.ndim == 3 else cv2.merge([image] * 3)
    return None


def _pixels(path: Path, header: bytes) -> int:
    """Return how many pixels the header of a picture promises, before anything is decoded.

    It is 0 where nobody can tell; OpenCV's own limit, of a thousand million, holds then.
    """
    known = TEXT_HEADER.search(header)
    if known:
        first, second = (int(digits) for digits in known.groups() if digits)
        return first * second
    try:
        with warnings.catch_warnings(), open(path, "rb") as file:
            warnings.simplefilter("ignore")  # Pillow warns of large pictures, and of tags it does not know
            if header[:4] in (
                b"II*\0",
                b"MM\0*",
            ):  # of a TIFF Pillow opens some depths only, but reads all tags
                tags = TiffImagePlugin.ImageFileDirectory_v2(header[:8])
                file.seek(tags.next)
                tags.load(file)
                return int(tags[TiffImagePlugin.IMAGEWIDTH]) * int(tags[TiffImagePlugin.IMAGELENGTH])
            with Image.open(file) as image:
                return image.width * image.height
    except Image.DecompressionBombError:
        return MOST_PIXELS + 1
    except Exception:  # Pillow raises anything on broken headers; OpenCV may read them
        return 0


def _to_8_bits(image: np.ndarray) -> np.ndarray:
    """Return a picture as uint8, stretched if it has more bits; what is not finite becomes black."""
    if image.dtype == np.uint8:
        return image
    finite = np.isfinite(image)
    if not finite.any():
        return np.zeros(image.shape, np.uint8)
    low, high = np.percentile(image[finite], (DARKEST, BRIGHTEST))
    scaled = (np.where(finite, image, low).astype(np.float64) - low) * (255 / max(high - low, 1e-12))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)
