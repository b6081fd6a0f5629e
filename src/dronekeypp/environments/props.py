"""Small man-made things built from bars and wires: lamps, fences, power lines, masts, cranes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dronekeypp.environments.specs import Colour
from dronekeypp.environments.things import Lines, Thing

Bar = tuple[list[float], list[float]]  # two ends: forward, left, up, in metres


def along_line(heading: float, along: float, offset: float) -> tuple[float, float]:
    """Return a position x, y: `along` metres along a heading in radians and `offset` metres to its left."""
    c, s = np.cos(heading), np.sin(heading)
    return along * c - offset * s, along * s + offset * c


def to_world(points: np.ndarray | list, x: float, y: float, heading: float) -> np.ndarray:
    """Move local points (n, 3), forward, left and up, to a place x, y with this heading in radians."""
    points = np.asarray(points, float)
    c, s = np.cos(heading), np.sin(heading)
    world = points.copy()
    world[:, 0] = x + points[:, 0] * c - points[:, 1] * s
    world[:, 1] = y + points[:, 0] * s + points[:, 1] * c
    return world


def lamp(x: float, y: float, heading: float, height: float = 8.0, glow: float = 0.0) -> list[Thing]:
    """Make a street lamp: a tapering mast, an arm along `heading` (radians) and a head of radiance `glow`."""
    foot = np.array([x, y, 0.0])
    top = np.array([x, y, height])
    arm = top + np.array([np.cos(heading), np.sin(heading), 0.12]) * 1.4
    tip = arm + np.array([np.cos(heading), np.sin(heading), 0]) * 0.6
    middle = (top + foot) / 2
    mast = np.array([(foot, middle), (middle, top), (top, arm)])
    bars = Lines(mast, np.array([0.17, 0.12, 0.07]), (0.30, 0.31, 0.31))
    light = (glow, glow * 0.8, glow * 0.5)
    head = Lines(np.array([(arm, tip)]), np.array([0.16]), (0.35, 0.35, 0.35), light)
    return [bars, head]


@dataclass(frozen=True)
class FenceStyle:
    """How a fence is built.

    Attributes:
        pitch: metres from post to post.
        colour: albedo.
        post, rail: thickness in metres.
        levels: heights of the rails or wires, as shares of the fence's height.
    """

    pitch: float
    colour: Colour
    post: float
    rail: float
    levels: tuple[float, ...]


FENCES: dict[str, FenceStyle] = {
    "posts": FenceStyle(2.4, (0.17, 0.13, 0.095), 0.10, 0.06, (0.55, 0.92)),
    "mesh": FenceStyle(3.0, (0.26, 0.27, 0.27), 0.06, 0.012, tuple(np.linspace(0.06, 1, 9))),
}


def fence(
    start: tuple[float, float], end: tuple[float, float], height: float = 1.2, style: str = "posts"
) -> list[Thing]:
    """Make a fence between two ground positions in metres.

    style: "posts" (wood posts and two rails) or "mesh" (posts and wires).
    """
    kind = FENCES[style]
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.hypot(*(end - start)))
    count = max(2, int(length / kind.pitch) + 1)
    feet = start + (end - start) * np.linspace(0, 1, count)[:, None]
    ends, widths = [], []
    for x, y in feet:
        ends.append(([x, y, 0.0], [x, y, height]))
        widths.append(kind.post)
    for (x0, y0), (x1, y1) in zip(feet[:-1], feet[1:], strict=True):
        for level in kind.levels:
            ends.append(([x0, y0, height * level], [x1, y1, height * level]))
            widths.append(kind.rail)
    ends, widths = np.array(ends, float), np.array(widths)
    middle = (ends[:, 0] + ends[:, 1])[:, :2] / 2
    far_first = np.argsort(-np.hypot(middle[:, 0], middle[:, 1]))
    # Each bar is a thing of its own, so that what stands near the fence is painted between its bars.
    return [Lines(ends[i : i + 1], widths[i : i + 1], kind.colour) for i in far_first]


def power_line(
    heading: float,
    offset: float,
    height: float = 9.0,
    pitch: float = 42.0,
    spans: int = 9,
    *,
    ground: Callable[[float, float], float],
) -> list[Thing]:
    """Make poles along a line, with three sagging wires.

    Args:
        heading: of the line, radians.
        offset: metres to the left of the camera.
        height: of the poles, metres.
        pitch: metres from pole to pole.
        spans: number of poles to each side of the middle one.
        ground: function (x, y) that returns the height of the ground in metres.
    """
    lines: list[Thing] = []
    tops = []
    for i in range(-spans, spans + 1):
        x, y = along_line(heading, i * pitch + 11.0, offset)
        foot = np.array([x, y, ground(x, y)])
        top = np.array([x, y, foot[2] + height])
        side = np.array([-np.sin(heading), np.cos(heading), 0]) * 0.11 * height
        drop = [0, 0, 0.6]  # from the top to the cross arm
        pole = np.array([(foot, top), (top - side - drop, top + side - drop)])
        lines.append(Lines(pole, np.array([0.03, 0.018]) * height**0.9, (0.15, 0.12, 0.10)))
        tops.append([top + side * k - [0, 0, 0.45] for k in (-1.0, 0.0, 1.0)])
    t = np.linspace(0, 1, 13)[:, None]
    for this_pole, next_pole in zip(tops[:-1], tops[1:], strict=True):
        for p, q in zip(this_pole, next_pole, strict=True):
            wire = p + (q - p) * t - np.array([0, 0, 0.03 * pitch]) * 4 * t * (1 - t)
            ends = np.stack([wire[:-1], wire[1:]], 1)
            lines.append(Lines(ends, np.full(12, 0.018), (0.06, 0.06, 0.06)))
    return lines


def pylon(x: float, y: float, heading: float, height: float = 42.0, ground: float = 0.0) -> list[Thing]:
    """Make a lattice mast for high voltage. heading: radians. ground: height of its foot in metres."""
    levels = np.linspace(0, 1, 9)
    half_width = height * 0.085 * (1 - levels) ** 1.2 + 0.5
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    bars: list[Bar] = []
    for i in range(8):
        low, high = levels[i] * height, levels[i + 1] * height
        for k in range(4):
            a, b = corners[k], corners[(k + 1) % 4]
            a_low, a_high = [*(a * half_width[i]), low], [*(a * half_width[i + 1]), high]
            b_low, b_high = [*(b * half_width[i]), low], [*(b * half_width[i + 1]), high]
            bars += [(a_low, a_high), (a_low, b_high), (b_low, a_high)]
    for level in (0.66, 0.8, 0.94):
        reach = height * (0.17 - 0.06 * (level - 0.66) / 0.28)
        for sign in (-1, 1):
            tip = [0, sign * reach, level * height]
            bars += [([0, 0, level * height], tip), ([0, 0, (level + 0.05) * height], tip)]
    ends = np.stack([to_world(bar, x, y, heading) for bar in bars]) + [0, 0, ground]
    return [Lines(ends, np.full(len(ends), 0.13), (0.25, 0.26, 0.26))]


def crane(x: float, y: float, heading: float, height: float = 38.0) -> list[Thing]:
    """Make a tower crane: a lattice mast, a jib along `heading` (radians) and a counterweight."""
    bars = _crane_mast(height) + _crane_jib(height)
    apex = [0, 0, height + 7]
    bars += [
        ([0, 0, height], apex),
        (apex, [34, 0, height + 1.6]),
        (apex, [16, 0, height + 1.6]),
        (apex, [-11, 0, height + 1.2]),
        ([24, 0, height], [24, 0, height * 0.45]),  # the hook's rope
    ]
    ends = np.stack([to_world(bar, x, y, heading) for bar in bars])
    thick = np.full(len(ends), 0.16)
    thick[-5:] = (0.25, 0.06, 0.06, 0.06, 0.05)
    counterweight = to_world([[-11.5, 0, height + 0.1], [-8.5, 0, height + 0.1]], x, y, heading)[None]
    return [Lines(ends, thick, (0.42, 0.27, 0.03)), Lines(counterweight, np.array([2.2]), (0.3, 0.3, 0.29))]


def _crane_mast(height: float) -> list[Bar]:
    """Return the bars of a crane's mast: four posts with diagonals between."""
    bars: list[Bar] = []
    w = 0.8  # half the width
    steps = int(height / 2.2)
    z = np.linspace(0, height, steps + 1)
    for i in range(steps):
        low, high = z[i], z[i + 1]
        flip = w if i % 2 else -w
        for sx, sy in ((w, w), (-w, w), (-w, -w), (w, -w)):
            bars.append(([sx, sy, low], [sx, sy, high]))
        bars += [
            ([flip, w, low], [-flip, w, high]),
            ([flip, -w, low], [-flip, -w, high]),
            ([w, flip, low], [w, -flip, high]),
            ([-w, flip, low], [-w, -flip, high]),
        ]
    return bars


