"""This module makes a COCO-keypoints file for each split of 6DroneSyn, in pixels of the stored images.

The file lies beside its split. `segmentation` is the outline of the drone's mask where the data set has
masks; holes in it are filled. Elsewhere it is the convex outline of the drone with its propeller discs.
`bbox` always holds the discs. Both end at the border of the image.

COCO's own evaluation needs a standard deviation for each keypoint, as a share of the drone's size in the
picture (the root of `area`). COCO measured its own where several people marked the same photographs: 0.025
for an eye, its sharpest keypoint, up to 0.107 for a hip. A hub is known exactly, so there is nothing to
measure. We take that of an eye for all four, as a motor is as clearly bounded. Set them as
`COCOeval.params.kpt_oks_sigmas`; each category holds them as `sigmas`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from dronekeypp.camera import project, to_crop
from dronekeypp.classes import DroneClass
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, depth_files
from dronekeypp.sixdronesyn.annotation import MM, numbers
from dronekeypp.sixdronesyn.drones import KEYPOINT_NAMES
from dronekeypp.sixdronesyn.flight_file import read_own_flight
from dronekeypp.sixdronesyn.folders import read_image
from dronekeypp.sixdronesyn.instances import one_value
from dronekeypp.sixdronesyn.ply import read_points
from dronekeypp.sixdronesyn.scenes import HEIGHT, WIDTH

SKELETON = [[1, 2], [2, 3], [3, 4], [4, 1]]
SIGMAS = [0.025] * 4
YEAR = 2026  # of the editions; a date of rendering would make every file another
DISC = np.linspace(0, 2 * np.pi, 24, endpoint=False)  # angles of the points around a propeller disc
STRAIGHT = 0.1  # pixels that a convex outline may be off where it is made of fewer points
TRACED = 0.3  # and that of a mask: too little to move a pixel in or out
FINER = 4  # a mask is traced on a grid so many times finer, so that the outline runs along its pixels' edges


def coco(root: str | Path, split: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the COCO-keypoints dictionary of one split.

    Args:
        root: folder of the data set. Its models/ must be there.
        split: "train", "val" or "test".
        settings: those of the data set, as its manifest holds them.

    Raises:
        InputError: a file of the models, an annotation or a mask is missing or broken.
    """
    root = Path(root)
    models = _read_models(root)
    outlines: dict[int, np.ndarray] = {}
    images, annotations = [], []
    for found in described_frames(root, split, settings):
        frame, width, height = found.annotation, found.image["width"], found.image["height"]
        if settings.get("masks"):
            path = depth_files.paths(found.folder, frame.number, settings)[-1]
            polygons, area = _traced(read_image(path, found.digests[-1])[..., 0])
        else:
            if frame.obj_id not in outlines:
                outlines[frame.obj_id] = _extreme_points(root, frame.obj_id, models[frame.obj_id])
            points = project(outlines[frame.obj_id] @ frame.R.T + frame.t, frame.K)
            polygons, area = _convex(_in_image(points, frame, settings["size"]), width, height)
        images.append(found.image)
        annotations.append({**found.note, "area": round(area, 2), "segmentation": polygons})
    return {
        "info": _info(settings),
        "licenses": [_license(settings)],
        "images": images,
        "annotations": annotations,
        "categories": categories(root),
    }


@dataclass(frozen=True)
class DescribedFrame:
    """This is what a COCO file says of a frame, but for the drone's outline.

    Attributes:
        folder: of its flight.
        annotation: what the scene files say.
        digests: of its picture, its annotation, and its depth image and masks.
        image: its entry in `images`.
        note: its entry in `annotations`.
    """

    folder: Path
    annotation: bop.Frame
    digests: list[str]
    image: dict[str, Any]
    note: dict[str, Any]


def described_frames(root: Path, split: str, settings: dict[str, Any]) -> Iterator[DescribedFrame]:
    """Return the frames of a split in the order of its COCO file. The arguments are those of `coco`.

    Raises:
        InputError: a file of the models or an annotation is missing or broken.
    """
    size = settings["size"]
    width, height = size or WIDTH, size or HEIGHT
    models = _read_models(root)
    for folder in bop.flight_folders(root, split):
        frames, about = read_own_flight(folder, models, 1 + len(depth_files.paths(root, 0, settings)))
        for frame in frames:
            identity = int(folder.name) * 1000 + frame.number
            name = bop.image_path(folder, frame.number).relative_to(root).as_posix()
            image = {"id": identity, "file_name": name, "width": width, "height": height, "license": 1}
            note = _annotation(frame, identity, size, width, height)
            yield DescribedFrame(folder, frame, about["digests"][str(frame.number)], image, note)


def categories(root: Path) -> list[dict[str, Any]]:
    """Return the categories of a data set: its drones."""
    return [_category(number, drone) for number, drone in _read_models(root).items()]


