"""What the ground is made of: albedo of grass, asphalt, snow ... at ground positions in metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dronekeypp.environments.noise import blade_tile, cell_tile, fbm_tile, look_fading, smooth


@dataclass
class Patch:
    """A band of the ground to colour: x, y (h, w) metres, `footprint` (h,) metres a pixel of each row, `sun` unit
    vector towards it.
    """

    x: np.ndarray
    y: np.ndarray
    footprint: np.ndarray
    sun: np.ndarray
    seed: int

    def noise(self, period: float, slope: float = 1.5, seed: int = 0) -> np.ndarray:
        return look_fading(fbm_tile(1024, slope, 40 + seed), self.x, self.y, period, self.footprint)

    def bump(self, period: float, step: float, slope: float = 1.5, seed: int = 0) -> np.ndarray:
        """Relief in sunlight: positive where the ground falls towards the sun. step: metres between the two heights
        compared.
        """
        tile = fbm_tile(1024, slope, 40 + seed)
        flat = max(float(np.hypot(*self.sun[:2])), 1e-3)
        dx, dy = np.float32(self.sun[0] / flat * step), np.float32(self.sun[1] / flat * step)
        here = look_fading(tile, self.x, self.y, period, self.footprint)
        return here - look_fading(tile, self.x + dx, self.y + dy, period, self.footprint)

    def blades(self, period: float, length: float = 0.02, seed: int = 0) -> np.ndarray:
        return look_fading(blade_tile(2048, 60000, length, seed), self.x, self.y, period, self.footprint)

    def cells(self, period: float, cells: int = 60, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """(how far inside its stone, 0 mean; shade of the stone, 0 mean)."""
        inside, tone = cell_tile(1024, cells, seed)
        return look_fading(inside, self.x, self.y, period, self.footprint), look_fading(
            tone, self.x, self.y, period, self.footprint
        )

    def lines(self, across: np.ndarray, pitch: float, width: float, offset: float = 0.0) -> np.ndarray:
        """Coverage 0..1 of lines every `pitch` metres, `width` wide, softened to the pixel's footprint."""
        soft = np.maximum(self.footprint[:, None], 0.008)
        gap = np.abs((across - offset + pitch / 2) % pitch - pitch / 2)
        line = np.clip((width / 2 - gap) / soft + 0.5, 0, 1)
        return line * np.clip(1.4 - 0.9 * soft / pitch, width / pitch, 1)


def _mix(a, b, t: np.ndarray) -> np.ndarray:
    a, b = np.asarray(a, np.float32), np.asarray(b, np.float32)
    return a + (b - a) * t[..., None].astype(np.float32)


def _grass(p: Patch, fresh, dry, tall: float = 1.0, share: float = 0.35) -> np.ndarray:
    patch = p.noise(46, 1.6, 1) + 0.7 * p.noise(310, 1.5, 2)
    clump = p.noise(5.3, 1.0, 3)
    blade = p.blades(2.1, 0.028) + 0.55 * p.blades(0.83, 0.028)
    fine = p.noise(11.0, 0.55, 4)
    dryness = smooth(-1.3, 1.3, patch + 0.5 * clump + 2.4 * (share - 0.5))
    colour = _mix(fresh, dry, dryness)
    tone = np.exp(0.30 * tall * blade + 0.16 * clump + 0.13 * fine + 0.08 * patch)
    return colour * np.clip(tone, 0.15, 3.2)[..., None]


def meadow(p):
    base = _grass(p, (0.042, 0.076, 0.017), (0.090, 0.102, 0.034), 1.15, 0.3)
    border, tone = p.cells(3.7, 60, 3)
    flower = smooth(1.35, 1.6, tone) * smooth(0.9, 1.2, border) * smooth(0.2, 1.2, p.noise(31, 1.5, 9))
    return _mix(base, (0.62, 0.6, 0.42), flower * np.clip(1 - p.footprint[:, None] * 8, 0, 1))


