"""This module holds what the body of a random quadrotor is built from: its plan and a few more shapes.

A plan has the lengths of the quadrotor in design millimetres: its wheelbase is 300 of them, whatever its true
size. So one set of proportions serves a drone of 8 cm and one of 80 cm, and the finished body is scaled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.quadrotor_colours import accent
from dronekeypp.sixdronesyn.quadrotors import neighbour_distance
from dronekeypp.sixdronesyn.shapes import RGB, Part, beam, surface

BODY = 3  # what the generator is for, beside those of quadrotors.py
DESIGN = 300.0  # millimetres of wheelbase while a body is built
GAP = 3.0  # that the body keeps from a propeller's disc

Point = Sequence[float]
Sides = tuple[list[Part], list[Part]]


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan holds one quadrotor's lengths in design millimetres, its colours, and its random generator.

    Attributes:
        drone: the quadrotor.
        rng: the generator that its body is drawn from.
        scale: true millimetres per design millimetre.
        front, rear: (3,) the left hubs.
        radius, motor: of a propeller and of a motor.
        ground: z of the ground that it stands on.
        accent: the colour of what stands out.
    """

    drone: Drone
    rng: np.random.Generator
    scale: float
    front: np.ndarray
    rear: np.ndarray
    radius: float
    motor: float
    ground: float
    accent: RGB

    @property
    def hull(self) -> RGB:
        """Return the main colour."""
        return self.drone.hull_rgb

    @property
    def trim(self) -> RGB:
        """Return the second colour."""
        return self.drone.trim_rgb

    @property
    def height(self) -> float:
        """Return the height on the ground, without antennas."""
        return -2 * self.ground

    @property
    def low(self) -> float:
        """Return z of the lower pair of hubs."""
        return float(min(self.front[2], self.rear[2]))

    @property
    def spare(self) -> float:
        """Return the room between a disc and the middle of the way to the next one."""
        return 0.5 * neighbour_distance(self.drone.hubs) * 1000 / self.scale - self.radius

    def draw(self, low: float, high: float) -> float:
        """Return an even draw between two numbers."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """Return true as often as `share` says."""
        return bool(self.rng.random() < share)

    def pick(self, *choices: RGB) -> RGB:
        """Return one of some colours."""
        return choices[int(self.rng.integers(len(choices)))]

    def grey(self, low: int, high: int) -> RGB:
        """Return a grey between two values."""
        value = int(self.rng.integers(low, high))
        return value, value, min(255, value + 2)

    def roof(self, x: tuple[float, float], half: float, margin: float = GAP) -> float:
        """Return the greatest z that something over x[0]..x[1], from -half to half sideways, may reach.

        It is the height of the lowest disc that reaches over it, less a gap, or infinity.
        """
        lowest = np.inf
        for hub in (self.front, self.rear):
            nearest = np.clip(hub[:2], (x[0], -half), (x[1], half))
            if np.linalg.norm(hub[:2] - nearest) < self.radius + margin:
                lowest = min(lowest, float(hub[2]) - margin)
        return lowest

    def free_half(self, x: tuple[float, float], margin: float = GAP) -> float:
        """Return how wide, from the middle, something over x[0]..x[1] may be without a disc above it."""
        half = 1.5 * DESIGN
        for hub in (self.front, self.rear):
            away = hub[0] - np.clip(hub[0], *x)
            inside = (self.radius + margin) ** 2 - away**2
            if inside > 0:
                half = min(half, float(hub[1] - np.sqrt(inside)))
        return half

    def narrowed(self, x: tuple[float, float], half: float) -> tuple[tuple[float, float], float]:
        """Return the x range and half width of something between the discs, shortened until it fits."""
        for _ in range(12):
            if self.free_half(x) >= half:
                break
            x = (0.92 * x[0], 0.92 * x[1])
        return x, min(half, self.free_half(x))

    def clears(self, part: Part) -> bool:
        """Return whether no point of a part lies above a disc, or nearer than half the gap below it."""
        for hub in (self.front, self.rear):
            offset = np.stack([part.points[:, 0], np.abs(part.points[:, 1])], 1) - hub[:2]
            under = np.linalg.norm(offset, axis=1) < self.radius + 0.5 * GAP
            if (part.points[under, 2] > hub[2] - 0.1 * GAP).any():
                return False
        return True

    def whole(self, parts: list[Part]) -> list[Part]:
        """Return parts that belong together, or none of them where one does not clear the discs."""
        return parts if all(self.clears(part) for part in parts) else []


def plan_of(drone: Drone) -> Plan:
    """Return the plan of a random quadrotor."""
    rng = np.random.default_rng([drone.body_seed, drone.number, BODY])
    scale = 1000 * drone.wheelbase / DESIGN
    millimetres = 1000 / scale
    return Plan(
        drone=drone,
        rng=rng,
        scale=scale,
        front=drone.hubs[0] * millimetres,
        rear=drone.hubs[3] * millimetres,
        radius=drone.propeller_radius * millimetres,
        motor=drone.motor_radius * millimetres,
        ground=-0.5 * drone.body_mm[2] / scale,
        accent=accent(rng),
    )


def scaled(part: Part, factor: float) -> Part:
    """Return a part that is `factor` times as large about the origin."""
    return replace(part, points=factor * part.points)


def ring(
    at: Point, profile: Sequence[tuple[float, float]], rgb: RGB, segments: int = 32, gloss: float = 0.3
) -> Part:
    """Return a ring: a closed `profile` of (radius, height) turned about the vertical axis through `at`."""
    angle = np.arange(segments) * (2 * np.pi / segments)
    section = np.asarray(profile, float)
    radius, height = np.broadcast_arrays(section[:, 0], section[None, :, 1])
    points = np.stack(
        [
            np.cos(angle)[:, None] * radius,
            np.sin(angle)[:, None] * radius,
            np.broadcast_to(height, (segments, len(section))),
        ],
        -1,
    )
    corner = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    a, b = corner, np.roll(corner, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return surface(points.reshape(-1, 3) + np.asarray(at, float), faces, rgb, gloss)


def plate(
    outline: Sequence[tuple[float, float]], z: tuple[float, float], rgb: RGB, gloss: float = 0.3
) -> Part:
    """Return a flat plate between two heights.

    `outline` is its (x, y) border, seen from above; every spot of it must be seen from its middle.
    """
    border = np.asarray(outline, float)
    count = len(border)
    points = []
    for height in z:
        points.append(np.column_stack([border, np.full(count, height)]))
    for height in z:
        points.append(np.append(border.mean(axis=0), height)[None])
    k = np.arange(count)
    following = (k + 1) % count
    faces = [
        np.stack([k, following, count + following], 1),
        np.stack([k, count + following, count + k], 1),
        np.stack([np.full(count, 2 * count), following, k], 1),
        np.stack([np.full(count, 2 * count + 1), count + k, count + following], 1),
    ]
    return surface(np.concatenate(points), np.concatenate(faces), rgb, gloss)


def rounded(
    x: tuple[float, float], half: float, corner: float, waist: float = 1.0
) -> list[tuple[float, float]]:
    """Return the outline of a rectangle with cut corners, `waist` times as wide in its middle."""
    rear, front = x
    middle = 0.5 * (rear + front)
    left = [
        (front, half - corner),
        (front - corner, half),
        (middle, waist * half),
        (rear + corner, half),
        (rear, half - corner),
    ]
    return left + [(px, -py) for px, py in reversed(left)]


def tube(start: Point, end: Point, radius: float, rgb: RGB, around: int = 8, gloss: float = 0.4) -> Part:
    """Return a round straight tube with closed ends."""
    path = [start, end]
    upright = abs(end[2] - start[2]) > 0.9 * np.linalg.norm(np.subtract(end, start))
    up = (1, 0, 0) if upright else (0, 0, 1)
    sizes = [(radius, radius), (radius, radius)]
    return beam(path, sizes, rgb, up=up, along=2, around=around, exponent=2.0, gloss=gloss, round_end=0.1)


def facing(direction: Point) -> np.ndarray:
    """Return a (3, 3) rotation that takes x to `direction` (any length) and keeps y level."""
    forward = np.asarray(direction, float) / np.linalg.norm(direction)
    left = np.cross((0, 0, 1), forward)
    left /= np.linalg.norm(left)
    return np.stack([forward, left, np.cross(forward, left)], 1)
