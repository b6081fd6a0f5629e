"""This module builds what random quadrotors carry: cameras, batteries, antennas, domes, legs and stickers.

Lengths are design millimetres (see quadrotor_plan.py). Left and right parts are the caller's to mirror.
"""

import numpy as np

from dronekeypp.sixdronesyn.fittings import (
    BLACK,
    GLASS,
    GREEN,
    METAL,
    RED,
    WHITE,
    gimbal,
    lens,
    light,
    motor,
    shade,
)
from dronekeypp.sixdronesyn.quadrotor_plan import DESIGN, Plan, Point, facing, plate, ring, rounded, tube
from dronekeypp.sixdronesyn.shapes import RGB, Part, beam, block, lathe, moved, on_surface, painted

CARBON = (34, 35, 38)
LIGHTS = (RED, GREEN, WHITE, (40, 120, 255), (255, 160, 30))


def skin(body: Part, x: float, y: float = 0.0, up: float = 1.0) -> float:
    """Return z of the top of a hull over (x, y), or of its belly if `up` is -1; x is kept within the hull."""
    ends = body.points[:, 0]
    inside = np.clip(x, ends.min() + 2, ends.max() - 2)
    return float(on_surface(body, (inside, y, -up * DESIGN), (0, 0, up))[0][2])


def motors(plan: Plan, height: float, base: RGB) -> list[Part]:
    """Build the two left motors; the bells have the same colour in front and at the rear, or not."""
    bell = plan.pick(METAL, METAL, BLACK, (150, 152, 156), plan.accent)
    rear_bell = plan.accent if plan.chance(0.12) else bell
    front = motor(plan.front, plan.motor, height, base, bell)
    return front + motor(plan.rear, plan.motor, height, base, rear_bell)


def lights(plan: Plan, drop: float) -> list[Part]:
    """Build status lights at the motors, in front, at the rear or both, of different colours."""
    parts = []
    pair = plan.pick((RED, GREEN), (GREEN, RED), (RED, WHITE), (WHITE, RED), (LIGHTS[3], RED))
    half = np.array([1.4, 4.0, 1.8]) * plan.draw(0.9, 1.6)
    kind = plan.rng.random()
    if kind < 0.75:
        parts.append(light(plan.rear, plan.motor, drop, pair[1], half))
    if kind > 0.35:
        parts.append(light(plan.front, plan.motor, drop, pair[0], half))
    return parts


def gimbal_camera(
    plan: Plan, x: float, top: float, bottom: float, size: float, body: Part | None = None
) -> list[Part]:
    """Build a camera on a gimbal that hangs at `x`, its stem up to `top`, and not below `bottom`.

    `size` is the camera's half width. If it hangs from a hull, `body`, the stem ends within that.
    """
    tall = plan.draw(0.75, 1.25)
    half = (plan.draw(0.7, 1.0) * size, size, tall * size)
    z = max(bottom + half[2], top - plan.draw(1.0, 1.35) * half[2])
    lenses = [(0.0, 0.0, plan.draw(0.45, 0.62) * size)]
    if plan.chance(0.35) and tall > 0.95:
        r = 0.4 * half[2]
        lenses = [(0.0, 0.48 * half[2], plan.draw(0.75, 1.0) * r), (0.0, -0.45 * half[2], r)]
    elif plan.chance(0.15):
        lenses = [(0.45 * size, 0.0, 0.36 * size), (-0.45 * size, 0.0, 0.36 * size)]
    case = plan.pick(plan.grey(30, 70), plan.grey(90, 150), plan.hull, WHITE)
    yoke = plan.pick(plan.grey(30, 80), shade(plan.hull, 0.8), plan.grey(120, 190))
    top = max(top, z + 1)
    if body is not None:
        top = max(top, skin(body, x - 1.9 * half[0], up=-1.0) + 2)
    return gimbal((x, 0, z), half, top, case, yoke, lenses, hood=plan.chance(0.15))


def fixed_camera(plan: Plan, at: Point, size: float, up: float, rgb: RGB) -> list[Part]:
    """Build a small camera that looks forward, `up` radians above the horizon. `size` is its half width."""
    turn = facing((np.cos(up), 0, np.sin(up)))
    parts = [block((0, 0, 0), (0.7 * size, size, size), rgb, around=12)]
    parts += lens((1.25 * size, 0, 0), 0.66 * size, 0.7 * size, rim=BLACK)
    return [moved(part, turn, at) for part in parts]


def nose_camera(plan: Plan, body: Part, z: float, size: float, up: float, rgb: RGB) -> list[Part]:
    """Build a small camera that is let into the nose of a hull at height `z`, or as near to it as fits."""
    end = body.points[:, 0].max() - 4
    belly, roof = skin(body, end, up=-1.0), skin(body, end)
    margin = min(0.4 * size, 0.5 * (roof - belly))
    level = float(np.clip(z, belly + margin, roof - margin))
    x, _, _ = on_surface(body, (-DESIGN, 0, level), (1, 0, 0))[0]
    return fixed_camera(plan, (x - 0.3 * size, 0, level), size, up, rgb)


