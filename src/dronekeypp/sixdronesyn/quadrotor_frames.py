"""This module builds the random quadrotors on open frames: racers, and plates with long arms.

Lengths are design millimetres (see quadrotor_plan.py). Each builder returns the parts on the middle plane and
those to the left, like airframes.py.
"""

from collections.abc import Sequence

import numpy as np

from dronekeypp.sixdronesyn.fittings import BLACK, RED, WHITE, arm, leg, shade
from dronekeypp.sixdronesyn.quadrotor_extras import (
    CARBON,
    action_camera,
    battery,
    box,
    dome,
    fixed_camera,
    gimbal_camera,
    landing_skid,
    lights,
    motors,
    rod,
)
from dronekeypp.sixdronesyn.quadrotor_plan import Plan, Sides, plate, rounded, tube
from dronekeypp.sixdronesyn.shapes import RGB, Part, beam, block, hull, lathe, painted

BOARD = (26, 66, 44)  # of a circuit


def _flat_arm(root: np.ndarray, hub: np.ndarray, level: float, wide: float, thick: float, rgb: RGB) -> Part:
    """Build an arm cut from a plate, from `root` to under the hub, its middle at height `level`."""
    start, end = np.array([root[0], root[1], level]), np.array([hub[0], hub[1], level])
    outward = (end - start) / np.linalg.norm(end - start)
    path = [start, start + 0.5 * (end - start), end + 0.9 * wide * outward]
    sizes = [(1.3 * wide, thick), (wide, thick), (wide, thick)]
    return beam(path, sizes, rgb, along=5, around=8, exponent=6.0, round_end=0.2)