def _crane_jib(height: float) -> list[Bar]:
    """Return the bars of a crane's jib: two lower booms and an upper one, with diagonals between."""
    bars: list[Bar] = []
    upper = height + 1.6
    forward = np.arange(-12, 40.1, 2.0)
    for a, b in zip(forward[:-1], forward[1:], strict=True):
        middle = (a + b) / 2
        for side in (-0.7, 0.7):
            bars += [
                ([a, side, height], [b, side, height]),
                ([a, side, height], [middle, 0, upper]),
                ([middle, 0, upper], [b, side, height]),
            ]
        bars.append(([a, 0, upper], [b, 0, upper]))
    return bars


def floodlight(x: float, y: float, height: float = 30.0) -> list[Thing]:
    """Make a mast of floodlights that face the camera. The lamps are off."""
    towards = np.arctan2(-y, -x)
    side = np.array([-np.sin(towards), np.cos(towards), 0])
    foot, top = np.array([x, y, 0.0]), np.array([x, y, height])
    middle = foot + (top - foot) * 0.5
    mast = np.array([(foot, middle), (middle, top + [0, 0, 3])])
    rows = []
    for up in (0.2, 1.1, 2.0, 2.9):
        rows.append((top + side * -2.6 + [0, 0, up], top + side * 2.6 + [0, 0, up]))
    return [
        Lines(mast, np.array([0.75, 0.5]), (0.35, 0.36, 0.36)),
        Lines(np.array(rows), np.full(4, 0.6), (0.45, 0.46, 0.47)),
    ]
