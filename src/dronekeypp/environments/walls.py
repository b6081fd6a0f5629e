"""The face of a building: the albedo of its walls, its windows and what they mirror."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dronekeypp.environments.facades import Facade
from dronekeypp.environments.noise import fbm_tile, look, smooth

_CURTAINED = 0.62  # windows with a random number above this one have a curtain


@dataclass
class WallPoints:
    """The points of the walls that a block of h x w pixels shows.

    Attributes:
        along: (1, w) metres along the wall.
        z: (h, w) metres above the foot of the building.
        span: (1, w) length of the wall in metres.
        top: (1, w) height of the wall in metres.
        soft: (1, w) metres that a pixel covers; edges are this soft.
        side: (w,) number of the wall, 0 to 3.
    """

    along: np.ndarray
    z: np.ndarray
    span: np.ndarray
    top: np.ndarray
    soft: np.ndarray
    side: np.ndarray


@dataclass
class Windows:
    """The windows at `WallPoints`, each array (h, w).

    Attributes:
        hole: share of the pixel that is window, with its frame.
        pane: share that is glass.
        height: metres above the middle of the window.
        random: a number from 0 to 1 per window.
    """

    hole: np.ndarray
    pane: np.ndarray
    height: np.ndarray
    random: np.ndarray


def fraction(x: np.ndarray) -> np.ndarray:
    """Return what is left of x above the next lower whole number."""
    return x - np.floor(x)


def wall_appearance(
    facade: Facade, seed: int, points: WallPoints
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the albedo (h, w, 3), the strength of the mirror (h, w) and the light of lit windows (h, w).

    seed: another seed gives other stains and curtains.
    """
    albedo = _wall(facade, seed, points)
    if facade.window[0] <= 0:
        nothing = np.zeros_like(points.z)
        return albedo, nothing, nothing
    windows = _windows(facade, seed, points)
    opening = _opening(facade, windows)
    albedo = albedo + windows.hole[..., None] * (opening - albedo)
    glass = windows.hole * windows.pane
    is_lit = np.modf(windows.random * 7.77)[0] < facade.lit
    lit = glass * is_lit * (0.35 + 0.65 * np.modf(windows.random * 3.3)[0])
    return albedo, glass * facade.glass * (facade.bands != "open"), lit


def _wall(facade: Facade, seed: int, points: WallPoints) -> np.ndarray:
    """Return the albedo (h, w, 3) of the wall without its windows."""
    z, soft = points.z, points.soft
    s = points.along + 0 * z
    tile = fbm_tile(1024, 1.3, 161)
    phase = 17.0 * seed + 31.0 * points.side[None]
    grime = look(tile, (s + phase).astype(np.float32), z.astype(np.float32), 23.0)
    streak = look(tile, (s * 3 + phase).astype(np.float32), (z * 0.25).astype(np.float32), 19.0)
    tone = 0.07 * grime + 0.05 * streak
    if facade.bands == "brick":
        course = np.floor(z / 0.075)
        shifted = s + (course % 2) * 0.12
        joint = np.maximum(_line(z, 0.075, 0.012, soft), _line(shifted, 0.24, 0.012, soft))
        random = fraction(np.sin(np.floor(shifted / 0.24) * 12.99 + course * 78.2) * 43758.5)
        tone = tone + 0.35 * (random - 0.5) * np.clip(1.2 - soft / 0.1, 0, 1) + 0.5 * joint
    elif facade.bands == "ribs":
        tone = tone + 0.16 * np.sin(s * (2 * np.pi / 0.3)) * np.clip(1 - soft / 0.14, 0, 1)
    elif facade.bands == "panel":
        joint = np.maximum(_line(s, facade.pitch[0], 0.04, soft), _line(z, facade.pitch[1], 0.04, soft))
        tone = tone - 0.35 * joint
    albedo = np.asarray(facade.wall, np.float32) * np.exp(tone)[..., None]
    low = smooth(facade.plinth + 0.03, facade.plinth - 0.03, z) * (facade.plinth > 0)
    albedo = albedo * (1 - 0.45 * low)[..., None]
    # A light cornice under the roof, with its shadow below.
    cornice = np.clip((0.35 - np.abs(points.top - 0.2 - z)) / soft, 0, 1) * (
        facade.bands not in ("ribs", "open")
    )
    shadow = 0.35 * np.clip((0.12 - np.abs(points.top - 0.62 - z)) / soft, 0, 1) * (cornice < 1)
    return albedo * (1 + 0.18 * cornice - shadow)[..., None]


