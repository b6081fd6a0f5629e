"""This module holds propeller hubs that were measured on models which other people made of the seven drones.

Only a model's numbers are here. Origin and attitude of a body are conventions, so hubs are compared after a
rigid fit. Air 3, Mavic Air 2 and Tello are not measured.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class MeasuredHubs:
    """The hubs of one drone in somebody else's model.

    Attributes:
        drone: the drone's name in `drones.DRONES`.
        source: what the hubs were read off.
        hubs_mm: (4, 3) in keypoint order, x forward, y left, z up, the model's own origin, millimetres.
    """

    drone: str
    source: str
    hubs_mm: tuple[tuple[float, float, float], ...]


MEASURED = (
    MeasuredHubs(
        "Mini3",
        "URDF of htnk-lab/open_dji_drone_robot, turned by 14.3 degrees so that the thrust axes stand upright",
        ((29.5, 112.7, 28.6), (29.5, -113.6, 28.6), (-122.8, -81.2, 15.7), (-122.8, 80.3, 15.7)),
    ),
    MeasuredHubs(
        "Mini2",
        "rotor parts of a textured model",
        ((46.2, 87.7, 45.2), (46.2, -87.7, 45.2), (-77.8, -84.3, 18.6), (-77.8, 84.3, 18.6)),
    ),
    MeasuredHubs(
        "Mav2",
        "rotor positions of a robot simulator's model",
        (
            (54.85, 151.29, -2.8),
            (54.85, -151.29, -2.8),
            (-177.18, -127.45, -32.0),
            (-177.18, 127.45, -32.0),
        ),
    ),
    MeasuredHubs(
        "Mav2",
        "mesh of a Mavic 2 Enterprise Dual (VCL3D/DronePose), scaled to a diagonal of 354 mm",
        ((81.4, 153.3, 37.5), (81.4, -153.3, 37.5), (-146.5, -115.0, 0.7), (-146.5, 115.0, 0.7)),
    ),
    MeasuredHubs(
        "Mav3",
        "URDF of htnk-lab/open_dji_drone_robot",
        ((98.2, 160.0, 3.6), (98.2, -160.0, 3.4), (-144.3, -126.4, -3.2), (-144.3, 126.4, -3.3)),
    ),
)


def rms_after_rigid_fit(hubs: np.ndarray, measured: np.ndarray) -> float:
    """Return the RMS distance between two sets of points (N, 3) after the best rotation and shift.

    The shift joins the centroids, and the rotation is that of Kabsch (Acta Cryst. A32, 1976). The result has
    the unit of the points; nothing is scaled.
    """
    centred, target = hubs - hubs.mean(axis=0), measured - measured.mean(axis=0)
    _, root_of_sum = Rotation.align_vectors(target, centred)
    return float(root_of_sum / np.sqrt(len(hubs)))