def lawn(p):
    return _grass(p, (0.042, 0.080, 0.020), (0.078, 0.10, 0.035), 0.85, 0.25)


def autumn_grass(p):
    base = _grass(p, (0.058, 0.076, 0.019), (0.155, 0.13, 0.052), 1.0, 0.5)
    border, tone = p.cells(2.3, 60, 5)
    leaf = smooth(0.5, 0.75, border) * smooth(-0.3, 0.9, p.noise(17, 1.3, 6) + 0.35 * tone)
    fallen = (
        _mix((0.30, 0.14, 0.03), (0.42, 0.27, 0.06), smooth(-1, 1, tone))
        * np.exp(0.25 * p.noise(1.9, 0.8, 7))[..., None]
    )
    return _mix(base, 0, leaf * 0.85) + fallen * (leaf * 0.85)[..., None]


def dry_grass(p):
    base = _grass(p, (0.115, 0.10, 0.04), (0.235, 0.185, 0.092), 1.1, 0.6)
    bare = smooth(0.4, 1.5, p.noise(23, 1.2, 8) + 0.3 * p.noise(3.1, 1.0, 9))
    return _mix(base, 0, bare) + soil(p) * bare[..., None]


def soil(p):
    lump = p.bump(1.7, 0.02, 1.1, 10) * 1.1 + p.bump(7.0, 0.08, 1.2, 11)
    tone = np.exp(
        0.27 * np.clip(lump, -1.6, 1.6) + 0.12 * p.noise(13, 1.4, 12) + 0.12 * p.noise(0.9, 0.6, 13)
    )
    return np.array([0.17, 0.122, 0.080], np.float32) * tone[..., None]


def desert(p):
    ripple = p.y * 0.8 + p.x * 0.35 + 0.5 * p.noise(9, 1.8, 14) + 2.0 * p.noise(60, 1.9, 15)
    fade = np.clip(1 - p.footprint[:, None] / 0.05, 0, 1)
    wave = np.sin(ripple * (2 * np.pi / 0.16)) * fade * (0.55 + 0.45 * p.noise(4.4, 1.4, 16))
    grain = p.noise(0.7, 0.4, 17)
    tone = np.exp(
        0.10 * wave
        + 0.05 * grain
        + 0.10 * p.noise(37, 1.6, 18)
        + 0.3 * np.clip(p.bump(12, 0.15, 1.8, 19), -1, 1)
    )
    border, shade = p.cells(6.1, 60, 9)
    stone = smooth(0.85, 1.1, border) * smooth(0.9, 1.3, shade) * smooth(0.3, 1.0, p.noise(21, 1.2, 20))
    colour = np.array([0.34, 0.235, 0.145], np.float32) * tone[..., None]
    return _mix(colour, (0.20, 0.145, 0.11), 0.75 * stone)


def sand(p):
    dimple = np.clip(p.bump(2.6, 0.05, 1.25, 21), -1.5, 1.5) + 0.8 * np.clip(
        p.bump(0.9, 0.02, 1.2, 22), -1.5, 1.5
    )
    tone = np.exp(0.30 * dimple + 0.03 * p.noise(0.5, 0.3, 23) + 0.06 * p.noise(41, 1.6, 24))
    return np.array([0.36, 0.305, 0.235], np.float32) * tone[..., None]


def snow(p):
    drift = np.clip(p.bump(9, 0.12, 1.9, 25), -1.2, 1.2) + 0.5 * np.clip(
        p.bump(1.6, 0.02, 1.5, 26), -1.5, 1.5
    )
    across = p.x * 0.5 - p.y * 0.87 + 0.9 * p.noise(43, 2.0, 27)
    track = p.lines(across, 29.0, 0.32, 4.0) + p.lines(across, 29.0, 0.32, 5.6)
    steps = track * (0.6 + 0.4 * np.clip(p.noise(0.8, 0.9, 28), -1, 1))
    tone = np.exp(0.17 * drift - 0.20 * steps + 0.015 * p.noise(0.35, 0.3, 29))
    poke = smooth(1.7, 2.6, p.noise(2.7, 0.9, 30) + 0.6 * p.noise(33, 1.5, 31))
    colour = np.array([0.80, 0.82, 0.86], np.float32) * np.minimum(tone, 1.18)[..., None]
    return _mix(colour, (0.25, 0.2, 0.12), 0.7 * poke)


