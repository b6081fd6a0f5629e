"""Cars and boats: little meshes."""

from __future__ import annotations

import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.props import to_world
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight
from dronekeypp.environments.specs import Colour
from dronekeypp.environments.things import Lines, Mesh, Thing

CAR_PAINTS: tuple[Colour, ...] = (
    (0.62, 0.62, 0.61),
    (0.03, 0.03, 0.035),
    (0.30, 0.31, 0.32),
    (0.10, 0.11, 0.12),
    (0.30, 0.025, 0.02),
    (0.03, 0.07, 0.20),
    (0.45, 0.44, 0.41),
)
_TYRE: Colour = (0.02, 0.02, 0.022)
_RIM: Colour = (0.25, 0.25, 0.26)
_GLASS: Colour = (0.015, 0.018, 0.02)
_HEADLIGHT: Colour = (0.6, 0.6, 0.6)
_TAIL_LIGHT: Colour = (0.3, 0.01, 0.01)

HULLS: tuple[Colour, ...] = (
    (0.50, 0.50, 0.49),
    (0.42, 0.41, 0.38),
    (0.05, 0.08, 0.16),
    (0.24, 0.05, 0.04),
)
_DECK: Colour = (0.40, 0.37, 0.30)
_CABIN_ROOF: Colour = (0.58, 0.58, 0.56)

Point = tuple[float, float, float]  # forward, left, up, in metres
Outline = list[tuple[float, float]]  # corners of a side view: forward, up


class _Details(Mesh):
    """Loose polygons that lie on a body: a little nearer than it, each drawn whichever way it faces."""

    @property
    def distance(self) -> float:
        return super().distance - 1.2

    def cast(self, shadows: Shadows) -> None:
        """They cast no shadow of their own."""

    def paint(self, canvas: Canvas, light: Daylight) -> None:
        for face, colour, shine in zip(self.faces, self.colours, self.gloss, strict=True):
            Mesh([face], [colour], [shine]).paint(canvas, light)


def car(x: float, y: float, heading: float, rng: np.random.Generator) -> list[Thing]:
    """Make a parked car about 4.4 m long: a body with a cabin, and its wheels and lamps.

    Args:
        x, y: its middle, metres.
        heading: radians.
        rng: draws its colour and shape.
    """
    paint = CAR_PAINTS[int(rng.integers(len(CAR_PAINTS)))]
    long, tall = rng.uniform(3.9, 4.7), rng.uniform(1.42, 1.62)
    van = rng.random() < 0.25
    hood = 1.1 if van else 0.95
    # Outlines as (forward in lengths of the car, up in metres).
    body = [
        (-0.5, 0.35),
        (-0.5, 0.82),
        (-0.47, hood - 0.02),
        (0.26, hood),
        (0.46, hood - 0.16),
        (0.5, 0.68),
        (0.5, 0.33),
        (0.3, 0.24),
        (-0.3, 0.24),
    ]
    cabin = [
        (-0.46 if van else -0.42, hood - 0.01),
        (-0.42 if van else -0.29, tall),
        (0.02, tall + 0.02),
        (0.27, hood),
    ]
    shell = Mesh([], [], [])
    _extrude(shell, _scaled(body, long), (0.86, 0.86), hood, paint, [paint])
    _extrude(shell, _scaled(cabin, long), (0.84, 0.64), hood, _GLASS, [_GLASS, paint, _GLASS, paint])
    # Only what faces the camera is drawn: wheels of the near side, and lamps of the near end.
    camera_forward = np.cos(heading) * -x + np.sin(heading) * -y
    camera_left = -np.sin(heading) * -x + np.cos(heading) * -y
    near_side = 1 if camera_left >= 0 else -1
    details = _Details([], [], [])
    _add_wheels(details, long, near_side)
    _add_lamps(details, long, front=camera_forward >= 0)
    shell.faces = [to_world(face, x, y, heading) for face in shell.faces]
    details.faces = [to_world(face, x, y, heading) for face in details.faces]
    return [shell, details]


def _scaled(outline: Outline, long: float) -> Outline:
    """Return an outline with its forward positions in metres."""
    return [(forward * long, up) for forward, up in outline]


def _add(mesh: Mesh, face: list[Point], colour: Colour, shine: float) -> None:
    """Add a face to a mesh."""
    mesh.faces.append(np.array(face, float))
    mesh.colours.append(colour)
    mesh.gloss.append(shine)


def _extrude(
    mesh: Mesh,
    outline: Outline,
    half_width: tuple[float, float],
    hood: float,
    side: Colour,
    tops: list[Colour],
) -> None:
    """Add a side view, extruded to both sides, to a mesh.

    Args:
        mesh: the faces are added here.
        outline: the side view, metres.
        half_width: half the width in metres, of what lies below the hood and of what lies above.
        hood: height of the hood in metres.
        side: colour of the two sides.
        tops: colours of the faces between them, in turn.
    """
    halves = []
    for _, up in outline:
        halves.append(half_width[0] if up < hood + 0.02 else half_width[1])
    for sign in (-1, 1):
        face = []
        for (forward, up), half in zip(outline, halves, strict=True):
            face.append((forward, sign * half, up))
        _add(mesh, face, side, 0.6)
    for i in range(len(outline)):
        j = (i + 1) % len(outline)
        (a, b), (c, d) = outline[i], outline[j]
        face = [(a, halves[i], b), (c, halves[j], d), (c, -halves[j], d), (a, -halves[i], b)]
        _add(mesh, face, tops[i % len(tops)], 0.9)


