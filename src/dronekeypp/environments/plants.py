"""Trees, bushes and tufts, grown leaf by leaf once per kind, then lit and placed as often as a scene needs them."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from dronekeypp.environments.kinds import KINDS, Kind
from dronekeypp.environments.noise import fbm_tile

_DRAWN = 1280  # a model is drawn this many pixels high, and kept at half


class Model:
    """A grown plant seen from the side, at several sizes.

    The picture's height stands for the whole plant. Bytes keep it small: `levels` is a list of (form (h, w, 4),
    matter (h, w, 3)) uint8, each half the size of the one before. form: normal (right, towards viewer, up) as 128 +
    120 n, and how much sky its leaves see as 255 x. matter: leaf 1 .. bark 0 as 255 x, tone (albedo variation) as 128
    x, alpha as 255 x. All premultiplied by alpha.
    """

    def __init__(self, form: np.ndarray, matter: np.ndarray, kind: Kind):
        self.kind = kind
        pair = form, matter
        self.levels = [pair]
        while min(pair[0].shape[:2]) > 24:
            size = pair[0].shape[1] // 2, pair[0].shape[0] // 2
            pair = tuple(cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in pair)
            self.levels.append(pair)

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.levels[0][0].shape[1] / self.levels[0][0].shape[0]

    def sized(self, rows: int, columns: int, mirrored: bool) -> tuple[np.ndarray, ...]:
        """Normal (h, w, 3), open, leaf, tone (h, w), no longer premultiplied, and alpha, float32, of a picture of
        this size.
        """
        level = 0
        while level + 1 < len(self.levels) and self.levels[level + 1][0].shape[0] >= rows:
            level += 1
        method = cv2.INTER_AREA if rows < self.levels[level][0].shape[0] else cv2.INTER_LINEAR
        form, matter = (cv2.resize(p, (columns, rows), interpolation=method) for p in self.levels[level])
        if mirrored:
            form, matter = form[:, ::-1], matter[:, ::-1]
        form, matter = form.astype(np.float32), matter.astype(np.float32)
        alpha = matter[..., 2] / 255
        solid = 1 / np.maximum(alpha, 1e-2)
        normal = (form[..., :3] - 128) * (solid / 120)[..., None]
        if mirrored:
            normal[..., 0] *= -1
        return (
            normal,
            form[..., 3] * solid / 255,
            matter[..., 0] * solid / 255,
            matter[..., 1] * solid / 128,
            alpha,
        )


@lru_cache(maxsize=28)
def grow(name: str, variant: int) -> Model:
    """Grow one plant of a kind. Deterministic from (name, variant)."""
    kind = KINDS[name]
    rng = np.random.default_rng((sorted(KINDS).index(name), variant, 17))
    if kind.shape == "rock":
        return Model(*_bytes(_rock(kind, rng)), kind)
    size = _DRAWN
    width = 2 * int(size * (kind.width * 1.35 + 0.1) / 2)
    owner = np.zeros((size, width), np.int32)  # which element shows at a pixel; 0 is nothing
    elements = [np.zeros((1, 6), np.float32)]
    limbs = _limbs(kind, rng)
    _draw_limbs(owner, limbs, kind, elements, rng, size, width)
    if kind.shape in ("tuft", "fan"):
        _draw_blades(owner, kind, elements, rng, size, width)
    elif kind.leaves:
        _draw_leaves(owner, kind, elements, rng, size, width)
    table = np.concatenate(elements)
    table = np.concatenate([table, (np.arange(len(table)) > 0)[:, None]], 1)
    half = width // 2, size // 2
    return Model(
        *(cv2.resize(np.take(t, owner, axis=0), half, interpolation=cv2.INTER_AREA) for t in _bytes(table)),
        kind,
    )


def _bytes(layers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Form and matter (see Model) of layers (..., 7) float: normal, open, leaf, tone, alpha; premultiplied."""
    form = np.concatenate([layers[..., :3] * 120 + 128, layers[..., 3:4] * 255], -1)
    matter = layers[..., 4:] * [255, 128, 255]
    return tuple(np.clip(p + 0.5, 0, 255).astype(np.uint8) for p in (form, matter))


