"""Seeded, tileable noise, and fast lookups into it. Everything the procedural environments call "texture" starts
here.
"""

from __future__ import annotations

from collections import OrderedDict
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial import cKDTree


@lru_cache(maxsize=20)
def fbm_tile(
    size: int = 1024, slope: float = 1.8, seed: int = 0, low: float = 1.0, high: float = 1e9
) -> np.ndarray:
    """A (size, size) float32 tile of fractal noise: mean 0, deviation 1, seamless.

    slope: amplitude falls as frequency ** -slope. low, high: band in cycles a tile; a narrow band is one octave.
    """
    rng = np.random.default_rng((seed, size, 7))
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    fy, fx = np.fft.fftfreq(size, 1 / size)[:, None], np.fft.rfftfreq(size, 1 / size)[None]
    frequency = np.hypot(fx, fy)
    gain = np.where((frequency >= low) & (frequency <= high), np.maximum(frequency, 1e-6) ** -slope, 0)
    tile = np.fft.irfft2(spectrum * gain, (size, size))
    tile -= tile.mean()
    return (tile / tile.std()).astype(np.float32)


@lru_cache(maxsize=10)
def cell_tile(
    size: int = 1024, cells: int = 60, seed: int = 0, jitter: float = 0.9
) -> tuple[np.ndarray, np.ndarray]:
    """Voronoi cells, seamless: (how far inside its cell, a random shade a cell), both mean 0, deviation 1."""
    rng = np.random.default_rng((seed, cells, 11))
    grid = np.stack(np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"), -1).reshape(-1, 2)
    points = (grid + 0.5 + jitter * (rng.random(grid.shape) - 0.5)) % cells
    where = (
        (np.stack(np.meshgrid(np.arange(size), np.arange(size), indexing="ij"), -1).reshape(-1, 2) + 0.5)
        * cells
        / size
    )
    distance, index = cKDTree(points, boxsize=cells).query(where, k=2)
    inside = np.minimum(distance[:, 1] - distance[:, 0], 0.35)
    shade = rng.random(len(points))[index[:, 0]]
    return tuple(((t - t.mean()) / t.std()).reshape(size, size).astype(np.float32) for t in (inside, shade))


@lru_cache(maxsize=2)
def blade_tile(size: int = 2048, blades: int = 60000, length: float = 0.02, seed: int = 0) -> np.ndarray:
    """Grass seen from above: strokes of random direction and shade, later ones on top. (size, size) float32, mean 0,
    deviation 1, seamless.
    """
    rng = np.random.default_rng((seed, blades, 13))
    tile = np.full((size, size), 40, np.uint8)
    start = rng.random((blades, 2)) * size
    angle, reach = rng.random(blades) * 2 * np.pi, length * size * rng.uniform(0.3, 1.0, blades)
    end = start + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    # Brighter strokes come later: they stand higher and catch the light, what lies below is in their shade.
    shade = np.clip(np.linspace(50, 190, blades) + rng.normal(0, 30, blades), 0, 255)
    thick = 1 + (rng.random(blades) < 0.35)
    for a, b, s, w in zip((start * 8).astype(int), (end * 8).astype(int), shade, thick, strict=True):
        cv2.line(tile, a.tolist(), b.tolist(), float(s), int(w), cv2.LINE_AA, 3)
        wrapped = (
            [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]
            if (b.min() < 0 or b.max() >= size * 8)
            else []
        )
        for dx, dy in wrapped:
            shift = np.array([dx, dy]) * size * 8
            cv2.line(tile, (a + shift).tolist(), (b + shift).tolist(), float(s), int(w), cv2.LINE_AA, 3)
    tile = tile.astype(np.float32)
    return (tile - tile.mean()) / tile.std()


_PYRAMIDS: OrderedDict[int, list[np.ndarray]] = OrderedDict()


def _reduced(tile: np.ndarray, level: int) -> np.ndarray:
    """The tile halved `level` times; the last few tiles' reductions are kept."""
    pyramid = _PYRAMIDS.get(id(tile))
    if pyramid is None or pyramid[0] is not tile:
        pyramid = _PYRAMIDS[id(tile)] = [tile]
        if len(_PYRAMIDS) > 16:
            _PYRAMIDS.popitem(last=False)
    while len(pyramid) <= level:
        pyramid.append(cv2.resize(pyramid[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    return pyramid[level]


def look(tile: np.ndarray, x: np.ndarray, y: np.ndarray, period: float, level: int = 0) -> np.ndarray:
    """The tile, repeated every `period` metres, at ground positions x, y (2-D float32 arrays). level: halvings,
    against aliasing.
    """
    if level:
        tile = _reduced(tile, level)
    size = tile.shape[0]
    u, v = x * np.float32(1 / period), y * np.float32(1 / period)
    u -= np.floor(u)
    v -= np.floor(v)
    u *= size
    v *= size
    # Own modulo above: cv2.remap keeps whole pixels in 16 bits.
    return cv2.remap(
        tile, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
    )


def look_fading(
    tile: np.ndarray, x: np.ndarray, y: np.ndarray, period: float, footprint: np.ndarray
) -> np.ndarray:
    """As `look`, but each row picks the halving that fits its pixels' footprint (metres, one a row), so that nothing
    aliases or shimmers.

    Past the coarsest level the texture fades into its mean, 0.
    """
    levels = np.log2(np.maximum(footprint * tile.shape[0] / period, 1e-3))
    top = int(np.log2(tile.shape[0])) - 3
    lower = np.clip(np.floor(levels), 0, top).astype(int)
    out = np.zeros(x.shape, np.float32)
    for level in np.unique(lower):
        rows = np.flatnonzero(lower == level)
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            band = slice(part[0], part[-1] + 1)
            fine = look(tile, x[band], y[band], period, int(level))
            if level < top:
                blend = np.clip(levels[band] - level, 0, 1).astype(np.float32)[:, None]
                fine += blend * (look(tile, x[band], y[band], period, int(level) + 1) - fine)
            else:
                fine *= np.clip(1 - (levels[band] - top) / 2, 0, 1).astype(np.float32)[:, None]
            out[band] = fine
    return out


def smooth(low: float, high: float, x: np.ndarray) -> np.ndarray:
    """Smoothstep from 0 at `low` to 1 at `high` (low > high falls instead)."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
