"""This module builds the bodies of random quadrotors.

Being written.
"""

from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.shapes import Part


def parts(drone: Drone) -> list[Part]:
    """Return all opaque parts of a random quadrotor, left and right."""
    raise NotImplementedError
