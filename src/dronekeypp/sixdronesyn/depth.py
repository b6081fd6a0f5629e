"""This module draws depth images and masks of a drone, as BOP has them, at the stored image's own pixels.

They show the mesh that models/ holds, which has no propellers. A flight's folder then holds

    depth/000000.png                16 bits; value × depth_scale is z in millimetres, 0 where no drone is
    mask/000000_000000.png          255 where the drone is, whether something hides it or not
    mask_visib/000000_000000.png    255 where it is to be seen; nothing else flies here, so it equals mask/

Depth is read at the centres of the pixels and never averaged, because the mean of a near and a far point is
the depth of neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from dronekeypp.camera import crop_intrinsics
from dronekeypp.files import digest
from dronekeypp.sixdronesyn import scenes
from dronekeypp.sixdronesyn.annotation import MM, Frame
from dronekeypp.sixdronesyn.drones import Drone
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.render import aim, check_opengl, pose_matrix

FOLDERS = ("depth", "mask", "mask_visib")
STEP = 0.2  # mm, of a depth image: 16 bits then reach 13.1 m
DEEPEST = 2**16 - 1


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
        self.reach = 1.1 * scenes.reach(drone)  # guards may stand out a little beyond the propellers
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
        near, far = max(0.05, float(t[2]) - self.reach), float(t[2]) + self.reach
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
    """Return the millimetres of one step of a frame's depth image: STEP, or twice that for a far drone."""
    farthest = (float(frame.t[2]) + scenes.reach(drone)) * MM
    return STEP if farthest < STEP * DEEPEST else 2 * STEP


# --- files ------------------------------------------------------------------------------------------------


def paths(folder: Path, number: int, settings: dict[str, Any]) -> list[Path]:
    """Return the depth image and the masks of a frame, as far as `settings` of the data set ask for them."""
    found = []
    if settings.get("depth"):
        found.append(folder / FOLDERS[0] / f"{number:06d}.png")
    if settings.get("masks"):
        found += [folder / name / f"{number:06d}_000000.png" for name in FOLDERS[1:]]
    return found


def encode(depth: np.ndarray, scale: float, settings: dict[str, Any]) -> list[bytes]:
    """Return the contents of the files that `paths` names.

    Args:
        depth: (H, W) metres, from `draw_depth`.
        scale: millimetres a step, from `depth_scale`.
        settings: those of the data set.
    """
    contents = []
    if settings.get("depth"):
        contents.append(_png(np.rint(depth * (MM / scale)).astype(np.uint16)))
    if settings.get("masks"):
        contents += 2 * [_png(np.where(depth > 0, 255, 0).astype(np.uint8))]
    return contents


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def counts(visible: int, whole: int) -> dict[str, float]:
    """Return what scene_gt_info.json says of a frame's masks.

    Args:
        visible: how many pixels of the image show the drone.
        whole: how many its silhouette has, those outside the image included.
    """
    return {
        "px_count_all": whole,
        "px_count_valid": visible,  # every one of them has a depth
        "px_count_visib": visible,
        "visib_fract": round(visible / whole, 6) if whole else 0.0,
    }


def faults(
    folder: Path, number: int, info: dict[str, Any], digests: Sequence[str], settings: dict[str, Any]
) -> list[str]:
    """Return what is wrong with the depth image and the masks of a frame, one line each.

    Args:
        folder: of the flight.
        number: of the frame.
        info: the frame's entry in scene_gt_info.json.
        digests: of the files that `paths` names.
        settings: those of the data set.
    """
    found = []
    content = b""
    for path, expected in zip(paths(folder, number, settings), digests, strict=True):
        content = path.read_bytes() if path.is_file() else b""
        if digest(content) != expected:
            what = "not the image that was generated" if content else "image missing"
            found.append(f"{path}: {what}; delete its flight folder and run generate again")
    if settings.get("masks") and not found:
        mask = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)  # the last is mask_visib/
        visible = int((mask > 0).sum())
        if info != {**info, **counts(visible, info.get("px_count_all", -1))}:
            path = folder / "scene_gt_info.json"
            found.append(f"{path} frame {number}: its pixel counts are not those of mask_visib/")
    return found
