"""The pieces every drone has: motors, arms, legs, hinges, eyes, lenses, the gimbal camera, status lights.

Millimetres, body frame, left side of the drone; colours are RGB 0..255.
"""

from collections.abc import Sequence

import numpy as np

from dronekeypp.sixdronesyn.shapes import RGB, Part, beam, block, lathe, on_surface

BLACK, GLASS, METAL, WHITE = (24, 25, 27), (12, 14, 20), (78, 79, 82), (236, 237, 236)
COATING = (58, 66, 104)
RED, GREEN = (222, 44, 38), (44, 200, 88)


def shade(rgb: RGB, factor: float) -> RGB:
    """A darker (below 1) or lighter colour of the same hue."""
    return tuple(int(min(255, round(channel * factor))) for channel in rgb)


def motor(hub: np.ndarray, radius: float, height: float, base: RGB, bell: RGB = METAL) -> list[Part]:
    """Propeller nut, turning bell and fixed base below a hub. Everything stays below the hub, so the keypoint itself is never inside."""
    at, r = hub, radius
    nut = lathe([(0.0, -0.4), (0.3 * r, -0.4), (0.4 * r, -1.4), (0.4 * r, -3.6)], BLACK, at, segments=8)
    top, waist = -3.2, -0.66 * height
    cap = lathe(
        [(0.0, top), (0.66 * r, top), (0.86 * r, top - 1.6), (0.86 * r, waist)],
        bell,
        at,
        segments=14,
        gloss=0.7,
    )
    seat = lathe(
        [(0.0, waist - 0.1), (0.7 * r, waist - 0.1), (0.7 * r, waist - 1.4), (1.0 * r, waist - 1.8), (1.0 * r, -height - 2),
        (0.8 * r, -height - 5)],
        base, at, segments=14,
    )  # fmt: skip
    return [nut, cap, seat]


def eye(
    body: Part, start: Sequence[float], direction: Sequence[float], radius: float, rim: RGB = BLACK
) -> list[Part]:
    """A vision sensor set flush where a ray from `start` inside the hull leaves it: a rim with a dark glossy dome, facing half way
    between the ray and the skin's normal."""
    r = radius
    at, normal = on_surface(body, start, direction)
    axis = normal + np.asarray(direction, float) / np.linalg.norm(direction)
    ring = lathe(
        [(1.05 * r, -1.0 * r), (1.0 * r, 0.12 * r), (0.8 * r, 0.22 * r), (0.7 * r, 0.05 * r)],
        rim,
        at,
        axis,
        12,
    )
    dome = lathe([(0.72 * r, 0.02 * r), (0.55 * r, 0.2 * r)], GLASS, at, axis, 10, 0.95)
    pupil = lathe([(0.56 * r, 0.18 * r), (0.3 * r, 0.32 * r)], COATING, at, axis, 10, 0.95)
    return [ring, dome, pupil]


def lens(at: Sequence[float], radius: float, depth: float, rim: RGB = BLACK) -> list[Part]:
    """A lens barrel looking forward, its front at `at`."""
    r = radius
    barrel = lathe(
        [(r, -depth), (r, 0), (0.84 * r, 0.06 * r), (0.72 * r, -0.25 * r)], rim, at, (1, 0, 0), 18, 0.5
    )
    glass = lathe([(0.73 * r, -0.25 * r), (0.46 * r, -0.1 * r)], GLASS, at, (1, 0, 0), 14, 1.0)
    coating = lathe([(0.47 * r, -0.12 * r), (0.25 * r, -0.02 * r), (0, 0.0)], COATING, at, (1, 0, 0), 12, 1.0)
    return [barrel, glass, coating]