def racer(plan: Plan) -> Sides:
    """Build a racer: arms and plates of carbon, a battery under a strap, a camera that looks up."""
    carbon = plan.grey(24, 52) if plan.chance(0.85) else plan.pick(shade(plan.hull, 0.6), plan.grey(60, 120))
    colour = plan.accent if plan.chance(0.5) else plan.hull
    thick = plan.draw(2.4, 3.8)
    drop = min(plan.low - plan.ground - 2.5 * thick, plan.motor * plan.draw(1.35, 1.9))
    level = plan.low - drop - thick
    reach = 0.5 * (plan.front[0] - plan.rear[0])
    x = (-plan.draw(0.6, 1.05) * reach, plan.draw(0.6, 1.0) * reach)
    x, half = plan.narrowed(x, plan.draw(15, 27))
    rear, front = x
    floor = level + thick
    rise = plan.draw(22, 34)  # between the plates
    corner = plan.draw(0.2, 0.7) * half
    outline = rounded(x, half, corner, waist=plan.draw(0.7, 1.1))
    middle = [plate(outline, (floor, floor + 3.4), carbon)]
    left = []
    roof = floor + rise
    open_frame = plan.chance(0.75)
    if open_frame:
        middle.append(plate(outline, (roof, roof + 3), carbon))
        post = plan.pick(colour, CARBON, (170, 40, 40), (150, 152, 156))
        for place in (0.88, 0.3, -0.3, -0.88):
            at = 0.5 * (front + rear) + place * 0.5 * (front - rear)
            left.append(tube((at, 0.72 * half, floor), (at, 0.72 * half, roof + 1), 2.4, post, around=6))
        boards = plan.draw(0.45, 0.7) * rise
        middle.append(
            block((0.1 * rear, 0, floor + 0.5 * boards), (0.75 * half, 0.68 * half, 0.42 * boards), BOARD)
        )
        middle.append(
            block((0.1 * rear, 0, floor + 0.62 * boards), (0.5 * half, 0.74 * half, 0.2 * boards), CARBON)
        )
    else:  # a canopy covers all
        rows = [
            (rear, 0.5 * half, floor, floor + 2, floor + 0.5 * rise, 4, 3),
            (rear + 4, 0.8 * half, floor, floor + 3, floor + 0.75 * rise, 4, 3),
            (0.0, half, floor, floor + 5, roof + 3, 4, 2.6),
            (0.6 * front, 0.9 * half, floor, floor + 5, floor + 0.95 * rise, 4, 2.6),
            (front, 0.7 * half, floor, floor + 4, floor + 0.5 * rise, 4, 3),
        ]
        canopy = hull(rows, colour, rings=14, around=18, gloss=0.5)
        if plan.chance(0.6):
            canopy = painted(
                canopy, plan.pick(WHITE, BLACK, plan.accent), y=(-0.25 * half, 0.25 * half), z=(floor, 999)
            )
        middle.append(canopy)
    # the camera between the cheeks of its cage, which stand on the lower plate
    size = plan.draw(0.36, 0.5) * half + 2
    up = plan.draw(0.2, 0.7)
    middle += fixed_camera(
        plan, (front - 0.3 * size, 0, floor + 0.5 * rise), size, up, plan.pick(BLACK, colour)
    )
    cage = plan.pick(carbon, carbon, colour)
    left.append(
        block(
            (front - 2, size + 1.0, floor + 0.5 * rise), (0.9 * size + 4, 1.5, 0.48 * rise), cage, around=12
        )
    )
    if open_frame:  # else it is under the canopy
        middle += _racer_battery(plan, x, half, level - thick, roof + 3)
    # what sits at the rear
    kind = plan.rng.random()
    mount = (rear + 4, 0.0, floor + 2.0)  # in the lower plate
    if kind < 0.5:
        pod = plan.draw(5, 8) if plan.chance(0.6) else 0.0
        rgb = plan.pick(BLACK, colour, WHITE)
        middle += rod(plan, mount, (-plan.draw(0.3, 1.2), 0, 1), plan.draw(35, 60), 2.0, rgb, pod)
    elif kind < 0.8:
        lean = (-1, plan.draw(0.4, 1.0), plan.draw(0.3, 1.0))
        side = min(0.5 * half, half - corner)
        left += rod(plan, (rear + 4, side, mount[2]), lean, plan.draw(35, 55), 1.7, BLACK)
    if plan.chance(0.3):
        receiver = dome(
            plan, (rear - 4, 0, floor + 0.7 * rise), 9.0, 0.0, plan.pick(BLACK, plan.grey(180, 230))
        )
        foot = 0.35 * rise + 0.5  # half the height of what it stands on
        receiver.append(block((rear, 0, floor + foot), (8, 6, foot), colour))
        middle += plan.whole(receiver)
    if plan.chance(0.45):
        glow = plan.pick(RED, (255, 120, 20), (60, 160, 255), (60, 240, 120))
        middle.append(block((rear - 1.0, 0, floor + 4.0), (1.6, 0.7 * half, 3.2), glow, around=10))

    wide = plan.draw(7.0, 11.5)
    inset = plan.draw(0.15, 0.8)  # how far apart the arms leave the body: an X or an H
    front_rgb = carbon
    rear_rgb = colour if plan.chance(0.12) else carbon
    for hub, end, rgb in ((plan.front, front, front_rgb), (plan.rear, rear, rear_rgb)):
        root = np.array([0.8 * inset * end, 0.35 * half, 0])
        limb = _flat_arm(root, hub, level, wide, thick, rgb)
        if plan.chance(0.35):  # a sleeve, a controller or tape on the arm
            low = plan.draw(0.45, 0.62) * hub[1]
            limb = painted(limb, plan.pick(colour, RED, plan.accent), y=(low, low + 0.16 * hub[1]))
        left.append(limb)
        pad = [(1.1 * plan.motor, -thick), (1.15 * plan.motor, 0), (1.1 * plan.motor, thick)]
        left.append(lathe(pad, rgb, (hub[0], hub[1], level), segments=14))
        foot = level - thick - plan.ground
        if foot > 3:
            left.append(
                tube((hub[0], hub[1], level), (hub[0], hub[1], plan.ground + 1), 3.5, colour, around=6)
            )
    left += motors(plan, drop - 2, plan.pick(BLACK, colour, (120, 122, 126)))
    return middle, left


