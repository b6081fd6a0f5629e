"""Make the README's first picture from one whole frame and a close view of each drone.

It shows what the geometric network of data_samples says of them.
"""

from __future__ import annotations

import csv
import dataclasses
import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np

from dronekeypp import checkpoint
from dronekeypp.classes import DroneClass
from dronekeypp.data import FrameDataset, open_dataset
from dronekeypp.footage import Calibration, read_camera, read_picture
from dronekeypp.predict import Pose, draw_overlay, predict
from dronekeypp.sixdronesyn.scenes import HEIGHT

TILE = 480, 320  # pixels, width and height
COLUMNS = 4
BORDER = 3  # pixels of white around a tile


def sheet(samples: Path) -> bytes:
    """Make a JPEG of one whole frame and a close view of each of the seven drones.

    They are drawn with box, propellers, axes, name and distance. `samples` is the folder data_samples.

    Raises:
        InputError: The checkpoint or the frames are missing.
    """
    dataset = open_dataset(samples / "frames", "test")
    nearest = nearest_frames(dataset)
    camera = dataset.folders[nearest[0]] / "scene_camera.json"
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        copy_frames(dataset, nearest, root)
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
    drones = {drone.name: drone for drone in checkpoint.load(samples / "beyond").drones}
    whole = (0, 0, HEIGHT * TILE[0] / TILE[1])
    tiles = [tile(images[-1], poses[-1], calibration, whole, drones[poses[-1].drone])]
    for image, pose in zip(images, poses, strict=True):
        tiles.append(tile(image, pose, calibration, near_the_drone(pose), drones[pose.drone]))
    around = ((BORDER, BORDER), (BORDER, BORDER), (0, 0))
    tiles = [np.pad(picture, around, constant_values=255) for picture in tiles]
    rows = []
    for start in range(0, len(tiles), COLUMNS):
        rows.append(np.concatenate(tiles[start : start + COLUMNS], axis=1))
    picture = np.concatenate(rows)[..., ::-1]  # RGB -> BGR
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def nearest_frames(dataset: FrameDataset) -> list[int]:
    """Return for each drone the index of the frame in which its box is widest."""
    nearest: dict[int, int] = {}
    for i, label in enumerate(dataset.labels):
        width = dataset.frames[i].box[2]
        if label not in nearest or width > dataset.frames[nearest[label]].box[2]:
            nearest[label] = i
    return [nearest[label] for label in sorted(nearest)]


def copy_frames(dataset: FrameDataset, chosen: list[int], folder: Path) -> None:
    """Write the chosen frames as FOLDER/images/0.jpg, 1.jpg, … and their boxes as FOLDER/boxes.csv."""
    (folder / "images").mkdir()
    with open(folder / "boxes.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("frame", "x", "y", "w", "h"))
        for number, i in enumerate(chosen):
            shutil.copy(dataset.stored[i].image, folder / "images" / f"{number}.jpg")
            rows.writerow((f"{number}.jpg", *dataset.frames[i].box))


def near_the_drone(pose: Pose) -> tuple[float, float, float]:
    """Return left, top and width, in pixels, of a part of the frame around its drone."""
    x, y, w, h = pose.box
    width = 1.7 * max(w, h * TILE[0] / TILE[1])
    height = width * TILE[1] / TILE[0]
    return x + w / 2 - width / 2, y + h / 2 - height / 2, width


def tile(
    image: np.ndarray,
    pose: Pose,
    calibration: Calibration,
    part: tuple[float, float, float],
    drone: DroneClass,
) -> np.ndarray:
    """Cut out a part of a frame, enlarge it to TILE and draw the pose on it at that size.

    Args:
        image: (H, W, 3), the whole frame.
        pose: the pose of the drone in it.
        calibration: the camera's calibration.
        part: left, top and width in pixels; it is moved inside the frame.
        drone: the class that the pose names.

    Returns:
        (320, 480, 3) uint8.
    """
    left, top, width = part
    height = width * TILE[1] / TILE[0]
    left = int(np.clip(left, 0, image.shape[1] - width))
    top = int(np.clip(top, 0, image.shape[0] - height))
    picture = image[top : top + round(height), left : left + round(width)]
    scale = np.array(TILE) / picture.shape[1::-1]
    picture = cv2.resize(picture, TILE, interpolation=cv2.INTER_AREA if scale[0] < 1 else cv2.INTER_CUBIC)
    moved = dataclasses.replace(
        pose,
        box=np.concatenate([(pose.box[:2] - (left, top)) * scale, pose.box[2:] * scale]),
        keypoints=(pose.keypoints - (left, top)) * scale,
    )
    K = np.diag([*scale, 1.0]) @ (calibration.K - [[0, 0, left], [0, 0, top], [0, 0, 0]])
    return draw_overlay(picture, moved, Calibration(K), drone)
