"""This module describes the seven drones in numbers (Sec. IV).

The numbers are sizes, weights, colours and the four propeller hubs. Lengths are metres in the body frame: x
points forward, y left, z up. The origin is the drone's centre: half its height above the ground it stands
on, and midway between the front and the rear hubs. Only Mini 2 differs: its origin is that of its maker's
model, 1.6 mm behind the middle. Hubs come in keypoint order: front-left, front-right, rear-right, rear-left.

Every number says in `sources` where it is from. Published figures come first. Hubs measured on models that
other people made (see `measured.py`) come next; where such a model's diagonal is not the published one, its
hubs are scaled to it. The rest is estimated from how the drone looks. Two propellers must not meet, so their
hubs stand at least one diameter apart, and a disc that reaches over the hull lies above it.
"""

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import own, quadrotors
from dronekeypp.sixdronesyn.drone import KEYPOINT_NAMES, Drone, hubs_from_mm, spread_hubs
from dronekeypp.sixdronesyn.first_edition import REPLACED

__all__ = ["DRONES", "EDITION", "EDITIONS", "KEYPOINT_NAMES", "SEVEN", "Drone", "find_drone"]

EDITION = 1  # of what is made by default, until everything is measured again on the second

# Where most numbers of most drones are from. What differs stands at the drone.
_SOURCES = {
    "body_mm": "published",
    "wheelbase": "published",
    "propeller_diameter": "published",
    "mass": "published",
    "motor_radius": "estimated",
    "colours": "estimated",
    "blades": "published",
    "blade_width": "estimated",
    "hull_pitch": "estimated",
}

_LIST = (
    # The thrust axes lean forward in the hull, so the nose points up when the propellers lie level. In the
    # hull's own axes the rear rotors are the higher pair by 25 mm; to the air the front ones are, by 13 mm.
    # The propellers are 6030, which is 6.0 inches.
    Drone(
        name="Mini3",
        label="Mini 3 Pro",
        index=0,
        body_mm=(171, 245, 62),
        wheelbase=0.247,
        propeller_diameter=0.1524,
        mass=0.249,
        motor_radius=0.0105,
        hull_rgb=(196, 199, 202),
        trim_rgb=(70, 72, 76),
        propeller_rgb=(86, 88, 92),
        tip_rgb=(86, 88, 92),
        hubs=spread_hubs(247, (113.2, 24.4), (80.8, 11.5)),
        hull_pitch=float(np.radians(14.3)),
        sources=_SOURCES
        | {
            "hubs": "measured: URDF, times 1.0004 for the published diagonal; height estimated",
            "hull_pitch": "measured: the tilt of the URDF's thrust axes",
            "motor_radius": "estimated: from the published width less the hubs",
        },
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
        hubs=hubs_from_mm((87.8, 24.7), (85.5, 3.2), (64.3, -61.1)),
        sources=_SOURCES | {"hubs": "measured: the maker's own model"},
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
        hubs=spread_hubs(354, (146.5, 48.0), (126.0, 33.0)),
        sources=_SOURCES | {"wheelbase": "estimated", "hubs": "estimated"},
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
        hubs=spread_hubs(302, (126.5, 36.0), (110.0, 25.0)),
        sources=_SOURCES | {"hubs": "estimated"},
        box_between_axes=True,
    ),
    # The maker prints 322 x 242 x 84 mm as length, width and height. The measured hubs show that 322 mm is
    # the width, across the front motors, and 242 mm the length, fore to aft. Two models differ by 8 mm RMS
    # when both are scaled to the published diagonal. The simulator's is taken, because with it hubs and
    # motors are as wide as published (294 + 28 mm); with the other the motors would be 15 mm thick.
    Drone(
        name="Mav2",
        label="Mavic 2 Pro",
        index=4,
        body_mm=(242, 322, 84),
        wheelbase=0.354,
        propeller_diameter=0.221,
        mass=0.907,
        motor_radius=0.0140,
        hull_rgb=(92, 95, 98),
        trim_rgb=(40, 41, 44),
        propeller_rgb=(54, 55, 58),
        tip_rgb=(150, 146, 136),
        hubs=spread_hubs(354, (147.2, 42.0), (124.0, 13.6)),
        sources=_SOURCES
        | {
            "body_mm": "published: printed as 322 x 242 x 84, of which the first is across",
            "hubs": "measured: simulator's model, times 0.973 for the published diagonal; height estimated",
            "motor_radius": "estimated: from the published width less the hubs",
        },
    ),
    # The maker prints 347.5 x 283 x 107.7 mm. By the measured hubs 347.5 mm is the width, across the front
    # motors, and 283 mm the length, from the nose to the rear motors.
    Drone(
        name="Mav3",
        label="Mavic 3",
        index=5,
        body_mm=(283, 347.5, 107.7),
        wheelbase=0.3801,
        propeller_diameter=0.239,
        mass=0.895,
        motor_radius=0.0130,
        hull_rgb=(134, 136, 138),
        trim_rgb=(54, 56, 59),
        propeller_rgb=(56, 57, 60),
        tip_rgb=(232, 122, 44),
        hubs=spread_hubs(380.1, (162.0, 53.5), (128.0, 46.7)),
        sources=_SOURCES
        | {
            "body_mm": "published: printed as 347.5 x 283 x 107.7, of which the first is across",
            "hubs": "measured: URDF, times 1.013 for the published diagonal; height estimated",
            "motor_radius": "estimated: from the published width less the hubs",
        },
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
        hubs=spread_hubs(120, (41.2, 17.5), (41.2, 17.5)),
        sources=_SOURCES | {"wheelbase": "estimated", "hubs": "estimated"},
    ),
)

SEVEN = tuple(drone.name for drone in _LIST)
_SECOND: dict[str, Drone] = {drone.name: drone for drone in _LIST}
_OWN: dict[str, Drone] = {fields["name"]: Drone(**fields) for fields in own.read(SEVEN)}
# The drones of each edition of the data set, and of your own, by name.
EDITIONS: dict[int, dict[str, Drone]] = {1: {**_SECOND, **REPLACED, **_OWN}, 2: {**_SECOND, **_OWN}}
DRONES = EDITIONS[EDITION]


def find_drone(name: str, edition: int = EDITION) -> Drone:
    """Return a drone by its name: one of the seven, one of your own, or a random quadrotor ("Quad17").

    `edition`, 1 or 2, says which shapes the seven have. A random quadrotor is the same in either, and flies
    in data sets of the second only.

    Raises:
        InputError: the name is unknown.
    """
    if name in EDITIONS[edition]:
        return EDITIONS[edition][name]
    number = quadrotors.number_of(name)
    if number is None:
        raise InputError(f"drone {name!r} is unknown; choose one of {', '.join(EDITIONS[edition])}")
    return quadrotors.quadrotor(number)
