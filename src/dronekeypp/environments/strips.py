"""Roads, paths and water: where a strip lies on the ground, and its markings."""

from __future__ import annotations

import numpy as np

from dronekeypp.environments.noise import fbm_tile, look, smooth
from dronekeypp.environments.patch import Patch
from dronekeypp.environments.specs import Strip
from dronekeypp.environments.surfaces import SURFACES

_PAINT = np.array([0.62, 0.62, 0.60], np.float32)  # albedo of road markings
_KERB = np.array([0.36, 0.35, 0.335], np.float32)


def strip_position(strip: Strip, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the metres to the left of a strip's middle line, and along it, float32, at positions x, y."""
    c = np.float32(np.cos(np.radians(strip.heading)))
    s = np.float32(np.sin(np.radians(strip.heading)))
    across = (y * c - x * s - np.float32(strip.offset)).astype(np.float32)
    along = (x * c + y * s).astype(np.float32)
    return across, along


def strip_share(strip: Strip, x: np.ndarray, y: np.ndarray, soft: np.ndarray | float = 0.02) -> np.ndarray:
    """Return how much of the positions x, y (h, w) lies in a strip, 0 to 1.

    soft: width of the strip's edge in metres.
    """
    across, along = strip_position(strip, x, y)
    if strip.wobble:
        tile = fbm_tile(1024, 1.9, 120)
        across = across + strip.wobble * 0.5 * look(tile, along, across * 0.3, 40 + 12 * strip.wobble)
    soft = np.maximum(soft, 0.01 + 0.1 * strip.wobble)
    inside = np.clip((strip.width / 2 - np.abs(across)) / soft + 0.5, 0, 1)
    if strip.length < 50e3:  # rounded ends
        bulge = strip.length / 2 - 0.3 * strip.width * (2 * across / strip.width) ** 2
        inside = inside * np.clip((bulge - np.abs(along)) / soft + 0.5, 0, 1)
    return inside


def strip_blocks(strip: Strip, x: float, y: float, margin: float) -> bool:
    """Say whether a point lies on a strip, or within `margin` metres of it.

    A parking lot blocks nothing: what stands on it is placed between the cars.
    """
    across, _ = strip_position(strip, np.array([x]), np.array([y]))
    return bool(abs(across[0]) < strip.width / 2 + margin + 0.5 * strip.wobble and strip.marks != "bays")


def strip_albedo(strip: Strip, patch: Patch) -> np.ndarray:
    """Return the albedo (h, w, 3) of a strip's surface with its markings and kerb."""
    colour = SURFACES[strip.surface](patch)
    across, along = strip_position(strip, patch.x, patch.y)
    soft = np.maximum(patch.footprint[:, None], 0.01)
    if strip.marks:
        worn_out = smooth(0.2, 1.5, patch.noise(9, 1.2, 71))
        worn = np.clip(0.9 + 0.25 * patch.noise(1.3, 0.8, 70) - 0.3 * worn_out, 0, 1)
        paint = _markings(strip, patch, across, along, soft)
        colour = colour + (np.clip(paint, 0, 1) * worn * 0.85)[..., None] * (_PAINT - colour)
    if strip.kerb:
        edge = _bar(np.abs(across) - strip.width / 2, strip.kerb, soft)
        colour = colour + edge[..., None] * (_KERB - colour)
    return colour


def _bar(distance: np.ndarray, half: float, soft: np.ndarray) -> np.ndarray:
    """Return the coverage of a bar, `half` metres to both sides of `distance` = 0."""
    return np.clip((half - np.abs(distance)) / soft + 0.5, 0, 1)


def _markings(
    strip: Strip, patch: Patch, across: np.ndarray, along: np.ndarray, soft: np.ndarray
) -> np.ndarray:
    """Return the coverage (h, w) of the white lines."""
    if strip.marks == "road":
        dashes = np.clip((1.5 - np.abs((along + 4.5) % 9 - 4.5)) / soft + 0.5, 0, 1)
        edges = _bar(np.abs(across) - strip.width / 2 + 0.35, 0.07, soft)
        return _bar(across, 0.07, soft) * dashes + edges
    # A parking lot: lanes of 7 m with bays of 5 m on both sides.
    lane = np.abs((across + 8.5) % 17 - 8.5)
    in_bay = np.clip((lane - 3.5) / soft + 0.5, 0, 1)
    return np.maximum(patch.lines(along, 2.6, 0.12) * in_bay, _bar(lane - 8.5, 0.06, soft))