def action_camera(plan: Plan, at: Point, size: float, up: float) -> list[Part]:
    """Build an action camera in its holder; `at` is the middle of its foot. `size` is its half width."""
    turn = facing((np.cos(up), 0, np.sin(up)))
    case = plan.grey(28, 70)
    half = (0.62 * size, size, 0.72 * size)
    parts = [block((0, 0, half[2]), half, case, soft=0.4, around=16)]
    parts += lens((half[0] + 1.5, -0.45 * size, 1.3 * half[2]), 0.42 * size, 3, rim=BLACK)
    parts.append(
        block((half[0], 0.45 * size, 1.2 * half[2]), (0.8, 0.36 * size, 0.3 * size), GLASS, around=8)
    )
    parts.append(
        block((-0.2 * half[0], 0, 0.3 * half[2]), (half[0], 1.12 * size, 0.4 * half[2]), plan.accent)
    )
    return [moved(part, turn, at) for part in parts]


def battery(plan: Plan, at: Point, half: Point) -> list[Part]:
    """Build a battery pack with a label and a strap around it."""
    x, y, z = at
    hx, hy, hz = half
    case = plan.pick(
        BLACK, plan.grey(30, 60), (28, 52, 120), (210, 170, 30), plan.grey(180, 230), plan.accent
    )
    pack = block(at, half, case, soft=0.2, exponent=8)
    label = plan.pick(WHITE, plan.accent, (230, 200, 40), (200, 40, 40))
    pack = painted(pack, label, x=(x - 0.75 * hx, x - 0.2 * hx))
    strap = block(
        (x + plan.draw(-0.1, 0.4) * hx, y, z), (0.13 * hx, hy + 0.9, hz + 0.9), plan.pick(BLACK, plan.accent)
    )
    wire = tube(
        (x - 0.95 * hx, y + 0.3 * hy, z), (x - 1.25 * hx, y + 0.5 * hy, z - 0.4 * hz), 1.6, RED, around=6
    )
    return [pack, strap, wire]


def dome(plan: Plan, at: Point, radius: float, mast: float, rgb: RGB) -> list[Part]:
    """Build a satellite receiver: a flat round case on a mast. `at` is the foot of the mast."""
    x, y, z = at
    top = z + mast
    r, high = radius, radius * plan.draw(0.35, 0.7)
    profile = [
        (0.86 * r, 0),
        (r, 0.2 * high),
        (r, 0.55 * high),
        (0.8 * r, 0.9 * high),
        (0.4 * r, high),
        (0, high),
    ]
    parts = [lathe(profile, rgb, (x, y, top), segments=18, gloss=0.5)]
    if mast > 0:
        parts.append(tube((x, y, z - 2), (x, y, top + 1), max(1.6, 0.14 * r), CARBON))
        parts.append(lathe([(0.5 * r, -1), (0.5 * r, 1.5)], CARBON, (x, y, z), segments=12))
    return parts


def rod(
    plan: Plan, foot: Point, lean: Point, length: float, radius: float, rgb: RGB, pod: float = 0.0
) -> list[Part]:
    """Build a rod antenna from `foot` along `lean`, with a pod of that radius at its end if it is not 0.

    Where a disc is in its way, it is turned towards the middle plane, then laid lower. It is left out if
    nothing helps.
    """
    for upward in (1.0, 0.5, 0.0):
        for sideways in (1.0, 0.6, 0.3, 0.0):
            parts = plan.whole(
                _rod(foot, np.multiply(lean, (1.0, sideways, upward)), length, radius, rgb, pod)
            )
            if parts:
                return parts
    return []


def _rod(foot: Point, lean: Point, length: float, radius: float, rgb: RGB, pod: float) -> list[Part]:
    direction = np.asarray(lean, float) / np.linalg.norm(lean)
    start = np.asarray(foot, float) - radius * direction
    end = start + length * direction
    parts = [tube(start, end, radius, rgb, around=6)]
    if pod > 0:
        profile = [(0.5 * pod, -0.3 * pod), (pod, 0.1 * pod), (pod, 0.6 * pod), (0.6 * pod, 1.1 * pod)]
        parts.append(lathe(profile, rgb, end, direction, segments=12))
    return parts


def landing_skid(plan: Plan, root: Point, y: float, thick: float, rgb: RGB, length: float) -> list[Part]:
    """Build the left half of a tube undercarriage: a strut from `root` down to a bar along x at `y`."""
    x, _, _ = root
    z = plan.ground + 1.2 * thick
    bar = tube((x - 0.5 * length, y, z), (x + 0.5 * length, y, z), thick, rgb)
    foam = plan.pick(BLACK, BLACK, plan.accent)
    ends = []
    for sign in (-1, 1):
        inner, outer = x + 0.3 * sign * length, x + 0.5 * sign * length
        ends.append(tube((inner, y, z), (outer, y, z), 1.2 * thick, foam))
    return [tube(root, (x, y, z), thick, rgb), bar, *ends]