def _profile(kind: Kind, level: np.ndarray) -> np.ndarray:
    """Radius of the crown, share of half its width, at a level 0..1 of the crown."""
    if kind.shape == "cone":
        return (1 - level) ** 0.85 + 0.02
    if kind.shape == "column":
        return np.clip(np.sin(np.pi * np.clip(level, 0.02, 1) ** 0.7), 0.0, 1) ** 0.6
    if kind.shape in ("umbrella", "flat"):
        return np.sqrt(np.clip(1 - level**2, 0, 1)) * 0.9 + 0.1
    return np.sqrt(np.clip(1 - (2 * level - 0.9) ** 2 / 1.3, 0.02, 1))


def _clumps(kind: Kind, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Centres (N, 3) as (right, towards viewer, up) and radii (N,) of the clumps of leaves, in heights."""
    count = kind.clumps
    bottom, top = kind.crown
    level = rng.random(count) if kind.shape != "cone" else 1 - rng.random(count) ** 0.72
    radius = _profile(kind, level) * kind.width / 2
    around = rng.random(count) * 2 * np.pi
    # Foliage grows near the surface: the inside is dark.
    out = radius * np.power(rng.random(count), 0.35) * rng.uniform(0.72, 1.02, count)
    lobes = (
        1
        + 0.22 * np.sin(3 * around + rng.random() * 6)
        + 0.15 * np.sin(5 * level * np.pi + 2 * around + rng.random() * 6)
    )
    out = out * (lobes if kind.shape not in ("cone", "column") else 1)
    height = bottom + (top - bottom) * (0.05 + 0.9 * level)
    if kind.shape == "cone":
        height = height - 0.10 * out  # boughs droop
    centre = np.stack([out * np.cos(around), out * np.sin(around), height], -1)
    return centre, kind.spread * rng.uniform(0.65, 1.35, count) * (
        0.45 + 0.75 * (1 - level) if kind.shape == "cone" else 1
    )


def _draw_leaves(owner, kind, elements, rng, size, width):
    centre, radius = _clumps(kind, rng)
    pick = rng.choice(len(centre), kind.leaves, p=radius**2 / (radius**2).sum())
    direction = rng.normal(size=(kind.leaves, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    squash = {"cone": (1.25, 1.25, 0.45), "umbrella": (1.3, 1.3, 0.55), "flat": (1.7, 1.7, 0.38)}.get(
        kind.shape, (1.1, 1.1, 0.85)
    )
    # Leaves sit on twigs, twigs in clumps: two scales of lumps, as in nature.
    twig = rng.integers(0, max(1, kind.leaves // 22), kind.leaves)
    pick, direction = pick[twig], direction[twig]
    offset = direction * (np.power(rng.random(kind.leaves)[twig], 0.45) * radius[pick])[:, None] * squash
    place = centre[pick] + offset + rng.normal(size=offset.shape) * 0.19 * radius[pick][:, None] * squash
    direction = 0.75 * direction + 0.45 * rng.normal(size=offset.shape)
    middle = np.array([0, 0, (kind.crown[0] + kind.crown[1]) / 2])
    crown = (place - middle) / [kind.width / 2, kind.width / 2, (kind.crown[1] - kind.crown[0]) / 2]
    reach = np.linalg.norm(crown, axis=1, keepdims=True)
    normal = 0.75 * direction + 0.65 * crown / np.maximum(reach, 0.2) + 0.55 * rng.normal(size=place.shape)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # How open to the sky: out and up in the crown, out and up in its clump.
    openness = 0.10 + 0.55 * np.clip(reach[:, 0], 0, 1.15) ** 2 * (
        0.55 + 0.45 * np.clip(crown[:, 2] * 0.5 + 0.5, 0, 1)
    )
    openness = np.clip(openness + 0.28 * direction[:, 2] + 0.08 * rng.normal(size=kind.leaves), 0.03, 1)
    tone = np.clip(
        1 + 0.14 * rng.normal(size=kind.leaves) + 0.10 * rng.normal(size=kind.leaves)[twig], 0.5, 1.6
    )
    order = np.argsort(place[:, 1])  # far ones first
    u = width / 2 + place[order, 0] * size
    v = size - 1 - place[order, 2] * size * 0.93
    long, short = kind.leaf
    angle = rng.random(kind.leaves) * np.pi
    if kind.shape == "cone":  # needles hang along their bough
        angle = np.where(place[order, 0] > 0, 0.45, -0.45) + 0.5 * rng.normal(size=kind.leaves)
    scale = rng.uniform(0.6, 1.25, kind.leaves)
    first = sum(len(e) for e in elements)
    columns = [normal[order], openness[order, None], np.ones((kind.leaves, 1)), tone[order, None]]
    elements.append(np.concatenate(columns, 1).astype(np.float32))
    reach_px = int(np.ceil(long * 1.25))
    ids = np.arange(kind.leaves, dtype=np.int32) + first
    jj, ii = np.meshgrid(np.arange(-reach_px, reach_px + 1), np.arange(-reach_px, reach_px + 1))
    for start in range(0, kind.leaves, 4000):  # in depth order; within a call numpy lets the last writer win
        s = slice(start, start + 4000)
        c, n = np.cos(angle[s])[:, None], np.sin(angle[s])[:, None]
        a = (jj.ravel() * c + ii.ravel() * n) / (long * scale[s])[:, None]
        b = (-jj.ravel() * n + ii.ravel() * c) / (short * scale[s])[:, None]
        leaf, pixel = np.nonzero(a * a + b * b < 1)
        rows = np.round(v[s][leaf]).astype(int) + ii.ravel()[pixel]
        cols = np.round(u[s][leaf]).astype(int) + jj.ravel()[pixel]
        inside = (rows >= 0) & (rows < size) & (cols >= 0) & (cols < width)
        owner[rows[inside], cols[inside]] = ids[s][leaf[inside]]


def _limbs(kind: Kind, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray, float, float]]:
    """Trunk and branches: (start, end, thickness at start, at end), points as (right, up) in heights."""
    limbs: list[tuple[np.ndarray, np.ndarray, float, float]] = []
    if not kind.trunk and not kind.twigs:
        return limbs
    if kind.shape in ("ellipsoid",) and kind.trunk == 0:  # a shrub: stems from the ground
        for _ in range(kind.twigs):
            a = np.array([rng.normal() * 0.12, 0.0])
            b = a + [rng.normal() * 0.45, rng.uniform(0.3, 0.95)]
            limbs.append((a, b, 0.006, 0.002))
        return limbs
    straight = kind.shape in ("cone", "column", "fan")
    fork = 0.86 if straight else kind.crown[0] + 0.12 * (kind.crown[1] - kind.crown[0])
    here, thick = np.array([0.0, 0.0]), kind.trunk
    lean = rng.normal() * (0.01 if straight else 0.05)
    for i in range(8):
        there = np.array([lean * ((i + 1) / 8) ** 2 + rng.normal() * 0.002, fork * (i + 1) / 8])
        thinner = thick * (0.86 if straight else 0.95)
        limbs.append((here, there, thick * (1.25 if i == 0 else 1), thinner))
        here, thick = there, thinner
    if straight:
        return limbs
    depth = 7 if kind.twigs > 500 else 4
    reach = (kind.crown[1] - kind.crown[0]) * (
        0.30 if depth == 7 else 0.33 * kind.width if kind.shape != "flat" else 0.4
    )

    def branch(at: np.ndarray, angle: float, length: float, width: float, left: int) -> None:
        bend = angle + rng.normal() * 0.12
        mid = at + 0.5 * length * np.array([np.sin(angle), np.cos(angle)])
        end = mid + 0.5 * length * np.array([np.sin(bend), np.cos(bend)])
        limbs.append((at, mid, width, width * 0.85))
        limbs.append((mid, end, width * 0.85, width * 0.7))
        if left == 0:
            return
        for _ in range(2 if left > 1 else 3):
            side = rng.uniform(0.2, 0.75) * rng.choice([-1, 1])
            branch(
                end if rng.random() < 0.7 else mid,
                (bend + side) * 0.93,
                length * rng.uniform(0.66, 0.86),
                width * 0.64,
                left - 1,
            )

    for start in np.linspace(-0.75, 0.75, 4 if depth == 7 else 5):
        wide = 1.5 if kind.shape == "flat" else 1.0
        branch(
            here - [0, rng.uniform(0, 0.12)],
            (start + rng.normal() * 0.1) * wide,
            reach * rng.uniform(0.75, 1.05),
            thick * 0.6,
            depth - 1,
        )
    return limbs


def _draw_limbs(owner, limbs, kind, elements, rng, size, width):
    """Limbs as cylinders: across each runs a normal from left to right."""
    if not limbs:
        return
    first = sum(len(e) for e in elements)
    strips = 9
    across = np.linspace(-0.95, 0.95, strips)
    normal = np.stack([across, np.sqrt(1 - across**2), np.full(strips, 0.15)], -1)
    table = np.concatenate(
        [normal, np.full((strips, 1), 0.6), np.zeros((strips, 1)), np.ones((strips, 1))], 1
    )
    rough = [table]
    for tone in (0.75, 1.3):
        other = table.copy()
        other[:, 5] = tone
        rough.append(other)
    elements.append(np.concatenate(rough).astype(np.float32))
    for a, b, start, end in limbs:
        if max(start, end) * size < 2.2:
            p, q = (
                (width / 2 + a[0] * size, size - 1 - a[1] * size),
                (width / 2 + b[0] * size, size - 1 - b[1] * size),
            )
            thickness = max(1, round(start * size))
            which = first + int(rng.integers(0, strips)) + strips * int(rng.integers(0, 3))
            cv2.line(owner, (int(p[0]), int(p[1])), (int(q[0]), int(q[1])), int(which), thickness)
            continue
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-6)
        side = np.array([along[1], -along[0]])
        for i in range(strips):
            lo, hi = -1 + 2 * i / strips, -1 + 2 * (i + 1) / strips
            corners = [
                a + side * start / 2 * lo,
                a + side * start / 2 * hi,
                b + side * end / 2 * hi,
                b + side * end / 2 * lo,
            ]
            polygon = np.array(
                [[(width / 2 + c[0] * size) * 16, (size - 1 - c[1] * size) * 16] for c in corners], np.int32
            )
            cv2.fillConvexPoly(owner, polygon, int(first + i + strips * rng.integers(0, 3)), cv2.LINE_8, 4)


def _draw_blades(owner, kind, elements, rng, size, width):
    """Grass blades and palm fronds: curved, tapering strokes."""
    first = sum(len(e) for e in elements)
    tuft = kind.shape == "tuft"
    count = kind.leaves if tuft else kind.clumps
    table = []
    for i in range(count):
        if tuft:
            root = np.array([rng.normal() * kind.width * 0.16, 0.0])
            lean = rng.normal() * 0.35 + root[0] * 0.8
            tall = rng.uniform(0.35, 0.98)
            t = np.linspace(0, 1, 8)[:, None]
            line = root + np.concatenate(
                [lean * tall * (0.4 * t + 0.9 * t**2), tall * (t - 0.12 * abs(lean) * t**2)], 1
            )
            table.append(
                [rng.normal() * 0.6, 0.6, 0.5, 0.35 + 0.6 * tall * rng.random(), 1, rng.uniform(0.7, 1.35)]
            )
            _stroke(owner, line, 5.5, first + i, size, width)
            continue
        around = 2 * np.pi * (i + rng.random()) / count
        rise = rng.uniform(-0.3, 1.1)
        t = np.linspace(0, 1, 9)[:, None]
        side = np.cos(around) * kind.width / 2
        top = np.array([0.0, 0.855])
        rib = top + np.concatenate([side * t, 0.16 * rise * t - (0.10 + 0.12 * (1.1 - rise)) * t**2], 1)
        openness = np.clip(0.35 + 0.4 * rise, 0.1, 0.95)
        table.append([np.cos(around) * 0.6, 0.4 * np.sin(around), 0.7, openness, 1, rng.uniform(0.75, 1.2)])
        _stroke(owner, rib, 4, first + i, size, width)
        for s in np.linspace(0.12, 1, 30):  # leaflets along the rib
            at = np.array([np.interp(s, t[:, 0], rib[:, 0]), np.interp(s, t[:, 0], rib[:, 1])])
            for sign in (-1, 1):
                long = 0.085 * np.sin(np.pi * min(0.98, 0.15 + 0.8 * s))
                tip = at + long * np.array(
                    [np.sign(side) * 0.55 + 0.35 * sign * abs(np.sin(around)), -0.75 + 0.35 * sign]
                )
                _stroke(owner, np.stack([at, (at + tip) / 2 + [0, 0.004], tip]), 1.6, first + i, size, width)
    elements.append(np.array(table, np.float32))


def _rock(kind: Kind, rng: np.random.Generator, size: int = 480) -> np.ndarray:
    """A boulder as layers (see Model): a lump cut by a few planes, roughened with fractal noise."""
    width = int(size * kind.width)
    x, z = np.meshgrid((np.arange(width) + 0.5) / size - kind.width / 2, 1 - (np.arange(size) + 0.5) / size)
    depth = np.full(x.shape, 10.0)
    for _ in range(26):  # a convex stone is what many planes leave over
        normal = rng.normal(size=3) * [1.0, 1.0, 0.8]
        normal[1] = abs(normal[1]) + 0.15
        normal /= np.linalg.norm(normal)
        reach = rng.uniform(0.36, 0.52) * (1 + 0.35 * abs(normal[0]))
        depth = np.minimum(depth, (reach - normal[0] * x - normal[2] * (z - 0.42)) / normal[1])
    tile = fbm_tile(512, 1.6, int(rng.integers(1000)))
    rough = np.tile(tile, (1, 2))[:size, :width]
    alpha = (depth + 0.012 * rough > 0) & (z > 0.012 * (1 + rough))
    height = cv2.GaussianBlur(np.clip(depth, -0.2, 1).astype(np.float32), (0, 0), 2.5) + 0.016 * rough
    dy, dx = np.gradient(height * size)
    normal = np.stack([-dx, np.ones_like(dx), dy], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    openness = np.clip(0.45 + 0.4 * z + 0.06 * rough, 0.1, 1)
    tone = np.exp(0.14 * np.roll(rough, 91, 1))
    layers = (
        np.concatenate([normal, np.stack([openness, 0 * z, tone, np.ones_like(z)], -1)], -1)
        * alpha[..., None]
    )
    return np.stack([cv2.GaussianBlur(layers[..., i], (0, 0), 0.7) for i in range(7)], -1)


def _stroke(owner, line, thick, which, size, width):
    points = np.stack([width / 2 + line[:, 0] * size, size - 1 - line[:, 1] * size * 0.97], -1)
    for k in range(len(points) - 1):
        taper = max(1, round(thick * (1 - 0.75 * k / (len(points) - 1))))
        cv2.line(owner, points[k].astype(int).tolist(), points[k + 1].astype(int).tolist(), int(which), taper)
