"""This module is about the depth images and masks of a data set as files: paths, contents, faults.

`depth` draws what they hold. Nothing is drawn here, so no graphics library is needed. A flight's folder holds

    depth/000000.png                16 bits; value × depth_scale is z in millimetres, 0 where no drone is
    mask/000000_000000.png          255 where the drone is, whether something hides it or not
    mask_visib/000000_000000.png    255 where it is to be seen; nothing else flies here, so it equals mask/
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dronekeypp.files import digest
from dronekeypp.sixdronesyn.annotation import MM

FOLDERS = ("depth", "mask", "mask_visib")


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
        depth: (H, W) metres, from `depth.draw_depth`.
        scale: millimetres a step, from `depth.depth_scale`.
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
        whole = info.get("px_count_all")
        is_possible = type(whole) is int and whole >= visible
        if not is_possible or info != {**info, **counts(visible, whole)}:
            path = folder / "scene_gt_info.json"
            found.append(f"{path} frame {number}: its pixel counts are not those of mask_visib/")
    return found
