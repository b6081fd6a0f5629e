"""This module builds the random quadrotors with a moulded hull: folding drones and shells on legs.

Lengths are design millimetres (see quadrotor_plan.py). Each builder returns the parts on the middle plane and
those to the left, like airframes.py. The columns of `stations` are those of `shapes.hull`.
"""

import numpy as np

from dronekeypp.sixdronesyn.fittings import BLACK, arm, eye, hinge, leg, shade, skid
from dronekeypp.sixdronesyn.quadrotor_extras import (
    dome,
    gimbal_camera,
    guards,
    landing_loop,
    landing_skid,
    lights,
    motors,
    nose_camera,
    skin,
    sticker,
)
from dronekeypp.sixdronesyn.quadrotor_plan import Plan, Sides
from dronekeypp.sixdronesyn.shapes import Part, block, hull, painted


def fuselage(
    plan: Plan, x: tuple[float, float], half: float, z: tuple[float, float], bay: float, soft: float
) -> Part:
    """Build a hull from x[0] to x[1], of half width `half`, between two heights.

    `bay` is how far its belly rises at the nose, as a share of its height, to make room for a camera. `soft`
    runs from 0 (a box) to 1 (an egg).
    """
    rear, front = x
    bottom, top = z
    high = top - bottom
    at = np.array([0.0, 0.02, 0.16, 0.42, 0.66, 0.83, 0.95, 1.0])
    tail, nose = plan.draw(0.6, 0.92) - 0.25 * soft, plan.draw(0.55, 0.95) - 0.2 * soft
    hump = plan.draw(0.35, 0.6)  # where it is highest
    wide = np.interp(at, [0, 0.02, 0.3, 0.6, 0.95, 1], [0.85 * tail, tail, 0.97, 1, nose, 0.8 * nose])
    crown_tail, crown_nose = plan.draw(0.5, 0.9), plan.draw(0.55, 0.92)
    roof = np.interp(
        at, [0, 0.02, hump, 0.95, 1], [crown_tail - 0.1, crown_tail, 1, crown_nose, crown_nose - 0.1]
    )
    belly = np.interp(at, [0, 0.02, 0.16, 0.66, 0.95, 1], [0.26, 0.15, 0.02, 0.04, bay, bay + 0.08])
    belly = np.minimum(belly, roof - 0.2)
    sharp = 5.0 - 2.4 * soft
    rows = []
    for share, w, up, down in zip(at, wide, roof, belly, strict=True):
        middle = 0.5 * (up + down) + 0.05
        rows.append(
            (
                rear + share * (front - rear),
                w * half,
                bottom + down * high,
                bottom + middle * high,
                bottom + up * high,
                sharp,
                sharp - 0.6,
            )
        )
    return hull(rows, plan.hull, rings=20, around=22, gloss=plan.draw(0.15, 0.6))