def _read_models(root: Path) -> dict[int, DroneClass]:
    """Return the drones of a data set by number.

    Raises:
        InputError: models_info.json is missing or broken, or a drone lacks its hubs.
    """
    path = root / bop.MODELS / "models_info.json"
    models = bop.read_models(root)
    if not models:
        raise InputError(f"{path}: missing; run generate again, it writes what is missing")
    for number, drone in models.items():
        if drone.hubs is None:
            raise InputError(f"{path} object {number}: the field keypoints is missing")
    return models


def _info(settings: dict[str, Any]) -> dict[str, Any]:
    return {
        "description": "6DroneSyn: rendered drones with poses and four propeller hubs",
        "version": settings["version"],
        "edition": settings.get("edition", 1),
        "seed": settings["seed"],
        "year": YEAR,
        "contributor": "the DroneKey++ project",
        "sigmas": "categories[].sigmas: a keypoint's deviation over the root of area, that of an eye in COCO",
    }


def _license(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the licence of the pictures. Panoramas of your own keep theirs."""
    name = "MIT License"
    if settings["environments"] != "procedural":
        name += f" for what is drawn; the panoramas of {settings['environments']} keep their own licence"
    return {"id": 1, "name": name, "url": "https://opensource.org/license/mit"}


def _category(number: int, drone: DroneClass) -> dict[str, Any]:
    return {
        "id": number,
        "name": drone.name,
        "supercategory": "drone",
        "keypoints": list(KEYPOINT_NAMES),
        "skeleton": SKELETON,
        "sigmas": SIGMAS,
    }


def _annotation(frame: bop.Frame, identity: int, size: int | None, width: int, height: int) -> dict[str, Any]:
    """Return a drone's annotation without its outline."""
    corners = np.array([frame.box[:2], frame.box[:2] + frame.box[2:]])
    (x, y), high = np.clip(_in_image(corners, frame, size), 0, [width, height])
    keypoints: list[float] = []
    for (px, py), visible in zip(_in_image(frame.keypoints_2d, frame, size), frame.visible, strict=True):
        keypoints += [round(px, 2), round(py, 2), 2 if visible else 1]
    return {
        "id": identity,
        "image_id": identity,
        "category_id": frame.obj_id,
        "iscrowd": 0,
        "bbox": numbers(np.array([x, y, high[0] - x, high[1] - y]), 2),
        "num_keypoints": 4,
        "keypoints": keypoints,
    }


def _in_image(pixels: np.ndarray, frame: bop.Frame, size: int | None) -> np.ndarray:
    """Return full-frame pixels (P, 2) as pixels of the stored image."""
    return pixels if frame.square is None else to_crop(pixels, frame.square) * size


# --- outlines ---------------------------------------------------------------------------------------------


def _extreme_points(root: Path, number: int, drone: DroneClass) -> np.ndarray:
    """Return the extreme points (P, 3) of a drone of models/, in metres and body axes.

    The propeller discs are included, where models_info.json says how large they are.

    Raises:
        InputError: the mesh or the diameter is broken.
    """
    mesh, info = root / bop.MODELS / f"obj_{number:06d}.ply", root / bop.MODELS / "models_info.json"
    points = read_points(mesh) / MM
    entry = bop.read_json(info)[str(number)]
    if entry.get("propeller_diameter") is not None:
        diameter = one_value(entry, "propeller_diameter", 1, f"{info} object {number}")[0]
        circle = np.stack([np.cos(DISC), np.sin(DISC), 0 * DISC], axis=1) * (diameter / MM / 2)
        discs = drone.hubs[:, None] + circle  # (4, D, 3)
        points = np.concatenate([points, discs.reshape(-1, 3)])
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        raise InputError(f"{mesh}: its points lie in one plane; delete it and run generate again") from None


def _convex(points: np.ndarray, width: int, height: int) -> tuple[list[list[float]], float]:
    """Return the convex outline of points (P, 2) inside an image, as COCO's polygons, and its area."""
    hull = cv2.convexHull(points.astype(np.float32))
    border = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
    _, inside = cv2.intersectConvexConvex(hull, border)
    polygon = cv2.approxPolyDP(inside, STRAIGHT, True)
    return [numbers(polygon, 2)], float(cv2.contourArea(polygon))


def _traced(mask: np.ndarray) -> tuple[list[list[float]], float]:
    """Return the outlines of a mask (H, W) as COCO's polygons, and how many pixels it has."""
    if not mask.any():
        return [], 0.0
    x, y, w, h = cv2.boundingRect(mask)
    fine = np.kron(mask[y : y + h, x : x + w], np.ones((FINER, FINER), np.uint8))
    contours, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    polygons = []
    for contour in contours:
        contour = cv2.approxPolyDP(contour, TRACED * FINER, True)
        # OpenCV runs through the centres of the fine pixels, and puts the first one's at 0.
        polygons.append(numbers((contour.reshape(-1, 2) + 0.5) / FINER + [x, y], 2))
    return polygons, float((mask > 0).sum())
