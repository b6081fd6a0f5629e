"""Write the files of a data set in Ultralytics' layout: a label for each picture, and data.yaml.

The pictures are images/SPLIT/NAME.jpg, the labels labels/SPLIT/NAME.txt with one line for each drone.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dronekeypp.files import write_beside

SEEN, HIDDEN, UNLABELLED = 2, 1, 0  # what a label says of a keypoint


def label_line(
    label: int,
    box: Sequence[float],
    size: tuple[float, float],
    keypoints: np.ndarray | None = None,
    visibility: Sequence[int] | None = None,
) -> str:
    """Return one drone in a picture as a line of YOLO's label file, in units of the picture.

    Args:
        label: its class index.
        box: x, y, width, height in pixels of the picture.
        size: width and height of the picture, pixels.
        keypoints: (4, 2) in pixels of the picture; None: the line holds the box alone.
        visibility: of each keypoint: SEEN, HIDDEN or UNLABELLED.
    """
    (x, y, w, h), (width, height) = box, size
    words = [str(label)]
    for value in ((x + w / 2) / width, (y + h / 2) / height, w / width, h / height):
        words.append(f"{value:.6f}")
    if keypoints is not None:
        for (u, v), how in zip(keypoints, visibility, strict=True):
            if how == UNLABELLED:
                words += ["0", "0", "0"]
            else:
                words += [f"{u / width:.6f}", f"{v / height:.6f}", str(how)]
    return " ".join(words)


def write_data_yaml(out: Path, splits: Sequence[str], names: Sequence[str], keypoints: bool = True) -> Path:
    """Write data.yaml, which tells the library where the pictures are, and return its path.

    It names no folder of its own: the library takes the one that it lies in, so the folder can be moved.

    Args:
        out: the folder that holds images/SPLIT and labels/SPLIT.
        splits: the names of the splits.
        names: the names of the classes, in order.
        keypoints: whether the labels hold the four keypoints.
    """
    lines = [f"{split}: images/{split}" for split in splits]
    if keypoints:
        lines += ["kpt_shape: [4, 3]", "flip_idx: [1, 0, 3, 2]"]
    lines.append("names:")
    for i, name in enumerate(names):
        lines.append(f"  {i}: {json.dumps(name, ensure_ascii=False)}")
    write_beside(out / "data.yaml", ("\n".join(lines) + "\n").encode())
    return out / "data.yaml"