def trodden_snow(p):
    return _mix(
        snow(p) * 0.93,
        gravel(p),
        smooth(0.1, 1.6, p.noise(5.3, 1.3, 58) + 0.5 * p.noise(0.8, 0.9, 59)) * 0.75,
    )


def asphalt(p):
    grain = p.noise(0.42, 0.15, 32)
    border, shade = p.cells(1.1, 120, 11)
    patch = p.noise(19, 1.7, 33)
    crack = (
        smooth(0.10, 0.0, np.abs(p.noise(14, 1.5, 34)))
        * smooth(0.5, 1.3, p.noise(45, 1.4, 35))
        * np.clip(1 - p.footprint[:, None] * 12, 0, 1)
    )
    stain = smooth(1.1, 2.3, p.noise(6.1, 1.4, 36))
    tone = np.exp(0.14 * grain + 0.08 * shade + 0.03 * border + 0.10 * patch - 0.45 * crack - 0.30 * stain)
    return np.array([0.105, 0.103, 0.101], np.float32) * tone[..., None]


def gravel(p):
    b1, t1 = p.cells(1.9, 60, 13)
    b2, t2 = p.cells(0.8, 60, 14)
    big = smooth(0.3, 1.2, p.noise(11, 1.1, 37))
    stones = np.where(big > 0.5, 0.16 * b1 + 0.17 * t1, 0.16 * b2 + 0.17 * t2) + 0.1 * t2
    tone = np.exp(stones + 0.12 * p.noise(29, 1.5, 38) + 0.2 * np.clip(p.bump(5.5, 0.06, 1.3, 39), -1.3, 1.3))
    return np.array([0.23, 0.21, 0.185], np.float32) * tone[..., None]


def paving(p):
    return _slabs(p, 0.62, 0.62, (0.175, 0.163, 0.15), 0.10)


def plates(p):
    return _slabs(p, 2.4, 2.4, (0.24, 0.235, 0.225), 0.05)


def brick_paving(p):
    return _slabs(p, 0.21, 0.11, (0.26, 0.17, 0.13), 0.13)


def _slabs(p: Patch, long: float, short: float, colour, variety: float) -> np.ndarray:
    a, b = (
        p.x * np.float32(0.96) + p.y * np.float32(0.28) + 0.21 * long,
        p.y * np.float32(0.96) - p.x * np.float32(0.28) + 0.43 * short,
    )
    course = np.floor(b / short)
    shifted = a + (course % 2) * long / 2
    joint = np.maximum(p.lines(b, short, 0.012), p.lines(shifted, long, 0.012))
    which = np.sin(np.floor(shifted / long) * 127.1 + course * 311.7) * 43758.5453
    shade = (which - np.floor(which) - 0.5) * np.clip(1.3 - 1.2 * p.footprint[:, None] / short, 0, 1)
    tone = np.exp(
        2 * variety * shade
        + 0.06 * p.noise(0.9, 0.5, 41)
        + 0.10 * p.noise(12, 1.5, 42)
        - 0.14 * smooth(1, 2.4, p.noise(3.7, 1.3, 43))
    )
    return np.asarray(colour, np.float32) * (tone * (1 - 0.5 * joint))[..., None]


