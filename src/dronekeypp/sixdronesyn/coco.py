"""This module makes a COCO-keypoints file for each split of 6DroneSyn, in pixels of the stored images.

The file lies beside its split.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp.camera import to_crop
from dronekeypp.classes import DroneClass
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.annotation import numbers
from dronekeypp.sixdronesyn.drones import KEYPOINT_NAMES
from dronekeypp.sixdronesyn.scenes import HEIGHT, WIDTH

SKELETON = [[1, 2], [2, 3], [3, 4], [4, 1]]


def coco(root: str | Path, split: str, size: int | None = None) -> dict[str, list]:
    """Return the COCO-keypoints dictionary of one split.

    `size` is the side of stored crops, None for whole frames.
    """
    images, annotations = [], []
    for folder in bop.flight_folders(root, split):
        for frame in bop.read_flight(folder)[0]:
            identity = int(folder.name) * 1000 + frame.number
            name = bop.image_path(folder, frame.number).relative_to(root).as_posix()
            images.append(
                {"id": identity, "file_name": name, "width": size or WIDTH, "height": size or HEIGHT}
            )
            annotations.append(_annotation(frame, identity, size))
    categories = [_category(number, drone) for number, drone in bop.read_models(root).items()]
    return {"images": images, "annotations": annotations, "categories": categories}


def _annotation(frame: bop.Frame, identity: int, size: int | None) -> dict[str, Any]:
    points = frame.keypoints_2d
    corners = np.array([frame.box[:2], frame.box[:2] + frame.box[2:]])
    if frame.square is not None:
        points = to_crop(points, frame.square) * size
        corners = to_crop(corners, frame.square) * size
    (x, y), (w, h) = corners[0], corners[1] - corners[0]
    keypoints: list[float] = []
    for (px, py), visible in zip(points, frame.visible, strict=True):
        keypoints += [round(px, 2), round(py, 2), 2 if visible else 1]
    return {
        "id": identity,
        "image_id": identity,
        "category_id": frame.obj_id,
        "iscrowd": 0,
        "bbox": numbers(np.array([x, y, w, h]), 2),
        "area": round(w * h, 2),
        "num_keypoints": 4,
        "keypoints": keypoints,
    }


def _category(number: int, drone: DroneClass) -> dict[str, Any]:
    return {
        "id": number,
        "name": drone.name,
        "supercategory": "drone",
        "keypoints": list(KEYPOINT_NAMES),
        "skeleton": SKELETON,
    }