def landing_loop(
    plan: Plan, x: tuple[float, float], top: Point, y: float, thick: float, rgb: RGB
) -> list[Part]:
    """Build the left leg of a landing frame: two struts from the belly down to a runner along x at `y`.

    `x` is (rear, front) of the struts' feet; `top` is (x shift towards the middle, y, z) of their roots.
    """
    rear, front = x
    inward, root_y, root_z = top
    z = plan.ground + thick
    parts = [tube((rear - 6, y, z), (front + 6, y, z), thick, rgb)]
    for foot, shift in ((rear, inward), (front, -inward)):
        parts.append(tube((foot + shift, root_y, root_z), (foot, y, z), 0.9 * thick, rgb))
    return parts


def sticker(plan: Plan, part: Part, x: tuple[float, float], half: float, z: tuple[float, float]) -> Part:
    """Paint a patch, a stripe along x, a band across or two stripes on the top of a hull."""
    kind = int(plan.rng.integers(4))
    rear, front = x
    length = front - rear
    if kind == 0:
        middle = plan.draw(rear + 0.3 * length, front - 0.3 * length)
        size = plan.draw(0.06, 0.16) * length
        return painted(part, plan.accent, x=(middle - size, middle + size), y=(-0.6 * half, 0.6 * half), z=z)
    if kind == 1:
        wide = plan.draw(0.12, 0.35) * half
        return painted(part, plan.accent, y=(-wide, wide), z=z)
    if kind == 2:
        at = plan.draw(rear + 0.1 * length, front - 0.1 * length)
        return painted(part, plan.accent, x=(at, at + plan.draw(0.05, 0.15) * length))
    inner, wide = plan.draw(0.3, 0.5) * half, plan.draw(0.08, 0.2) * half
    part = painted(part, plan.accent, y=(inner, inner + wide), z=z)
    return painted(part, plan.accent, y=(-inner - wide, -inner), z=z)


def box(plan: Plan, at: Point, half: Point, rgb: RGB) -> list[Part]:
    """Build a payload or a case: a box with a lid of another shade."""
    x, y, z = at
    hx, hy, hz = half
    lid = plate(
        rounded((x - 0.8 * hx, x + 0.8 * hx), 0.8 * hy, 0.2 * hy),
        (z + 0.5 * hz, z + hz + 0.6),
        shade(rgb, 0.7),
    )
    return [block(at, half, rgb, soft=0.2, exponent=8), lid]


def guards(plan: Plan, drop: float, spare: float = 0.0) -> list[Part]:
    """Build the left propeller guards on struts: arcs on the outer side, or whole rings where there is room.

    `drop` is how far below the hub the struts begin, `spare` the room that a whole ring may take.
    """
    thick = plan.draw(1.6, 2.2)
    parts = []
    rgb = plan.pick(plan.trim, plan.hull, plan.accent, BLACK)
    whole = spare > 2.4 * thick + 3 and plan.chance(0.6)
    radius = plan.radius + max(0.5 * spare + 1, thick + 3)
    wide = np.pi if whole else plan.draw(0.3, 0.5) * np.pi
    level = plan.draw(-0.6, 0.2) * drop
    for hub in (plan.front, plan.rear):
        outward = np.arctan2(hub[1], hub[0])
        if whole:
            profile = [(radius - thick, level - 1.4 * thick), (radius + thick, level - 1.4 * thick)]
            profile += [(radius + thick, level + 1.4 * thick), (radius - thick, level + 1.4 * thick)]
            parts.append(ring(hub, profile, rgb, segments=40))
        else:
            angle = outward + np.linspace(-wide, wide, 17)
            knots = hub + np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(17, level)], -1)
            sizes = np.tile([thick, 1.4 * thick], (17, 1))
            parts.append(beam(knots, sizes, rgb, along=25, around=6))
        for turn in (-0.75 * wide, 0.0, 0.75 * wide) if whole else (-0.6 * wide, 0.6 * wide):
            direction = np.array([np.cos(outward + turn), np.sin(outward + turn), 0])
            start = hub + (0, 0, -0.85 * drop)
            end = hub + radius * direction + (0, 0, min(level, -4.0))
            # it stays low until it is beyond the disc, where a post takes it up to the guard
            parts.append(
                beam([start, 0.5 * (start + end), end], [(thick, thick)] * 3, rgb, along=3, around=6)
            )
            if level > -4.0:
                parts.append(tube(end - (0, 0, thick), end + (0, 0, level + 4.0), thick, rgb, around=6))
    return parts
