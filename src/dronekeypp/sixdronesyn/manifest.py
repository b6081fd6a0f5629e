"""This module writes the manifest of a data set, and the other files that describe all of it.

manifest.json comes first, with the settings and the plan. When the flights are there, `finish` adds what is
on disk. A data set numbers the seven drones 1 to 7. It numbers drones of your own (see `own`) from 8, in the
order in which it met them. The manifest holds that order. Random quadrotors are numbered from 1.
"""

from __future__ import annotations

import contextlib
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyvista as pv
import vtk
from filelock import FileLock

from dronekeypp import __version__
from dronekeypp.errors import InputError
from dronekeypp.files import LOCK, digest, lock_file, remove_unfinished, write_json
from dronekeypp.sixdronesyn import bop, depth_files, scenes
from dronekeypp.sixdronesyn.coco import coco
from dronekeypp.sixdronesyn.drawn import PARTIAL, check_panoramas, drawn_flights, flights_of, forget_model
from dronekeypp.sixdronesyn.drones import EDITIONS, SEVEN
from dronekeypp.sixdronesyn.flight_file import annotation_digest, read_flight_file
from dronekeypp.sixdronesyn.folders import check_flight, drone_names, read_manifest
from dronekeypp.sixdronesyn.manifest_check import NAME, OLDER
from dronekeypp.sixdronesyn.models import write_models
from dronekeypp.sixdronesyn.own import VARIABLE
from dronekeypp.sixdronesyn.targets import NAME as TARGETS
from dronekeypp.sixdronesyn.targets import write_targets


def lock(root: Path) -> FileLock:
    """Return the lock of the files that describe the whole data set.

    One process at a time reads, changes and writes them. Shards may run side by side.
    """
    return FileLock(root / LOCK)


