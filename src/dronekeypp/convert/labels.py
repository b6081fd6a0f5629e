"""Write what a detector learns from: labels for every picture of a data set, in one format or the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dronekeypp.baselines.yolo_layout import HIDDEN, SEEN, UNLABELLED, label_line, write_data_yaml
from dronekeypp.classes import names_of
from dronekeypp.files import make_folder, write_beside, write_json
from dronekeypp.frame_dataset import FrameDataset
from dronekeypp.sixdronesyn.coco import coco
from dronekeypp.stored import StoredFrame

SLIVER = 1.0  # pixels: a drone of which less is in the picture has no label

# The drones of each picture of a split by the picture's new name. One without a drone has one entry all the
# same, whose annotation is None.
Pictures = dict[str, list[StoredFrame]]


def write_yolo(
    partial: Path,
    splits: dict[str, FrameDataset],
    pictures: dict[str, Pictures],
    keypoints: bool,
    types: bool,
) -> None:
    """Write a label for each picture, and then data.yaml."""
    for split, frames in splits.items():
        folder = partial / "labels" / split
        make_folder(folder)
        numbers = list(frames.objects)
        for name, drones in pictures[split].items():
            lines = []
            for drone in drones:
                box = box_inside(drone)
                if box is not None:
                    label = numbers.index(drone.annotation.obj_id) if types else 0
                    lines.append(_yolo_line(drone, box, label, keypoints) + "\n")
            write_beside((folder / name).with_suffix(".txt"), "".join(lines).encode())
    names = names_of(splits["train"].drones) if types else ["drone"]
    write_data_yaml(partial, list(splits), names, keypoints)


def box_inside(frame: StoredFrame) -> np.ndarray | None:
    """Return the part of a drone's box (x, y, w, h) that lies in the picture, or None where that is none."""
    if frame.annotation is None:
        return None
    box, size = frame.annotation.box, np.array([frame.width, frame.height])
    corner = box[:2].clip(0, size)
    extent = (box[:2] + box[2:]).clip(0, size) - corner
    return np.concatenate([corner, extent]) if extent.min() >= min(SLIVER, box[2:].min()) else None


def _yolo_line(frame: StoredFrame, box: np.ndarray, label: int, keypoints: bool) -> str:
    """Return the line of a drone, of which `box` and the keypoints in the picture count."""
    size = (frame.width, frame.height)
    points, visible = frame.annotation.keypoints_2d, frame.annotation.visible
    if not keypoints:
        return label_line(label, box, size)
    if points is None:
        return label_line(label, box, size, np.zeros((4, 2)), [UNLABELLED] * 4)
    inside = ((points >= 0) & (points <= size)).all(axis=1)
    seen = np.ones(4, dtype=bool) if visible is None else visible
    visibility = np.where(inside, np.where(seen, SEEN, HIDDEN), UNLABELLED)
    return label_line(label, box, size, points, visibility)


def write_coco(
    partial: Path,
    root: Path,
    splits: dict[str, FrameDataset],
    pictures: dict[str, Pictures],
    types: bool,
) -> None:
    """Write the COCO file of each split.

    It is the data set's own, with other names of the pictures and, but for `types`, one category.
    """
    for split, frames in splits.items():
        new_name = {}
        for name, drones in pictures[split].items():
            old = drones[0].image.relative_to(root).as_posix()
            new_name[old] = f"images/{split}/{name}"
        table = coco(root, split, frames.manifest["settings"])
        for image in table["images"]:
            image["file_name"] = new_name[image["file_name"]]
        if not types:
            table["categories"] = [{**table["categories"][0], "id": 1, "name": "drone"}]
            for annotation in table["annotations"]:
                annotation["category_id"] = 1
        write_json(partial / f"{split}.json", table)
