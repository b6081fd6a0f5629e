"""Write a data set of whole frames as a detector wants it: in Ultralytics' layout, or with COCO files.

A detector finds the box that `predict` needs. Its data lie in a folder of their own:

    OUT/images/SPLIT/FLIGHT_NUMBER.jpg     the data set's own pictures: linked, or copied where that fails
    OUT/labels/SPLIT/FLIGHT_NUMBER.txt     yolo: one line for each drone, see `baselines.yolo_layout`
    OUT/data.yaml                          yolo: what Ultralytics is told to train on
    OUT/SPLIT.json                         coco: of train, val and test; file names start at OUT
    OUT/convert.json                       what was converted, and how

The splits are the data set's, so every flight lies in one of them.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from dronekeypp.baselines.yolo_layout import HIDDEN, SEEN, UNLABELLED, label_line, write_data_yaml
from dronekeypp.classes import names_of
from dronekeypp.data import open_dataset, require
from dronekeypp.errors import InputError
from dronekeypp.files import lock_folder, read_json, remove_unfinished, write_beside, write_json
from dronekeypp.frame_dataset import FrameDataset, StoredFrame
from dronekeypp.sixdronesyn import folders, scenes
from dronekeypp.sixdronesyn.coco import coco

FORMATS = ("yolo", "coco")
RECORD = "convert.json"

# The drones of each picture of a split, as indices into its data set, by the picture's new name.
Pictures = dict[str, list[int]]


def convert(
    dataset: str | Path,
    to: str,
    out: str | Path | None = None,
    keypoints: bool = False,
    types: bool = False,
    progress: bool = True,
) -> Path:
    """Write a data set of whole frames for a detector, and return the folder.

    What is there already is left alone. After a kill, the same call goes on; until it has finished, the
    folder is not there.

    Args:
        dataset: 6DroneSyn, or for "yolo" any BOP folder of `dronekeypp.data`.
        to: "yolo" for Ultralytics, "coco" for torchvision and others.
        out: the folder to write to; None: DATASET-yolo or DATASET-coco, beside the data set.
        keypoints: yolo: labels with four keypoints, for its task "pose". A COCO file has them in any case.
        types: yolo: one class for each type of drone, and not one class "drone". So has a COCO file.
        progress: whether to print what was done, and to show a bar in a terminal.

    Raises:
        InputError: the data set holds crops, lacks what the format needs, or cannot be read; a flight lies in
            two splits; `out` holds something else.
    """
    root = Path(dataset)
    _check_arguments(to, keypoints, types)
    out = Path(out) if out else _beside(root, to)
    splits = _open_splits(root, to, keypoints)
    record = {
        "to": to,
        "keypoints": keypoints,
        "types": types,
        "digests": {split: frames.digest for split, frames in splits.items()},
        "frames": {split: len(_pictures(frames)) for split, frames in splits.items()},
    }
    counts = ", ".join(f"{count} {split}" for split, count in record["frames"].items())
    if _is_finished(out, record):
        if progress:
            print(f"{out}: already there, {counts} frames")
        return out
    partial = out.with_name(f".{out.name}.partial")
    partial.mkdir(parents=True, exist_ok=True)
    with lock_folder(partial):
        _start(partial, record)
        _write_pictures(partial, splits, progress)
        if to == "yolo":
            _write_yolo(partial, splits, keypoints, types)
        else:
            _write_coco(partial, root, splits)
    partial.rename(out)
    if progress:
        print(f"{out}: {counts} frames")
    return out


def _check_arguments(to: str, keypoints: bool, types: bool) -> None:
    """Raise InputError for arguments of `convert` that do not go together."""
    if to not in FORMATS:
        raise InputError(f"--to {to}: choose {' or '.join(FORMATS)}")
    if to == "coco" and (keypoints or types):
        raise InputError(
            "--keypoints and --types are for --to yolo: a COCO file has keypoints and types in any case"
        )


def _beside(root: Path, to: str) -> Path:
    """Return the folder that is written to where none is given."""
    named = root if root.name not in ("", "..") else root.resolve()
    return named.with_name(f"{named.name}-{to}")


# --- the data set -----------------------------------------------------------------------------------------


def _open_splits(root: Path, to: str, keypoints: bool) -> dict[str, FrameDataset]:
    """Open every split of a data set, and check that a detector can be trained on it.

    Raises:
        InputError: it holds crops, or lacks what the format needs; a flight lies in two splits.
    """
    if not root.is_dir():
        raise InputError(f"{root}: no such folder")
    manifest = folders.read_manifest(root)
    if to == "coco" and not manifest:
        raise InputError(f"{root}: COCO files are made of 6DroneSyn only; --to yolo takes any BOP folder")
    splits = {}
    for split in scenes.SPLITS:
        if _has_split(root, split, manifest):
            splits[split] = open_dataset(root, split)
    needed = ("train", "val") if to == "yolo" else tuple(splits) or scenes.SPLITS
    for split in needed:
        if split not in splits:
            raise InputError(f"{root}: no {split} flights; {to} needs {' and '.join(needed)}")
    for frames in splits.values():
        if any(frame.annotation.square is not None for frame in frames.stored):
            raise InputError(
                f"{root}: holds crops, and a detector is trained on whole frames; "
                "make them with `python -m dronekeypp generate DIR --frames full`"
            )
        if keypoints:
            require(frames, ("keypoints",), "--keypoints")
    _check_apart(splits)
    return splits


def _has_split(root: Path, split: str, manifest: dict[str, Any]) -> bool:
    """Return whether a data set has a split."""
    if manifest:
        return bool(folders.find_flights(root, split, manifest))
    return (root / f"{split}.txt").is_file() or (root / split).is_dir()


def _check_apart(splits: dict[str, FrameDataset]) -> None:
    """Raise InputError where two splits share a flight: its frames are too much alike."""
    split_of: dict[Path, str] = {}
    for split, frames in splits.items():
        for folder in dict.fromkeys(frames.folders):
            other = split_of.setdefault(folder.resolve(), split)
            if other != split:
                raise InputError(f"{folder}: in {other} and in {split}; a flight belongs to one split")


def _pictures(frames: FrameDataset) -> Pictures:
    """Return the drones of each picture of a split, by the name that the picture gets.

    Raises:
        InputError: two pictures would get one name.
    """
    pictures: Pictures = {}
    for index, frame in enumerate(frames.stored):
        name = _picture_name(frame, frames.root / frames.split)
        indices = pictures.setdefault(name, [])
        indices.append(index)
        first = frames.stored[indices[0]].image
        if first != frame.image:
            raise InputError(f"{first} and {frame.image} would both be called {name}; rename a flight")
    return pictures


def _picture_name(frame: StoredFrame, folder: Path) -> str:
    """Return the new name of a picture: its flight, as seen from the split's `folder`, and its number."""
    parts = Path(os.path.relpath(frame.folder, folder)).parts
    flight = "-".join(part for part in parts if part != "..")
    return f"{flight}_{frame.image.name}"


