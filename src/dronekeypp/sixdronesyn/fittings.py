"""This module builds the pieces that every drone has.

They are motors, arms, legs, hinges, eyes, lenses, the gimbal camera and status lights. Lengths are
millimetres in the body frame, on the left side of the drone. Colours are RGB, 0 to 255.
"""

from collections.abc import Sequence

import numpy as np

from dronekeypp.sixdronesyn.shapes import RGB, Part, beam, block, lathe, on_surface

BLACK = (24, 25, 27)
GLASS = (12, 14, 20)
METAL = (78, 79, 82)
WHITE = (236, 237, 236)
COATING = (58, 66, 104)  # of a lens
RED = (222, 44, 38)
GREEN = (44, 200, 88)


def shade(rgb: RGB, factor: float) -> RGB:
    """Return a darker (`factor` below 1) or lighter colour of the same hue."""
    red, green, blue = np.minimum(255, np.round(np.asarray(rgb) * factor)).astype(int).tolist()
    return red, green, blue


def motor(hub: np.ndarray, radius: float, height: float, base: RGB, bell: RGB = METAL) -> list[Part]:
    """Build the propeller nut, turning bell and fixed base of a motor under the hub (3,).

    Every part stays below the hub, so the keypoint itself is never inside one.
    """
    r = radius
    top, waist = -3.2, -0.66 * height
    nut = [(0.0, -0.4), (0.3 * r, -0.4), (0.4 * r, -1.4), (0.4 * r, -3.6)]
    cap = [(0.0, top), (0.66 * r, top), (0.86 * r, top - 1.6), (0.86 * r, waist)]
    seat = [
        (0.0, waist - 0.1),
        (0.7 * r, waist - 0.1),
        (0.7 * r, waist - 1.4),
        (1.0 * r, waist - 1.8),
        (1.0 * r, -height - 2),
        (0.8 * r, -height - 5),
    ]
    return [
        lathe(nut, BLACK, hub, segments=8),
        lathe(cap, bell, hub, segments=14, gloss=0.7),
        lathe(seat, base, hub, segments=14),
    ]


def eye(
    body: Part, start: Sequence[float], direction: Sequence[float], radius: float, rim: RGB = BLACK
) -> list[Part]:
    """Build a vision sensor, which is a rim with a dark glossy dome.

    It is set flush where the ray from `start` inside the hull `body` leaves it. It faces half way between the
    ray's `direction` and the normal of the skin.
    """
    r = radius
    at, normal = on_surface(body, start, direction)
    axis = normal + np.asarray(direction, float) / np.linalg.norm(direction)
    ring = [(1.05 * r, -1.0 * r), (1.0 * r, 0.12 * r), (0.8 * r, 0.22 * r), (0.7 * r, 0.05 * r)]
    dome = [(0.72 * r, 0.02 * r), (0.55 * r, 0.2 * r)]
    pupil = [(0.56 * r, 0.18 * r), (0.3 * r, 0.32 * r)]
    return [
        lathe(ring, rim, at, axis, segments=12),
        lathe(dome, GLASS, at, axis, segments=10, gloss=0.95),
        lathe(pupil, COATING, at, axis, segments=10, gloss=0.95),
    ]


def lens(at: Sequence[float], radius: float, depth: float, rim: RGB = BLACK) -> list[Part]:
    """Build a lens barrel that looks forward; the middle of its front is `at`."""
    r = radius
    forward = (1, 0, 0)
    barrel = [(r, -depth), (r, 0), (0.84 * r, 0.06 * r), (0.72 * r, -0.25 * r)]
    glass = [(0.73 * r, -0.25 * r), (0.46 * r, -0.1 * r)]
    coating = [(0.47 * r, -0.12 * r), (0.25 * r, -0.02 * r), (0, 0.0)]
    return [
        lathe(barrel, rim, at, forward, segments=18, gloss=0.5),
        lathe(glass, GLASS, at, forward, segments=14, gloss=1.0),
        lathe(coating, COATING, at, forward, segments=12, gloss=1.0),
    ]


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
    """Build the gimbal camera of a drone.

    It is held by a pitch arm at its side, a roll arm behind it and a stem into the hull.

    Args:
        at: the camera's centre.
        half: its half sizes along x, y, z.
        top: z of the upper end of the stem.
        body: colour of the camera.
        yoke: colour of the arms, the stem and the motors.
        lenses: (sideways, up, radius) of each lens, relative to the middle of the camera's front.
        face: colour of the front plate.
        hood: whether the lenses sit in the square frame of the Hasselblad camera.
    """
    x, y, z = at
    hx, hy, hz = half
    arm = 0.16 * hy + 1.2  # half the thickness of the pitch arm
    pitch_motor = [(0.62 * hz, -1.2 * arm), (0.62 * hz, 0.6 * arm), (0.5 * hz, arm)]
    roll_motor = [(0.45 * hz, -0.5 * hx), (0.45 * hz, 0.35 * hx), (0.36 * hz, 0.5 * hx)]
    stem = [(x - 1.75 * hx, 0, z), (x - 1.9 * hx, 0, top)]
    stem_sizes = [(0.5 * hy, 0.3 * hx), (0.6 * hy, 0.4 * hx)]
    plate_at, plate_half = (x + 0.93 * hx, y, z), (0.12 * hx, 0.86 * hy, 0.88 * hz)
    pitch_at, pitch_half = (x - 0.35 * hx, y + hy + arm + 0.6, z), (0.95 * hx, arm, 0.52 * hz)
    roll_at, roll_half = (x - 1.45 * hx, y + 0.45 * hy, z), (0.26 * hx, 0.85 * hy, 0.42 * hz)
    parts = [
        block(at, half, body, soft=0.35, exponent=5, around=20),
        block(plate_at, plate_half, face, soft=0.5, exponent=5, around=20),
        block(pitch_at, pitch_half, yoke, exponent=4, around=12),
        lathe(pitch_motor, yoke, (x, y + hy + arm, z), axis=(0, 1, 0), segments=16),
        block(roll_at, roll_half, yoke, exponent=4, around=12),
        lathe(roll_motor, yoke, (x - 1.75 * hx, y, z), axis=(1, 0, 0), segments=14),
        beam(stem, stem_sizes, yoke, up=(1, 0, 0), along=3),
    ]
    front = x + 1.06 * hx
    if hood:
        front = x + 1.35 * hx
        hood_at, hood_half = (x + 1.12 * hx, y, z), (0.2 * hx, 0.9 * hy, 0.9 * hz)
        parts.append(block(hood_at, hood_half, shade(body, 0.75), soft=0.4, exponent=7))
    for side, up, radius in lenses:
        lens_at = (front + 0.25 * radius, y + side, z + up)
        parts += lens(lens_at, radius, depth=0.8 * radius, rim=(46, 47, 50))
    return parts