def _racer_battery(plan: Plan, x: tuple[float, float], half: float, below: float, above: float) -> list[Part]:
    """Build the battery of a racer on its roof at `above`, or under its belly at `below` if there is room."""
    rear, front = x
    long = plan.draw(0.55, 0.8) * 0.5 * (front - rear)
    middle = plan.draw(-0.25, 0.05) * (front - rear) + 0.5 * (front + rear)
    tall = plan.draw(9, 15)
    if below - plan.ground > 12 and plan.chance(0.5):
        tall = 0.5 * (below - plan.ground)
        return battery(plan, (middle, 0, below - tall + 0.5), (long, 0.9 * half, tall))
    wide = min(0.95 * half, plan.free_half((middle - long, middle + long)))
    parts = battery(plan, (middle, 0, above + tall - 0.5), (long, wide, tall))
    if plan.chance(0.3):
        start = (middle + 0.55 * long, 0, above + 2 * tall - 2)
        parts += action_camera(plan, start, min(15.0, wide), plan.draw(0.1, 0.5))
    return parts


def plates(plan: Plan) -> Sides:
    """Build two plates with round or moulded arms between them, and what a workshop puts on such a frame."""
    drop = plan.motor * plan.draw(1.3, 1.9)
    carbon = plan.grey(26, 54)
    base = plan.pick(carbon, carbon, plan.hull, WHITE, plan.grey(90, 200))
    thick = plan.draw(5.5, 8.5)  # of an arm, half of it
    moulded = plan.chance(0.35)
    level = plan.low - drop - thick
    size = plan.draw(0.13, 0.2) * 300
    stretch = plan.draw(0.9, 1.45)
    corner = plan.draw(0.25, 0.75) * size
    x = (-stretch * size, stretch * size)
    outline = rounded(x, size, corner, waist=plan.draw(0.75, 1.12))
    grip = (1.0 if moulded else 0.8) * thick - 0.4  # the plates clamp the arms, which are that high
    top, bottom = level + grip, level - grip
    middle = [plate(outline, (top, top + 3), base), plate(outline, (bottom - 3, bottom), base)]
    left = []
    limbs = []  # the middle lines of the arms
    # arms: the front pair often has another colour, so that the pilot knows which way it looks
    front_rgb = plan.pick(plan.hull, carbon, plan.accent, WHITE, RED)
    rear_rgb = plan.pick(carbon, plan.trim, WHITE) if plan.chance(0.7) else front_rgb
    for hub, end, rgb in ((plan.front, x[1], front_rgb), (plan.rear, x[0], rear_rgb)):
        start = np.array([0.5 * end, 0.45 * size, level])
        tip = np.array([hub[0], hub[1], hub[2] - drop - thick])
        limbs.append((start, tip))
        if moulded:
            sizes = [(1.5 * thick, 1.0 * thick), (0.9 * thick, 1.15 * thick), (1.0 * thick, 0.9 * thick)]
            limb = arm(start, hub, drop + thick, sizes, rgb, (0.5, 0.5, 0.5))
        else:
            limb = tube(start, tip + 0.03 * (tip - start), 0.8 * thick, rgb, around=10)
            seat = [
                (0.9 * plan.motor, -1.1 * thick),
                (1.1 * plan.motor, -0.7 * thick),
                (1.1 * plan.motor, 1.02 * thick),
            ]
            left.append(lathe(seat, carbon, tip, segments=12))
        if plan.chance(0.3):
            limb = painted(limb, plan.accent, y=(0.7 * hub[1], 0.8 * hub[1]))
        left.append(limb)
    left += motors(plan, drop, plan.pick(BLACK, carbon, plan.hull))
    if plan.chance(0.6):
        left += lights(plan, drop + 2 if moulded else drop + thick)
    middle += _on_top(plan, x, size, top + 3)
    camera = front_rgb == rear_rgb or plan.chance(0.75)
    below, legs = _below(plan, x, size, (bottom - 3, top + 3), limbs, camera)
    return middle + below, left + legs