def _windows(facade: Facade, seed: int, points: WallPoints) -> Windows:
    """Find the windows: a grid of columns and storeys, centred on the wall."""
    z, soft = points.z, points.soft
    s = points.along + 0 * z
    width, height = facade.window
    pitch, storey_height = facade.pitch
    count = np.maximum(1, np.floor((points.span - 0.8) / pitch))
    margin = (points.span - count * pitch) / 2
    column = (s - margin) / pitch
    storey = (z - 0.15) / storey_height
    du = (column - np.floor(column) - 0.5) * pitch
    dv = (storey - np.floor(storey)) * storey_height - facade.sill - height / 2
    highest = points.top - 0.25 + 0.05 * (facade.bands == "open")
    inside = (column > 0) & (column < count) & (np.floor(storey) >= 0)
    inside = inside & ((np.floor(storey) + 1) * storey_height <= highest)
    hole = _bar(du, width / 2, soft) * _bar(dv, height / 2, soft) * inside
    # Far away the windows melt into an even darkening.
    fade = np.clip(1.5 - soft / (0.5 * pitch), 0, 1)
    hole = hole * fade + (1 - fade) * 0.3 * inside
    pane = _bar(du, width / 2 - facade.frame, soft) * _bar(dv, height / 2 - facade.frame, soft)
    if facade.frame and facade.bands != "":  # a bar down the middle
        pane = pane * (1 - _bar(du, facade.frame / 2, soft) * (width > 0.9))
    phase = seed * 7.3 + points.side[None] * 3.1
    random = fraction(np.sin(np.floor(column) * 127.1 + np.floor(storey) * 311.7 + phase) * 43758.5453)
    return Windows(hole, pane, dv, random)


def _opening(facade: Facade, windows: Windows) -> np.ndarray:
    """Return the albedo (h, w, 3) in the windows: frames, and dark rooms of which some have a curtain."""
    height = facade.window[1]
    above, random = windows.height, windows.random
    # The reveal throws a shadow from above.
    reveal = 1 - 0.5 * np.clip((above - height / 2 + 0.22) / 0.1, 0, 1)
    if facade.bands == "open":
        depth = 0.035 + 0.10 * np.clip(0.5 - above / height, 0, 1) * (0.5 + random)
        room = depth[..., None] * np.array([1.0, 0.97, 0.92])
    else:
        has_curtain = random > _CURTAINED
        curtain = has_curtain * smooth(-0.5, 0.3, above / height + (random - 0.8) * 3)
        room = (0.025 + 0.28 * curtain * has_curtain)[..., None] * np.array([1.0, 0.98, 0.93])
    if facade.bands == "open":
        rim = np.asarray(facade.wall)
    elif facade.bands in ("brick", "plaster"):
        rim = np.array([0.55, 0.54, 0.52])
    else:
        rim = np.asarray(facade.wall) * 0.55
    return (rim + windows.pane[..., None] * (room - rim)) * reveal[..., None]


def _bar(distance: np.ndarray, half: float, soft: np.ndarray) -> np.ndarray:
    """Return the coverage of a bar, `half` metres to both sides of `distance` = 0."""
    return np.clip((half - np.abs(distance)) / soft + 0.5, 0, 1)


def _line(x: np.ndarray, pitch: float, width: float, soft: np.ndarray) -> np.ndarray:
    """Return the coverage of lines every `pitch` metres, `width` metres wide."""
    gap = np.abs((x + pitch / 2) % pitch - pitch / 2)
    return np.clip((width / 2 - gap) / soft + 0.5, 0, 1) * np.clip(1.4 - soft / pitch, width / pitch, 1)
