"""This module makes 6DroneSyn on disk, flight by flight from a seed, on any number of workers or shards.

It can be stopped at any frame and started again, see `flight`. Every random draw comes from (seed, scene,
drone, background, frame), so neither the order nor the number of workers changes a pixel.

manifest.json comes first, with the settings and the plan. When the flights are there, `finish` adds what is
on disk. A data set numbers the seven drones 1 to 7. It numbers drones of your own (see `own`) from 8, in the
order in which it met them. The manifest holds that order.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import joblib
import numpy as np
import pyvista as pv
import vtk
from filelock import FileLock
from tqdm import tqdm

from dronekeypp import __version__
from dronekeypp.environments.cache import environment_files
from dronekeypp.errors import InputError
from dronekeypp.files import digest, write_json
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn import quadrotors as random_quadrotors
from dronekeypp.sixdronesyn.coco import coco
from dronekeypp.sixdronesyn.drones import EDITION, EDITIONS, SEVEN
from dronekeypp.sixdronesyn.flight import Flight, annotation_digest, render_flight
from dronekeypp.sixdronesyn.models import write_models
from dronekeypp.sixdronesyn.own import VARIABLE
from dronekeypp.sixdronesyn.render import check_opengl
from dronekeypp.sixdronesyn.targets import write_targets

__all__ = ["Flight", "annotation_digest", "finish", "generate", "totals"]

KINDS = ("crop", "full")  # of frames
# settings that older manifests lack
BEFORE_THERE_WERE_TWO = {"edition": 1, "quadrotors": None, "depth": False, "masks": False}
_DRAWING = ThreadPoolExecutor(1, "drawing")  # of a process that is called from threads


def generate(
    root: str | Path,
    scene_numbers: Sequence[int] | None = None,
    drone_names: Sequence[str] | None = None,
    frames: str = "crop",
    size: int = 128,
    stride: int = 1,
    seed: int = 0,
    environments: str | Path | None = None,
    workers: int = 1,
    shard: tuple[int, int] = (0, 1),
    progress: bool = True,
    edition: int | None = None,
    quadrotors: tuple[int, int] | None = None,
    depth: bool = False,
    masks: bool = False,
) -> dict[str, Any]:
    """Generate 6DroneSyn, or a part of it, in `root` (paper Sec. IV).

    What is already there is kept.

    Args:
        root: output folder.
        scene_numbers, drone_names: which scenes (1 to 13) and drones (keys of `DRONES`); None for all.
        frames: "crop", the square around the drone at `size` pixels, or "full", 1920×1080.
        size: side of a stored crop, pixels.
        stride: keep every stride-th frame of each flight.
        seed: the seed of all random draws.
        environments: folder of equirectangular images; None for the 22 procedural ones.
        workers: the number of processes. The result does not depend on it. Inside
            `joblib.parallel_config("dask")` it is that of the cluster, whose workers share `root`.
        shard: (I, N) renders flights I, I + N, I + 2N, …; run every I from 0 to N − 1, at the same time if
            you like.
        progress: show a progress bar, where stderr is a terminal.
        edition: 1, with which the recorded results were made, or 2, with the right shapes of three drones and
            a lens for every flight. None for 1, or for 2 with `quadrotors`.
        quadrotors: (A, B) flies the random quadrotors A, A + 1, …, B − 1 in place of the seven. Each flies in
            the scenes of its own split, see `quadrotors.split_of`.
        depth, masks: also write depth images and masks (edition 2), see `depth`.

    Returns:
        the manifest, a dictionary (also written as manifest.json).

    Raises:
        InputError: an argument or an environment image is bad, there is no OpenGL library, the folder holds a
            data set with other settings or another drone of the same name, or there are too many drones.
    """
    root = Path(root)
    if edition is None:
        edition = EDITION if quadrotors is None else 2
    _check_arguments(scene_numbers, drone_names, frames, size, stride, seed, workers, shard, edition)
    _check_quadrotors(quadrotors, drone_names, edition)
    if edition == 1 and (depth or masks):
        raise InputError("depth images and masks belong to the second edition; add --edition 2")
    check_opengl()
    files = environment_files(environments, workers=workers, progress=progress)
    settings = {
        "version": __version__,
        "edition": edition,
        "quadrotors": None if quadrotors is None else list(quadrotors),
        "seed": seed,
        "frames": frames,
        "size": size if frames == "crop" else None,
        "stride": stride,
        "depth": depth,
        "masks": masks,
        "environments": "procedural" if environments is None else Path(environments).resolve().name,
        "environment_digests": {Path(file).name: digest(Path(file).read_bytes()) for file in files},
    }
    root.mkdir(parents=True, exist_ok=True)
    with _lock(root):
        plan = _start_manifest(root, settings, scene_numbers, drone_names)
    chosen = plan[shard[0] :: shard[1]]
    threads = 1 if workers > 1 else 2
    # A Dask worker may stand in another folder.
    where, files = root.absolute(), [Path(file).absolute() for file in files]
    jobs = [joblib.delayed(_work)(where, flight, settings, files, stride, threads) for flight in chosen]
    total = sum(len(scenes.frame_numbers(flight, stride)) for flight in chosen)
    with tqdm(total=total, unit="frame", disable=None if progress else True, smoothing=0.05) as bar:
        for flight in joblib.Parallel(n_jobs=workers, return_as="generator_unordered")(jobs):
            bar.update(len(scenes.frame_numbers(flight, stride)))
    return finish(root)


def _check_arguments(
    scene_numbers: Sequence[int] | None,
    drone_names: Sequence[str] | None,
    frames: str,
    size: int,
    stride: int,
    seed: int,
    workers: int,
    shard: tuple[int, int],
    edition: int,
) -> None:
    """Raise InputError for the first argument of `generate` that is not allowed."""
    if edition not in EDITIONS:
        raise InputError(f"edition {edition}: choose 1 or 2")
    if scene_numbers == [] or drone_names == []:
        raise InputError("the list of scenes or drones is empty; leave it out for all of them")
    for number in scene_numbers or ():
        if number not in scenes.SCENES:
            raise InputError(f"scene {number}: there are scenes 1 to {max(scenes.SCENES)}")
    for name in drone_names or ():
        if name not in EDITIONS[edition]:
            raise InputError(f"drone {name!r}: choose from {', '.join(EDITIONS[edition])}")
    if frames not in KINDS:
        raise InputError(f"frames {frames!r}: choose crop or full")
    if not 32 <= size <= 1024:
        raise InputError(f"size {size}: a crop is 32 to 1024 pixels wide")
    if stride < 1 or workers < 1 or seed < 0:
        raise InputError("stride and workers must be at least 1, seed at least 0")
    if not 0 <= shard[0] < shard[1]:
        raise InputError(f"shard {shard[0]}/{shard[1]}: I counts from 0 to N − 1")


def _check_quadrotors(
    quadrotors: tuple[int, int] | None, drone_names: Sequence[str] | None, edition: int
) -> None:
    """Raise InputError where a range of random quadrotors is not allowed."""
    if quadrotors is None:
        return
    first, end = quadrotors
    most = scenes.MOST_DRONES[2]
    if not 0 <= first < end or end - first > most:
        raise InputError(f"quadrotors {first}:{end}: write A:B with 0 ≤ A < B, at most {most} of them")
    if edition == 1:
        raise InputError("random quadrotors fly in the second edition only; leave out --edition 1")
    if drone_names is not None:
        raise InputError("random quadrotors fly in place of the drones; leave out --drones")


def _work(
    root: Path,
    subsequence: scenes.Subsequence,
    settings: dict[str, Any],
    environments: Sequence[str | Path],
    stride: int,
    threads: int,
) -> scenes.Subsequence:
    """Render one flight in a worker, and return it."""
    if threading.current_thread() is not threading.main_thread():
        # A Dask worker has threads of its own; OpenGL wants the same one at all times.
        job = _DRAWING.submit(_render, root, subsequence, settings, environments, stride, threads)
        return job.result()
    return _render(root, subsequence, settings, environments, stride, threads)


def _render(
    root: Path,
    subsequence: scenes.Subsequence,
    settings: dict[str, Any],
    environments: Sequence[str | Path],
    stride: int,
    threads: int,
) -> scenes.Subsequence:
    """Render one flight in this thread, and return it."""
    # Mesa's software rasteriser would take every core in every worker.
    os.environ.setdefault("LP_NUM_THREADS", str(threads))
    cv2.setNumThreads(threads)
    render_flight(root, subsequence, settings, environments, stride)
    return subsequence


# --- the manifest -----------------------------------------------------------------------------------------


def _lock(root: Path) -> FileLock:
    """Return the lock of the files that describe the whole data set.

    One process at a time reads, changes and writes them. Shards may run side by side.
    """
    return FileLock(root / ".lock")


def _start_manifest(
    root: Path,
    settings: dict[str, Any],
    scene_numbers: Sequence[int] | None,
    drone_names: Sequence[str] | None,
) -> list[scenes.Subsequence]:
    """Write the plan before the first frame, and return it.

    Raises:
        InputError: the folder holds a data set with other settings, or something else.
    """
    path = root / "manifest.json"
    old: dict[str, Any] = {"settings": {}, "versions": [], "planned": {}}
    if path.exists():
        old = bop.read_json(path)
        if not isinstance(old, dict) or not {"settings", "versions", "planned"} <= old.keys():
            raise InputError(f"{path}: not the manifest of a data set; choose another folder")
        for key, value in settings.items():
            _check_same(path, key, old["settings"].get(key, BEFORE_THERE_WERE_TWO.get(key)), value)
    elif any(not item.name.startswith(".") for item in root.iterdir()):
        raise InputError(
            f"{root}: the folder is not empty and holds no manifest.json; choose an empty or new folder"
        )
    if settings["quadrotors"]:
        plan = scenes.quadrotor_flights(range(*settings["quadrotors"]), scene_numbers)
        if not plan:
            raise InputError(
                "no flight: of ten quadrotors 0 to 7 fly in training scenes, 8 in validation scenes and 9 in "
                "test scenes; choose other numbers or scenes"
            )
    else:
        edition = settings["edition"]
        own = _own_drones(path, old["settings"].get("own_drones", {}), drone_names, edition)
        if own:
            settings = {**settings, "own_drones": own}
        numbers = {name: len(SEVEN) + place for place, name in enumerate(own)}
        plan = scenes.subsequences(scene_numbers, drone_names, numbers, edition)
    planned = dict(old["planned"])
    for subsequence in plan:
        planned[f"{subsequence.id:06d}"] = len(scenes.frame_numbers(subsequence, settings["stride"]))
    versions = list(old["versions"])  # a resumed data set may have been rendered by several
    if _versions() not in versions:
        versions.append(_versions())
    manifest = {
        "name": "6DroneSyn",
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
    path: Path, old: dict[str, str], drone_names: Sequence[str] | None, edition: int
) -> dict[str, str]:
    """Return name and digest of each drone of your own in a data set, in the order of their numbers.

    Those that it holds (`old`) keep their places; new ones come behind them.

    Raises:
        InputError: the data set holds another drone of that name, or would hold too many.
    """
    own = dict(old)
    for drone in EDITIONS[edition].values():
        if drone.digest is None:  # one of the seven
            continue
        if own.get(drone.name, drone.digest) != drone.digest:
            raise InputError(
                f"{path}: this folder was made with another drone {drone.name}: set {VARIABLE} to the folder "
                "it was made with, or choose another folder"
            )
        if drone_names is None or drone.name in drone_names:
            own[drone.name] = drone.digest
    most = scenes.MOST_DRONES[edition]
    if len(SEVEN) + len(own) > most:
        raise InputError(
            f"{len(own)} drones of your own: a data set holds {most - len(SEVEN)} beside the seven; "
            "choose some with --drones"
        )
    return own


def _versions() -> dict[str, str]:
    """Return the versions of what the pictures may depend on."""
    return {
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
    with _lock(root):
        return _finish(root)


def _finish(root: Path) -> dict[str, Any]:
    """Do the work of `finish` while it holds the folder."""
    manifest = bop.read_json(root / "manifest.json")
    flights = {}
    for split in scenes.SPLITS:
        for folder in bop.flight_folders(root, split):
            digests = bop.read_json(folder / "flight.json")["digests"]
            flights[folder.name] = {"split": split, "digests": digests}
    manifest.update(totals(manifest["planned"], flights))
    manifest["flights"] = dict(sorted(flights.items()))
    settings = {**BEFORE_THERE_WERE_TWO, **manifest["settings"]}
    names = (*SEVEN, *settings.get("own_drones", {}))
    if settings["quadrotors"]:
        names = tuple(random_quadrotors.name_of(number) for number in range(*settings["quadrotors"]))
    write_models(root, names, settings["edition"])
    for split in scenes.SPLITS:
        if manifest["frames"][split]:
            write_json(root / f"coco_{split}.json", coco(root, split, settings))
    if settings["edition"] != 1:
        write_targets(root, flights, settings["edition"])
    write_json(root / "manifest.json", manifest)
    partial = root / ".partial"
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
