"""Compare a COCO file of 6DroneSyn with the annotations that it was made of."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from dronekeypp.errors import InputError
from dronekeypp.schema import Count, Open, check
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.coco import categories, described_frames

MEND = "run generate again, it writes it anew"
OFF = 0.02  # pixels: two roundings to 0.01
BESIDE = 1.0  # pixels that an outline may reach out of its box: pixels of a mask are whole

Numbers = list[float]


class Image(Open):
    """This is an entry of `images`."""

    id: Count
    file_name: str
    width: Count
    height: Count


class Annotation(Open):
    """This is an entry of `annotations`."""

    id: Count
    image_id: Count
    category_id: Count
    iscrowd: int
    bbox: Annotated[Numbers, Field(min_length=4, max_length=4)]
    area: Annotated[float, Field(ge=0)]
    num_keypoints: Count
    keypoints: Annotated[Numbers, Field(min_length=12, max_length=12)]
    segmentation: list[Annotated[Numbers, Field(min_length=6)]] = Field(default=None)


class CocoFile(Open):
    """This is a COCO file. Those of earlier versions have neither `info` nor `segmentation`."""

    info: dict[str, Any] = Field(default=None)
    licenses: list[dict[str, Any]] = Field(default=None)
    images: list[Image]
    annotations: list[Annotation]
    categories: list[dict[str, Any]]


def coco_faults(root: Path, split: str, settings: dict[str, Any]) -> list[str]:
    """Return what is wrong with the COCO file of a split, one line for each kind of fault.

    Args:
        root: the data set.
        split: its flights must be sound.
        settings: those of its manifest.
    """
    path = root / f"coco_{split}.json"
    try:
        content = bop.read_json(path)
        check(CocoFile, content, path, MEND)
        return _faults(path, content, root, split, settings)
    except InputError as error:
        return [str(error)]


def _faults(
    path: Path, content: dict[str, Any], root: Path, split: str, settings: dict[str, Any]
) -> list[str]:
    images, annotations = content["images"], content["annotations"]
    early = "info" not in content and "licenses" not in content
    if not early and not ("info" in content and "licenses" in content):
        return [f"{path}: info or licenses is missing; {MEND}"]
    expected = list(described_frames(root, split, settings))
    for name, entries in (("images", images), ("annotations", annotations)):
        if len(entries) != len(expected):
            return [f"{path}: lists {len(entries)} {name}, the data set has {len(expected)}; {MEND}"]
    drones = categories(root)
    if len(content["categories"]) != len(drones):
        return [f"{path}: its categories are not the drones of the data set; {MEND}"]
    for number, (listed, drone) in enumerate(zip(content["categories"], drones, strict=True)):
        if not _same(listed, drone, early):
            return [f"{path}: categories.{number} is not {drone['name']}; {MEND}"]
    for number, (frame, image, note) in enumerate(zip(expected, images, annotations, strict=True)):
        fault = ""
        if not _same(image, frame.image, early):
            fault = f"images.{number} is not {frame.image['file_name']}"
        elif not _same(note, frame.note, early):
            fault = f"annotations.{number} is not that of {frame.image['file_name']}"
        elif not early and not _is_outline(note):
            fault = f"annotations.{number}: its segmentation lies outside its bbox"
        if fault:
            return [f"{path}: {fault}; {MEND}"]
    return []


def _same(listed: dict[str, Any], known: dict[str, Any], early: bool) -> bool:
    """Tell whether an entry says what is known, up to rounding. Early files lack some keys."""
    for key, value in known.items():
        if early and key not in listed:
            continue
        other = listed.get(key)
        if isinstance(value, list) and value and isinstance(value[0], float):
            if np.abs(np.subtract(other, value)).max() > OFF:
                return False
        elif other != value:
            return False
    return True


def _is_outline(note: dict[str, Any]) -> bool:
    """Tell whether the outline of an annotation, and its area, are in its box."""
    if "segmentation" not in note:
        return False
    x, y, width, height = note["bbox"]
    if note["area"] > (width + 2 * BESIDE) * (height + 2 * BESIDE):
        return False
    for polygon in note["segmentation"]:
        if len(polygon) % 2:
            return False
        points = np.reshape(polygon, (-1, 2))
        low, high = points.min(axis=0), points.max(axis=0)
        if (low < [x - BESIDE, y - BESIDE]).any():
            return False
        if (high > [x + width + BESIDE, y + height + BESIDE]).any():
            return False
    return True
