"""This module builds the small random quadrotors: toys on thin legs, and those with ducts.

Lengths are design millimetres (see quadrotor_plan.py). Each builder returns the parts on the middle plane and
those to the left, like airframes.py.
"""

import numpy as np

from dronekeypp.sixdronesyn.fittings import BLACK, RED, WHITE, arm, eye, leg, shade
from dronekeypp.sixdronesyn.quadrotor_extras import (
    CARBON,
    action_camera,
    battery,
    fixed_camera,
    gimbal_camera,
    guards,
    lights,
    motors,
    nose_camera,
    rod,
    skin,
    sticker,
)
from dronekeypp.sixdronesyn.quadrotor_hulls import fuselage
from dronekeypp.sixdronesyn.quadrotor_plan import Plan, Sides, plate, ring, rounded, tube
from dronekeypp.sixdronesyn.shapes import Part, beam, block, painted


def toy(plan: Plan) -> Sides:
    """Build a small moulded drone on thin legs, its canopy in a bright colour."""
    rgb, dark = plan.hull, plan.trim
    reach = 0.5 * (plan.front[0] - plan.rear[0])
    x = (-plan.draw(0.45, 0.95) * reach, plan.draw(0.5, 1.0) * reach)
    half = plan.draw(0.11, 0.19) * 300
    if plan.chance(0.5):  # a tall canopy beside the discs, else a low one below them
        x, half = plan.narrowed(x, half)
    drop = plan.motor * plan.draw(2.0, 3.2)
    bottom = plan.ground + plan.draw(0.1, 0.35) * plan.height
    roof = plan.roof(x, half)
    top = min(roof, bottom + plan.draw(0.55, 0.85) * plan.height)
    top = max(top, bottom + 20) if roof > bottom + 20 else roof
    high = top - bottom
    body = fuselage(plan, x, half, (bottom, top), plan.draw(0.05, 0.4), plan.draw(0.4, 1.0))
    if plan.chance(0.75):
        body = painted(body, dark, z=(bottom - 9, bottom + plan.draw(0.25, 0.5) * high))
    if plan.chance(0.6):
        body = sticker(plan, body, x, half, (bottom + 0.5 * high, top + 9))
    window = plan.chance(0.6)
    if window:  # in front
        low = bottom + plan.draw(0.4, 0.6) * high
        body = painted(
            body,
            plan.pick(BLACK, dark, plan.accent),
            x=(x[1] - 0.25 * (x[1] - x[0]), x[1] + 9),
            z=(low, low + 0.28 * high),
        )
    middle = [body]
    if not window or plan.chance(0.5):
        size = plan.draw(0.2, 0.34) * half
        middle += nose_camera(plan, body, bottom + 0.4 * high, size, plan.draw(-0.3, 0.2), dark)
    wide = plan.draw(0.018, 0.034) * 300
    left = []
    front_rgb = plan.pick(dark, rgb, BLACK)
    rear_rgb = plan.pick(front_rgb, front_rgb, plan.accent)
    for hub, end, colour in ((plan.front, x[1], front_rgb), (plan.rear, x[0], rear_rgb)):
        level = min(bottom + 0.45 * high, hub[2] - drop)
        sizes = [(1.8 * wide, 1.1 * wide), (wide, 0.8 * wide), (0.9 * wide, 0.7 * wide)]
        left.append(arm((0.4 * end, 0.5 * half, level), hub, drop, sizes, colour, (0.5, 0.55, 0.5)))
        foot = (plan.ground, 0, plan.draw(0, 4))
        left.append(leg(hub, drop + 2, foot, (wide, 0.6 * wide), 0.4 * wide, colour))
    left += motors(plan, drop, plan.pick(dark, rgb, plan.accent))
    left += lights(plan, 0.9 * drop)
    if plan.chance(0.6):
        left += guards(plan, drop, min(plan.spare, 16.0))
    if plan.chance(0.3):
        foot = (0.6 * x[0], 0.3 * half, skin(body, 0.6 * x[0], 0.3 * half) - 1)
        left += rod(plan, foot, (-0.4, 0.1, 1), 0.6 * high, 1.4, BLACK)
    return middle, left


