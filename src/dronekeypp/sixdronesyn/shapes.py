"""This module makes small closed surfaces to build a drone from: lofts, beams, lathes and blocks.

Lengths are millimetres here, because that is how a drone is measured; `merge` turns them into metres. Every
builder returns a `Part` whose faces look outward. Its normals are smooth within a surface and split along
sharp edges. Nothing is random.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyvista as pv
from scipy.interpolate import PchipInterpolator

RGB = tuple[int, int, int]
AXES = "xyz"


@dataclass(frozen=True)
class Part:
    """A part is a coloured triangle surface of P points and F faces.

    `points` and `normals` are (P, 3), `faces` (F, 3), `rgb` (P, 3) uint8, and `gloss` (P,) runs from 0 (matt)
    to 1 (like a mirror).
    """

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    rgb: np.ndarray
    gloss: np.ndarray


def as_polydata(points: np.ndarray, faces: np.ndarray) -> pv.PolyData:
    """Return triangles (F, 3) over points (P, 3) as a PolyData."""
    cells = np.empty((len(faces), 4), np.int64)
    cells[:, 0] = 3
    cells[:, 1:] = faces
    return pv.PolyData(points, cells.ravel())


def surface(points: np.ndarray, faces: np.ndarray, rgb: RGB, gloss: float, crease: float = 38.0) -> Part:
    """Return a part of one colour.

    Its faces are turned outward, and faces without area are dropped. Normals are split where two faces meet
    at more than `crease` degrees.
    """
    corners = points[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    corners, faces = corners[area > 1e-7], faces[area > 1e-7]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))  # six times it
    if volume < 0:
        faces = faces[:, ::-1]
    mesh = as_polydata(points, faces).compute_normals(
        cell_normals=False,
        split_vertices=True,
        feature_angle=crease,
        consistent_normals=False,
        auto_orient_normals=False,
    )
    return Part(
        points=np.asarray(mesh.points, float),
        normals=np.asarray(mesh.point_data["Normals"], float),
        faces=mesh.faces.reshape(-1, 4)[:, 1:].copy(),
        rgb=np.tile(np.asarray(rgb, np.uint8), (mesh.n_points, 1)),
        gloss=np.full(mesh.n_points, gloss),
    )


def _tube(rings: np.ndarray, rgb: RGB, gloss: float, crease: float = 38.0) -> Part:
    """Return the skin over `rings` (R, A, 3), which are R rings of A points.

    A fan around its middle closes each end.
    """
    count, around = rings.shape[:2]
    points = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    k = np.arange(around)
    following = (k + 1) % around
    faces = []
    for ring in range(count - 1):
        a, b = ring * around, (ring + 1) * around
        faces.append(np.stack([a + k, b + k, b + following], 1))
        faces.append(np.stack([a + k, b + following, a + following], 1))
    last = (count - 1) * around
    first_middle, last_middle = count * around, count * around + 1
    faces.append(np.stack([np.full(around, first_middle), k, following], 1))
    faces.append(np.stack([np.full(around, last_middle), last + following, last + k], 1))
    return surface(points, np.concatenate(faces), rgb, gloss, crease)


def _oval(around: int, exponent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `around` points on each superellipse |a|^n + |b|^n = 1, for the exponents n (..., 1).

    An exponent of 2 gives an ellipse, 5 a box with round corners, where its points crowd.
    """
    angle = (np.arange(around) + 0.5) * (2 * np.pi / around)
    a, b = np.cos(angle), np.sin(angle)
    return np.sign(a) * np.abs(a) ** (2 / exponent), np.sign(b) * np.abs(b) ** (2 / exponent)


