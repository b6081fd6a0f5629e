"""Seeded, seamless noise and fast lookups into it. Every texture of the environments starts here."""

from __future__ import annotations

from collections import OrderedDict
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial import cKDTree

_NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
_PYRAMIDS: OrderedDict[int, list[np.ndarray]] = OrderedDict()  # id of a tile: the tile and its halvings


@lru_cache(maxsize=20)
def fbm_tile(
    size: int = 1024, slope: float = 1.8, seed: int = 0, low: float = 1.0, high: float = 1e9
) -> np.ndarray:
    """Make a seamless tile of fractal noise.

    Args:
        size: pixels of a side.
        slope: the amplitude falls as frequency ** -slope.
        seed: another seed gives another tile.
        low, high: the band of frequencies in cycles per tile. A narrow band is one octave.

    Returns:
        (size, size) float32 with mean 0 and standard deviation 1.
    """
    rng = np.random.default_rng((seed, size, 7))
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    fy = np.fft.fftfreq(size, 1 / size)[:, None]
    fx = np.fft.rfftfreq(size, 1 / size)[None]
    frequency = np.hypot(fx, fy)
    gain = np.where((frequency >= low) & (frequency <= high), np.maximum(frequency, 1e-6) ** -slope, 0)
    tile = np.fft.irfft2(spectrum * gain, (size, size))
    tile -= tile.mean()
    return (tile / tile.std()).astype(np.float32)


@lru_cache(maxsize=10)
def cell_tile(
    size: int = 1024, cells: int = 60, seed: int = 0, jitter: float = 0.9
) -> tuple[np.ndarray, np.ndarray]:
    """Make a seamless tile of Voronoi cells.

    Args:
        size: pixels of a side.
        cells: cells along a side.
        seed: another seed gives another tile.
        jitter: how far a cell's centre may leave its place on a square grid, in cells.

    Returns:
        Two (size, size) float32 tiles with mean 0 and standard deviation 1: how far a pixel lies inside its
        cell, and a random shade per cell.
    """
    rng = np.random.default_rng((seed, cells, 11))
    grid = _grid(cells)
    points = (grid + 0.5 + jitter * (rng.random(grid.shape) - 0.5)) % cells
    pixels = (_grid(size) + 0.5) * cells / size
    distance, index = cKDTree(points, boxsize=cells).query(pixels, k=2)
    inside = np.minimum(distance[:, 1] - distance[:, 0], 0.35)
    shade = rng.random(len(points))[index[:, 0]]
    return _standardised(inside, size), _standardised(shade, size)


def _grid(size: int) -> np.ndarray:
    """Return the (size * size, 2) whole positions of a square grid, row by row."""
    rows, columns = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    return np.stack([rows, columns], -1).reshape(-1, 2)


def _standardised(values: np.ndarray, size: int) -> np.ndarray:
    """Shift and scale (size * size,) values to mean 0 and deviation 1; return a (size, size) float32 tile."""
    return ((values - values.mean()) / values.std()).reshape(size, size).astype(np.float32)


