"""The seven drones in numbers (Sec. IV): sizes, weights, colours and the four propeller hubs.

Metres, body frame: x forward, y left, z up. The origin is the drone's centre: half its height above the ground it stands on, and midway
between the front and the rear hubs (Mini 2: the origin of its maker's model, 1.6 mm behind that). Hubs come in keypoint order:
front-left, front-right, rear-right, rear-left.

How the hubs were chosen. The wheelbase (front-left to rear-right) and the propellers come first: two propellers must not meet, so their
hubs stand at least one diameter apart, and a disc that reaches over the hull lies above it. The sideways positions follow the unfolded
width, the fore-aft distance then follows from the wheelbase. Only Mini 2's hubs are measured. For the others the heights, and how much
narrower the rear is than the front, are estimated from how the drone looks.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dronekeypp.sixdronesyn import own

KEYPOINT_NAMES = ("front-left", "front-right", "rear-right", "rear-left")


@dataclass(frozen=True, eq=False)
class Drone:
    """One drone type.

    `hubs` is (4, 3), metres, body frame: the centres of the propeller discs. `body_mm` is the published length, width and height,
    unfolded, without propellers. `wheelbase`, `propeller_diameter` and `motor_radius` are metres, `mass` is kilograms, colours are RGB
    0..255. `estimated` names the fields that are not published figures.
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
    # the published length and width reach from motor axis to motor axis, not to the outer edge (see Air2)
    box_between_axes: bool = False
    # one of your own (see own.py): its mesh, metres per unit of it, and what tells this mesh and these numbers from others
    mesh: Path | None = None
    mesh_scale: float = 1.0
    digest: str | None = None

    @property
    def propeller_radius(self) -> float:
        """Metres."""
        return self.propeller_diameter / 2


def _hubs(front: tuple[float, float], rear: tuple[float, float], x: tuple[float, float]) -> np.ndarray:
    """(4, 3) metres from millimetres: `front` and `rear` are (sideways, up), `x` the two forward positions. Read-only, left-right
    symmetric."""
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
    """Hubs whose front-left to rear-right distance is the wheelbase; the fore-aft distance is solved for and centred."""
    across, rise = front[0] + rear[0], front[1] - rear[1]
    half = 0.5 * float(np.sqrt(wheelbase_mm**2 - across**2 - rise**2))
    return _hubs(front, rear, (half, -half))


_LIST = (
    # Front arms hang low so that the camera can look up; the rear rotors are the higher pair (heights ~). Propellers ~141-152 mm: 144 just
    # clear each other.
    Drone(
        "Mini3", "Mini 3 Pro", 0, (171, 245, 62), 0.247, 0.144, 0.249, 0.0125,
        (196, 199, 202), (70, 72, 76), (86, 88, 92), (86, 88, 92),
        _spread(247, (108.0, 3.0), (92.0, 25.0)), ("propeller_diameter", "hubs"),
    ),
    # The maker's own positions: front rotors 21.5 mm above the rear ones. The diagonal is 215.0 mm, published 213.
    Drone(
        "Mini2", "Mini 2", 1, (159, 203, 56), 0.213, 0.119, 0.249, 0.0115,
        (200, 202, 204), (92, 94, 98), (92, 94, 98), (226, 120, 52),
        _hubs((87.8, 24.7), (85.5, 3.2), (64.3, -61.1)),
    ),
    # Wheelbase ~354, estimated. Wide front arms on long legs; the front rotors are the higher pair (~).
    Drone(
        "Air3", "Air 3", 2, (259, 326, 106), 0.354, 0.221, 0.720, 0.0155,
        (124, 127, 131), (48, 50, 53), (60, 62, 65), (60, 62, 65),
        _spread(354, (146.5, 48.0), (126.0, 33.0)), ("wheelbase", "hubs"),
    ),
    # 183 x 253 mm leaves no room for a 302 mm wheelbase inside the motors' outer edges; read from axis to axis it fits (188 x 253 mm).
    Drone(
        "Air2", "Mavic Air 2", 3, (183, 253, 77), 0.302, 0.183, 0.570, 0.0140,
        (82, 85, 89), (38, 39, 42), (58, 59, 62), (58, 59, 62),
        _spread(302, (126.5, 36.0), (110.0, 25.0)), ("hubs",), True,
    ),
    # 242 mm wide to the outside would make the 221 mm propellers meet: the hubs are set 228 and 224 mm apart (~), wider than the box.
    Drone(
        "Mav2", "Mavic 2 Pro", 4, (322, 242, 84), 0.354, 0.221, 0.907, 0.0140,
        (92, 95, 98), (40, 41, 44), (54, 55, 58), (150, 146, 136),
        _spread(354, (114.0, 38.0), (112.0, 26.0)), ("hubs",),
    ),
    # Front and rear hubs both about half the width less a motor: 239 mm propellers leave no room for a narrower rear (heights ~).
    Drone(
        "Mav3", "Mavic 3", 5, (347.5, 283, 107.7), 0.3801, 0.239, 0.895, 0.0165,
        (134, 136, 138), (54, 56, 59), (56, 57, 60), (232, 122, 44),
        _spread(380.1, (124.5, 50.0), (121.0, 32.0)), ("hubs",),
    ),
    # Wheelbase ~120-127: 120 is what fits a 98 x 92.5 mm frame with 5 mm motors at its corners. All four rotors level.
    Drone(
        "Tello", "Tello", 6, (98, 92.5, 41), 0.120, 0.076, 0.080, 0.0050,
        (236, 237, 238), (30, 31, 33), (34, 35, 37), (34, 35, 37),
        _spread(120, (41.2, 17.5), (41.2, 17.5)), ("wheelbase", "hubs"),
    ),
)  # fmt: skip

SEVEN = tuple(drone.name for drone in _LIST)
DRONES: dict[str, Drone] = {
    drone.name: drone for drone in (*_LIST, *(Drone(**fields) for fields in own.read(SEVEN)))
}
