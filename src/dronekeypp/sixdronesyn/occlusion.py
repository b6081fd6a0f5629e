"""This module finds out which propeller hubs a camera can see."""

import numpy as np
import vtk

from dronekeypp.sixdronesyn.drones import Drone
from dronekeypp.sixdronesyn.meshes import drone_mesh


class SelfOcclusion:
    """This class finds the propeller hubs that the drone's own body hides.

    It casts rays in double precision, which gives the same answer on every machine, unlike a depth buffer.

    Args:
        drone: the drone, or its name.
    """

    def __init__(self, drone: str | Drone) -> None:
        self.mesh = drone_mesh(drone)
        self._locator = vtk.vtkStaticCellLocator()
        self._locator.SetDataSet(self.mesh.body)
        self._locator.BuildLocator()

    def visible(self, hubs: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return whether nothing of the body lies between the camera and each hub, (4,) bool.

        Args:
            hubs: (4, 3) metres, body frame.
            R, t: (3, 3) and (3,) metres, the pose in the camera frame.
        """
        camera = -R.T @ t  # in body axes
        visible = []
        for hub in hubs:
            ray = camera - hub
            start = hub + ray / np.linalg.norm(ray) * self.mesh.hub_clearance  # beyond its own motor's top
            visible.append(not self._is_blocked(start, camera))
        return np.array(visible)

    def _is_blocked(self, start: np.ndarray, end: np.ndarray) -> bool:
        """Return whether the line from `start` to `end` (3,) meets the body."""
        # VTK writes where the line meets it to these four; nobody reads them
        share, point, parametric, sub_id = vtk.reference(0.0), [0.0] * 3, [0.0] * 3, vtk.reference(0)
        hit = self._locator.IntersectWithLine(start, end, 1e-9, share, point, parametric, sub_id)
        return bool(hit)