def _add_wheels(mesh: Mesh, long: float, side: int) -> None:
    """Add the wheels of one side to a mesh. side: 1 for the left one, -1 for the right one."""
    for axle in (-0.29 * long, 0.31 * long):
        _add(mesh, _disc(axle, side * 0.87, 0.31), _TYRE, 0.0)
        _add(mesh, _disc(axle, side * 0.88, 0.18), _RIM, 0.3)


def _disc(forward: float, left: float, radius: float) -> list[Point]:
    """Return a polygon around a wheel's hub, which is 0.31 m above the ground."""
    points = []
    for angle in np.linspace(0, 2 * np.pi, 15)[:-1]:
        points.append((forward + radius * np.cos(angle), left, 0.31 + radius * np.sin(angle)))
    return points


def _add_lamps(mesh: Mesh, long: float, front: bool) -> None:
    """Add the headlights (front) or the tail lights of a car to a mesh."""
    for sign in (-1, 1):
        if front:
            face = [
                (0.49 * long, sign * 0.78, 0.72),
                (0.505 * long, sign * 0.45, 0.70),
                (0.505 * long, sign * 0.45, 0.60),
                (0.50 * long, sign * 0.78, 0.60),
            ]
            _add(mesh, face, _HEADLIGHT, 1)
        else:
            face = [
                (-0.5 * long - 0.01, sign * 0.8, 0.85),
                (-0.505 * long, sign * 0.6, 0.85),
                (-0.505 * long, sign * 0.6, 0.7),
                (-0.505 * long, sign * 0.8, 0.7),
            ]
            _add(mesh, face, _TAIL_LIGHT, 1)


def boat(x: float, y: float, heading: float, rng: np.random.Generator) -> list[Thing]:
    """Make a small sailing boat with a bare mast. x, y: its middle, metres. heading: radians."""
    long = rng.uniform(6.5, 10.5)
    hull = HULLS[int(rng.integers(4))]
    mesh = Mesh([], [], [], afloat=True)
    _add_hull(mesh, long, hull)
    _add_cabin(mesh, long)
    mesh.faces = [to_world(face, x, y, heading) for face in mesh.faces]
    top = 1.35 * long
    foot = 0.05 * long
    bars = [
        ([foot, 0, 1.2], [foot, 0, top]),  # mast
        ([foot, 0, 2.0], [-0.38 * long, 0, 1.9]),  # boom
        ([foot, 0, top], [0.5 * long, 0, 1.2]),  # stays and shrouds
        ([foot, 0, top], [-0.5 * long, 0, 1.0]),
        ([foot, 0, top * 0.97], [0.04 * long, 0.15 * long, 1.0]),
        ([foot, 0, top * 0.97], [0.04 * long, -0.15 * long, 1.0]),
    ]
    ends = np.stack([to_world(bar, x, y, heading) for bar in bars])
    thick = np.array([0.11, 0.10, 0.012, 0.012, 0.012, 0.012])
    return [mesh, Lines(ends, thick, (0.5, 0.5, 0.5), afloat=True)]


def _add_hull(mesh: Mesh, long: float, colour: Colour) -> None:
    """Add the hull of a boat to a mesh: eight planks on each side and the stern."""
    t = np.linspace(-1, 1, 9)  # from the stern to the bow
    taper = 1 - np.clip(t, -0.5, 1) ** 2.0 * (t > 0) - 0.25 * (t < 0) * t**2
    beam = 0.16 * long * np.sqrt(np.clip(taper, 0, 1))  # half the width
    rise = 0.95 + 0.25 * np.maximum(t, 0)  # height of the deck
    for sign in (-1, 1):
        for a in range(8):
            b = a + 1
            face = [
                (t[a] * long / 2, sign * beam[a], rise[a]),
                (t[b] * long / 2, sign * beam[b], rise[b]),
                (t[b] * long / 2.15, sign * beam[b] * 0.75, 0),
                (t[a] * long / 2.15, sign * beam[a] * 0.75, 0),
            ]
            _add(mesh, face, colour, 0.3)
    stern = [
        (-long / 2, -beam[0], 0.95),
        (-long / 2, beam[0], 0.95),
        (-long / 2.15, beam[0] * 0.75, 0),
        (-long / 2.15, -beam[0] * 0.75, 0),
    ]
    _add(mesh, stern, colour, 0.3)


def _add_cabin(mesh: Mesh, long: float) -> None:
    """Add the cabin of a boat to a mesh: two sides and the faces between."""
    outline = [(-0.18 * long, 0.9), (-0.16 * long, 1.55), (0.14 * long, 1.45), (0.2 * long, 1.0)]
    half = 0.09 * long
    for sign in (-1, 1):
        _add(mesh, [(forward, sign * half, up) for forward, up in outline], _DECK, 0.3)
    for (a, b), (c, d) in zip(outline[:-1], outline[1:], strict=True):
        _add(mesh, [(a, half, b), (c, half, d), (c, -half, d), (a, -half, b)], _CABIN_ROOF, 0.3)
