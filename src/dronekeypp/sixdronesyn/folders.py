"""Find the flights and the pictures of a split of a data set on disk."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np

from dronekeypp import files
from dronekeypp.classes import DroneClass
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, quadrotors, scenes
from dronekeypp.sixdronesyn.flight_file import MEND
from dronekeypp.sixdronesyn.manifest_check import NAME, OLDER, check_manifest

CAMERA = "camera.json"  # of a data set: width and height of its frames, where it is there
IMAGES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")


def find_flights(root: Path, split: str, manifest: dict[str, Any]) -> dict[Path, set[int] | None]:
    """Return the flight folders of a split, in order, and which of their frames belong to it (None: all).

    Of 6DroneSyn they are those that its manifest plans. Of any other folder they are those that
    ROOT/SPLIT.txt lists, or those in ROOT/SPLIT.

    Raises:
        InputError: no such folder or split, or a flight of 6DroneSyn is missing.
    """
    if not root.is_dir():
        raise InputError(f"{root}: no such folder; make it with `python -m dronekeypp generate`")
    if manifest:
        if split not in scenes.SPLITS:
            raise InputError(f"split {split!r}: choose {', '.join(scenes.SPLITS)}")
        check_complete(root, split, manifest)
        return dict.fromkeys(bop.flight_folders(root, split))
    listed = root / f"{split}.txt"
    if listed.is_file():
        return read_list(listed)
    folder = root / split
    if not split or not folder.is_dir():
        raise InputError(f"{root}: no split {split!r}: neither a folder nor {listed.name}")
    flights = [path for path in folder.iterdir() if (path / bop.SCENE_FILES[0]).is_file()]
    return dict.fromkeys(sorted(flights, key=lambda path: files.natural_order(path.name)))


def read_manifest(root: Path) -> dict[str, Any]:
    """Return the manifest of 6DroneSyn, or {} for a folder without one.

    A manifest.json without a plan and of another name is somebody else's.

    Raises:
        InputError: manifest.json holds something else, see `check_manifest`.
    """
    path = root / "manifest.json"
    if not path.is_file():
        return {}
    manifest = bop.read_json(path)
    if not isinstance(manifest, dict):
        raise InputError(f"{path}: not a data set's manifest; mend it, or generate it in another folder")
    if "planned" not in manifest and manifest.get("name") != NAME:
        return {}
    check_manifest(path, manifest)
    return manifest


def require_manifest(root: Path) -> dict[str, Any]:
    """Return the manifest of a data set of 6DroneSyn.

    Raises:
        InputError: the folder has none, or a broken one.
    """
    manifest = read_manifest(root)
    if not manifest:
        raise InputError(
            f"{root / 'manifest.json'}: missing, or not the manifest of 6DroneSyn; "
            "is this a data set of `python -m dronekeypp generate`?"
        )
    return manifest


def check_complete(root: Path, split: str, manifest: dict[str, Any]) -> None:
    """Check that every flight that 6DroneSyn's manifest plans for a split is there.

    Raises:
        InputError: one is missing.
    """
    edition = edition_of(manifest)
    planned = [name for name in manifest["planned"] if split_of(name, edition) == split]
    finished = bop.flight_folders(root, split)
    if len(finished) < len(planned):
        raise InputError(
            f"{root}: {len(finished)} of {len(planned)} {split} flights are there; "
            "run generate again, it resumes"
        )


def edition_of(manifest: dict[str, Any]) -> int:
    """Return the edition of 6DroneSyn that a manifest describes."""
    return manifest.get("settings", {}).get("edition", OLDER["edition"])


def split_of(name: str, edition: int) -> str | None:
    """Return the split of a flight of 6DroneSyn by its folder's name, or None for any other name."""
    scene = scenes.SCENES.get(_parts(name, edition)[0]) if name.isdecimal() else None
    return scene.split if scene else None


def drone_of(name: str, edition: int) -> int:
    """Return the number of the drone, from 0, of a flight of 6DroneSyn by its folder's name."""
    return _parts(name, edition)[1]


