"""Leaves, blades of grass and palm fronds, drawn one by one."""

from __future__ import annotations

import numpy as np

from dronekeypp.environments.drawing import Drawing
from dronekeypp.environments.kinds import Kind

_TOGETHER = 4000  # leaves that are drawn at once

# How wide, deep and tall a clump of leaves is; other shapes have the last.
_CLUMPS = {"cone": (1.25, 1.25, 0.45), "umbrella": (1.3, 1.3, 0.55), "flat": (1.7, 1.7, 0.38)}
_ROUND_CLUMP = (1.1, 1.1, 0.85)


def _profile(kind: Kind, level: np.ndarray) -> np.ndarray:
    """Return the radius of the crown as a share of half its width. level: 0 at its bottom, 1 at its top."""
    if kind.shape == "cone":
        return (1 - level) ** 0.85 + 0.02
    if kind.shape == "column":
        return np.clip(np.sin(np.pi * np.clip(level, 0.02, 1) ** 0.7), 0.0, 1) ** 0.6
    if kind.shape in ("umbrella", "flat"):
        return np.sqrt(np.clip(1 - level**2, 0, 1)) * 0.9 + 0.1
    return np.sqrt(np.clip(1 - (2 * level - 0.9) ** 2 / 1.3, 0.02, 1))


