"""The README's first picture: what the geometric network of data_samples says of one whole frame a drone."""

from __future__ import annotations

import csv
import dataclasses
import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.footage import Calibration, read_camera, read_picture
from dronekeypp.predict import Pose, draw_overlay, predict
from dronekeypp.sixdronesyn.bop import image_path
from dronekeypp.sixdronesyn.dataset import SixDroneSyn
from dronekeypp.sixdronesyn.drones import SEVEN
from dronekeypp.sixdronesyn.scenes import HEIGHT

TILE = 480, 320  # pixels, width and height
COLUMNS = 4


def sheet(samples: Path) -> bytes:
    """A JPEG of one whole frame and seven looks at a drone each, with box, propellers, axes, name and distance. `samples`: data_samples.

    Raises:
        InputError: the checkpoint or the frames are missing.
    """
    frames = SixDroneSyn(samples / "frames", "test")
    nearest = [
        max(
            (i for i, f in enumerate(frames.frames) if f.obj_id == n + 1),
            key=lambda i: frames.frames[i].box[2],
        )
        for n in range(len(SEVEN))
    ]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "images").mkdir()
        with open(root / "boxes.csv", "w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(("frame", "x", "y", "w", "h"))
            for n, i in enumerate(nearest):
                shutil.copy(
                    image_path(frames.folders[i], frames.frames[i].number), root / "images" / f"{n}.jpg"
                )
                rows.writerow((f"{n}.jpg", *frames.frames[i].box))
        camera = frames.folders[nearest[0]] / "scene_camera.json"
        poses = predict(
            samples / "beyond",
            root / "images",
            camera,
            root / "out",
            boxes=root / "boxes.csv",
            overlay=False,
            progress=False,
        )
        images = [read_picture(root / "images" / f"{pose.frame}.jpg") for pose in poses]
    calibration = read_camera(camera)
    tiles = [tile(images[-1], poses[-1], calibration, (0, 0, HEIGHT * TILE[0] / TILE[1]))]
    tiles += [
        tile(image, pose, calibration, near_the_drone(pose))
        for image, pose in zip(images, poses, strict=True)
    ]
    tiles = [np.pad(one, ((3, 3), (3, 3), (0, 0)), constant_values=255) for one in tiles]
    rows = [np.concatenate(tiles[i : i + COLUMNS], axis=1) for i in range(0, len(tiles), COLUMNS)]
    return cv2.imencode(".jpg", np.concatenate(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def near_the_drone(pose: Pose) -> tuple[float, float, float]:
    """Left, top and width of a part of the frame around its drone, pixels."""
    x, y, w, h = pose.box
    wide = 1.7 * max(w, h * TILE[0] / TILE[1])
    return x + w / 2 - wide / 2, y + h / 2 - wide * TILE[1] / TILE[0] / 2, wide


def tile(
    image: np.ndarray, pose: Pose, calibration: Calibration, part: tuple[float, float, float]
) -> np.ndarray:
    """A part of a frame (left, top, width; moved inside it), enlarged to TILE, and drawn upon at that size."""
    left, top, wide = part
    high = wide * TILE[1] / TILE[0]
    left, top = int(np.clip(left, 0, image.shape[1] - wide)), int(np.clip(top, 0, image.shape[0] - high))
    picture = image[top : top + round(high), left : left + round(wide)]
    scale = np.array(TILE) / picture.shape[1::-1]
    picture = cv2.resize(picture, TILE, interpolation=cv2.INTER_AREA if scale[0] < 1 else cv2.INTER_CUBIC)
    corner = (pose.box[:2] - (left, top)) * scale
    seen = dataclasses.replace(
        pose,
        box=np.concatenate([corner, pose.box[2:] * scale]),
        keypoints=(pose.keypoints - (left, top)) * scale,
    )
    return draw_overlay(
        picture,
        seen,
        Calibration(np.diag([*scale, 1.0]) @ (calibration.K - [[0, 0, left], [0, 0, top], [0, 0, 0]])),
    )
