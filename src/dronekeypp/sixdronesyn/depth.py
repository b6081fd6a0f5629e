"""This module draws depth images and masks of a drone, as BOP has them, at the stored image's own pixels.

They show the mesh that models/ holds, which has no propellers. `depth_files` writes and checks them.

Depth is read at the centres of the pixels and never averaged, because the mean of a near and a far point is
the depth of neither.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from dronekeypp.camera import crop_intrinsics
from dronekeypp.sixdronesyn import scenes
from dronekeypp.sixdronesyn.annotation import MM, Frame
from dronekeypp.sixdronesyn.drones import Drone
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.render import aim, check_opengl, depth_range, farthest_point, pose_matrix

STEP = 0.2  # mm, of a depth image: 16 bits then reach 13.1 m
DEEPEST = 2**16 - 1
ROOM = 1.1  # times the reach of a drone, where a depth renderer sees at least


class DepthRenderer:
    """A depth renderer draws how far the body of one drone is.

    Args:
        drone: the drone.
        resolution: side in pixels of the square it draws.

    Raises:
        InputError: this machine cannot render.
    """

    def __init__(self, drone: Drone, resolution: int) -> None:
        check_opengl()
        self.resolution = resolution
        # The range fixes how depth is rounded, so it grows only for a mesh that stands out of it.
        self.radius = max(ROOM * scenes.reach(drone), farthest_point(drone))
        mapper = vtk.vtkPolyDataMapper()
        mapper.SetInputData(drone_mesh(drone).body)
        mapper.ScalarVisibilityOff()
        self._body = vtk.vtkActor()
        self._body.SetMapper(mapper)
        renderer = vtk.vtkRenderer()
        renderer.AddActor(self._body)
        self._camera = renderer.GetActiveCamera()
        self._window = vtk.vtkRenderWindow()
        self._window.SetOffScreenRendering(True)
        self._window.SetMultiSamples(0)
        self._window.SetSize(resolution, resolution)
        self._window.AddRenderer(renderer)
        self._buffer = vtk.vtkFloatArray()

    def draw(self, R: np.ndarray, t: np.ndarray, K: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """Draw the body in a square of the image whose camera matrix is `K`.

        Args:
            R, t: (3, 3) and (3,) metres, the pose in the camera frame.
            K: (3, 3) camera matrix of the image, pixels.
            corner: (2,) the pixel x, y of the image where the square begins.

        Returns:
            (resolution, resolution) float64: z in camera axes in metres at the centres of the image's pixels,
            0 where no drone is.
        """
        self._body.SetUserMatrix(pose_matrix(R, t))
        near, far = depth_range(float(t[2]), self.radius)
        aim(self._camera, K, (*corner, self.resolution), near, far)
        self._window.Render()
        last = self.resolution - 1
        self._window.GetZbufferData(0, 0, last, last, self._buffer)
        share = vtk_to_numpy(self._buffer).reshape(self.resolution, self.resolution)[::-1].astype(np.float64)
        depth = near * far / (far - share * (far - near))
        depth[share >= 1] = 0
        return depth


@lru_cache(maxsize=2)
def _renderer(drone: Drone, resolution: int) -> DepthRenderer:
    return DepthRenderer(drone, resolution)


def draw_depth(drone: Drone, frame: Frame, width: int, height: int) -> tuple[np.ndarray, int]:
    """Return the depth image of a frame, and how many pixels the whole silhouette has.

    Args:
        drone: the drone in the frame.
        frame: its annotation.
        width, height: of the stored image, pixels.

    Returns:
        (height, width) float64, z in camera axes in metres, 0 where no drone is; and the number of pixels,
        those outside the image included.
    """
    K, box = frame.K, frame.box
    if frame.square is not None:
        K, scale = crop_intrinsics(frame.K, frame.square, width), width / frame.square[2]
        box = scale * np.concatenate([box[:2] - frame.square[:2], box[2:]])
    side = max(64, float(box[2:].max()) + 4)
    resolution = 2 ** int(np.ceil(np.log2(side)))  # few different ones, so that renderers are kept
    corner = np.floor(box[:2] + box[2:] / 2).astype(int) - resolution // 2
    square = _renderer(drone, resolution).draw(frame.R, frame.t, K, corner)
    low = np.clip(corner, 0, [width, height])
    high = np.clip(corner + resolution, 0, [width, height])
    (x0, y0), (x1, y1) = low - corner, high - corner
    image = np.zeros((height, width))
    image[low[1] : high[1], low[0] : high[0]] = square[y0:y1, x0:x1]
    return image, int((square > 0).sum())


def depth_scale(drone: Drone, frame: Frame) -> float:
    """Return the millimetres of one step of a frame's depth image.

    It is STEP, doubled until 16 bits hold the farthest point that the drone may have.
    """
    farthest = (float(frame.t[2]) + max(scenes.reach(drone), farthest_point(drone))) * MM
    step = STEP
    while farthest >= step * DEEPEST:
        step *= 2
    return step