def _clumps(kind: Kind, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Place the clumps of leaves.

    Returns:
        Their centres (n, 3) as (right, towards viewer, up) and their radii (n,), both in heights of the
        plant.
    """
    count = kind.clumps
    bottom, top = kind.crown
    level = rng.random(count)
    if kind.shape == "cone":
        level = 1 - level**0.72
    radius = _profile(kind, level) * kind.width / 2
    around = rng.random(count) * 2 * np.pi
    # Foliage grows near the surface: the inside is dark.
    reach = radius * np.power(rng.random(count), 0.35) * rng.uniform(0.72, 1.02, count)
    lobes = 1 + 0.22 * np.sin(3 * around + rng.random() * 6)
    lobes = lobes + 0.15 * np.sin(5 * level * np.pi + 2 * around + rng.random() * 6)
    if kind.shape not in ("cone", "column"):
        reach = reach * lobes
    height = bottom + (top - bottom) * (0.05 + 0.9 * level)
    if kind.shape == "cone":
        height = height - 0.10 * reach  # boughs droop
    centre = np.stack([reach * np.cos(around), reach * np.sin(around), height], -1)
    size = kind.spread * rng.uniform(0.65, 1.35, count)
    if kind.shape == "cone":
        size = size * (0.45 + 0.75 * (1 - level))
    return centre, size


def draw_leaves(drawing: Drawing, kind: Kind, rng: np.random.Generator) -> None:
    """Draw the leaves of a crown as ellipses, far ones first.

    Leaves sit on twigs and twigs in clumps: two scales of lumps, as in nature.
    """
    count = kind.leaves
    centre, radius = _clumps(kind, rng)
    clump = rng.choice(len(centre), count, p=radius**2 / (radius**2).sum())
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    squash = _CLUMPS.get(kind.shape, _ROUND_CLUMP)
    twig = rng.integers(0, max(1, count // 22), count)
    clump, direction = clump[twig], direction[twig]
    offset = direction * (np.power(rng.random(count)[twig], 0.45) * radius[clump])[:, None] * squash
    scatter = rng.normal(size=offset.shape) * 0.19 * radius[clump][:, None] * squash
    position = centre[clump] + offset + scatter
    direction = 0.75 * direction + 0.45 * rng.normal(size=offset.shape)
    # Position in the crown, 1 at its surface.
    middle = np.array([0, 0, (kind.crown[0] + kind.crown[1]) / 2])
    crown = (position - middle) / [kind.width / 2, kind.width / 2, (kind.crown[1] - kind.crown[0]) / 2]
    reach = np.linalg.norm(crown, axis=1, keepdims=True)
    normal = 0.75 * direction + 0.65 * crown / np.maximum(reach, 0.2)
    normal = normal + 0.55 * rng.normal(size=position.shape)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # How open to the sky: out and up in the crown, out and up in its clump.
    upper = 0.55 + 0.45 * np.clip(crown[:, 2] * 0.5 + 0.5, 0, 1)
    openness = 0.10 + 0.55 * np.clip(reach[:, 0], 0, 1.15) ** 2 * upper
    openness = np.clip(openness + 0.28 * direction[:, 2] + 0.08 * rng.normal(size=count), 0.03, 1)
    tone = 1 + 0.14 * rng.normal(size=count) + 0.10 * rng.normal(size=count)[twig]
    tone = np.clip(tone, 0.5, 1.6)
    order = np.argsort(position[:, 1])  # far ones first
    column = drawing.width / 2 + position[order, 0] * drawing.size
    row = drawing.size - 1 - position[order, 2] * drawing.size * 0.93
    angle = rng.random(count) * np.pi
    if kind.shape == "cone":  # needles hang along their bough
        angle = np.where(position[order, 0] > 0, 0.45, -0.45) + 0.5 * rng.normal(size=count)
    scale = rng.uniform(0.6, 1.25, count)
    first = drawing.count()
    drawing.add(
        np.concatenate([normal[order], openness[order, None], np.ones((count, 1)), tone[order, None]], 1)
    )
    for start in range(0, count, _TOGETHER):
        part = slice(start, start + _TOGETHER)
        _draw_ellipses(drawing, kind.leaf, column[part], row[part], angle[part], scale[part], first + start)


def _draw_ellipses(
    drawing: Drawing,
    leaf: tuple[float, float],
    column: np.ndarray,
    row: np.ndarray,
    angle: np.ndarray,
    scale: np.ndarray,
    first: int,
) -> None:
    """Draw n leaves, later ones over earlier ones.

    Args:
        drawing: the plant.
        leaf: long and short half axis in pixels.
        column, row: (n,) pixels of their middle.
        angle: (n,) radians.
        scale: (n,) factor on the axes.
        first: the element number of the first leaf.
    """
    long, short = leaf
    window = np.arange(-int(np.ceil(long * 1.25)), int(np.ceil(long * 1.25)) + 1)
    dx, dy = np.meshgrid(window, window)
    dx, dy = dx.ravel(), dy.ravel()
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    a = (dx * c + dy * s) / (long * scale)[:, None]
    b = (-dx * s + dy * c) / (short * scale)[:, None]
    number, pixel = np.nonzero(a * a + b * b < 1)
    rows = np.round(row[number]).astype(int) + dy[pixel]
    columns = np.round(column[number]).astype(int) + dx[pixel]
    inside = (rows >= 0) & (rows < drawing.size) & (columns >= 0) & (columns < drawing.width)
    # Where leaves overlap, numpy keeps the value written last.
    drawing.owner[rows[inside], columns[inside]] = first + number[inside]


def draw_blades(drawing: Drawing, kind: Kind, rng: np.random.Generator) -> None:
    """Draw a tuft of grass: curved, tapering strokes."""
    first = drawing.count()
    t = np.linspace(0, 1, 8)[:, None]
    elements = []
    for i in range(kind.leaves):
        root = np.array([rng.normal() * kind.width * 0.16, 0.0])
        lean = rng.normal() * 0.35 + root[0] * 0.8
        tall = rng.uniform(0.35, 0.98)
        right = lean * tall * (0.4 * t + 0.9 * t**2)
        up = tall * (t - 0.12 * abs(lean) * t**2)
        sideways = rng.normal() * 0.6
        openness = 0.35 + 0.6 * tall * rng.random()
        elements.append([sideways, 0.6, 0.5, openness, 1, rng.uniform(0.7, 1.35)])
        drawing.stroke(root + np.concatenate([right, up], 1), 5.5, first + i)
    drawing.add(np.array(elements))


def draw_fronds(drawing: Drawing, kind: Kind, rng: np.random.Generator) -> None:
    """Draw the fronds of a palm: ribs with leaflets on both sides."""
    first = drawing.count()
    top = np.array([0.0, 0.855])
    t = np.linspace(0, 1, 9)[:, None]
    elements = []
    for i in range(kind.clumps):
        around = 2 * np.pi * (i + rng.random()) / kind.clumps
        rise = rng.uniform(-0.3, 1.1)
        side = np.cos(around) * kind.width / 2
        up = 0.16 * rise * t - (0.10 + 0.12 * (1.1 - rise)) * t**2
        rib = top + np.concatenate([side * t, up], 1)
        openness = np.clip(0.35 + 0.4 * rise, 0.1, 0.95)
        tone = rng.uniform(0.75, 1.2)
        elements.append([np.cos(around) * 0.6, 0.4 * np.sin(around), 0.7, openness, 1, tone])
        drawing.stroke(rib, 4, first + i)
        for s in np.linspace(0.12, 1, 30):  # leaflets along the rib
            foot = np.array([np.interp(s, t[:, 0], rib[:, 0]), np.interp(s, t[:, 0], rib[:, 1])])
            long = 0.085 * np.sin(np.pi * min(0.98, 0.15 + 0.8 * s))
            for sign in (-1, 1):
                right = np.sign(side) * 0.55 + 0.35 * sign * abs(np.sin(around))
                tip = foot + long * np.array([right, -0.75 + 0.35 * sign])
                drawing.stroke(np.stack([foot, (foot + tip) / 2 + [0, 0.004], tip]), 1.6, first + i)
    drawing.add(np.array(elements))
