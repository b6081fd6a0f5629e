"""Make the folder of `convert`: check the data set, link its pictures, and write what goes beside them."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dronekeypp.convert.labels import Pictures, box_inside, write_coco, write_yolo
from dronekeypp.data import open_dataset, require
from dronekeypp.errors import InputError
from dronekeypp.files import (
    LOCK,
    digest,
    holds_nothing,
    is_unfinished,
    lock_folder,
    make_folder,
    read_json,
    remove_unfinished,
    write_beside,
    write_json,
)
from dronekeypp.frame_dataset import FrameDataset
from dronekeypp.sixdronesyn import folders, scenes
from dronekeypp.sixdronesyn.bop import SCENE_FILES
from dronekeypp.stored import StoredFrame

FORMATS = ("yolo", "coco")
RECORD = "convert.json"
# All that stands in a folder that is being made: its folders, and its files.
FOLDERS = ("images", "labels")
FILES = (RECORD, "data.yaml", *(f"{split}.json" for split in scenes.SPLITS))

LAYOUT = 2  # raised when this module writes something else for the same data set


def convert(
    dataset: str | Path,
    to: str,
    out: str | Path | None = None,
    keypoints: bool = False,
    types: bool = False,
    progress: bool = True,
) -> Path:
    """Write a data set of whole frames for a detector, and return the folder.

    Every drone whose box meets its picture is labelled, and a picture without one is written as well, with an
    empty label. What is left out is printed: drones whose box lies outside, and pictures that scene_gt.json
    does not mention.

    What is there already is left alone. After a kill, the same call goes on; until it has finished, the
    folder is not there.

    Args:
        dataset: 6DroneSyn, or for "yolo" any BOP folder of `dronekeypp.data`.
        to: "yolo" for Ultralytics, "coco" for torchvision and others.
        out: the folder to write to; None: DATASET-yolo or DATASET-coco, beside the data set.
        keypoints: yolo: labels with four keypoints, for its task "pose". A COCO file has them in any case. A
            keypoint in the picture is "seen" where `keypoints_visible` says so or is not there, and "hidden"
            where that says that it is. One outside the picture or unknown is "unlabelled".
        types: one class for each type of drone, and not one class "drone".
        progress: whether to print what was done, and to show a bar in a terminal.

    Raises:
        InputError: the data set holds crops, lacks what the format needs, or cannot be read; a flight lies in
            two splits; `out` holds something else.
    """
    root = Path(dataset)
    _check_arguments(to, keypoints)
    out = Path(out) if out else _beside(root, to)
    splits = _open_splits(root, to, keypoints)
    pictures = {split: _pictures(frames) for split, frames in splits.items()}
    record = {
        "layout": LAYOUT,
        "to": to,
        "keypoints": keypoints,
        "types": types,
        "digests": {split: _digest(frames) for split, frames in splits.items()},
        "frames": {split: len(names) for split, names in pictures.items()},
    }
    counts = ", ".join(f"{count} {split}" for split, count in record["frames"].items())
    if _is_finished(out, record):
        if progress:
            print(f"{out}: already there, {counts} frames")
        return out
    if progress:
        for split, frames in splits.items():
            _tell_left_out(f"{root} {split}", frames)
    partial = out.with_name(f".{out.name}.partial")
    make_folder(partial)
    _check_partial(partial)
    with lock_folder(partial):
        _start(partial, record, pictures)
        _write_pictures(partial, pictures, progress)
        if to == "yolo":
            write_yolo(partial, splits, pictures, keypoints, types)
        else:
            write_coco(partial, root, splits, pictures, types)
    partial.rename(out)
    if progress:
        print(f"{out}: {counts} frames")
    return out


def _check_arguments(to: str, keypoints: bool) -> None:
    """Raise InputError for arguments of `convert` that do not go together."""
    if to not in FORMATS:
        raise InputError(f"--to {to}: choose {' or '.join(FORMATS)}")
    if to == "coco" and keypoints:
        raise InputError("--keypoints is for --to yolo: a COCO file has keypoints in any case")


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
    for frame in (*frames.stored, *frames.outside, *frames.empty):
        name = _picture_name(frame, frames.root / frames.split)
        same = pictures.setdefault(name, [])
        same.append(frame)
        if same[0].image != frame.image:
            raise InputError(
                f"{same[0].image} and {frame.image} would both be called {name}; rename a flight"
            )
    return pictures


def _digest(frames: FrameDataset) -> str | None:
    """Return what tells a split from others, with what `FrameDataset` leaves out of it."""
    facts = [str(frames.digest)]
    for frame in (*frames.outside, *frames.empty):
        facts.append(f"{frame.folder.name} {frame.image.name} {frame.annotation}")
    return frames.digest if len(facts) == 1 else digest("\n".join(facts).encode())


def _tell_left_out(place: str, frames: FrameDataset) -> None:
    """Print how many drones and pictures of a split get no label, if any."""
    drones = sum(box_inside(frame) is None for frame in (*frames.stored, *frames.outside))
    if drones:
        print(f"{place}: {drones} drones left out, whose box is not in the picture")
    if frames.unannotated:
        print(f"{place}: {frames.unannotated} pictures left out, which {SCENE_FILES[1]} does not mention")


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
    old = read_json(out / RECORD, mend="choose another folder with --out")
    for key, value in record.items():
        before = old.get(key) if isinstance(old, dict) else None
        if before != value:
            raise InputError(
                f"{out}: made with other {key} ({before}, now {value}); choose another folder with --out"
            )
    return True


def _check_partial(partial: Path) -> None:
    """Check that the folder of an unfinished conversion holds one, or nothing.

    Raises:
        InputError: it holds something else, which is somebody's and stays.
    """
    if holds_nothing(partial, FILES):
        return
    for path in partial.iterdir():
        ours = path.name in (*FOLDERS, *FILES, LOCK) and not path.is_symlink()
        if not (partial / RECORD).is_file() or not (ours or is_unfinished(path, FILES)):
            raise InputError(f"{path}: not of a conversion; move {partial} away, or choose another --out")


def _start(partial: Path, record: dict[str, Any], pictures: dict[str, Pictures]) -> None:
    """Keep what a killed run of this very conversion has left in a folder, and clear that of another one."""
    path = partial / RECORD
    remove_unfinished(partial, FILES)
    if _holds(path, record):
        for split, names in pictures.items():
            remove_unfinished(partial / "images" / split, names)
            remove_unfinished(partial / "labels" / split, {Path(name).stem + ".txt" for name in names})
        return
    for name in FOLDERS:
        if (partial / name).is_dir():
            shutil.rmtree(partial / name)
    for name in FILES:
        (partial / name).unlink(missing_ok=True)
    write_json(path, record)


def _holds(path: Path, record: dict[str, Any]) -> bool:
    """Tell whether a file is there and holds `record`. One that is torn does not."""
    try:
        return path.is_file() and read_json(path) == record
    except InputError:
        return False


def _write_pictures(partial: Path, pictures: dict[str, Pictures], progress: bool) -> None:
    """Link the pictures of each split into a folder. Each is read once, so a broken one is found here."""
    for split, names in pictures.items():
        folder = partial / "images" / split
        make_folder(folder)
        bar = tqdm(names.items(), split, unit="frame", disable=None if progress else True)
        for name, drones in bar:
            if not (folder / name).exists():
                drones[0].read()
                _link(drones[0].image, folder / name)


def _link(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system does not allow that."""
    try:
        os.link(source.resolve(), target)
    except OSError:
        write_beside(target, source.read_bytes())
