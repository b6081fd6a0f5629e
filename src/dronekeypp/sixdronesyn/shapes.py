"""Small closed surfaces to build a drone from: lofts, beams, lathes, blocks.

Lengths are millimetres here, because that is how a drone is measured; `merge` turns them into metres. Every builder returns a `Part`
whose faces look outward and whose normals are smooth within a surface and split along its sharp edges. Nothing is random.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyvista as pv
from scipy.interpolate import PchipInterpolator

RGB = tuple[int, int, int]


@dataclass(frozen=True)
class Part:
    """A coloured triangle surface: `points` and `normals` (P, 3), `faces` (F, 3), `rgb` (P, 3) uint8, `gloss` (P,) 0 matt .. 1 mirror-
    like."""

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    rgb: np.ndarray
    gloss: np.ndarray


def as_polydata(points: np.ndarray, faces: np.ndarray) -> pv.PolyData:
    """Triangles (F, 3) over points (P, 3) as a PolyData."""
    cells = np.empty((len(faces), 4), np.int64)
    cells[:, 0], cells[:, 1:] = 3, faces
    return pv.PolyData(points, cells.ravel())


def _part(points: np.ndarray, faces: np.ndarray, rgb: RGB, gloss: float, crease: float = 38.0) -> Part:
    """Faces turned outward (signed volume), normals split where two faces meet at more than `crease` degrees."""
    corners = points[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    corners, faces = corners[area > 1e-7], faces[area > 1e-7]
    if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
        faces = faces[:, ::-1]
    mesh = as_polydata(points, faces).compute_normals(
        cell_normals=False,
        split_vertices=True,
        feature_angle=crease,
        consistent_normals=False,
        auto_orient_normals=False,
    )
    count = mesh.n_points
    return Part(
        np.asarray(mesh.points, float),
        np.asarray(mesh.point_data["Normals"], float),
        mesh.faces.reshape(-1, 4)[:, 1:].copy(),
        np.tile(np.asarray(rgb, np.uint8), (count, 1)),
        np.full(count, gloss),
    )


def _tube(rings: np.ndarray, rgb: RGB, gloss: float, crease: float = 38.0) -> Part:
    """Skin over `rings` (R, A, 3), both ends closed by a fan around their middle."""
    count, around = rings.shape[:2]
    points = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    k = np.arange(around)
    following = (k + 1) % around
    faces = []
    for ring in range(count - 1):
        a, b = ring * around, (ring + 1) * around
        faces += [
            np.stack([a + k, b + k, b + following], 1),
            np.stack([a + k, b + following, a + following], 1),
        ]
    last = (count - 1) * around
    faces.append(np.stack([np.full(around, count * around), k, following], 1))
    faces.append(np.stack([np.full(around, count * around + 1), last + following, last + k], 1))
    return _part(points, np.concatenate(faces), rgb, gloss, crease)


def _oval(around: int, exponent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Superellipse |a|^n + |b|^n = 1, `around` points, for exponents (..., 1): 2 is an ellipse, 5 a box with round corners (where its
    points crowd)."""
    angle = (np.arange(around) + 0.5) * (2 * np.pi / around)
    a, b = np.cos(angle), np.sin(angle)
    return np.sign(a) * np.abs(a) ** (2 / exponent), np.sign(b) * np.abs(b) ** (2 / exponent)


def hull(
    stations: Sequence[Sequence[float]], rgb: RGB, rings: int = 22, around: int = 24, gloss: float = 0.25
) -> Part:
    """A fuselage lofted along x.

    Each station is (x, half width, z bottom, z widest, z top, exponent bottom, exponent top); between stations every number follows a
    monotone cubic, so the skin has no waves. Rings sit closer together where the stations do.
    """
    table = np.asarray(stations, float)
    where = np.linspace(0, len(table) - 1, rings)
    row = PchipInterpolator(np.arange(len(table)), table, axis=0)(where)
    x, half, bottom, middle, top, low, high = (column[:, None] for column in row.T)
    angle = (np.arange(around) + 0.5) * (2 * np.pi / around)
    upper = np.sin(angle)[None] > 0
    a, b = _oval(around, np.where(upper, high, low))
    y, z = half * a, middle + np.where(upper, top - middle, middle - bottom) * b
    return _tube(np.stack([np.broadcast_to(x, y.shape), y, z], -1), rgb, gloss)