def _parts(name: str, edition: int) -> tuple[int, int]:
    """Return the scene and the drone's number in a flight's name, see `scenes.Subsequence.id`."""
    return divmod(int(name) // 10, scenes.MOST_DRONES[edition])


def drone_names(settings: dict[str, Any]) -> tuple[str, ...]:
    """Return the names of the drones of a data set with these settings; names[i] is object i + 1."""
    if settings.get("quadrotors"):
        return tuple(quadrotors.name_of(number) for number in range(*settings["quadrotors"]))
    return (*scenes.SEVEN, *settings.get("own_drones", {}))


def read_models(root: Path, manifest: dict[str, Any]) -> dict[int, DroneClass]:
    """Return the drones of any data set by object number.

    Args:
        root: of the data set.
        manifest: that of 6DroneSyn, or {}. Where `generate` has finished, its drones must all be there.

    Raises:
        InputError: models_info.json is broken, or its objects are not the drones of the manifest.
    """
    models = bop.read_models(root)
    if "flights" not in manifest:
        return models
    path = root / bop.MODELS / "models_info.json"
    mend = "delete it and run generate again, it writes what is missing"
    if not models:
        raise InputError(f"{path}: missing; run generate again, it writes what is missing")
    names = drone_names(manifest["settings"])
    for number in sorted({*models, *range(1, len(names) + 1)}):
        name = names[number - 1] if 1 <= number <= len(names) else None
        if number not in models or models[number].name != name:
            there = models[number].name if number in models else None
            raise InputError(f"{path}: object {number} is {there}, the manifest has {name}; {mend}")
        if models[number].hubs is None:
            raise InputError(f"{path} object {number}: the field keypoints is missing; {mend}")
    return models


def check_flight(folder: Path, about: dict[str, Any], manifest: dict[str, Any]) -> None:
    """Check that flight.json is that of its folder and of its data set.

    Args:
        folder: of the flight.
        about: what its flight.json holds.
        manifest: that of the data set.

    Raises:
        InputError: it is not; the message names the field.
    """
    scene = _parts(folder.name, edition_of(manifest))[0]
    for key, expected in (("scene", scene), ("seed", manifest["settings"]["seed"])):
        if about[key] != expected:
            raise InputError(f"{folder / 'flight.json'}: {key} is {about[key]}, not {expected}; {MEND}")


def read_list(path: Path) -> dict[Path, set[int] | None]:
    """Return the flights that a list of a split names, and which of their frames (None: all).

    Raises:
        InputError: a line names neither a flight folder nor a frame of one.
    """
    flights: dict[Path, set[int] | None] = {}
    try:
        content = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not text in UTF-8") from None
    for number, text in enumerate(content.splitlines(), 1):
        line = text.strip().rstrip("/")
        if not line or line.startswith("#"):
            continue
        if Path(line).is_absolute() or ".." in PurePosixPath(line.replace("\\", "/")).parts:
            raise InputError(f"{path} line {number}: {line!r} leads out of the data set's folder")
        folder, frame = path.parent / line, None
        if not (folder / bop.SCENE_FILES[0]).is_file() and Path(line).stem.isdecimal():
            folder, frame = folder.parent, int(Path(line).stem)
            folder = folder.parent if folder.name == "rgb" else folder
        if not (folder / bop.SCENE_FILES[0]).is_file():
            raise InputError(f"{path} line {number}: {line!r} is neither a flight folder nor FLIGHT/NUMBER")
        if frame is None:
            flights[folder] = None
        elif flights.setdefault(folder, set()) is not None:
            flights[folder].add(frame)
    return flights


def check_listed(folder: Path, wanted: set[int], annotated: set[int]) -> None:
    """Check that a flight annotates every frame that a list names.

    Raises:
        InputError: it does not.
    """
    missing = sorted(wanted - annotated)
    if missing:
        raise InputError(f"{folder}: a list names frame {missing[0]}, and there is no drone in it")


def unnamed_objects(root: Path) -> dict[int, DroneClass]:
    """Return the objects of a data set without models_info.json, by number.

    They are those of all its annotations. Flights lie in the data set's folder, or in a folder there.
    """
    name = bop.SCENE_FILES[1]
    numbers: set[int] = set()
    for path in [*root.glob(name), *root.glob(f"*/{name}"), *root.glob(f"*/*/{name}")]:
        for _, truths, _ in bop.read_entries(path.parent).values():
            for truth in truths:
                if type(truth.get("obj_id")) is int:
                    numbers.add(truth["obj_id"])
    return {number: DroneClass(f"object {number}") for number in sorted(numbers)}


def frame_size(root: Path, folder: Path, images: dict[int, Path]) -> tuple[int, int]:
    """Return width and height of the whole frames of a flight.

    They come from camera.json or, where there is none, from the first picture.

    Raises:
        InputError: camera.json holds no sizes, or there is no picture.
    """
    camera = root / CAMERA
    if camera.is_file():
        entry = files.read_json(camera)
        size = (entry.get("width"), entry.get("height")) if isinstance(entry, dict) else (None, None)
        if not all(type(value) is int and value > 0 for value in size):
            raise InputError(f"{camera}: width and height must be whole numbers of pixels")
        return size
    if not images:
        raise InputError(
            f"{folder / 'rgb'}: no image; a picture is called by its frame's number, 7.jpg or 000007.png"
        )
    height, width = read_image(next(iter(images.values()))).shape[:2]
    return width, height


def stored_images(folder: Path) -> dict[int, Path]:
    """Return the image files of a flight by frame number, in order."""
    images = {}
    for path in sorted((folder / "rgb").glob("*")):
        if path.suffix.lower() in IMAGES and path.stem.isdecimal():
            images[int(path.stem)] = path
    return images


def read_image(path: str | Path, digest: str | None = None) -> np.ndarray:
    """Read an image file as (H, W, 3) uint8 RGB.

    Raises:
        InputError: missing, truncated or not an image, or another one than `digest` (of flight.json) says.
            The message names the file.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        mend = "; delete its flight folder and run generate again" if digest else ""
        raise InputError(f"{path}: image missing{mend}") from None
    if path.suffix.lower() in (".jpg", ".jpeg"):
        # OpenCV fills what a truncated JPEG lacks with grey and says nothing. The end marker comes after the
        # last start of picture data, or the file is cut off.
        whole = data[:2] == b"\xff\xd8" and data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")
        kind = "a JPEG"
    else:
        whole, kind = bool(data), "an image"
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if whole else None
    if image is None:
        mend = "; delete its flight folder and run generate again" if digest else ""
        raise InputError(f"{path}: truncated or not {kind}{mend}")
    if digest and files.digest(data) != digest:
        raise InputError(
            f"{path}: not the image that was generated; delete its flight folder and run generate again"
        )
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