@lru_cache(maxsize=2)
def blade_tile(size: int = 2048, blades: int = 60000, length: float = 0.02, seed: int = 0) -> np.ndarray:
    """Make a seamless tile of grass seen from above: strokes of random direction and shade.

    Args:
        size: pixels of a side.
        blades: number of strokes.
        length: longest stroke, as a share of the tile.
        seed: another seed gives another tile.

    Returns:
        (size, size) float32 with mean 0 and standard deviation 1.
    """
    rng = np.random.default_rng((seed, blades, 13))
    tile = np.full((size, size), 40, np.uint8)
    start = rng.random((blades, 2)) * size
    angle = rng.random(blades) * 2 * np.pi
    reach = length * size * rng.uniform(0.3, 1.0, blades)
    end = start + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    # Brighter strokes come later: they stand higher and catch the light, what lies below is in their shade.
    shade = np.clip(np.linspace(50, 190, blades) + rng.normal(0, 30, blades), 0, 255)
    thickness = 1 + (rng.random(blades) < 0.35)
    # The strokes are drawn in eighths of a pixel (the last argument of cv2.line: 3 bits).
    starts = (start * 8).astype(int)
    ends = (end * 8).astype(int)
    for a, b, s, w in zip(starts, ends, shade, thickness, strict=True):
        cv2.line(tile, a.tolist(), b.tolist(), float(s), int(w), cv2.LINE_AA, 3)
        if b.min() >= 0 and b.max() < size * 8:
            continue
        for neighbour in _NEIGHBOURS:  # a stroke over the edge comes in again on the other side
            shift = np.array(neighbour) * size * 8
            cv2.line(tile, (a + shift).tolist(), (b + shift).tolist(), float(s), int(w), cv2.LINE_AA, 3)
    tile = tile.astype(np.float32)
    return (tile - tile.mean()) / tile.std()


def _reduced(tile: np.ndarray, level: int) -> np.ndarray:
    """Return the tile halved `level` times. The reductions of the last 16 tiles are kept."""
    pyramid = _PYRAMIDS.get(id(tile))
    if pyramid is None or pyramid[0] is not tile:
        pyramid = [tile]
        _PYRAMIDS[id(tile)] = pyramid
        if len(_PYRAMIDS) > 16:
            _PYRAMIDS.popitem(last=False)
    while len(pyramid) <= level:
        pyramid.append(cv2.resize(pyramid[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    return pyramid[level]


def look(tile: np.ndarray, x: np.ndarray, y: np.ndarray, period: float, level: int = 0) -> np.ndarray:
    """Look up a tile that repeats every `period` metres.

    Args:
        tile: (size, size) float32.
        x, y: positions in metres, two-dimensional arrays of one shape.
        period: metres.
        level: how often the tile is halved first, against aliasing.

    Returns:
        Values of the tile in the shape of `x`, float32.
    """
    if level:
        tile = _reduced(tile, level)
    size = tile.shape[0]
    u = x * np.float32(1 / period)
    v = y * np.float32(1 / period)
    # The modulo is taken here because cv2.remap keeps whole pixels in 16 bits.
    u -= np.floor(u)
    v -= np.floor(v)
    u *= size
    v *= size
    u = u.astype(np.float32)
    v = v.astype(np.float32)
    return cv2.remap(tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)


def look_fading(
    tile: np.ndarray, x: np.ndarray, y: np.ndarray, period: float, footprint: np.ndarray
) -> np.ndarray:
    """Look up a tile as `look` does, without aliasing or shimmer.

    Each row picks the halving that fits the size of its pixels. Past the coarsest level the texture fades
    into its mean, 0.

    Args:
        tile: (size, size) float32.
        x, y: (h, w) positions in metres.
        period: metres.
        footprint: (h,) metres that a pixel of each row covers.

    Returns:
        (h, w) float32.
    """
    levels = np.log2(np.maximum(footprint * tile.shape[0] / period, 1e-3))
    top = int(np.log2(tile.shape[0])) - 3
    lower = np.clip(np.floor(levels), 0, top).astype(int)
    values = np.zeros(x.shape, np.float32)
    for level in np.unique(lower):
        rows = np.flatnonzero(lower == level)
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            band = slice(run[0], run[-1] + 1)
            fine = look(tile, x[band], y[band], period, int(level))
            if level < top:
                blend = np.clip(levels[band] - level, 0, 1).astype(np.float32)[:, None]
                fine += blend * (look(tile, x[band], y[band], period, int(level) + 1) - fine)
            else:
                fine *= np.clip(1 - (levels[band] - top) / 2, 0, 1).astype(np.float32)[:, None]
            values[band] = fine
    return values


def smooth(low: float, high: float, x: np.ndarray) -> np.ndarray:
    """Return the smoothstep of x, from 0 at `low` to 1 at `high`. With low > high it falls instead."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
