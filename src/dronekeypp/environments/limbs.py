"""Trunks and branches of a plant, grown and drawn."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dronekeypp.environments.drawing import Drawing
from dronekeypp.environments.kinds import Kind

_STRIPS = 9  # a limb is drawn as this many strips side by side, each with its own normal


@dataclass
class Limb:
    """A straight piece of wood. Lengths are shares of the plant's height.

    Attributes:
        start, end: (2,) points as (right of the foot, up).
        start_width, end_width: its thickness.
    """

    start: np.ndarray
    end: np.ndarray
    start_width: float
    end_width: float


def grow_limbs(kind: Kind, rng: np.random.Generator) -> list[Limb]:
    """Grow the trunk and the branches of a plant. Grass and bushes have none."""
    if not kind.trunk and not kind.twigs:
        return []
    if kind.shape == "ellipsoid" and kind.trunk == 0:
        return _stems(kind, rng)
    straight = kind.shape in ("cone", "column", "fan")
    trunk = _trunk(kind, rng, straight)
    if straight:
        return trunk
    return trunk + _branches(kind, rng, trunk[-1])


def _stems(kind: Kind, rng: np.random.Generator) -> list[Limb]:
    """Grow the stems of a shrub, from the ground."""
    stems = []
    for _ in range(kind.twigs):
        start = np.array([rng.normal() * 0.12, 0.0])
        end = start + [rng.normal() * 0.45, rng.uniform(0.3, 0.95)]
        stems.append(Limb(start, end, 0.006, 0.002))
    return stems


def _trunk(kind: Kind, rng: np.random.Generator, straight: bool) -> list[Limb]:
    """Grow a trunk of eight pieces: to where the branches start, or almost to the top if it is straight."""
    fork = 0.86 if straight else kind.crown[0] + 0.12 * (kind.crown[1] - kind.crown[0])
    start = np.array([0.0, 0.0])
    width = kind.trunk
    lean = rng.normal() * (0.01 if straight else 0.05)
    trunk = []
    for i in range(8):
        end = np.array([lean * ((i + 1) / 8) ** 2 + rng.normal() * 0.002, fork * (i + 1) / 8])
        end_width = width * (0.86 if straight else 0.95)
        foot_width = width * 1.25 if i == 0 else width
        trunk.append(Limb(start, end, foot_width, end_width))
        start = end
        width = end_width
    return trunk


def _branches(kind: Kind, rng: np.random.Generator, trunk_top: Limb) -> list[Limb]:
    """Grow the branches of a crown from the top of the trunk."""
    bare = kind.twigs > 500
    forks = 7 if bare else 4
    if bare:
        share = 0.30
    elif kind.shape == "flat":
        share = 0.4
    else:
        share = 0.33 * kind.width
    reach = (kind.crown[1] - kind.crown[0]) * share
    spread = 1.5 if kind.shape == "flat" else 1.0
    limbs: list[Limb] = []
    for angle in np.linspace(-0.75, 0.75, 4 if bare else 5):
        foot = trunk_top.end - [0, rng.uniform(0, 0.12)]
        angle = (angle + rng.normal() * 0.1) * spread
        length = reach * rng.uniform(0.75, 1.05)
        _grow_branch(limbs, rng, foot, angle, length, trunk_top.end_width * 0.6, forks - 1)
    return limbs


def _grow_branch(
    limbs: list[Limb],
    rng: np.random.Generator,
    start: np.ndarray,
    angle: float,
    length: float,
    width: float,
    forks: int,
) -> None:
    """Grow a branch and what forks from it.

    Args:
        limbs: the new limbs are added here.
        rng: random numbers.
        start: (2,) the branch's foot.
        angle: radians from straight up, to the right.
        length, width: of the branch.
        forks: how many times it may fork again.
    """
    bend = angle + rng.normal() * 0.12
    middle = start + 0.5 * length * np.array([np.sin(angle), np.cos(angle)])
    end = middle + 0.5 * length * np.array([np.sin(bend), np.cos(bend)])
    limbs.append(Limb(start, middle, width, width * 0.85))
    limbs.append(Limb(middle, end, width * 0.85, width * 0.7))
    if forks == 0:
        return
    for _ in range(2 if forks > 1 else 3):
        side = rng.uniform(0.2, 0.75) * rng.choice([-1, 1])
        foot = end if rng.random() < 0.7 else middle
        shorter = length * rng.uniform(0.66, 0.86)
        _grow_branch(limbs, rng, foot, (bend + side) * 0.93, shorter, width * 0.64, forks - 1)


def draw_limbs(drawing: Drawing, kind: Kind, rng: np.random.Generator) -> None:
    """Grow and draw the limbs of a plant as cylinders: across each runs a normal from left to right."""
    limbs = grow_limbs(kind, rng)
    if not limbs:
        return
    first = drawing.count()
    drawing.add(_bark())
    for limb in limbs:
        if max(limb.start_width, limb.end_width) * drawing.size < 2.2:
            element = first + int(rng.integers(0, _STRIPS)) + _STRIPS * int(rng.integers(0, 3))
            _draw_twig(drawing, limb, element)
            continue
        length = float(np.linalg.norm(limb.end - limb.start))
        along = (limb.end - limb.start) / max(length, 1e-6)
        side = np.array([along[1], -along[0]])
        for i in range(_STRIPS):
            low = -1 + 2 * i / _STRIPS
            high = -1 + 2 * (i + 1) / _STRIPS
            corners = np.stack(
                [
                    limb.start + side * limb.start_width / 2 * low,
                    limb.start + side * limb.start_width / 2 * high,
                    limb.end + side * limb.end_width / 2 * high,
                    limb.end + side * limb.end_width / 2 * low,
                ]
            )
            polygon = (_pixels(drawing, corners) * 16).astype(np.int32)  # sixteenths of a pixel
            element = int(first + i + _STRIPS * rng.integers(0, 3))
            cv2.fillConvexPoly(drawing.owner, polygon, element, cv2.LINE_8, 4)


def _bark() -> np.ndarray:
    """Return the elements (3 * strips, 6) of a limb: its strips in a middle, a dark and a light tone."""
    across = np.linspace(-0.95, 0.95, _STRIPS)
    normal = np.stack([across, np.sqrt(1 - across**2), np.full(_STRIPS, 0.15)], -1)
    tables = []
    for tone in (1.0, 0.75, 1.3):
        openness_leaf_tone = np.tile([0.6, 0.0, tone], (_STRIPS, 1))
        tables.append(np.concatenate([normal, openness_leaf_tone], 1))
    return np.concatenate(tables)


def _draw_twig(drawing: Drawing, limb: Limb, element: int) -> None:
    """Draw a limb that is about a pixel thick."""
    start, end = _pixels(drawing, np.stack([limb.start, limb.end])).astype(int).tolist()
    cv2.line(drawing.owner, start, end, element, max(1, round(limb.start_width * drawing.size)))


def _pixels(drawing: Drawing, points: np.ndarray) -> np.ndarray:
    """Return the pixels (n, 2), column and row, of points (n, 2) as (right of the foot, up) in heights."""
    columns = drawing.width / 2 + points[:, 0] * drawing.size
    rows = drawing.size - 1 - points[:, 1] * drawing.size
    return np.stack([columns, rows], -1)