def concrete(p):
    grain = (
        0.05 * p.noise(0.6, 0.4, 44)
        + 0.12 * p.noise(17, 1.6, 45)
        - 0.2 * smooth(0.9, 2.2, p.noise(5, 1.4, 46))
    )
    joint = np.maximum(p.lines(p.x, 5.0, 0.02, 1.7), p.lines(p.y, 5.0, 0.02, 2.2))
    return np.array([0.235, 0.23, 0.22], np.float32) * (np.exp(grain) * (1 - 0.45 * joint))[..., None]


def mud(p):
    rut = p.bump(3.4, 0.04, 1.35, 47) + 0.8 * p.bump(11, 0.12, 1.5, 48)
    track = p.lines(p.x * 0.86 + p.y * 0.5 + 0.7 * p.noise(40, 1.9, 49), 11.0, 0.5)
    tread = np.sin((p.y * 0.86 - p.x * 0.5) * (2 * np.pi / 0.14)) * np.clip(
        1 - p.footprint[:, None] / 0.04, 0, 1
    )
    tone = np.exp(
        0.3 * np.clip(rut, -1.5, 1.5)
        + 0.13 * p.noise(0.9, 0.6, 50)
        - track * (0.25 + 0.16 * tread)
        + 0.12 * p.noise(23, 1.5, 51)
    )
    return np.array([0.175, 0.138, 0.10], np.float32) * tone[..., None]


def rock(p):
    border, shade = p.cells(8.3, 30, 15)
    slab = np.clip(p.bump(6.5, 0.07, 1.45, 52), -1.4, 1.4) + 0.6 * np.clip(
        p.bump(1.2, 0.02, 1.1, 53), -1.4, 1.4
    )
    tone = np.exp(0.36 * slab + 0.12 * shade + 0.14 * np.clip(border, -2, 0.5) + 0.1 * p.noise(0.8, 0.6, 54))
    return (
        _mix((0.22, 0.20, 0.172), (0.165, 0.156, 0.143), smooth(-1, 1, p.noise(15, 1.4, 55)))
        * tone[..., None]
    )


def wheat(p):
    base = _grass(p, (0.26, 0.185, 0.07), (0.34, 0.255, 0.105), 1.0, 0.5)
    tram = p.lines(p.x * 0.94 + p.y * 0.34, 18.0, 0.5, 3.0) + p.lines(p.x * 0.94 + p.y * 0.34, 18.0, 0.5, 4.9)
    return base * (1 - 0.5 * np.clip(tram, 0, 1))[..., None]


def rows(p):
    """Bare soil between planted rows, grass under them."""
    strip = p.lines(p.x * 0.42 + p.y * 0.91, 2.4, 1.1, 1.2)
    return (
        _mix(soil(p) * 1.1, 0, strip) + _grass(p, (0.07, 0.115, 0.03), (0.16, 0.15, 0.06)) * strip[..., None]
    )


def forest_floor(p):
    litter = _mix((0.15, 0.10, 0.055), (0.075, 0.085, 0.03), smooth(-0.7, 1.2, p.noise(9, 1.3, 56)))
    border, tone = p.cells(1.6, 60, 17)
    tone = np.exp(0.22 * tone + 0.12 * border + 0.3 * p.blades(1.2, 0.028) + 0.2 * p.noise(3.1, 1.0, 57))
    return litter * np.clip(tone, 0.2, 3)[..., None]


GRAIN = dict(
    snow=0.012,
    trodden_snow=0.05,
    asphalt=0.05,
    concrete=0.02,
    paving=0.03,
    plates=0.02,
    brick_paving=0.04,
    sand=0.06,
    desert=0.06,
    rock=0.1,
    gravel=0.1,
)

SURFACES: dict[str, Callable[[Patch], np.ndarray]] = {
    f.__name__: f
    for f in (
        meadow,
        lawn,
        autumn_grass,
        dry_grass,
        soil,
        desert,
        sand,
        snow,
        trodden_snow,
        asphalt,
        gravel,
        paving,
        plates,
        brick_paving,
        concrete,
        mud,
    )
    + (rock, wheat, rows, forest_floor)
}