def beam(
    path: Sequence[Sequence[float]],
    size: Sequence[Sequence[float]],
    rgb: RGB,
    up: Sequence[float] = (0, 0, 1),
    along: int = 9,
    around: int = 10,
    exponent: float = 2.8,
    gloss: float = 0.25,
    round_end: float = 0.5,
) -> Part:
    """A tapered bar with round ends: `path` (n, 3), `size` (n, 2) half width (across `up`) and half height (towards `up`)."""
    knots, table = np.arange(len(path)), np.concatenate([np.asarray(path, float), np.asarray(size, float)], 1)
    curve = PchipInterpolator(knots, table, axis=0) if len(path) > 2 else None
    where = np.linspace(0, len(path) - 1, along)
    row = curve(where) if curve else table[0] + where[:, None] * (table[1] - table[0])
    centre, half = row[:, :3], row[:, 3:]
    tangent = np.gradient(centre, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(np.asarray(up, float), tangent)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    lift = np.cross(tangent, side)
    a, b = _oval(around, np.full((along, 1), exponent))
    rings = (
        centre[:, None]
        + half[:, :1, None] * a[..., None] * side[:, None]
        + half[:, 1:, None] * b[..., None] * lift[:, None]
    )

    def cap(index: int, way: float) -> np.ndarray:
        # one smaller ring beyond the end makes the tip look moulded, not sawn
        reach = way * round_end * float(half[index].min())
        return centre[index] + 0.62 * (rings[index] - centre[index]) + reach * tangent[index]

    return _tube(np.concatenate([cap(0, -1)[None], rings, cap(-1, 1)[None]]), rgb, gloss, crease=50)


def frame(axis: Sequence[float]) -> np.ndarray:
    """(3, 3) rotation that takes z to `axis`."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    helper = np.array([1.0, 0, 0]) if abs(z[0]) < 0.8 else np.array([0, 1.0, 0])
    x = helper - z * (helper @ z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], 1)


def lathe(
    profile: Sequence[tuple[float, float]],
    rgb: RGB,
    at: Sequence[float] = (0, 0, 0),
    axis: Sequence[float] = (0, 0, 1),
    segments: int = 16,
    gloss: float = 0.3,
) -> Part:
    """`profile` of (radius, height) turned about `axis` through `at`; both ends are closed."""
    angle = np.arange(segments) * (2 * np.pi / segments)
    circle = np.stack([np.cos(angle), np.sin(angle)], -1)
    rings = np.stack([np.column_stack([max(r, 1e-3) * circle, np.full(segments, h)]) for r, h in profile])
    return moved(_tube(rings, rgb, gloss), frame(axis), at)


def block(
    at: Sequence[float],
    half: Sequence[float],
    rgb: RGB,
    soft: float = 0.25,
    exponent: float = 6.0,
    turn: np.ndarray | None = None,
    gloss: float = 0.3,
    around: int = 16,
) -> Part:
    """A box of half sizes `half` with round corners, centred at `at`; `soft` is the share of its smallest half size taken by the rounded
    ends."""
    hx, hy, hz = half
    edge = soft * min(half)
    a, b = _oval(around, np.full((1, 1), exponent))
    rings = [
        np.column_stack([np.full(around, x), (hy - inset) * a[0], (hz - inset) * b[0]])
        for x, inset in (
            (-hx, edge),
            (-hx + 0.35 * edge, 0.3 * edge),
            (-hx + edge, 0),
            (hx - edge, 0),
            (hx - 0.35 * edge, 0.3 * edge),
            (hx, edge),
        )
    ]
    return moved(_tube(np.stack(rings), rgb, gloss, crease=42), np.eye(3) if turn is None else turn, at)


def moved(part: Part, turn: np.ndarray, at: Sequence[float] = (0, 0, 0)) -> Part:
    """The part rotated by `turn` (3, 3), then shifted by `at`."""
    return replace(part, points=part.points @ turn.T + np.asarray(at, float), normals=part.normals @ turn.T)


def mirrored(part: Part) -> Part:
    """The part on the other side of the drone (y to -y)."""
    flip = np.array([1.0, -1.0, 1.0])
    return replace(part, points=part.points * flip, normals=part.normals * flip, faces=part.faces[:, ::-1])


def _sliced(part: Part, faces: np.ndarray, axis: int, value: float) -> Part:
    """The part with those of its `faces` (F,) bool that cross the plane coordinate `axis` = `value` cut along it: three triangles for
    one."""
    side = part.points[:, axis][part.faces] > value
    count = side.sum(axis=1)
    cut = faces & (count > 0) & (count < 3)
    if not cut.any():
        return part
    # turn each triangle so that the corner alone on its side comes first
    alone = np.where(count[cut] == 1, side[cut].argmax(axis=1), (~side[cut]).argmax(axis=1))
    a, b, c = (part.faces[cut][np.arange(cut.sum()), (alone + k) % 3] for k in range(3))
    arrays = {key: [getattr(part, key)] for key in ("points", "normals", "rgb", "gloss")}
    for other in (b, c):
        share = (value - part.points[a, axis]) / (part.points[other, axis] - part.points[a, axis])
        arrays["points"].append(part.points[a] + share[:, None] * (part.points[other] - part.points[a]))
        normal = part.normals[a] + share[:, None] * (part.normals[other] - part.normals[a])
        arrays["normals"].append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
        arrays["rgb"].append(part.rgb[a])
        arrays["gloss"].append(part.gloss[a])
    p = len(part.points) + np.arange(len(a))
    q = p + len(a)
    pieces = [part.faces[~cut], np.stack([a, p, q], 1), np.stack([p, b, c], 1), np.stack([p, c, q], 1)]
    return Part(faces=np.concatenate(pieces), **{key: np.concatenate(value) for key, value in arrays.items()})


def painted(part: Part, rgb: RGB, gloss: float | None = None, **bounds: tuple[float, float]) -> Part:
    """The surface inside a box (`x`, `y`, `z` = (low, high), any of them) in another colour, its border sharp because triangles are cut
    along it."""

    def chosen() -> np.ndarray:
        centre = part.points[part.faces].mean(axis=1)
        inside = np.ones(len(centre), bool)
        for name, (low, high) in bounds.items():
            inside &= (centre[:, "xyz".index(name)] > low) & (centre[:, "xyz".index(name)] < high)
        return inside

    for name, limits in bounds.items():
        axis = "xyz".index(name)
        for value in limits:
            corners = part.points[part.faces]
            near = np.ones(len(corners), bool)
            for other, (low, high) in bounds.items():
                along = corners[:, :, "xyz".index(other)]
                near &= (along.max(axis=1) > low) & (along.min(axis=1) < high)
            part = _sliced(part, near, axis, value)
    inside = chosen()
    used, local = np.unique(part.faces[inside], return_inverse=True)
    return Part(
        np.concatenate([part.points, part.points[used]]),
        np.concatenate([part.normals, part.normals[used]]),
        np.concatenate([part.faces[~inside], local.reshape(-1, 3) + len(part.points)]),
        np.concatenate([part.rgb, np.tile(np.asarray(rgb, np.uint8), (len(used), 1))]),
        np.concatenate([part.gloss, part.gloss[used] if gloss is None else np.full(len(used), gloss)]),
    )


def on_surface(
    part: Part, start: Sequence[float], direction: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Where a ray from inside the part leaves it, and the surface's normal there: to set an eye or a light flush."""
    start, direction = np.asarray(start, float), np.asarray(direction, float) / np.linalg.norm(direction)
    a, b, c = (part.points[part.faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    cross = np.cross(direction, v)
    size = np.einsum("ij,ij->i", u, cross)
    size = np.where(np.abs(size) < 1e-12, np.inf, size)
    offset = start - a
    first = np.einsum("ij,ij->i", offset, cross) / size
    second_cross = np.cross(offset, u)
    second = second_cross @ direction / size
    distance = np.where(
        (first >= -1e-9) & (second >= -1e-9) & (first + second <= 1 + 1e-9),
        np.einsum("ij,ij->i", v, second_cross) / size,
        -np.inf,
    )
    face = int(distance.argmax())
    normal = np.cross(u[face], v[face])
    return start + distance[face] * direction, normal / np.linalg.norm(normal)


def merge(parts: Sequence[Part]) -> pv.PolyData:
    """All parts as one PolyData in metres, with point arrays `Normals`, `rgb` (uint8) and `specular` (float32)."""
    start = np.cumsum([0] + [len(part.points) for part in parts])
    faces = np.concatenate([part.faces + first for part, first in zip(parts, start[:-1], strict=True)])
    used, faces = np.unique(faces, return_inverse=True)
    stacked = {
        key: np.concatenate([getattr(part, key) for part in parts])[used]
        for key in ("points", "normals", "rgb", "gloss")
    }
    mesh = as_polydata((stacked["points"] / 1000.0).astype(np.float32), faces.reshape(-1, 3))
    mesh.point_data["Normals"] = stacked["normals"].astype(np.float32)
    mesh.point_data["rgb"] = stacked["rgb"]
    mesh.point_data["specular"] = stacked["gloss"].astype(np.float32)
    mesh.point_data.active_normals_name = "Normals"
    return mesh