def check_root(root: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Check that a data set with these settings can be begun in a folder, or go on there.

    Nothing is written. Panoramas and drones of your own are not compared; `start_manifest` does that.

    Returns:
        the manifest that is there, or {}.

    Raises:
        InputError: it is a file, or holds a data set with other settings, or something else.
    """
    if root.exists() and not root.is_dir():
        raise InputError(f"{root} is a file, not a folder")
    path = root / "manifest.json"
    if not path.exists():
        # Hidden files are those of a run that was killed before it wrote a manifest, or of the system.
        if root.exists() and any(not item.name.startswith(".") for item in root.iterdir()):
            raise InputError(
                f"{root}: the folder is not empty and holds no manifest.json; choose an empty or new folder"
            )
        return {}
    old = read_manifest(root)
    if not old:
        raise InputError(f"{path}: not the manifest of a data set; choose another folder")
    before = {**OLDER, **old["settings"]}
    for key, value in settings.items():
        if key not in ("version", "environment_digests"):
            _check_same(path, key, before[key], value)
    return old


def drawing(root: Path, subsequence: scenes.Subsequence) -> contextlib.AbstractContextManager[None]:
    """Hold a flight while it is drawn.

    Shards draw side by side, each its own flights. The same command given twice would write the same files.

    Raises:
        InputError: another process draws the flight.
    """
    name = f"{subsequence.id:06d}"
    message = f"{root}: another process is drawing flight {name}: let it finish, or use --shard"
    return lock_file(root / f".{name}.lock", message)


def start_manifest(
    root: Path,
    settings: dict[str, Any],
    scene_numbers: Sequence[int] | None,
    drone_names: Sequence[str] | None,
) -> list[scenes.Subsequence]:
    """Write the plan before the first frame, and return it.

    A data set that an earlier version of the package began is resumed: what it holds follows from its edition
    and its other settings. Its setting `version` stays that of the beginning.

    Raises:
        InputError: the folder holds a data set with other settings, or something else.
    """
    path = root / "manifest.json"
    remove_unfinished(root, (path.name, *(f"coco_{split}.json" for split in scenes.SPLITS), TARGETS))
    old = check_root(root, settings) or {"settings": {}, "versions": [], "planned": {}}
    flights: dict[Path, scenes.Subsequence] = {}
    if old["settings"]:
        before = {**OLDER, **old["settings"]}
        settings = {**settings, "version": before["version"]}
        flights = drawn_flights(root, before)
        digests = settings["environment_digests"]
        check_panoramas(path, before["environment_digests"], digests, flights, settings["seed"])
    if settings["quadrotors"]:
        plan = scenes.quadrotor_flights(range(*settings["quadrotors"]), scene_numbers)
        if not plan:
            raise InputError(
                "no flight: quadrotors whose number ends in 0 to 7 fly in training scenes, in 8 in "
                "validation scenes, in 9 in test scenes; choose other numbers or scenes"
            )
    else:
        edition = settings["edition"]
        own = _own_drones(path, old["settings"].get("own_drones", {}), drone_names, edition, flights)
        if own:
            settings = {**settings, "own_drones": own}
        numbers = {name: len(SEVEN) + place for place, name in enumerate(own)}
        plan = scenes.subsequences(scene_numbers, drone_names, numbers, edition)
    planned = dict(old["planned"])
    for subsequence in plan:
        planned[f"{subsequence.id:06d}"] = len(scenes.frame_numbers(subsequence, settings["stride"]))
    versions = list(old.get("versions", []))  # a resumed data set may have been rendered by several
    if _versions() not in versions:
        versions.append(_versions())
    manifest = {
        "name": NAME,
        "settings": settings,
        "versions": versions,
        "planned": dict(sorted(planned.items())),
    }
    write_json(path, manifest, indent=1)
    return plan


def _check_same(path: Path, key: str, old: Any, new: Any) -> None:
    """Raise InputError if a setting of the data set differs from the one asked for now."""
    if old != new:
        raise InputError(
            f"{path}: this folder holds a data set with another {key} ({_short(old)}, now {_short(new)}); "
            "choose another folder or repeat its settings"
        )


def _short(value: Any) -> str:
    """Return a setting for a message: its JSON, or the digest of a long one."""
    text = json.dumps(value)
    return text if len(text) < 60 else f"digest {digest(text.encode())}"


def _own_drones(
    path: Path,
    old: dict[str, str],
    drone_names: Sequence[str] | None,
    edition: int,
    flights: Mapping[Path, scenes.Subsequence],
) -> dict[str, str]:
    """Return name and digest of each drone of your own in a data set, in the order of their numbers.

    Those that it holds (`old`) keep their places; new ones come behind them. One that has not flown yet may
    have changed.

    Raises:
        InputError: another drone of that name has flown in the data set, or it would hold too many.
    """
    own = dict(old)
    changed = []
    for drone in EDITIONS[edition].values():
        if drone.digest is None:  # one of the seven
            continue
        if own.get(drone.name, drone.digest) != drone.digest:
            flown = flights_of(drone.name, flights)
            if flown:
                raise InputError(
                    f"{path}: this folder was made with another drone {drone.name}: set {VARIABLE} to the "
                    f"folder it was made with, or delete {flown} and run generate again"
                )
            changed.append(drone.name)
            own[drone.name] = drone.digest
        if drone_names is None or drone.name in drone_names:
            own[drone.name] = drone.digest
    most = scenes.MOST_DRONES[edition]
    if len(SEVEN) + len(own) > most:
        raise InputError(
            f"{len(own)} drones of your own: a data set holds {most - len(SEVEN)} beside the seven; "
            "choose some with --drones"
        )
    for name in changed:
        forget_model(path.parent, len(SEVEN) + 1 + list(own).index(name))
    return own


def _versions() -> dict[str, str]:
    """Return the versions of what the pictures may depend on."""
    return {
        "dronekeypp": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "pyvista": pv.__version__,
        "vtk": vtk.vtkVersion.GetVTKVersion(),
        "platform": sys.platform,
    }


def finish(root: str | Path) -> dict[str, Any]:
    """Bring manifest.json, models, targets and COCO files up to what is on disk, and return the manifest.

    Every shard does so at its end; the last one leaves them complete.
    """
    root = Path(root)
    with lock(root):
        return _finish(root)


def _finish(root: Path) -> dict[str, Any]:
    """Do the work of `finish` while it holds the folder."""
    manifest = read_manifest(root)
    settings = {**OLDER, **manifest["settings"]}
    images = 1 + len(depth_files.paths(root, 0, settings))
    flights = {}
    for split in scenes.SPLITS:
        for folder in bop.flight_folders(root, split):
            about = read_flight_file(folder, images)
            check_flight(folder, about, manifest)
            flights[folder.name] = {"split": split, "digests": about["digests"]}
    manifest.update(totals(manifest["planned"], flights))
    manifest["flights"] = dict(sorted(flights.items()))
    write_models(root, drone_names(settings), settings["edition"])
    for split in scenes.SPLITS:
        if manifest["frames"][split]:
            write_json(root / f"coco_{split}.json", coco(root, split, settings))
    if settings["edition"] != 1:
        write_targets(root, flights, settings["edition"])
    write_json(root / "manifest.json", manifest)
    partial = root / PARTIAL
    if partial.exists() and not any(partial.iterdir()):
        partial.rmdir()
    return manifest


def totals(planned: dict[str, int], flights: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return what the manifest says of the whole data set.

    Args:
        planned: {flight: number of frames}.
        flights: {flight: {"split": …, "digests": {frame: [image, annotation, *others]}}}, where `others` are
            those of the depth image and the masks.

    Returns:
        `planned_frames`, `frames` of each split on disk, and two digests over all frames: `digest` of what is
        drawn, which may differ between renderers, and `annotation_digest`, which never does.
    """
    counts = dict.fromkeys(scenes.SPLITS, 0)
    images, annotations = [], []
    for name, flight in sorted(flights.items()):
        counts[flight["split"]] += len(flight["digests"])
        for number, (image, annotation, *others) in flight["digests"].items():
            images.append([name, number, image, *others])
            annotations.append([name, number, annotation])
    return {
        "planned_frames": sum(planned.values()),
        "frames": counts,
        "digest": annotation_digest(images),
        "annotation_digest": annotation_digest(annotations),
    }
