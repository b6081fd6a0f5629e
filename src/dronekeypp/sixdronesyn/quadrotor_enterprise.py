"""This module builds the random quadrotors that work: boxes with tube arms, batteries and antennas.

Lengths are design millimetres (see quadrotor_plan.py). The builder returns the parts on the middle plane and
those to the left, like airframes.py.
"""

import numpy as np

from dronekeypp.sixdronesyn.fittings import BLACK, GREEN, leg, shade
from dronekeypp.sixdronesyn.quadrotor_extras import (
    CARBON,
    box,
    dome,
    gimbal_camera,
    landing_loop,
    landing_skid,
    lights,
    motors,
    nose_camera,
    rod,
    skin,
    sticker,
)
from dronekeypp.sixdronesyn.quadrotor_hulls import fuselage
from dronekeypp.sixdronesyn.quadrotor_plan import DESIGN, Plan, Sides, tube
from dronekeypp.sixdronesyn.shapes import beam, block, on_surface, painted


def enterprise(plan: Plan) -> Sides:
    """Build a working drone: a box of a hull, tube arms, tall legs, batteries and antennas."""
    rgb, dark = plan.hull, plan.trim
    reach = 0.5 * (plan.front[0] - plan.rear[0])
    x = (-plan.draw(0.6, 0.95) * reach, plan.draw(0.65, 1.0) * reach)
    half = plan.draw(0.1, 0.16) * 300
    high = plan.draw(0.14, 0.22) * 300
    free = plan.free_half(x)
    top = min(plan.roof(x, half), plan.low + plan.draw(0.0, 25.0))
    bottom = max(top - high, plan.ground + 0.3 * plan.height)
    bottom = min(bottom, top - 26)
    high = top - bottom
    body = fuselage(plan, x, half, (bottom, top), plan.draw(0.1, 0.35), plan.draw(0.0, 0.6))
    if plan.chance(0.6):
        body = painted(body, dark, x=(x[1] - plan.draw(0.15, 0.3) * (x[1] - x[0]), x[1] + 9))
    if plan.chance(0.5):
        body = sticker(plan, body, x, half, (bottom + 0.5 * high, top + 9))
    middle = [body]
    size = plan.draw(0.4, 0.62) * half
    at = plan.draw(0.6, 1.0) * x[1]
    middle += gimbal_camera(plan, at, bottom + 0.2 * high, plan.ground + 6, size, body)
    middle += nose_camera(plan, body, bottom + 0.6 * high, 0.2 * half, 0.0, BLACK)
    case = plan.pick(dark, shade(rgb, 0.8), plan.grey(40, 80))
    left = []
    if plan.chance(0.7):  # two batteries let into the back
        at = (0.72 * x[0], 0.42 * half, bottom + 0.55 * high)
        left += box(plan, at, (0.34 * (x[1] - x[0]) * 0.8, 0.36 * half, 0.42 * high), case)
    if plan.chance(0.5):  # a case below the belly
        deep = min(plan.draw(8, 22), 0.5 * (bottom - plan.ground) - 3)
        if deep > 4:
            at = (0.3 * x[0], 0, skin(body, 0.3 * x[0], up=-1.0) - deep + 3)
            middle += box(plan, at, (plan.draw(20, 38), 0.7 * half, deep), case)
    # what stands on the roof stays within the room that the discs leave
    spot = 0.45 * x[0]
    room = min(plan.free_half((spot - 12, spot + 12)), 0.8 * half)
    kind = plan.rng.random()
    if kind < 0.35 and room > 12:
        radius, mast = min(room, plan.draw(12, 20)), plan.draw(0, 45)
        colour = plan.pick(rgb, dark, plan.grey(220, 250))
        middle += plan.whole(dome(plan, (spot, 0, skin(body, spot) - 2), radius, mast, colour))
    elif kind < 0.6 and room > 16:
        at = (spot, 0.55 * room, skin(body, spot, 0.55 * room) - 2)
        left += plan.whole(dome(plan, at, 0.4 * room, plan.draw(10, 40), plan.pick(rgb, dark)))
    if free > 8 and plan.chance(0.3):
        size = (plan.draw(8, 16), 0.6 * min(free, half), plan.draw(5, 9))
        roof = min(skin(body, 0.25 * x[1] - size[0]), skin(body, 0.25 * x[1] + size[0]))
        middle += plan.whole(box(plan, (0.25 * x[1], 0, roof + 3), size, case))
    drop = plan.motor * plan.draw(1.2, 1.7)
    radius = plan.draw(0.018, 0.028) * 300
    front_rgb = plan.pick(CARBON, dark, rgb)
    rear_rgb = plan.pick(front_rgb, front_rgb, plan.accent)
    level = min(bottom + plan.draw(0.4, 0.7) * high, plan.low - drop - radius)
    for hub, end, colour in ((plan.front, x[1], front_rgb), (plan.rear, x[0], rear_rgb)):
        root = np.array([0.7 * end, 0.7 * half, level])
        tip = hub - (0, 0, drop + 0.6 * radius)
        left.append(tube(root, tip + 0.02 * (tip - root), radius, colour))
        knee = root + 0.16 * (tip - root)
        left.append(
            beam([root, knee], [(1.9 * radius, 1.5 * radius), (1.5 * radius, 1.3 * radius)], dark, along=4)
        )
    left += motors(plan, drop, plan.pick(dark, BLACK, rgb))
    left += lights(plan, drop)
    thick = plan.draw(0.01, 0.016) * 300
    legs = plan.pick(CARBON, dark, rgb)
    kind = plan.rng.random()
    if kind < 0.45:
        y = plan.draw(1.1, 1.6) * half
        left += landing_skid(
            plan, (0, 0.6 * half, bottom + 0.25 * high), y, thick, legs, plan.draw(0.9, 1.3) * 2 * reach
        )
    elif kind < 0.7:
        span = 0.4 * (x[1] - x[0])
        left += landing_loop(
            plan, (-span, span), (0.3 * span, 0.6 * half, bottom + 0.25 * high), 1.3 * half, thick, legs
        )
    else:
        for hub in (plan.front, plan.rear):
            foot = (plan.ground, 0, plan.draw(0, 8))
            left.append(leg(hub, drop + 0.5 * radius, foot, (2.2 * thick, 1.4 * thick), thick, legs))
    if plan.chance(0.4):
        for hub in (plan.front, plan.rear):
            foot = hub - (np.sign(hub[0]) * 0.2 * plan.motor, 0.6 * plan.motor, drop + 0.6 * radius)
            left += rod(plan, foot, (0, 0.1, -1), plan.draw(20, 36), 2.2, BLACK)
    if plan.chance(0.3):
        at, _ = on_surface(body, (DESIGN, 0.5 * half, bottom + 0.5 * high), (-1, 0, 0))
        left.append(block(at, (1.5, 4, 2), GREEN, around=8))
    return middle, left