def ducted(plan: Plan) -> Sides:
    """Build a drone with a duct around every propeller, its body between them."""
    spare = plan.spare
    drop = plan.motor * plan.draw(1.2, 1.8)
    inner = plan.radius + plan.draw(2.0, 3.2)
    outer = plan.radius + spare + plan.draw(-0.25, 0.1) * spare
    wall = min(plan.draw(2.0, 7.0), outer - inner)
    tall = plan.draw(0.05, 0.15) * 300
    above = plan.draw(-0.1, 0.45) * tall
    rgb = plan.pick(plan.hull, plan.trim, plan.accent, BLACK, plan.grey(200, 245))
    rear_rgb = plan.pick(rgb, rgb, rgb, plan.accent, plan.trim)
    lip = plan.draw(0.0, 0.8) * (outer - inner - wall)
    left = []
    reach = 0.5 * (plan.front[0] - plan.rear[0])
    for hub, colour in ((plan.front, rgb), (plan.rear, rear_rgb)):
        low, high = above - tall, above
        profile = [(inner, low), (inner + wall, low), (inner + wall, high - 0.3 * tall)]
        profile += [(inner + wall + lip, high - 1.5), (inner + wall + lip, high), (inner, high)]
        left.append(ring(hub, profile, colour, segments=36, gloss=plan.draw(0.2, 0.5)))
        count = 3 if plan.chance(0.5) else 4
        start = np.arctan2(hub[1], hub[0]) + np.pi / count
        bottom = -drop - 1.5
        for k in range(count):
            angle = start + k * 2 * np.pi / count
            end = (
                hub
                + (inner + 0.5 * wall) * np.array([np.cos(angle), np.sin(angle), 0])
                + (0, 0, max(bottom, low + 2))
            )
            base = hub + (0, 0, bottom)
            left.append(beam([base, end], [(3.4, 2.4), (2.4, 1.8)], colour, along=2, around=6, round_end=0.1))
    left += motors(plan, drop, plan.pick(BLACK, plan.trim, rgb))
    base = plan.low - drop - 3
    x = (-plan.draw(0.4, 0.85) * reach, plan.draw(0.4, 0.9) * reach)
    kind = plan.rng.random()
    if kind < 0.4:
        middle = _canopy(plan, x, base)
    elif kind < 0.7:
        middle = _deck(plan, x, base)
    else:
        middle, more = _pod(plan, x, base)
        left += more
    # beams that meet below the middle of the body carry the motors and the ducts
    colour = plan.pick(rgb, CARBON, plan.trim)
    for hub in (plan.front, plan.rear):
        start, end = (
            np.array([0.08 * hub[0], 0.05 * hub[1], base]),
            np.array([hub[0], hub[1], hub[2] - drop - 3]),
        )
        left.append(beam([start, end], [(8, 2.6), (6.5, 2.4)], colour, along=3, around=8, exponent=5))
        foot = hub - (0, 0, drop + 5)
        if foot[2] - plan.ground > 3:
            left.append(tube(foot, (hub[0], hub[1], plan.ground + 0.4), 4.0, colour, around=8))
    if plan.chance(0.35):
        left += lights(plan, drop)
    return middle, left


def _under(plan: Plan, base: float) -> list[Part]:
    """Build the battery below the deck at `base`; the drone stands on it."""
    tall = 0.5 * (base - plan.ground) + 0.5
    if tall < 3:
        return []
    return battery(
        plan, (plan.draw(-12, 4), 0, plan.ground + tall), (plan.draw(26, 48), plan.draw(12, 18), tall)
    )