def arm(
    root: Sequence[float],
    hub: np.ndarray,
    drop: float,
    sizes: Sequence[Sequence[float]],
    rgb: RGB,
    bend: Sequence[float] = (0.55, 0.5, 0.5),
) -> Part:
    """Build an arm of three knots from `root` in the hull to the motor's seat, `drop` below the hub.

    `sizes` (3, 2) are the half widths and half heights at the knots. `bend` is where the middle knot lies
    along x, y and z, as a share of the way from the root to the tip.
    """
    root = np.asarray(root, float)
    tip = hub - (0, 0, drop)
    knee = root + np.asarray(bend) * (tip - root)
    return beam([root, knee, tip], sizes, rgb, along=8, around=10, exponent=3.6)


def leg(
    hub: np.ndarray, top: float, foot: Sequence[float], wide: Sequence[float], thick: float, rgb: RGB
) -> Part:
    """Build a blade that stands under a motor, from `top` below the hub down to its foot.

    `foot` is (z in the body frame, shift forward, shift sideways). `wide` holds the half widths above and
    below, `thick` is the half thickness.
    """
    z, forward, out = foot
    start = hub - (0, 0, top)
    end = np.array([hub[0] + forward, hub[1] + out, z + 0.6 * thick])
    middle = 0.5 * (start + end) + (0.12 * forward, 0, 0)
    sizes = [(thick, wide[0]), (0.85 * thick, 0.5 * (wide[0] + wide[1])), (0.8 * thick, wide[1])]
    return beam([start, middle, end], sizes, rgb, up=(1, 0, 0), along=6, exponent=3.2, round_end=0.7)


def hinge(at: Sequence[float], radius: float, height: float, rgb: RGB) -> Part:
    """Build the round joint about which an arm folds."""
    r, h = radius, 0.5 * height
    upper = [(0.0, h), (0.72 * r, h), (0.94 * r, h - 0.14 * r), (r, h - 0.4 * r)]
    lower = [(r, 0.4 * r - h), (0.85 * r, -h), (0, -h)]
    return lathe(upper + lower, rgb, at, segments=18)


def skid(x: tuple[float, float], y: float, top: float, bottom: float, thick: float, rgb: RGB) -> Part:
    """Build a low keel below the belly, slanted at both ends.

    `x` is (rear end, front end).
    """
    rear, front = x
    middle = 0.5 * (top + bottom)
    half = 0.5 * (top - bottom) + 0.2
    path = [
        (rear - 6, y, middle + 0.7 * half),
        (rear + 4, y, middle),
        (front - 4, y, middle),
        (front + 8, y, middle + 0.8 * half),
    ]
    sizes = [(0.7 * thick, 0.3 * half), (thick, half), (thick, half), (0.6 * thick, 0.2 * half)]
    return beam(path, sizes, rgb, along=10, around=8, exponent=4, round_end=0.2)


def light(
    hub: np.ndarray, radius: float, drop: float, rgb: RGB, half: Sequence[float] = (1.4, 4.0, 1.8)
) -> Part:
    """Build a status light in the outer rim of a motor's seat, `drop` below the hub.

    It faces away from the middle of the drone.
    """
    outward = np.array([np.sign(hub[0]) * 0.9, 0.45, 0.0]) / np.hypot(0.9, 0.45)
    turn = np.stack([outward, np.cross([0, 0, 1.0], outward), [0, 0, 1.0]], 1)
    at = hub + 0.96 * radius * outward - (0, 0, drop)
    return block(at, half, rgb, turn=turn, exponent=4, around=8)
