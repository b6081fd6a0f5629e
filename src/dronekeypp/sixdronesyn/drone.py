"""This module describes one drone in numbers (Sec. IV).

Lengths are metres in the body frame: x points forward, y left, z up. Hubs come in keypoint order:
front-left, front-right, rear-right, rear-left.
"""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

KEYPOINT_NAMES = ("front-left", "front-right", "rear-right", "rear-left")


@dataclass(frozen=True, eq=False)
class Drone:
    """A drone has a name, sizes, a mass, colours and four propeller hubs.

    Two drones are equal when name, edition, digest and body seed are: a copy in another process is the same
    drone.

    Attributes:
        name: its key in `DRONES`, or that of a random quadrotor, such as "Quad17".
        label: the name that is shown to people.
        index: its place in `DRONES`, or the number of a random quadrotor.
        body_mm: the published size in millimetres, unfolded, without propellers: fore to aft, across, up.
        wheelbase: metres from the front-left to the rear-right hub.
        propeller_diameter, motor_radius: metres.
        mass: kilograms.
        hull_rgb, trim_rgb, propeller_rgb, tip_rgb: RGB, 0 to 255.
        hubs: (4, 3), metres, body frame: the centres of the propeller discs.
        sources: where the numbers are from, by field ("colours" for the four of them). A source begins with
            "published", "measured" or "estimated"; a colon and a note may follow.
        hull_pitch: radians by which the hull's nose points up when the propellers lie level.
        box_between_axes: the published length and width reach from motor axis to motor axis, not to the outer
            edge (see Air2).
        mesh: the mesh file of a drone of your own (see own.py); None for the seven.
        mesh_scale: metres per unit of that mesh.
        digest: what tells that mesh and its numbers from others; None where there is no mesh file.
        blades: how many blades a propeller has, 2 to 4.
        blade_width: the width of the blades as a multiple of the usual one.
        rear_propeller_rgb: the colour of the rear propellers where it differs from that of the front ones.
        number: of a random quadrotor, see quadrotors.py; None for any other drone.
        family: the family of bodies that a random quadrotor is built as; None for any other drone.
        body_seed: the seed that the body of a random quadrotor is drawn from; 0 for any other drone.
        edition: 1 for a shape that only the first edition of the data set has.
    """

    name: str
    label: str
    index: int
    body_mm: tuple[float, float, float]
    wheelbase: float
    propeller_diameter: float
    mass: float
    motor_radius: float
    hull_rgb: tuple[int, int, int]
    trim_rgb: tuple[int, int, int]
    propeller_rgb: tuple[int, int, int]
    tip_rgb: tuple[int, int, int]
    hubs: np.ndarray = field(repr=False)
    sources: dict[str, str] = field(default_factory=dict, repr=False)
    hull_pitch: float = 0.0
    box_between_axes: bool = False
    mesh: Path | None = None
    mesh_scale: float = 1.0
    digest: str | None = None
    blades: int = 2
    blade_width: float = 1.0
    rear_propeller_rgb: tuple[int, int, int] | None = None
    number: int | None = None
    family: str | None = None
    body_seed: int = 0
    edition: int = 2

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Drone) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[str, int, str | None, int]:
        return self.name, self.edition, self.digest, self.body_seed

    @property
    def seed(self) -> int:
        """Return the number that the drone's random draws follow from.

        It is the index of one of the seven. For any other drone it follows from its name alone.
        """
        if self.mesh is None and self.number is None:
            return self.index
        return int.from_bytes(hashlib.sha256(self.name.encode()).digest()[:4], "big")

    @property
    def estimated(self) -> tuple[str, ...]:
        """Return which of its sizes, its mass and its hubs are estimated (motors and colours always are)."""
        fields = ("body_mm", "wheelbase", "propeller_diameter", "mass", "hubs")
        return tuple(name for name in fields if self.sources.get(name, "").startswith("estimated"))

    @property
    def propeller_radius(self) -> float:
        """Return the radius of a propeller in metres."""
        return self.propeller_diameter / 2


def hubs_from_mm(front: tuple[float, float], rear: tuple[float, float], x: tuple[float, float]) -> np.ndarray:
    """Return four hubs (4, 3) in metres, read-only and left–right symmetric, from millimetres.

    `front` and `rear` are (sideways, up), `x` the forward positions of front and rear.
    """
    (front_y, front_z), (rear_y, rear_z), (front_x, rear_x) = front, rear, x
    hubs = np.array(
        [
            [front_x, front_y, front_z],
            [front_x, -front_y, front_z],
            [rear_x, -rear_y, rear_z],
            [rear_x, rear_y, rear_z],
        ]
    )
    hubs /= 1000.0
    hubs.setflags(write=False)
    return hubs


def spread_hubs(wheelbase_mm: float, front: tuple[float, float], rear: tuple[float, float]) -> np.ndarray:
    """Return hubs (4, 3) in metres that have the given wheelbase, from millimetres.

    The wheelbase is the distance from the front-left to the rear-right hub. `front` and `rear` are (sideways,
    up). The fore-aft distance is solved for and centred.
    """
    across, rise = front[0] + rear[0], front[1] - rear[1]
    half = 0.5 * float(np.sqrt(wheelbase_mm**2 - across**2 - rise**2))
    return hubs_from_mm(front, rear, (half, -half))