def folding(plan: Plan) -> Sides:
    """Build a folding camera drone: hull, hinged arms, a camera on a gimbal and eyes."""
    length = plan.draw(0.5, 0.8) * plan.height * 3.2
    length = float(np.clip(length, 0.95 * (plan.front[0] - plan.rear[0]), 235))
    half = min(plan.draw(0.085, 0.135) * 300, 0.42 * plan.front[1] + 6)
    shift = plan.draw(-0.04, 0.06) * length
    x = (shift - length / 2, shift + length / 2)
    top = min(plan.roof(x, half), -plan.ground * plan.draw(0.55, 1.0))
    bottom = max(top - half * plan.draw(1.25, 1.95), plan.ground + plan.draw(0.04, 0.3) * plan.height)
    bottom = min(bottom, top - 24)
    high = top - bottom
    bay = plan.draw(0.3, 0.62)
    body = fuselage(plan, x, half, (bottom, top), bay, plan.draw(0.2, 1.0))
    dark = plan.trim
    if plan.chance(0.7):
        body = painted(
            body, shade(plan.hull, plan.draw(0.5, 0.85)), z=(bottom - 9, bottom + plan.draw(0.2, 0.45) * high)
        )
    if plan.chance(0.6):  # the battery
        end = x[0] + plan.draw(0.3, 0.6) * length
        rgb = plan.pick(dark, shade(plan.hull, 0.8), shade(plan.hull, 0.6))
        body = painted(body, rgb, x=(x[0] - 9, end), z=(bottom + plan.draw(0.4, 0.6) * high, top + 9))
    if plan.chance(0.75):  # the visor across the brow
        low = bottom + plan.draw(0.55, 0.7) * high
        body = painted(
            body, BLACK, x=(x[1] - plan.draw(0.08, 0.2) * length, x[1] + 9), z=(low, low + 0.22 * high)
        )
    if plan.chance(0.4):
        body = sticker(plan, body, x, half, (bottom + 0.5 * high, top + 9))
    size = plan.draw(0.36, 0.6) * half
    camera = gimbal_camera(
        plan, x[1] + plan.draw(-0.4, 0.5) * size, bottom + (bay + 0.05) * high, plan.ground + 3, size, body
    )
    middle = [body, *camera]

    left = []
    eyes = plan.draw(0.13, 0.24) * half
    if plan.chance(0.7):
        left += eye(body, (x[1] - 0.25 * length, 0.45 * half, bottom + 0.65 * high), (0.8, 0.55, 0.2), eyes)
    if plan.chance(0.6):
        left += eye(
            body, (x[0] + 0.25 * length, 0.4 * half, bottom + 0.55 * high), (-0.8, 0.5, 0.3), 0.8 * eyes
        )
    front_x = min(plan.draw(0.12, 0.32) * length + shift, plan.front[0] - 8)
    rear_x = max(shift - plan.draw(0.2, 0.36) * length, plan.rear[0] + 8)
    drop = plan.motor * plan.draw(0.9, 1.5)
    wide = plan.draw(0.028, 0.042) * 300
    sizes = [(wide, 0.75 * wide), (0.78 * wide, 0.62 * wide), (0.68 * wide, 0.55 * wide)]
    ceiling = min(top, plan.low) - 0.8 * wide
    front_z = min(bottom + plan.draw(0.45, 0.8) * high, ceiling)
    rear_z = min(bottom + plan.draw(0.2, 0.6) * high, ceiling)
    front_rgb = plan.pick(plan.hull, plan.hull, dark, shade(plan.hull, 0.8))
    rear_rgb = plan.pick(front_rgb, front_rgb, dark, plan.accent)
    for hub, root_x, root_z, rgb in (
        (plan.front, front_x, front_z, front_rgb),
        (plan.rear, rear_x, rear_z, rear_rgb),
    ):
        root = (root_x, 0.8 * half, root_z)
        limb = arm(root, hub, drop + 0.5 * wide, sizes, rgb, (0.45, 0.5, plan.draw(0.35, 0.55)))
        if plan.chance(0.15):
            limb = painted(limb, plan.accent, y=(0.75 * hub[1], 0.84 * hub[1]))
        left.append(limb)
        left.append(
            hinge(root, 1.05 * wide, min(1.8 * wide, 2 * (ceiling + 0.7 * wide - root_z)), shade(rgb, 0.92))
        )
    left += motors(plan, drop, plan.pick(plan.hull, dark))
    left += lights(plan, drop + 0.2 * wide)
    if plan.chance(0.08):
        left += guards(plan, drop)
    thick = 0.3 * wide
    left.append(
        leg(
            plan.front,
            drop + 0.5 * wide,
            (plan.ground, plan.draw(-4, 12), plan.draw(0, 4)),
            (0.8 * wide, 0.5 * wide),
            thick,
            front_rgb,
        )
    )
    if plan.chance(0.35):
        left.append(
            leg(
                plan.rear,
                drop + 0.5 * wide,
                (plan.ground, plan.draw(-8, 4), 0),
                (0.6 * wide, 0.4 * wide),
                thick,
                rear_rgb,
            )
        )
    elif 3 < bottom - plan.ground < 18:
        left.append(
            skid(
                (x[0] + 0.15 * length, x[0] + 0.4 * length),
                0.5 * half,
                bottom + 0.2 * high,
                plan.ground,
                thick,
                dark,
            )
        )
    if plan.chance(0.15):
        spot = x[0] + 0.25 * length
        at = (spot, 0, skin(body, spot) - 2)
        middle += plan.whole(dome(plan, at, 0.45 * half, 0.05 * high, plan.pick(dark, plan.hull)))
    return middle, left