def hull(
    stations: Sequence[Sequence[float]], rgb: RGB, rings: int = 22, around: int = 24, gloss: float = 0.25
) -> Part:
    """Return a fuselage lofted along x.

    Each station is (x, half width, z bottom, z widest, z top, exponent bottom, exponent top). Between the
    stations every number follows a monotone cubic, so the skin has no waves. Rings lie closer together where
    stations do.
    """
    table = np.asarray(stations, float)
    position = np.linspace(0, len(table) - 1, rings)
    columns = PchipInterpolator(np.arange(len(table)), table, axis=0)(position).T
    x, half, bottom, middle, top, low, high = columns[..., None]  # each (rings, 1)
    angle = (np.arange(around) + 0.5) * (2 * np.pi / around)
    upper = np.sin(angle)[None] > 0
    a, b = _oval(around, np.where(upper, high, low))
    y = half * a
    z = middle + np.where(upper, top - middle, middle - bottom) * b
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
    """Return a tapered bar with round ends.

    Args:
        path: (n, 3), the knots of its middle line.
        size: (n, 2), at each knot the half width (across `up`) and the half height (towards `up`).
        rgb: its colour.
        up: the direction that the half height is measured along.
        along, around: number of rings, and of points on each.
        exponent: that of the cross-section, see `_oval`.
        gloss: from 0 (matt) to 1 (like a mirror).
        round_end: how far each end bulges, as a share of the smaller half size there.
    """
    table = np.concatenate([np.asarray(path, float), np.asarray(size, float)], 1)
    position = np.linspace(0, len(path) - 1, along)
    if len(path) > 2:
        row = PchipInterpolator(np.arange(len(path)), table, axis=0)(position)
    else:
        row = table[0] + position[:, None] * (table[1] - table[0])
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

    def cap(index: int, sign: float) -> np.ndarray:
        # One smaller ring beyond the end makes the tip look moulded instead of sawn off.
        reach = sign * round_end * float(half[index].min())
        return centre[index] + 0.62 * (rings[index] - centre[index]) + reach * tangent[index]

    return _tube(np.concatenate([cap(0, -1)[None], rings, cap(-1, 1)[None]]), rgb, gloss, crease=50)


def frame(axis: Sequence[float]) -> np.ndarray:
    """Return a (3, 3) rotation that takes z to `axis` (any length)."""
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
    """Return a `profile` of (radius, height) turned about `axis` through `at`.

    Both ends are closed.
    """
    angle = np.arange(segments) * (2 * np.pi / segments)
    circle = np.stack([np.cos(angle), np.sin(angle)], -1)
    rings = []
    for radius, height in profile:
        rings.append(np.column_stack([max(radius, 1e-3) * circle, np.full(segments, height)]))
    return moved(_tube(np.stack(rings), rgb, gloss), frame(axis), at)


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
    """Return a box with round corners and edges.

    It has the half sizes `half`, is centred at `at` and rotated by `turn` (3, 3). `soft` is the share of its
    smallest half size that the rounded ends take.
    """
    hx, hy, hz = half
    edge = soft * min(half)
    a, b = _oval(around, np.full((1, 1), exponent))
    rings = []
    for x, inset in (
        (-hx, edge),
        (-hx + 0.35 * edge, 0.3 * edge),
        (-hx + edge, 0),
        (hx - edge, 0),
        (hx - 0.35 * edge, 0.3 * edge),
        (hx, edge),
    ):
        rings.append(np.column_stack([np.full(around, x), (hy - inset) * a[0], (hz - inset) * b[0]]))
    part = _tube(np.stack(rings), rgb, gloss, crease=42)
    return moved(part, np.eye(3) if turn is None else turn, at)


def moved(part: Part, turn: np.ndarray, at: Sequence[float] = (0, 0, 0)) -> Part:
    """Return the part rotated by `turn` (3, 3), then shifted by `at`."""
    return replace(part, points=part.points @ turn.T + np.asarray(at, float), normals=part.normals @ turn.T)


def mirrored(part: Part) -> Part:
    """Return the part on the other side of the drone (y becomes -y)."""
    flip = np.array([1.0, -1.0, 1.0])
    return replace(part, points=part.points * flip, normals=part.normals * flip, faces=part.faces[:, ::-1])


def _sliced(part: Part, faces: np.ndarray, axis: int, value: float) -> Part:
    """Return the part, cut along the plane where coordinate `axis` equals `value`.

    Only some faces are cut: `faces` (F,) bool says which. A face that crosses the plane becomes three
    triangles.
    """
    above = part.points[:, axis][part.faces] > value  # (F, 3): corners beyond the plane
    count = above.sum(axis=1)
    cut = faces & (count > 0) & (count < 3)
    if not cut.any():
        return part
    # turn each triangle so that its apex, the only corner on its side of the plane, comes first
    triangles, row = part.faces[cut], np.arange(cut.sum())
    apex = np.where(count[cut] == 1, above[cut].argmax(axis=1), (~above[cut]).argmax(axis=1))
    a = triangles[row, apex]
    b = triangles[row, (apex + 1) % 3]
    c = triangles[row, (apex + 2) % 3]
    points, normals = [part.points], [part.normals]
    for other in (b, c):
        share = (value - part.points[a, axis]) / (part.points[other, axis] - part.points[a, axis])
        points.append(part.points[a] + share[:, None] * (part.points[other] - part.points[a]))
        normal = part.normals[a] + share[:, None] * (part.normals[other] - part.normals[a])
        normals.append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    p = len(part.points) + np.arange(len(a))  # the new points between a and b
    q = p + len(a)  # and those between a and c
    pieces = [part.faces[~cut], np.stack([a, p, q], 1), np.stack([p, b, c], 1), np.stack([p, c, q], 1)]
    return Part(
        points=np.concatenate(points),
        normals=np.concatenate(normals),
        faces=np.concatenate(pieces),
        rgb=np.concatenate([part.rgb, part.rgb[a], part.rgb[a]]),
        gloss=np.concatenate([part.gloss, part.gloss[a], part.gloss[a]]),
    )


