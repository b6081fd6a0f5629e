"""This module says what each of the seven drones is made of.

The parts are the hull, arms, motors, legs, eyes, gimbal camera and lights. Lengths are millimetres in the
body frame. Sizes come from `drones.py`, and the arms have their true sweep and height. What is not a
published figure there is modelled on how the drone looks and is an estimate.

Each `name(drone, front, rear)` of `airframes_mini` and `airframes_mavic` returns the parts on the middle
plane and the parts to its left; `parts` mirrors the left ones. `front` and `rear` are the left hubs. The
columns of each table `stations` are those of `shapes.hull`: x, half width, z bottom, z widest, z top,
exponent bottom, exponent top. A `cheek` is the edge of the hull beside the gimbal camera.
"""

from dronekeypp.sixdronesyn import airframes_mavic, airframes_mini, first_airframes
from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.shapes import Part, mirrored

_BUILDERS = {
    "Mini3": airframes_mini.mini3,
    "Mini2": airframes_mini.mini2,
    "Air3": airframes_mavic.air3,
    "Air2": airframes_mavic.air2,
    "Mav2": airframes_mavic.mav2,
    "Mav3": airframes_mavic.mav3,
    "Tello": airframes_mini.tello,
}


def parts(drone: Drone) -> list[Part]:
    """Return all opaque parts of one of the seven drones, left and right."""
    builders = first_airframes.BUILDERS if drone.edition == 1 else _BUILDERS
    front, rear = drone.hubs[0] * 1000.0, drone.hubs[3] * 1000.0
    middle, left = builders[drone.name](drone, front, rear)
    right = [mirrored(part) for part in left]
    return middle + left + right