def shell(plan: Plan) -> Sides:
    """Build a moulded shell with arms that are part of it, on a landing frame, a camera below."""
    rgb, dark = plan.hull, plan.trim
    drop = plan.motor * plan.draw(1.0, 1.5)
    reach = 0.5 * (plan.front[0] - plan.rear[0])
    half = plan.draw(0.14, 0.2) * 300
    x = (-plan.draw(0.55, 0.8) * reach, plan.draw(0.55, 0.8) * reach)
    high = plan.draw(0.13, 0.2) * 300
    top = min(plan.roof(x, half), plan.low + plan.draw(0.0, 18.0))
    bottom = top - high
    body = fuselage(plan, x, half, (bottom, top), plan.draw(0.05, 0.2), plan.draw(0.5, 1.0))
    if plan.chance(0.5):
        body = painted(body, shade(rgb, 0.75), z=(bottom - 9, bottom + 0.35 * high))
    if plan.chance(0.6):
        body = sticker(plan, body, x, half, (bottom + 0.5 * high, top + 9))
    if plan.chance(0.4):  # the battery's back
        body = painted(
            body, plan.pick(dark, shade(rgb, 0.7)), x=(x[0] - 9, x[0] + 7), y=(-0.7 * half, 0.7 * half)
        )
    middle = [body]
    size = plan.draw(0.34, 0.5) * half
    at = plan.draw(0.1, 0.75) * x[1]
    if plan.chance(0.85):
        middle += gimbal_camera(plan, at, bottom + 4, plan.ground + 4, size, body)
        belly = skin(body, at - 1.5 * size, up=-1.0)
        middle.append(block((at - 1.5 * size, 0, belly - 1), (0.8 * size, 0.7 * size, 4), dark))
    left = []
    if plan.chance(0.6):
        left += eye(body, (0.3 * x[1], 0.35 * half, bottom + 0.4 * high), (1, 0.1, 0), 0.14 * half)
    else:  # or one small camera: a shell has little else that tells its front from its rear
        middle += nose_camera(plan, body, bottom + 0.5 * high, 0.2 * half, 0.0, BLACK)
    wide, tall = plan.draw(0.07, 0.12) * 300, plan.draw(0.035, 0.05) * 300
    tip = 0.9 * plan.motor
    front_rgb = plan.pick(rgb, rgb, rgb, dark)
    rear_rgb = plan.pick(front_rgb, front_rgb, plan.accent)
    for hub, end, colour in ((plan.front, x[1], front_rgb), (plan.rear, x[0], rear_rgb)):
        level = min(bottom + 0.55 * high, plan.low - tall - 4)
        root = (0.35 * end, 0.35 * half, level)
        sizes = [(wide, 1.1 * tall), (0.62 * wide, 0.8 * tall), (tip, 0.55 * tall)]
        limb = arm(root, hub, drop + 0.4 * tall, sizes, colour, (0.5, 0.5, 0.6))
        if plan.chance(0.25):
            limb = painted(limb, plan.accent, y=(0.62 * hub[1], 0.74 * hub[1]))
        left.append(limb)
    left += motors(plan, drop, plan.pick(rgb, dark))
    left += lights(plan, drop + 2)  # within the motor's seat
    if plan.chance(0.14):
        left += guards(plan, drop)
    legs = plan.pick(rgb, rgb, dark, BLACK)
    thick = plan.draw(0.008, 0.016) * 300
    y = plan.draw(0.9, 1.5) * half
    kind = plan.rng.random()
    if kind < 0.65:
        span = plan.draw(0.3, 0.45) * (x[1] - x[0])
        left += landing_loop(
            plan, (-span, span), (0.4 * span, 0.55 * half, bottom + 0.25 * high), y, thick, legs
        )
    elif kind < 0.85:
        left += landing_skid(
            plan, (0, 0.5 * half, bottom + 0.3 * high), y, thick, legs, plan.draw(0.8, 1.2) * 2 * reach
        )
    else:
        for hub in (plan.front, plan.rear):
            left.append(
                leg(hub, drop + 0.3 * tall, (plan.ground, 0, 0), (2 * thick, 1.2 * thick), thick, legs)
            )
    if plan.chance(0.2):
        at = (0.3 * x[0], 0, skin(body, 0.3 * x[0]) - 2)
        middle += plan.whole(dome(plan, at, 0.4 * half, 1, plan.pick(rgb, dark)))
    return middle, left