def gimbal(
    at: Sequence[float],
    half: Sequence[float],
    top: float,
    body: RGB,
    yoke: RGB,
    lenses: Sequence[Sequence[float]],
    face: RGB = BLACK,
    hood: bool = False,
) -> list[Part]:
    """A camera of half sizes `half` centred at `at`, held by a side arm, a roll arm behind it and a stem up to z = `top`.

    `lenses` holds (sideways, up, radius) relative to the middle of the camera's front.
    """
    x, y, z = at
    hx, hy, hz = half
    arm = 0.16 * hy + 1.2
    parts = [
        block(at, half, body, soft=0.35, exponent=5, around=20),
        block(
            (x + 0.93 * hx, y, z), (0.12 * hx, 0.86 * hy, 0.88 * hz), face, soft=0.5, exponent=5, around=20
        ),
        # pitch arm on the left and its motor, roll arm behind, yaw stem into the hull
        block(
            (x - 0.35 * hx, y + hy + arm + 0.6, z), (0.95 * hx, arm, 0.52 * hz), yoke, exponent=4, around=12
        ),
        lathe(
            [(0.62 * hz, -1.2 * arm), (0.62 * hz, 0.6 * arm), (0.5 * hz, arm)],
            yoke,
            (x, y + hy + arm, z),
            (0, 1, 0),
            16,
        ),
        block(
            (x - 1.45 * hx, y + 0.45 * hy, z), (0.26 * hx, 0.85 * hy, 0.42 * hz), yoke, exponent=4, around=12
        ),
        lathe(
            [(0.45 * hz, -0.5 * hx), (0.45 * hz, 0.35 * hx), (0.36 * hz, 0.5 * hx)],
            yoke,
            (x - 1.75 * hx, y, z),
            (1, 0, 0),
            14,
        ),
        beam(
            [(x - 1.75 * hx, 0, z), (x - 1.9 * hx, 0, top)],
            [(0.5 * hy, 0.3 * hx), (0.6 * hy, 0.4 * hx)],
            yoke,
            up=(1, 0, 0),
            along=3,
        ),
    ]
    if hood:  # the square frame around the Hasselblad lens
        parts.append(
            block(
                (x + 1.12 * hx, y, z), (0.2 * hx, 0.9 * hy, 0.9 * hz), shade(body, 0.75), soft=0.4, exponent=7
            )
        )
    for side, up, radius in lenses:
        parts += lens(
            (x + (1.35 if hood else 1.06) * hx + 0.25 * radius, y + side, z + up),
            radius,
            0.8 * radius,
            (46, 47, 50),
        )
    return parts


def arm(
    root: Sequence[float],
    hub: np.ndarray,
    drop: float,
    sizes: Sequence[Sequence[float]],
    rgb: RGB,
    bend: Sequence[float] = (0.55, 0.5, 0.5),
) -> Part:
    """An arm from `root` in the hull to the motor seat, `drop` below the hub; `bend` says how far along x, y, z its middle knot lies."""
    root, tip = np.asarray(root, float), hub - (0, 0, drop)
    knee = root + np.asarray(bend) * (tip - root)
    return beam([root, knee, tip], sizes, rgb, along=8, around=10, exponent=3.6)


def leg(
    hub: np.ndarray, top: float, foot: Sequence[float], wide: Sequence[float], thick: float, rgb: RGB
) -> Part:
    """A blade from `top` below the hub down to `foot` (absolute z, and forward and sideways shift); `wide` is its half width above and
    below."""
    z, forward, out = foot
    start = hub - (0, 0, top)
    end = np.array([hub[0] + forward, hub[1] + out, z + 0.6 * thick])
    middle = 0.5 * (start + end) + (0.12 * forward, 0, 0)
    sizes = [(thick, wide[0]), (0.85 * thick, 0.5 * (wide[0] + wide[1])), (0.8 * thick, wide[1])]
    return beam([start, middle, end], sizes, rgb, up=(1, 0, 0), along=6, exponent=3.2, round_end=0.7)


def hinge(at: Sequence[float], radius: float, height: float, rgb: RGB) -> Part:
    """The round joint an arm folds about."""
    r, h = radius, 0.5 * height
    return lathe(
        [
            (0.0, h),
            (0.72 * r, h),
            (0.94 * r, h - 0.14 * r),
            (r, h - 0.4 * r),
            (r, 0.4 * r - h),
            (0.85 * r, -h),
            (0, -h),
        ],
        rgb,
        at,
        segments=18,
    )


def skid(x: tuple[float, float], y: float, top: float, bottom: float, thick: float, rgb: RGB) -> Part:
    """A low keel below the belly, slanted at both ends."""
    rear, front = x
    middle = 0.5 * (top + bottom)
    half = 0.5 * (top - bottom) + 0.2
    path = [
        (rear - 6, y, middle + 0.7 * half),
        (rear + 4, y, middle),
        (front - 4, y, middle),
        (front + 8, y, middle + 0.8 * half),
    ]
    return beam(
        path,
        [(0.7 * thick, 0.3 * half), (thick, half), (thick, half), (0.6 * thick, 0.2 * half)],
        rgb,
        along=10,
        around=8,
        exponent=4,
        round_end=0.2,
    )


def light(
    hub: np.ndarray, radius: float, drop: float, rgb: RGB, half: Sequence[float] = (1.4, 4.0, 1.8)
) -> Part:
    """A status light in the outer rim of a motor's seat, `drop` below the hub: away from the drone's middle."""
    away = np.array([np.sign(hub[0]) * 0.9, 0.45, 0.0]) / np.hypot(0.9, 0.45)
    turn = np.stack([away, np.cross([0, 0, 1.0], away), [0, 0, 1.0]], 1)
    return block(hub + 0.96 * radius * away - (0, 0, drop), half, rgb, turn=turn, exponent=4, around=8)
