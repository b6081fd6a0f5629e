"""This module builds the bodies of random quadrotors, one builder for each family."""

from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.quadrotor_enterprise import enterprise
from dronekeypp.sixdronesyn.quadrotor_frames import plates, racer
from dronekeypp.sixdronesyn.quadrotor_hulls import folding, shell
from dronekeypp.sixdronesyn.quadrotor_plan import plan_of, scaled
from dronekeypp.sixdronesyn.quadrotor_small import ducted, toy
from dronekeypp.sixdronesyn.shapes import Part, mirrored

_BUILDERS = {
    "folding": folding,
    "shell": shell,
    "racer": racer,
    "plate": plates,
    "ducted": ducted,
    "toy": toy,
    "enterprise": enterprise,
}


def parts(drone: Drone) -> list[Part]:
    """Return all opaque parts of a random quadrotor, left and right."""
    plan = plan_of(drone)
    middle, left = _BUILDERS[drone.family](plan)
    return [scaled(part, plan.scale) for part in middle + left + [mirrored(part) for part in left]]
