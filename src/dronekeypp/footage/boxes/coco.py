"""Read COCO's JSON: a list of detections, or a data set of images and annotations.

    [{"image_id": "000001", "category_id": 1, "bbox": [1162.66, 492.62, 270.55, 80.47], "score": 0.9}]

    {"images": [{"id": 1, "file_name": "000001.jpg", "width": 1920, "height": 1080}],
     "annotations": [{"image_id": 1, "category_id": 1, "bbox": [1162.66, 492.62, 270.55, 80.47]}],
     "categories": [{"id": 1, "name": "drone"}]}

CVAT, Label Studio and Roboflow write the second, pycocotools takes both. Ultralytics' `save_json` writes the
first, where an image_id is the number in a picture's name, and adds file_name in later versions; its oriented
boxes have `poly`. Detections for BOP have a scene_id. Reference: https://cocodataset.org/#format-data.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.files import parse_json
from dronekeypp.footage.boxes.content import (
    Box,
    BoxFile,
    BoxRow,
    Kind,
    as_box,
    as_score,
    as_size,
    as_whole,
    number,
)

NEITHER = "neither a COCO list of detections nor a COCO data set of images and annotations"


def read_coco(path: Path, text: str, folder: str | Path) -> BoxFile:
    """Read the content of a COCO file.

    Args:
        path: the file, for messages.
        text: its text.
        folder: where the footage lies, for detections of several scenes of a BOP data set.

    Raises:
        InputError: It is not of this format.
    """
    content = parse_json(text, path)
    if isinstance(content, list):
        return _read_list(path, content, folder)
    if not isinstance(content, dict) or not isinstance(content.get("annotations"), list):
        raise InputError(f"{path}: {NEITHER}")
    if not isinstance(content.get("images"), list):
        raise InputError(f"{path}: {NEITHER}: its images are missing")
    file = BoxFile(path, "COCO data set", named=True)
    pictures = _enter_images(file, content["images"])
    names = _category_names(path, content.get("categories"))
    for count, entry in enumerate(content["annotations"]):
        where = f"{path} annotation {count}"
        if not isinstance(entry, dict) or "image_id" not in entry:
            raise InputError(f"{where}: needs image_id and bbox [x, y, w, h]")
        picture = pictures.get(_key(entry["image_id"], where))
        if picture is None:
            raise InputError(f"{where}: image_id {entry['image_id']!r} is none of its images")
        file.rows.append(_row(entry, where, picture, names))
    return file


def _read_list(path: Path, entries: list[Any], folder: str | Path) -> BoxFile:
    """Read a list of detections. Their file_name goes before their image_id."""
    named = [isinstance(entry, dict) and "file_name" in entry for entry in entries]
    file = BoxFile(path, "COCO detections", named=any(named))
    scene = Path(folder).resolve().parent.name
    for count, entry in enumerate(entries):
        where = f"{path} entry {count}"
        if not isinstance(entry, dict) or not {"file_name", "image_id"} & entry.keys():
            raise InputError(f"{where}: needs image_id or file_name of a frame, and bbox [x, y, w, h]")
        if named[count] != named[0]:
            raise InputError(f"{where}: some entries have a file_name, and some have none")
        name = entry["file_name"] if named[0] else _key(entry["image_id"], where)
        if named[0] and (not isinstance(name, str) or not name.strip()):
            raise InputError(f"{where}: file_name {name!r} is no name")
        if "scene_id" in entry:
            theirs = as_whole(entry["scene_id"], "scene_id", where)
            if not scene.isdecimal():
                raise InputError(f"{where}: of scene {theirs}; the footage is no scene of a BOP data set")
            if theirs != int(scene):
                name = f"{theirs:06d}/{name}"  # a picture of another scene
        row = _row(entry, where, file.picture(name, where), {})
        file.rows.append(row)
    return file


def _enter_images(file: BoxFile, images: list[Any]) -> dict[str | int, int]:
    """Enter the images of a data set, and return their indices by id."""
    pictures: dict[str | int, int] = {}
    for count, image in enumerate(images):
        where = f"{file.path} image {count}"
        if not isinstance(image, dict) or "id" not in image:
            raise InputError(f"{where}: an image without id and file_name: {str(image)[:60]}")
        name = image.get("file_name")
        extra = image.get("extra")
        if isinstance(extra, dict) and isinstance(extra.get("name"), str):
            name = extra["name"]  # Roboflow's: the name before it was renamed
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"{where}: an image without id and file_name: {str(image)[:60]}")
        identity = _key(image["id"], where)
        if identity in pictures:
            raise InputError(f"{where}: id {identity!r} is there twice")
        size = as_size(image.get("width"), image.get("height"), where)
        index = file.picture(name, where, size)
        if file.pictures[index].size != size:
            raise InputError(f"{where}: {name} has two sizes")
        pictures[identity] = index
    return pictures


def _key(value: Any, where: str) -> str | int:
    """Return an id: text, or a whole number. 5.0 is 5."""
    if isinstance(value, str) and value.strip():
        return value.strip()
    return as_whole(value, "the id", where)


def _category_names(path: Path, categories: Any) -> dict[str, str]:
    """Return the names of the categories by id."""
    names = {}
    for count, category in enumerate(categories if isinstance(categories, list) else []):
        where = f"{path} category {count}"
        if not isinstance(category, dict) or "id" not in category:
            raise InputError(f"{where}: needs id and name")
        names[str(_key(category["id"], where))] = str(category.get("name") or "")
    return names


def _row(entry: Mapping[str, Any], where: str, picture: int, names: Mapping[str, str]) -> BoxRow:
    """Return the box of an annotation or a detection."""
    kind = None
    if entry.get("category_id") is not None:
        identity = str(_key(entry["category_id"], where))
        kind = Kind(identity, names.get(identity) or None)
    attributes = entry.get("attributes")  # CVAT's
    track = entry.get("track_id")
    if track is None and isinstance(attributes, dict):
        track = attributes.get("track_id")
    return BoxRow(
        where,
        picture,
        _box(entry, where),
        as_score(entry.get("score"), where),
        kind,
        None if track is None else str(_key(track, where)),
    )


def _box(entry: Mapping[str, Any], where: str) -> Box | None:
    """Return the bbox of an entry, or the box around its poly, an oriented box x1, y1 … x4, y4."""
    if "bbox" in entry:
        values = entry["bbox"]
        if values is not None and not isinstance(values, list):
            raise InputError(f"{where}: bbox must be [x, y, w, h], got {str(values)[:60]}")
        return as_box(values or (), where)
    corners = entry.get("poly")
    if not isinstance(corners, list) or len(corners) != 8:
        raise InputError(f"{where}: needs bbox [x, y, w, h]")
    try:
        x, y = [number(value) for value in corners[::2]], [number(value) for value in corners[1::2]]
    except ValueError:
        raise InputError(f"{where}: poly needs eight numbers") from None
    return as_box([min(x), min(y), max(x) - min(x), max(y) - min(y)], where)
