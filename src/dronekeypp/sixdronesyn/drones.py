"""This module describes the seven drones in numbers (Sec. IV).

The numbers are sizes, weights, colours and the four propeller hubs. Lengths are metres in the body frame: x
points forward, y left, z up. The origin is the drone's centre: half its height above the ground it stands
on, and midway between the front and the rear hubs. Only Mini 2 differs: its origin is that of its maker's
model, 1.6 mm behind the middle. Hubs come in keypoint order: front-left, front-right, rear-right, rear-left.

The hubs were chosen as follows. The wheelbase (front-left to rear-right) and the propellers come first: two
propellers must not meet, so their hubs stand at least one diameter apart, and a disc that reaches over the
hull lies above it. The sideways positions follow the unfolded width. The fore-aft distance then follows from
the wheelbase. Only Mini 2's hubs are measured. For the others the heights, and how much narrower the rear is
than the front, are estimated from how the drone looks.
"""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dronekeypp.sixdronesyn import own

KEYPOINT_NAMES = ("front-left", "front-right", "rear-right", "rear-left")


@dataclass(frozen=True, eq=False)
class Drone:
    """A drone has a name, sizes, a mass, colours and four propeller hubs.

    Attributes:
        name: its key in `DRONES`.
        label: the name that is shown to people.
        index: its place in `DRONES`.
        body_mm: the published length, width and height in millimetres, unfolded, without propellers.
        wheelbase: metres from the front-left to the rear-right hub.
        propeller_diameter, motor_radius: metres.
        mass: kilograms.
        hull_rgb, trim_rgb, propeller_rgb, tip_rgb: RGB, 0 to 255.
        hubs: (4, 3), metres, body frame: the centres of the propeller discs.
        estimated: the fields that are not published figures.
        box_between_axes: the published length and width reach from motor axis to motor axis, not to the outer
            edge (see Air2).
        mesh: the mesh file of a drone of your own (see own.py); None for the seven.
        mesh_scale: metres per unit of that mesh.
        digest: what tells that mesh and its numbers from others; None for the seven.
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
    estimated: tuple[str, ...] = ()
    box_between_axes: bool = False
    mesh: Path | None = None
    mesh_scale: float = 1.0
    digest: str | None = None

    @property
    def seed(self) -> int:
        """Return the number that the drone's random draws follow from.

        It is the index of one of the seven. For a drone of your own it follows from its name alone.
        """
        if self.mesh is None:
            return self.index
        return int.from_bytes(hashlib.sha256(self.name.encode()).digest()[:4], "big")

    @property
    def propeller_radius(self) -> float:
        """Return the radius of a propeller in metres."""
        return self.propeller_diameter / 2


def _hubs(front: tuple[float, float], rear: tuple[float, float], x: tuple[float, float]) -> np.ndarray:
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


def _spread(wheelbase_mm: float, front: tuple[float, float], rear: tuple[float, float]) -> np.ndarray:
    """Return hubs (4, 3) in metres that have the given wheelbase, from millimetres.

    The wheelbase is the distance from the front-left to the rear-right hub. `front` and `rear` are (sideways,
    up). The fore-aft distance is solved for and centred.
    """
    across, rise = front[0] + rear[0], front[1] - rear[1]
    half = 0.5 * float(np.sqrt(wheelbase_mm**2 - across**2 - rise**2))
    return _hubs(front, rear, (half, -half))


_LIST = (
    # The front arms hang low so that the camera can look up, and the rear rotors are the higher pair. The
    # heights are estimated. So are the propellers, at 141 to 152 mm: those of 144 mm just clear each other.
    Drone(
        name="Mini3",
        label="Mini 3 Pro",
        index=0,
        body_mm=(171, 245, 62),
        wheelbase=0.247,
        propeller_diameter=0.144,
        mass=0.249,
        motor_radius=0.0125,
        hull_rgb=(196, 199, 202),
        trim_rgb=(70, 72, 76),
        propeller_rgb=(86, 88, 92),
        tip_rgb=(86, 88, 92),
        hubs=_spread(247, (108.0, 3.0), (92.0, 25.0)),
        estimated=("propeller_diameter", "hubs"),
    ),
    # The maker's own positions: the front rotors are 21.5 mm above the rear ones. The diagonal is 215.0 mm,
    # 213 mm is published.
    Drone(
        name="Mini2",
        label="Mini 2",
        index=1,
        body_mm=(159, 203, 56),
        wheelbase=0.213,
        propeller_diameter=0.119,
        mass=0.249,
        motor_radius=0.0115,
        hull_rgb=(200, 202, 204),
        trim_rgb=(92, 94, 98),
        propeller_rgb=(92, 94, 98),
        tip_rgb=(226, 120, 52),
        hubs=_hubs((87.8, 24.7), (85.5, 3.2), (64.3, -61.1)),
    ),
    # The wheelbase of 354 mm is estimated. Wide front arms stand on long legs, so the front rotors are the
    # higher pair, which is estimated too.
    Drone(
        name="Air3",
        label="Air 3",
        index=2,
        body_mm=(259, 326, 106),
        wheelbase=0.354,
        propeller_diameter=0.221,
        mass=0.720,
        motor_radius=0.0155,
        hull_rgb=(124, 127, 131),
        trim_rgb=(48, 50, 53),
        propeller_rgb=(60, 62, 65),
        tip_rgb=(60, 62, 65),
        hubs=_spread(354, (146.5, 48.0), (126.0, 33.0)),
        estimated=("wheelbase", "hubs"),
    ),
    # 183 × 253 mm leaves no room for a 302 mm wheelbase inside the motors' outer edges. Read from axis to
    # axis it fits (188 × 253 mm).
    Drone(
        name="Air2",
        label="Mavic Air 2",
        index=3,
        body_mm=(183, 253, 77),
        wheelbase=0.302,
        propeller_diameter=0.183,
        mass=0.570,
        motor_radius=0.0140,
        hull_rgb=(82, 85, 89),
        trim_rgb=(38, 39, 42),
        propeller_rgb=(58, 59, 62),
        tip_rgb=(58, 59, 62),
        hubs=_spread(302, (126.5, 36.0), (110.0, 25.0)),
        estimated=("hubs",),
        box_between_axes=True,
    ),
    # 242 mm wide to the outside would make the 221 mm propellers meet. So the hubs are set 228 and 224 mm
    # apart, which is estimated and wider than the box.
    Drone(
        name="Mav2",
        label="Mavic 2 Pro",
        index=4,
        body_mm=(322, 242, 84),
        wheelbase=0.354,
        propeller_diameter=0.221,
        mass=0.907,
        motor_radius=0.0140,
        hull_rgb=(92, 95, 98),
        trim_rgb=(40, 41, 44),
        propeller_rgb=(54, 55, 58),
        tip_rgb=(150, 146, 136),
        hubs=_spread(354, (114.0, 38.0), (112.0, 26.0)),
        estimated=("hubs",),
    ),
    # Front and rear hubs are both about half the width less a motor: 239 mm propellers leave no room for a
    # narrower rear. The heights are estimated.
    Drone(
        name="Mav3",
        label="Mavic 3",
        index=5,
        body_mm=(347.5, 283, 107.7),
        wheelbase=0.3801,
        propeller_diameter=0.239,
        mass=0.895,
        motor_radius=0.0165,
        hull_rgb=(134, 136, 138),
        trim_rgb=(54, 56, 59),
        propeller_rgb=(56, 57, 60),
        tip_rgb=(232, 122, 44),
        hubs=_spread(380.1, (124.5, 50.0), (121.0, 32.0)),
        estimated=("hubs",),
    ),
    # The wheelbase is 120 to 127 mm by estimate: 120 is what fits a 98 × 92.5 mm frame with 5 mm motors at
    # its corners. All four rotors are level.
    Drone(
        name="Tello",
        label="Tello",
        index=6,
        body_mm=(98, 92.5, 41),
        wheelbase=0.120,
        propeller_diameter=0.076,
        mass=0.080,
        motor_radius=0.0050,
        hull_rgb=(236, 237, 238),
        trim_rgb=(30, 31, 33),
        propeller_rgb=(34, 35, 37),
        tip_rgb=(34, 35, 37),
        hubs=_spread(120, (41.2, 17.5), (41.2, 17.5)),
        estimated=("wheelbase", "hubs"),
    ),
)

SEVEN = tuple(drone.name for drone in _LIST)
DRONES: dict[str, Drone] = {drone.name: drone for drone in _LIST}
for _fields in own.read(SEVEN):
    DRONES[_fields["name"]] = Drone(**_fields)
