"""Read the camera's calibration, as OpenCV or anybody else writes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dronekeypp.camera import check_intrinsics
from dronekeypp.errors import InputError
from dronekeypp.files import read_json
from dronekeypp.footage.pictures import CAMERA_FILE, BopScene, Footage

MATRIX = ("camera_matrix", "K", "cameraMatrix")
DISTORTION = ("distortion_coefficients", "dist_coeffs", "dist_coeff", "distCoeffs", "D")
SIZE = ("image_width", "image_height")
FISHEYE = "fisheye_model"
READ = (*MATRIX, *DISTORTION, *SIZE, FISHEYE)  # the entries of a calibration file that are looked at
COEFFICIENTS = (4, 5, 8, 12, 14)  # as many distortion coefficients does OpenCV know
HALF_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


@dataclass(frozen=True)
class Calibration:
    """Describe what a lens does.

    Attributes:
        K: (3, 3) the camera matrix of the whole frame, pixels, with pixel centres at +0.5.
        distortion: OpenCV's distortion coefficients, or None for a pinhole camera.
        size: (width, height) of the calibrated frame, where the file gives it.
    """

    K: np.ndarray
    distortion: np.ndarray | None = None
    size: tuple[int, int] | None = None

    def for_frames(self, width: int, height: int) -> Calibration:
        """Return the calibration of frames of another size.

        They must be the calibrated frames made smaller or larger.

        Raises:
            InputError: The frames have another shape. Then they were cut, and the matrix cannot be known. Or
                no lens has such a focal length.
        """
        calibrated_width = self.size[0] if self.size else width
        if not 0.05 < self.K[0, 0] / calibrated_width < 1000:
            raise InputError(
                f"a focal length of {self.K[0, 0]:g} pixels for a frame {calibrated_width} wide: "
                "is the matrix in pixels of the whole frame?"
            )
        if self.size is None or self.size == (width, height):
            return self
        if abs(width * self.size[1] / self.size[0] - height) > 1:  # pixels
            raise InputError(
                f"the camera was calibrated at {self.size[0]}×{self.size[1]}, "
                f"the frames are {width}×{height}: not the same shape"
            )
        scale = np.diag([width / self.size[0], height / self.size[1], 1.0])
        return Calibration(scale @ self.K, self.distortion, (width, height))

    @property
    def opencv_K(self) -> np.ndarray:
        """Return K (3, 3) as OpenCV counts: its pixel centres start from 0, where ours lie at +0.5."""
        return self.K - HALF_PIXEL

    def undistort(self, image: np.ndarray) -> np.ndarray:
        """Return the picture (H, W, 3) that a pinhole camera with the same K would have taken."""
        return image if self.distortion is None else cv2.undistort(image, self.opencv_K, self.distortion)

    def undistort_box(self, box: np.ndarray) -> np.ndarray:
        """Return the box (x, y, w, h) in the undistorted picture that surrounds a box of the distorted one.

        Points along the four edges are undistorted, because a straight edge becomes a curve.
        """
        if self.distortion is None:
            return box
        x, y, w, h = box
        along = np.linspace(0, 1, 9)
        edges = []
        for side in (y, y + h):
            edges.append(np.stack([x + along * w, np.full(9, side)], axis=1))
        for side in (x, x + w):
            edges.append(np.stack([np.full(9, side), y + along * h], axis=1))
        rim = np.concatenate(edges)[:, None] - 0.5  # (36, 1, 2) as OpenCV counts
        straight = cv2.undistortPoints(rim, self.opencv_K, self.distortion, P=self.opencv_K)
        points = straight[:, 0] + 0.5
        low, high = points.min(axis=0), points.max(axis=0)
        return np.array([*low, *(high - low)])


def read_camera(path: str | Path) -> Calibration:
    """Read a calibration in OpenCV's own format, or in plain JSON.

    OpenCV's own format is YAML, XML or JSON, as its calibration sample writes it. The entries read are
    `camera_matrix` (or cameraMatrix, K), `distortion_coefficients` (or dist_coeffs, distCoeffs, D),
    `image_width` and `image_height`. OpenCV counts pixel centres from 0 and this package from 0.5, so the
    principal point is moved by half a pixel. The `scene_camera.json` of a BOP scene with one camera is read
    as well, and it counts as this package does.

    Raises:
        InputError: The file is not found or unreadable. It holds no camera matrix, one that is not valid, or
            a fisheye's. Or it is that of a flight with several cameras.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: camera file not found")
    if path.name == CAMERA_FILE:
        values, shift = {"K": _matrix_of_a_flight(path)}, 0.0
    else:
        values, shift = _plain_json(path) or _opencv_nodes(path), 0.5
    matrix = _first_of(values, MATRIX)
    if matrix is None:
        example = '"camera_matrix": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]'
        raise InputError(
            f"{path}: holds no camera_matrix; write OpenCV's calibration format, or JSON with {example}"
        )
    try:
        K = np.array(matrix, dtype=np.float64).reshape(3, 3)
        fisheye = bool(values.get(FISHEYE))
        distortion = _first_of(values, DISTORTION)
        if distortion is not None:
            distortion = np.array(distortion, dtype=np.float64).ravel()
        size = None
        if all(values.get(name) for name in SIZE):
            size = int(values["image_width"]), int(values["image_height"])
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{path}: camera_matrix needs 3×3 numbers, distortion a list of numbers ({error})"
        ) from None
    if fisheye:
        raise InputError(
            f"{path}: a fisheye camera; undistort the footage with OpenCV's fisheye module first, "
            "and give the matrix of the result"
        )
    check_intrinsics(K, f"{path}: camera_matrix")
    _check_distortion(distortion, path)
    if size and min(size) < 1:
        raise InputError(
            f"{path}: image_width and image_height must be positive, got {size[0]} and {size[1]}"
        )
    K[:2, 2] += shift
    if distortion is not None and not distortion.any():
        distortion = None
    return Calibration(K, distortion, size)