def painted(part: Part, rgb: RGB, gloss: float | None = None, **bounds: tuple[float, float]) -> Part:
    """Return the part with the surface inside a box in another colour, and another gloss if it is given.

    `bounds` are `x`, `y`, `z` = (low, high), any of them. The border of the colour is sharp, because
    triangles are cut along the border of the box.
    """
    for name, limits in bounds.items():
        for value in limits:
            corners = part.points[part.faces]  # (F, 3, 3)
            near = np.ones(len(corners), bool)
            for other, (low, high) in bounds.items():
                coordinate = corners[:, :, AXES.index(other)]
                near &= (coordinate.max(axis=1) > low) & (coordinate.min(axis=1) < high)
            part = _sliced(part, near, AXES.index(name), value)

    centre = part.points[part.faces].mean(axis=1)
    inside = np.ones(len(centre), bool)
    for name, (low, high) in bounds.items():
        coordinate = centre[:, AXES.index(name)]
        inside &= (coordinate > low) & (coordinate < high)
    # the faces inside get points of their own, because a point has only one colour
    used, local = np.unique(part.faces[inside], return_inverse=True)
    new_gloss = part.gloss[used] if gloss is None else np.full(len(used), gloss)
    return Part(
        points=np.concatenate([part.points, part.points[used]]),
        normals=np.concatenate([part.normals, part.normals[used]]),
        faces=np.concatenate([part.faces[~inside], local.reshape(-1, 3) + len(part.points)]),
        rgb=np.concatenate([part.rgb, np.tile(np.asarray(rgb, np.uint8), (len(used), 1))]),
        gloss=np.concatenate([part.gloss, new_gloss]),
    )


def on_surface(
    part: Part, start: Sequence[float], direction: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a ray from inside the part leaves it, and the unit normal of the surface there, (3,) each.

    It serves to set an eye or a light flush. The intersection is Möller and Trumbore's.
    """
    start = np.asarray(start, float)
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    a = part.points[part.faces[:, 0]]
    b = part.points[part.faces[:, 1]]
    c = part.points[part.faces[:, 2]]
    u, v = b - a, c - a
    cross = np.cross(direction, v)
    size = np.einsum("ij,ij->i", u, cross)
    size = np.where(np.abs(size) < 1e-12, np.inf, size)  # a ray along the triangle misses it
    offset = start - a
    offset_cross = np.cross(offset, u)
    first = np.einsum("ij,ij->i", offset, cross) / size  # barycentric coordinates
    second = offset_cross @ direction / size
    hit = (first >= -1e-9) & (second >= -1e-9) & (first + second <= 1 + 1e-9)
    distance = np.where(hit, np.einsum("ij,ij->i", v, offset_cross) / size, -np.inf)
    face = int(distance.argmax())
    normal = np.cross(u[face], v[face])
    return start + distance[face] * direction, normal / np.linalg.norm(normal)


def merge(parts: Sequence[Part]) -> pv.PolyData:
    """Return all parts as one PolyData in metres.

    Its point arrays are `Normals` and `specular` (float32) and `rgb` (uint8). Points that no face uses are
    dropped.
    """
    faces = []
    offset = 0
    for part in parts:
        faces.append(part.faces + offset)
        offset += len(part.points)
    used, renumbered = np.unique(np.concatenate(faces), return_inverse=True)
    points = np.concatenate([part.points for part in parts])[used]
    normals = np.concatenate([part.normals for part in parts])[used]
    rgb = np.concatenate([part.rgb for part in parts])[used]
    gloss = np.concatenate([part.gloss for part in parts])[used]
    mesh = as_polydata((points / 1000.0).astype(np.float32), renumbered.reshape(-1, 3))
    mesh.point_data["Normals"] = normals.astype(np.float32)
    mesh.point_data["rgb"] = rgb
    mesh.point_data["specular"] = gloss.astype(np.float32)
    mesh.point_data.active_normals_name = "Normals"
    return mesh