# --- the folder -------------------------------------------------------------------------------------------


def _is_finished(out: Path, record: dict[str, Any]) -> bool:
    """Return whether this very conversion is there already.

    Raises:
        InputError: the folder holds something else.
    """
    if not out.exists():
        return False
    if not out.is_dir():
        raise InputError(f"{out} is a file, not a folder")
    if not (out / RECORD).is_file():
        raise InputError(f"{out}: the folder is there and holds no {RECORD}; choose another with --out")
    old = read_json(out / RECORD)
    for key, value in record.items():
        before = old.get(key) if isinstance(old, dict) else None
        if before != value:
            raise InputError(
                f"{out}: made with other {key} ({before}, now {value}); choose another folder with --out"
            )
    return True


def _start(partial: Path, record: dict[str, Any]) -> None:
    """Keep what a killed run of this very conversion has left in a folder, and clear anything else."""
    path = partial / RECORD
    if path.is_file() and read_json(path) == record:
        for folder in (partial, *partial.glob("*/*/")):
            remove_unfinished(folder)
        return
    for item in partial.iterdir():
        if item.is_dir():
            shutil.rmtree(item)
        elif item.name != ".lock":
            item.unlink()
    write_json(path, record)


def _write_pictures(partial: Path, splits: dict[str, FrameDataset], progress: bool) -> None:
    """Link the pictures into a folder. Each is read once, so that a broken one is found here."""
    for split, frames in splits.items():
        folder = partial / "images" / split
        folder.mkdir(parents=True, exist_ok=True)
        bar = tqdm(_pictures(frames).items(), split, unit="frame", disable=None if progress else True)
        for name, indices in bar:
            if not (folder / name).exists():
                frames.stored_image(indices[0])
                _link(frames.stored[indices[0]].image, folder / name)


def _link(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system does not allow that."""
    try:
        os.link(source.resolve(), target)
    except OSError:
        write_beside(target, source.read_bytes())


# --- labels -----------------------------------------------------------------------------------------------


def _write_yolo(partial: Path, splits: dict[str, FrameDataset], keypoints: bool, types: bool) -> None:
    """Write a label for each picture, and then data.yaml."""
    for split, frames in splits.items():
        folder = partial / "labels" / split
        folder.mkdir(parents=True, exist_ok=True)
        labels = frames.labels
        for name, indices in _pictures(frames).items():
            lines = []
            for index in indices:
                label = labels[index] if types else 0
                lines.append(_yolo_line(frames.stored[index], label, keypoints) + "\n")
            write_beside((folder / name).with_suffix(".txt"), "".join(lines).encode())
    names = names_of(splits["train"].drones) if types else ["drone"]
    write_data_yaml(partial, list(splits), names, keypoints)


def _yolo_line(frame: StoredFrame, label: int, keypoints: bool) -> str:
    """Return the line of a drone, of which only what lies in the picture counts."""
    annotation, size = frame.annotation, np.array([frame.width, frame.height])
    corner = annotation.box[:2].clip(0, size)
    extent = (annotation.box[:2] + annotation.box[2:]).clip(0, size) - corner
    box = (*corner, *extent)
    if not keypoints:
        return label_line(label, box, (frame.width, frame.height))
    points = annotation.keypoints_2d
    inside = ((points >= 0) & (points <= size)).all(axis=1)
    seen = np.ones(4, dtype=bool) if annotation.visible is None else annotation.visible
    visibility = np.where(inside, np.where(seen, SEEN, HIDDEN), UNLABELLED)
    return label_line(label, box, (frame.width, frame.height), points, visibility)


def _write_coco(partial: Path, root: Path, splits: dict[str, FrameDataset]) -> None:
    """Write the COCO file of each split. It is the data set's own, with other names of the pictures."""
    for split, frames in splits.items():
        new_name = {}
        for name, indices in _pictures(frames).items():
            old = frames.stored[indices[0]].image.relative_to(root).as_posix()
            new_name[old] = f"images/{split}/{name}"
        table = coco(root, split, frames.manifest["settings"])
        for image in table["images"]:
            image["file_name"] = new_name[image["file_name"]]
        write_json(partial / f"{split}.json", table)