def _on_top(plan: Plan, x: tuple[float, float], size: float, z: float) -> list[Part]:
    """Build what stands on the upper plate: a dome-shaped cover or a battery, a receiver, a mast, a rod."""
    parts = []
    kind = plan.rng.random()
    long = plan.draw(0.6, 0.85) * 0.5 * (x[1] - x[0])
    wide = min(plan.draw(0.5, 0.8) * size, plan.free_half((-long, long)))
    roof = plan.roof((-long, long), wide)
    high = min(plan.draw(18, 34), roof - z)
    if kind < 0.4 and high > 8:
        rows = [
            (-long, 0.5 * wide, z - 1, z, z + 0.4 * high, 4, 2.6),
            (-0.9 * long, 0.75 * wide, z - 1, z + 1, z + 0.6 * high, 4, 2.6),
            (-0.2 * long, wide, z - 1, z + 2, z + high, 4, 2.4),
            (0.5 * long, 0.9 * wide, z - 1, z + 2, z + 0.85 * high, 4, 2.4),
            (long, 0.5 * wide, z - 1, z + 1, z + 0.3 * high, 4, 2.6),
        ]
        cover = hull(rows, plan.hull, rings=14, around=20, gloss=0.55)
        if plan.chance(0.6):
            cover = painted(cover, plan.accent, y=(-0.22 * wide, 0.22 * wide), z=(z + 2, 999))
        parts.append(cover)
    elif kind < 0.8 and high > 8 and wide > 9:
        parts += battery(plan, (0.0, 0, z + 0.45 * high - 0.5), (0.9 * long, min(wide, 22), 0.45 * high))
    else:
        parts += box(plan, (0, 0, z + 4.5), (16, 13, 5), plan.pick(BLACK, plan.hull, plan.grey(180, 230)))
        parts.append(block((0.55 * x[0], 0, z + 3), (9, 7, 3.5), BOARD))
    if plan.chance(0.6):
        foot = 0.8 * x[0]
        mast = plan.draw(18, 60)
        room = min(plan.free_half((foot - 14, foot + 14)), 14.0)
        if room > 7:
            rgb = plan.pick(BLACK, plan.hull, plan.grey(210, 245))
            parts += plan.whole(dome(plan, (foot, 0, z), room, mast, rgb))
    elif plan.chance(0.4):
        parts += rod(plan, (0.9 * x[0], 0.3 * size, z - 1.5), (-0.5, 0.2, 1), plan.draw(30, 60), 1.8, BLACK)
    return parts


def _below(
    plan: Plan,
    x: tuple[float, float],
    size: float,
    heights: tuple[float, float],
    limbs: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: bool,
) -> Sides:
    """Build what hangs below the lower plate, middle and left: legs, a battery or a box, a camera.

    `heights` are the lowest and the highest z of the plates, `limbs` where the left arms begin and end.
    """
    z, top = heights
    room = z - plan.ground
    middle, legs = [], []
    kind = plan.rng.random()
    colour = plan.pick(CARBON, CARBON, plan.hull, plan.accent)
    bar = plan.draw(0.008, 0.014) * 300
    if room < 30 or kind < 0.35:
        for start, tip in limbs:
            spot = start + plan.draw(0.62, 0.8) * (tip - start)
            legs.append(leg(spot, 0, (plan.ground, 0, 2), (9, 4), 3.2, colour))
    elif kind < 0.7:
        y = plan.draw(0.9, 1.7) * size
        legs += landing_skid(plan, (0, 0.6 * size, z + 2), y, bar, colour, plan.draw(0.8, 1.3) * 180)
    else:
        for end in x:
            legs.append(
                tube((0.6 * end, 0.5 * size, z + 2), (1.1 * end, 1.5 * size, plan.ground + bar), bar, colour)
            )
            legs.append(
                lathe(
                    [(1.5 * bar, -bar), (1.6 * bar, bar)], BLACK, (1.1 * end, 1.5 * size, plan.ground + bar)
                )
            )
    deep = min(plan.draw(8, 15), 0.5 * room - 3)
    if deep > 5 and plan.chance(0.55):
        at = (plan.draw(-0.35, 0.0) * x[1], 0, z - deep + 1)
        if plan.chance(0.6):
            middle += battery(plan, at, (0.7 * x[1], min(20, 0.7 * size), deep))
        else:
            middle += box(plan, at, (0.6 * x[1], 0.6 * size, deep), plan.pick(plan.hull, plan.grey(40, 90)))
    wide = plan.draw(10, 17)
    if camera and room > 30 and plan.chance(0.7):
        middle += gimbal_camera(plan, x[1] - 4, z + 1, plan.ground + 5, wide)
    elif camera:
        # let into the gap between the plates, and at least as high
        half = max(0.5 * wide, 0.5 * (top - z) - 2)
        at = (x[1] - 0.3 * half, 0, 0.5 * (z + top))
        middle += fixed_camera(plan, at, half, plan.draw(-0.2, 0.3), BLACK)
    return middle, legs