def _canopy(plan: Plan, x: tuple[float, float], base: float) -> list[Part]:
    """Build a whoop: a canopy over the board, a camera that looks out of it, a battery below."""
    x, half = plan.narrowed(x, plan.draw(18, 32))
    top = base + plan.draw(0.12, 0.2) * 300
    body = fuselage(plan, x, half, (base - 3, top), plan.draw(0.1, 0.3), plan.draw(0.6, 1.0))
    if plan.chance(0.7):
        body = sticker(plan, body, x, half, (base + 0.4 * (top - base), 999))
    size = plan.draw(0.26, 0.42) * half
    lift = plan.draw(0.1, 0.6)
    level = base + 0.45 * (top - base)
    parts = [body, *nose_camera(plan, body, level, size, lift, plan.pick(BLACK, plan.trim))]
    parts += _under(plan, base - 2)
    if plan.chance(0.5):
        foot = (0.8 * x[0], 0, skin(body, 0.8 * x[0]) - 1)
        parts += rod(plan, foot, (-0.6, 0, 1), plan.draw(20, 40), 1.6, BLACK)
    return parts


def _deck(plan: Plan, x: tuple[float, float], base: float) -> list[Part]:
    """Build a carbon deck between the ducts, with a battery and a camera on top."""
    x, half = plan.narrowed(x, plan.draw(20, 32))
    outline = rounded(x, half, 0.5 * half)
    rise = plan.draw(20, 30)
    carbon = plan.grey(24, 50)
    parts = [
        plate(outline, (base - 2, base + 2), carbon),
        plate(outline, (base + rise, base + rise + 3), carbon),
    ]
    # the boards reach from the rear to the back of the camera
    size = plan.draw(0.3, 0.45) * half
    rear, front = -0.7 * x[1], x[1] - 1 - 0.3 * size
    boards = (0.5 * (front - rear), 0.6 * half, 0.5 * rise + 0.5)
    rgb = plan.pick(CARBON, plan.accent)
    parts.append(block((0.5 * (rear + front), 0, base + 0.5 * rise), boards, rgb))
    parts += fixed_camera(plan, (x[1] - 1, 0, base + 0.5 * rise), size, plan.draw(0.0, 0.4), BLACK)
    top = base + rise + 2.5
    wide = min(0.8 * half, 18)
    parts += battery(plan, (0.3 * x[0], 0, top + 11), (0.6 * x[1], wide, 11))
    if plan.chance(0.6):
        parts += action_camera(plan, (0.72 * x[1], 0, top), min(13.0, wide), plan.draw(0.0, 0.4))
    if plan.chance(0.6):
        parts += rod(
            plan,
            (x[0] + 2, 0, base + rise + 1.5),
            (-0.8, 0, 1),
            plan.draw(25, 45),
            1.8,
            plan.pick(BLACK, WHITE, RED),
        )
    return parts


def _pod(plan: Plan, x: tuple[float, float], base: float) -> Sides:
    """Build a moulded body with the battery in its tail and a camera on a gimbal in its nose."""
    x, half = plan.narrowed(x, plan.draw(22, 36))
    bottom = max(plan.ground + 1, base - plan.draw(16, 30))
    top = base + plan.draw(14, 36)
    high = top - bottom
    bay = plan.draw(0.3, 0.55)
    body = fuselage(plan, x, half, (bottom, top), bay, plan.draw(0.2, 0.8))
    dark = plan.pick(plan.trim, shade(plan.hull, 0.6))
    body = painted(body, dark, x=(x[0] - 9, x[0] + plan.draw(0.25, 0.45) * (x[1] - x[0])))
    if plan.chance(0.7):
        body = painted(
            body,
            BLACK,
            x=(0.8 * x[1], x[1] + 9),
            z=(bottom + (bay + 0.12) * high, bottom + (bay + 0.3) * high),
        )
    size = plan.draw(0.36, 0.5) * half
    middle = [body, *gimbal_camera(plan, x[1], bottom + (bay + 0.06) * high, bottom + 1, size, body)]
    left = []
    if plan.chance(0.5):
        left += eye(body, (0.5 * x[0], 0.3 * half, bottom + 0.5 * high), (-1, 0.2, 0.2), 0.14 * half)
    if bottom - plan.ground > 3:
        left.append(
            block(
                (0, 0.5 * half, 0.5 * (bottom + plan.ground) + 1),
                (0.5 * x[1], 2.5, 0.5 * (bottom - plan.ground) + 1),
                dark,
            )
        )
    return middle, left