def read_cameras(path: str | Path, footage: Footage) -> list[Calibration]:
    """Read the calibration of every frame of some footage, in order.

    Where the frames are those of a BOP scene, and the file is its scene_camera.json and does not say the same
    of all frames, every frame has its own. Otherwise all have that of `read_camera`.

    Raises:
        InputError: As `read_camera` raises it. Or the file lacks a frame of the scene, or the frames are
            crops and the file does not hold their camera matrices.
    """
    path, scene = Path(path), footage.bop_scene
    own = scene is not None and path.resolve() == scene.folder / CAMERA_FILE
    if scene is not None:
        _check_crops(scene, own)
    entries = _read_object(path) if own else {}
    if len({str(_matrix_of(entry)) for entry in entries.values()}) < 2:
        return [read_camera(path)] * len(footage.names)
    matrices = _by_number(entries)
    calibrations = []
    for number in scene.images:
        if _matrix_of(matrices.get(number)) is None:
            raise InputError(f"{path}: no cam_K of frame {number}")
        K = _matrix(_matrix_of(matrices[number]), f"{path} frame {number}: cam_K")
        calibrations.append(Calibration(K))
    return calibrations


def _check_crops(scene: BopScene, own: bool) -> None:
    """Raise InputError where the frames of a scene are crops, and the camera that is given is not theirs.

    `own` says whether it is that of the scene's own file. A crop has `crop` in scene_gt_info.json, and
    `cam_K_frame` beside its own cam_K; crops of the first edition have the cam_K of the whole frame.
    """
    path = scene.folder / "scene_gt_info.json"
    if not path.is_file():
        return
    infos = _by_number(_read_object(path))
    cameras = _by_number(_read_object(scene.folder / CAMERA_FILE))
    for number in scene.images:
        info, camera = infos.get(number), cameras.get(number)
        if not isinstance(info, list) or not any(isinstance(i, dict) and i.get("crop") for i in info):
            continue
        if not isinstance(camera, dict) or camera.get("cam_K_frame") is None:
            raise InputError(
                f"{path} frame {number}: crops of the first edition, whose cam_K is not theirs; "
                "use `evaluate`, or whole frames"
            )
        if not own:
            raise InputError(
                f"{path} frame {number}: crops, and each has a camera of its own; "
                f"give {scene.folder / CAMERA_FILE}"
            )


def _by_number(entries: dict[str, Any]) -> dict[int, Any]:
    """Return what a file of a BOP scene says of each frame, by the frame's number."""
    return {int(key): entry for key, entry in entries.items() if key.isdecimal()}


def _matrix(values: Any, where: str) -> np.ndarray:
    """Return a camera matrix (3, 3), or raise InputError with a message that begins with `where`."""
    try:
        K = np.array(values, dtype=np.float64).reshape(3, 3)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where} needs 3×3 numbers ({error})") from None
    return check_intrinsics(K, where)


def _first_of(values: dict[str, Any], names: Sequence[str]) -> Any:
    """Return the first value under one of several names, or None."""
    for name in names:
        if values.get(name) is not None:
            return values[name]
    return None


def _check_distortion(distortion: np.ndarray | None, path: Path) -> None:
    """Raise InputError unless OpenCV can use these coefficients."""
    if distortion is None:
        return
    if len(distortion) not in COEFFICIENTS or not np.isfinite(distortion).all():
        raise InputError(
            f"{path}: distortion has {len(distortion)} numbers; OpenCV knows 4, 5, 8, 12 or 14, all finite"
        )


def _read_object(path: Path) -> dict[str, Any]:
    """Read a JSON file that holds an object."""
    values = read_json(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no settings but a {type(values).__name__}")
    return values


def _matrix_of_a_flight(path: Path) -> Any:
    """Return the cam_K that all frames of a BOP scene_camera.json share."""
    cameras = [_matrix_of(frame) for frame in _read_object(path).values()]
    if not cameras or any(camera != cameras[0] for camera in cameras):
        raise InputError(
            f"{path}: {len(cameras)} frames, and not one camera for all of them; each frame gets its own "
            f"where the pictures have numbers for names, in a folder beside {CAMERA_FILE} in a folder that "
            "has a number for a name, too"
        )
    return cameras[0]


def _matrix_of(entry: Any) -> Any:
    """Return the cam_K in an entry of a scene_camera.json, or None."""
    return entry.get("cam_K") if isinstance(entry, dict) else None


def _plain_json(path: Path) -> dict[str, Any] | None:
    """Read JSON as anyone would write it, or OpenCV's with the data of its matrices.

    The answer is None if the file is no JSON.
    """
    if path.suffix.lower() != ".json":
        return None
    values = {}
    for key, value in _read_object(path).items():
        values[key] = value["data"] if isinstance(value, dict) and "data" in value else value
    return values


def _opencv_nodes(path: Path) -> dict[str, Any]:
    """Read the entries of a file of OpenCV's, as far as they are looked at."""
    values = {}
    try:
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        root = file.root()
        for key in root.keys():
            if key not in READ:
                continue
            node = root.getNode(key)
            if not node.isString():
                values[key] = node.mat() if node.isMap() else node.real()
        file.release()
    except (cv2.error, SystemError) as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError(f"{path}: not a calibration in OpenCV's YAML, XML or JSON ({reason})") from None
    return values
