"""What the ground is made of: the albedo of grass, asphalt, snow and more.

Every surface is a function of a `Patch` that returns (h, w, 3) linear RGB. `SURFACES` lists them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dronekeypp.environments.noise import smooth
from dronekeypp.environments.patch import Patch
from dronekeypp.environments.specs import Colour


def _mix(a: np.ndarray | Colour, b: np.ndarray | Colour | float, share: np.ndarray) -> np.ndarray:
    """Blend colour `a` into colour `b` by `share` (h, w)."""
    a = np.asarray(a, np.float32)
    b = np.asarray(b, np.float32)
    return a + (b - a) * share[..., None].astype(np.float32)


def _tinted(colour: Colour, tone: np.ndarray) -> np.ndarray:
    """Return one colour times `tone` (h, w)."""
    return np.array(colour, np.float32) * tone[..., None]


def _relief(p: Patch, limit: float, period: float, step: float, slope: float, seed: int) -> np.ndarray:
    """Return `Patch.bump` clipped to +- limit."""
    return np.clip(p.bump(period, step, slope, seed), -limit, limit)


def _grass(p: Patch, fresh: Colour, dry: Colour, tall: float = 1.0, share: float = 0.35) -> np.ndarray:
    """Return grass between two colours. tall: depth of the shade between blades. share: how much is dry."""
    patch = p.noise(46, 1.6, 1) + 0.7 * p.noise(310, 1.5, 2)
    clump = p.noise(5.3, 1.0, 3)
    blade = p.blades(2.1, 0.028) + 0.55 * p.blades(0.83, 0.028)
    fine = p.noise(11.0, 0.55, 4)
    dryness = smooth(-1.3, 1.3, patch + 0.5 * clump + 2.4 * (share - 0.5))
    colour = _mix(fresh, dry, dryness)
    tone = np.exp(0.30 * tall * blade + 0.16 * clump + 0.13 * fine + 0.08 * patch)
    return colour * np.clip(tone, 0.15, 3.2)[..., None]


def meadow(p: Patch) -> np.ndarray:
    """Grass with patches of pale flowers."""
    base = _grass(p, (0.042, 0.076, 0.017), (0.090, 0.102, 0.034), 1.15, 0.3)
    border, tone = p.cells(3.7, 60, 3)
    flower = smooth(1.35, 1.6, tone) * smooth(0.9, 1.2, border) * smooth(0.2, 1.2, p.noise(31, 1.5, 9))
    return _mix(base, (0.62, 0.6, 0.42), flower * np.clip(1 - p.footprint[:, None] * 8, 0, 1))


def lawn(p: Patch) -> np.ndarray:
    """Mown grass."""
    return _grass(p, (0.042, 0.080, 0.020), (0.078, 0.10, 0.035), 0.85, 0.25)


def autumn_grass(p: Patch) -> np.ndarray:
    """Grass under fallen leaves."""
    base = _grass(p, (0.058, 0.076, 0.019), (0.155, 0.13, 0.052), 1.0, 0.5)
    border, tone = p.cells(2.3, 60, 5)
    leaf = smooth(0.5, 0.75, border) * smooth(-0.3, 0.9, p.noise(17, 1.3, 6) + 0.35 * tone)
    fallen = _mix((0.30, 0.14, 0.03), (0.42, 0.27, 0.06), smooth(-1, 1, tone))
    fallen = fallen * np.exp(0.25 * p.noise(1.9, 0.8, 7))[..., None]
    return _mix(base, 0, leaf * 0.85) + fallen * (leaf * 0.85)[..., None]


def dry_grass(p: Patch) -> np.ndarray:
    """Yellow grass with bare soil between."""
    base = _grass(p, (0.115, 0.10, 0.04), (0.235, 0.185, 0.092), 1.1, 0.6)
    bare = smooth(0.4, 1.5, p.noise(23, 1.2, 8) + 0.3 * p.noise(3.1, 1.0, 9))
    return _mix(base, 0, bare) + soil(p) * bare[..., None]


def soil(p: Patch) -> np.ndarray:
    """Lumps of bare earth."""
    lump = p.bump(1.7, 0.02, 1.1, 10) * 1.1 + p.bump(7.0, 0.08, 1.2, 11)
    lump = np.clip(lump, -1.6, 1.6)
    tone = np.exp(0.27 * lump + 0.12 * p.noise(13, 1.4, 12) + 0.12 * p.noise(0.9, 0.6, 13))
    return _tinted((0.17, 0.122, 0.080), tone)


def desert(p: Patch) -> np.ndarray:
    """Rippled sand with a few stones."""
    ripple = p.y * 0.8 + p.x * 0.35 + 0.5 * p.noise(9, 1.8, 14) + 2.0 * p.noise(60, 1.9, 15)
    fade = np.clip(1 - p.footprint[:, None] / 0.05, 0, 1)
    wave = np.sin(ripple * (2 * np.pi / 0.16)) * fade * (0.55 + 0.45 * p.noise(4.4, 1.4, 16))
    grain = p.noise(0.7, 0.4, 17)
    dune = _relief(p, 1, 12, 0.15, 1.8, 19)
    tone = np.exp(0.10 * wave + 0.05 * grain + 0.10 * p.noise(37, 1.6, 18) + 0.3 * dune)
    border, shade = p.cells(6.1, 60, 9)
    stone = smooth(0.85, 1.1, border) * smooth(0.9, 1.3, shade) * smooth(0.3, 1.0, p.noise(21, 1.2, 20))
    return _mix(_tinted((0.34, 0.235, 0.145), tone), (0.20, 0.145, 0.11), 0.75 * stone)


def sand(p: Patch) -> np.ndarray:
    """A beach with the dimples of many feet."""
    dimple = _relief(p, 1.5, 2.6, 0.05, 1.25, 21) + 0.8 * _relief(p, 1.5, 0.9, 0.02, 1.2, 22)
    tone = np.exp(0.30 * dimple + 0.03 * p.noise(0.5, 0.3, 23) + 0.06 * p.noise(41, 1.6, 24))
    return _tinted((0.36, 0.305, 0.235), tone)


def snow(p: Patch) -> np.ndarray:
    """Drifted snow with two tracks; dry grass pokes through here and there."""
    drift = _relief(p, 1.2, 9, 0.12, 1.9, 25) + 0.5 * _relief(p, 1.5, 1.6, 0.02, 1.5, 26)
    across = p.x * 0.5 - p.y * 0.87 + 0.9 * p.noise(43, 2.0, 27)
    track = p.lines(across, 29.0, 0.32, 4.0) + p.lines(across, 29.0, 0.32, 5.6)
    steps = track * (0.6 + 0.4 * np.clip(p.noise(0.8, 0.9, 28), -1, 1))
    tone = np.exp(0.17 * drift - 0.20 * steps + 0.015 * p.noise(0.35, 0.3, 29))
    poke = smooth(1.7, 2.6, p.noise(2.7, 0.9, 30) + 0.6 * p.noise(33, 1.5, 31))
    colour = _tinted((0.80, 0.82, 0.86), np.minimum(tone, 1.18))
    return _mix(colour, (0.25, 0.2, 0.12), 0.7 * poke)


def trodden_snow(p: Patch) -> np.ndarray:
    """A path: snow worn down to gravel."""
    worn = smooth(0.1, 1.6, p.noise(5.3, 1.3, 58) + 0.5 * p.noise(0.8, 0.9, 59)) * 0.75
    return _mix(snow(p) * 0.93, gravel(p), worn)


def asphalt(p: Patch) -> np.ndarray:
    """A road surface with cracks, repairs and stains."""
    grain = p.noise(0.42, 0.15, 32)
    border, shade = p.cells(1.1, 120, 11)
    patch = p.noise(19, 1.7, 33)
    crack = smooth(0.10, 0.0, np.abs(p.noise(14, 1.5, 34))) * smooth(0.5, 1.3, p.noise(45, 1.4, 35))
    crack = crack * np.clip(1 - p.footprint[:, None] * 12, 0, 1)
    stain = smooth(1.1, 2.3, p.noise(6.1, 1.4, 36))
    tone = np.exp(0.14 * grain + 0.08 * shade + 0.03 * border + 0.10 * patch - 0.45 * crack - 0.30 * stain)
    return _tinted((0.105, 0.103, 0.101), tone)


def gravel(p: Patch) -> np.ndarray:
    """Stones of two sizes."""
    large_border, large_tone = p.cells(1.9, 60, 13)
    small_border, small_tone = p.cells(0.8, 60, 14)
    is_large = smooth(0.3, 1.2, p.noise(11, 1.1, 37)) > 0.5
    large = 0.16 * large_border + 0.17 * large_tone
    small = 0.16 * small_border + 0.17 * small_tone
    stones = np.where(is_large, large, small) + 0.1 * small_tone
    tone = np.exp(stones + 0.12 * p.noise(29, 1.5, 38) + 0.2 * _relief(p, 1.3, 5.5, 0.06, 1.3, 39))
    return _tinted((0.23, 0.21, 0.185), tone)


def paving(p: Patch) -> np.ndarray:
    """Square slabs of a town square."""
    return _slabs(p, 0.62, 0.62, (0.175, 0.163, 0.15), 0.10)


def plates(p: Patch) -> np.ndarray:
    """Large plates of a flat roof."""
    return _slabs(p, 2.4, 2.4, (0.24, 0.235, 0.225), 0.05)


def _slabs(p: Patch, long: float, short: float, colour: Colour, variety: float) -> np.ndarray:
    """Return slabs of long x short metres, every second course shifted by half. variety: of their shade."""
    a = p.x * np.float32(0.96) + p.y * np.float32(0.28) + 0.21 * long
    b = p.y * np.float32(0.96) - p.x * np.float32(0.28) + 0.43 * short
    course = np.floor(b / short)
    shifted = a + (course % 2) * long / 2
    joint = np.maximum(p.lines(b, short, 0.012), p.lines(shifted, long, 0.012))
    random = np.sin(np.floor(shifted / long) * 127.1 + course * 311.7) * 43758.5453
    shade = (random - np.floor(random) - 0.5) * np.clip(1.3 - 1.2 * p.footprint[:, None] / short, 0, 1)
    stain = smooth(1, 2.4, p.noise(3.7, 1.3, 43))
    tone = 2 * variety * shade + 0.06 * p.noise(0.9, 0.5, 41) + 0.10 * p.noise(12, 1.5, 42) - 0.14 * stain
    return _tinted(colour, np.exp(tone) * (1 - 0.5 * joint))


def concrete(p: Patch) -> np.ndarray:
    """Cast fields with joints every five metres."""
    stain = smooth(0.9, 2.2, p.noise(5, 1.4, 46))
    grain = 0.05 * p.noise(0.6, 0.4, 44) + 0.12 * p.noise(17, 1.6, 45) - 0.2 * stain
    joint = np.maximum(p.lines(p.x, 5.0, 0.02, 1.7), p.lines(p.y, 5.0, 0.02, 2.2))
    return _tinted((0.235, 0.23, 0.22), np.exp(grain) * (1 - 0.45 * joint))


def mud(p: Patch) -> np.ndarray:
    """Earth with the ruts of tyres."""
    rut = p.bump(3.4, 0.04, 1.35, 47) + 0.8 * p.bump(11, 0.12, 1.5, 48)
    rut = np.clip(rut, -1.5, 1.5)
    track = p.lines(p.x * 0.86 + p.y * 0.5 + 0.7 * p.noise(40, 1.9, 49), 11.0, 0.5)
    fade = np.clip(1 - p.footprint[:, None] / 0.04, 0, 1)
    tread = np.sin((p.y * 0.86 - p.x * 0.5) * (2 * np.pi / 0.14)) * fade
    pressed = track * (0.25 + 0.16 * tread)
    tone = np.exp(0.3 * rut + 0.13 * p.noise(0.9, 0.6, 50) - pressed + 0.12 * p.noise(23, 1.5, 51))
    return _tinted((0.175, 0.138, 0.10), tone)


def rock(p: Patch) -> np.ndarray:
    """Broken stone in two greys."""
    border, shade = p.cells(8.3, 30, 15)
    slab = _relief(p, 1.4, 6.5, 0.07, 1.45, 52) + 0.6 * _relief(p, 1.4, 1.2, 0.02, 1.1, 53)
    tone = np.exp(0.36 * slab + 0.12 * shade + 0.14 * np.clip(border, -2, 0.5) + 0.1 * p.noise(0.8, 0.6, 54))
    colour = _mix((0.22, 0.20, 0.172), (0.165, 0.156, 0.143), smooth(-1, 1, p.noise(15, 1.4, 55)))
    return colour * tone[..., None]


def wheat(p: Patch) -> np.ndarray:
    """Ripe grain with the tracks of the tractor."""
    base = _grass(p, (0.26, 0.185, 0.07), (0.34, 0.255, 0.105), 1.0, 0.5)
    across = p.x * 0.94 + p.y * 0.34
    track = p.lines(across, 18.0, 0.5, 3.0) + p.lines(across, 18.0, 0.5, 4.9)
    return base * (1 - 0.5 * np.clip(track, 0, 1))[..., None]


def rows(p: Patch) -> np.ndarray:
    """Bare soil between planted rows, grass under them."""
    strip = p.lines(p.x * 0.42 + p.y * 0.91, 2.4, 1.1, 1.2)
    grass = _grass(p, (0.07, 0.115, 0.03), (0.16, 0.15, 0.06)) * strip[..., None]
    return _mix(soil(p) * 1.1, 0, strip) + grass


def forest_floor(p: Patch) -> np.ndarray:
    """Leaf litter and moss."""
    litter = _mix((0.15, 0.10, 0.055), (0.075, 0.085, 0.03), smooth(-0.7, 1.2, p.noise(9, 1.3, 56)))
    border, tone = p.cells(1.6, 60, 17)
    tone = np.exp(0.22 * tone + 0.12 * border + 0.3 * p.blades(1.2, 0.028) + 0.2 * p.noise(3.1, 1.0, 57))
    return litter * np.clip(tone, 0.2, 3)[..., None]


# Grain that a surface keeps at any distance: the deviation of the logarithm of its albedo. Others have 0.2.
GRAIN: dict[str, float] = {
    "snow": 0.012,
    "trodden_snow": 0.05,
    "asphalt": 0.05,
    "concrete": 0.02,
    "paving": 0.03,
    "plates": 0.02,
    "sand": 0.06,
    "desert": 0.06,
    "rock": 0.1,
    "gravel": 0.1,
}

SURFACES: dict[str, Callable[[Patch], np.ndarray]] = {
    "meadow": meadow,
    "lawn": lawn,
    "autumn_grass": autumn_grass,
    "dry_grass": dry_grass,
    "soil": soil,
    "desert": desert,
    "sand": sand,
    "snow": snow,
    "trodden_snow": trodden_snow,
    "asphalt": asphalt,
    "gravel": gravel,
    "paving": paving,
    "plates": plates,
    "concrete": concrete,
    "mud": mud,
    "rock": rock,
    "wheat": wheat,
    "rows": rows,
    "forest_floor": forest_floor,
}
