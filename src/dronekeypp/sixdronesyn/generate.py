"""This module makes 6DroneSyn on disk, flight by flight from a seed, on any number of workers or shards.

It can be stopped at any frame and started again, see `flight`. Every random draw comes from (seed, scene,
drone, background, frame), so neither the order nor the number of workers changes a pixel.

The manifest comes first, with the settings and the plan. When the flights are there, `finish` adds what is on
disk. See `manifest`.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import joblib
from tqdm import tqdm

from dronekeypp import __version__
from dronekeypp.environments.cache import environment_files
from dronekeypp.errors import InputError
from dronekeypp.files import digest
from dronekeypp.processes import end_with_parent, total_memory
from dronekeypp.sixdronesyn import scenes
from dronekeypp.sixdronesyn.drones import EDITION, EDITIONS
from dronekeypp.sixdronesyn.flight import Flight, render_flight
from dronekeypp.sixdronesyn.flight_file import annotation_digest
from dronekeypp.sixdronesyn.manifest import check_root, drawing, finish, lock, start_manifest
from dronekeypp.sixdronesyn.manifest_check import KINDS
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.panorama import check_size, load_panorama
from dronekeypp.sixdronesyn.render import check_opengl

__all__ = ["Flight", "annotation_digest", "finish", "generate"]

WORKER = 0.2e9  # bytes that a rendering process takes at least
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
            data set with other settings or another drone of the same name, there are too many drones, or
            another process draws one of the flights.
    """
    root = Path(root)
    if edition is None:
        edition = EDITION if quadrotors is None else 2
    _check_arguments(scene_numbers, drone_names, frames, size, stride, seed, workers, shard, edition)
    _check_quadrotors(quadrotors, drone_names, edition)
    if edition == 1 and (depth or masks):
        raise InputError("depth images and masks belong to the second edition; add --edition 2")
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
    }
    begun = check_root(root, settings).get("settings", {})
    if environments is not None:
        environment_files(environments)  # before the time that all other checks take
    check_opengl()
    _check_meshes(drone_names, edition, begun.get("own_drones", {}))
    files = environment_files(environments, workers=workers, progress=progress)
    settings["environment_digests"] = _check_panoramas(files, begun.get("environment_digests", {}))
    root.mkdir(parents=True, exist_ok=True)
    with lock(root):
        plan = start_manifest(root, settings, scene_numbers, drone_names)
    chosen = plan[shard[0] :: shard[1]]
    threads = 1 if workers > 1 else 2
    # A Dask worker may stand in another folder.
    where, files = root.absolute(), [Path(file).absolute() for file in files]
    jobs = [joblib.delayed(_work)(where, flight, settings, files, stride, threads) for flight in chosen]
    total = sum(len(scenes.frame_numbers(flight, stride)) for flight in chosen)
    # A cluster's workers are nobody's children, and take no initializer.
    pool = joblib.Parallel(workers, return_as="generator_unordered", initializer=end_with_parent)
    with tqdm(total=total, unit="frame", disable=None if progress else True, smoothing=0.05) as bar:
        for flight in pool(jobs):
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
    memory = total_memory()
    if memory is not None and workers * WORKER > memory:
        raise InputError(
            f"workers {workers}: each takes {WORKER / 1e9} GB, and there are {memory / 1e9:.0f} GB"
        )
    if not 0 <= shard[0] < shard[1]:
        raise InputError(f"shard {shard[0]}/{shard[1]}: I counts from 0 to N − 1")


def _check_meshes(drone_names: Sequence[str] | None, edition: int, begun: Mapping[str, str]) -> None:
    """Read the meshes of the drones of your own that will fly, but for those that the data set `begun` with.

    Raises:
        InputError: one cannot be used. The message names its file.
    """
    for drone in EDITIONS[edition].values():
        flies = drone_names is None or drone.name in drone_names
        if drone.mesh is not None and flies and begun.get(drone.name) != drone.digest:
            drone_mesh(drone)


def _check_panoramas(files: Sequence[Path], begun: Mapping[str, str]) -> dict[str, str]:
    """Return {name: digest} of the panoramas. Those that the data set did not begin with are decoded.

    Raises:
        InputError: one cannot be used. The message names its file.
    """
    digests = {}
    for file in files:
        check_size(file)
        digests[file.name] = digest(file.read_bytes())
        if begun.get(file.name) != digests[file.name]:
            load_panorama(file)
    return digests


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
    with drawing(root, subsequence):
        render_flight(root, subsequence, settings, environments, stride)
    return subsequence
