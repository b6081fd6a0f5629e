"""Trees, bushes and tufts: grown leaf by leaf once, then lit and placed as often as a scene needs them."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from dronekeypp.environments.drawing import Drawing
from dronekeypp.environments.foliage import draw_blades, draw_fronds, draw_leaves
from dronekeypp.environments.kinds import KINDS, Kind
from dronekeypp.environments.limbs import draw_limbs
from dronekeypp.environments.noise import fbm_tile

_DRAWN = 1280  # a model is drawn this many pixels high, and kept at half
_ROCK = 480  # a boulder is drawn this many pixels high


class Model:
    """A grown plant seen from the side, at several sizes.

    The picture's height stands for the whole plant. Bytes save memory.

    Attributes:
        kind: its kind.
        levels: pairs of uint8 pictures, form (h, w, 4) and matter (h, w, 3), each half the size of the pair
            before. form holds the normal (right, towards viewer, up) as 128 + 120 n, and how much sky its
            leaves see as 255 x. matter holds leaf 1 to bark 0 as 255 x, tone (variation of the albedo) as 128
            x, and alpha as 255 x. All are multiplied by alpha.
    """

    def __init__(self, form: np.ndarray, matter: np.ndarray, kind: Kind) -> None:
        self.kind = kind
        self.levels = [(form, matter)]
        while min(form.shape[:2]) > 24:
            size = form.shape[1] // 2, form.shape[0] // 2
            form = cv2.resize(form, size, interpolation=cv2.INTER_AREA)
            matter = cv2.resize(matter, size, interpolation=cv2.INTER_AREA)
            self.levels.append((form, matter))

    @property
    def aspect(self) -> float:
        """Width over height."""
        form, _ = self.levels[0]
        return form.shape[1] / form.shape[0]

    def sized(
        self, rows: int, columns: int, mirrored: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return a picture of rows x columns pixels, float32, no longer multiplied by alpha.

        Returns:
            normal (h, w, 3), then openness to the sky, leaf, tone and alpha, each (h, w).
        """
        level = 0
        while level + 1 < len(self.levels) and self.levels[level + 1][0].shape[0] >= rows:
            level += 1
        form, matter = self.levels[level]
        method = cv2.INTER_AREA if rows < form.shape[0] else cv2.INTER_LINEAR
        form = cv2.resize(form, (columns, rows), interpolation=method)
        matter = cv2.resize(matter, (columns, rows), interpolation=method)
        if mirrored:
            form, matter = form[:, ::-1], matter[:, ::-1]
        form, matter = form.astype(np.float32), matter.astype(np.float32)
        alpha = matter[..., 2] / 255
        solid = 1 / np.maximum(alpha, 1e-2)
        normal = (form[..., :3] - 128) * (solid / 120)[..., None]
        if mirrored:
            normal[..., 0] *= -1
        openness = form[..., 3] * solid / 255
        leaf = matter[..., 0] * solid / 255
        tone = matter[..., 1] * solid / 128
        return normal, openness, leaf, tone, alpha


@lru_cache(maxsize=28)
def grow(name: str, variant: int) -> Model:
    """Grow one plant of a kind. The same (name, variant) gives the same plant."""
    kind = KINDS[name]
    rng = np.random.default_rng((sorted(KINDS).index(name), variant, 17))
    if kind.shape == "rock":
        form, matter = _bytes(_rock(kind, rng))
        return Model(form, matter, kind)
    drawing = Drawing(_DRAWN, 2 * int(_DRAWN * (kind.width * 1.35 + 0.1) / 2))
    draw_limbs(drawing, kind, rng)
    if kind.shape == "tuft":
        draw_blades(drawing, kind, rng)
    elif kind.shape == "fan":
        draw_fronds(drawing, kind, rng)
    elif kind.leaves:
        draw_leaves(drawing, kind, rng)
    table = drawing.table()
    alpha = (np.arange(len(table)) > 0)[:, None]
    form, matter = _bytes(np.concatenate([table, alpha], 1))
    half = drawing.width // 2, drawing.size // 2
    form = cv2.resize(np.take(form, drawing.owner, axis=0), half, interpolation=cv2.INTER_AREA)
    matter = cv2.resize(np.take(matter, drawing.owner, axis=0), half, interpolation=cv2.INTER_AREA)
    return Model(form, matter, kind)


def _bytes(layers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn layers (..., 7) float into form and matter, see `Model`.

    The layers are normal (right, towards viewer, up), openness, leaf, tone and alpha, multiplied by alpha.
    """
    form = np.concatenate([layers[..., :3] * 120 + 128, layers[..., 3:4] * 255], -1)
    matter = layers[..., 4:] * [255, 128, 255]
    form = np.clip(form + 0.5, 0, 255).astype(np.uint8)
    matter = np.clip(matter + 0.5, 0, 255).astype(np.uint8)
    return form, matter


def _rock(kind: Kind, rng: np.random.Generator) -> np.ndarray:
    """Make a boulder as layers (h, w, 7), see `_bytes`: a lump cut by planes, roughened with noise."""
    width = int(_ROCK * kind.width)
    right = (np.arange(width) + 0.5) / _ROCK - kind.width / 2
    up = 1 - (np.arange(_ROCK) + 0.5) / _ROCK
    x, z = np.meshgrid(right, up)
    depth = np.full(x.shape, 10.0)
    for _ in range(26):  # a convex stone is what many planes leave over
        normal = rng.normal(size=3) * [1.0, 1.0, 0.8]
        normal[1] = abs(normal[1]) + 0.15
        normal /= np.linalg.norm(normal)
        reach = rng.uniform(0.36, 0.52) * (1 + 0.35 * abs(normal[0]))
        depth = np.minimum(depth, (reach - normal[0] * x - normal[2] * (z - 0.42)) / normal[1])
    tile = fbm_tile(512, 1.6, int(rng.integers(1000)))
    rough = np.tile(tile, (1, 2))[:_ROCK, :width]
    alpha = (depth + 0.012 * rough > 0) & (z > 0.012 * (1 + rough))
    height = cv2.GaussianBlur(np.clip(depth, -0.2, 1).astype(np.float32), (0, 0), 2.5) + 0.016 * rough
    dy, dx = np.gradient(height * _ROCK)
    normal = np.stack([-dx, np.ones_like(dx), dy], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    openness = np.clip(0.45 + 0.4 * z + 0.06 * rough, 0.1, 1)
    tone = np.exp(0.14 * np.roll(rough, 91, 1))
    matter = np.stack([openness, 0 * z, tone, np.ones_like(z)], -1)
    layers = np.concatenate([normal, matter], -1) * alpha[..., None]
    return np.stack([cv2.GaussianBlur(layers[..., i], (0, 0), 0.7) for i in range(7)], -1)
