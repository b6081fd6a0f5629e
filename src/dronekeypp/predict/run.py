"""Make the run itself: read the inputs, ask the network batch by batch, and write what it answers."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from dronekeypp.checkpoint import weights_file
from dronekeypp.classes import names_of
from dronekeypp.errors import InputError
from dronekeypp.files import append_to, digest, lock_folder, write_beside, write_json
from dronekeypp.footage import (
    Footage,
    Tracker,
    check_box,
    fit_to_frames,
    open_footage,
    read_boxes,
    read_cameras,
)
from dronekeypp.predict.batches import load_network, predicted
from dronekeypp.predict.journal import (
    COLUMNS,
    JOURNAL,
    POSES,
    TRAJECTORY,
    Pose,
    Row,
    begin,
    bop_results,
    check_folder,
    read_journal,
    to_pose,
)
from dronekeypp.predict.overlay import draw_trajectory, write_overlay
from dronekeypp.predict.summary import box_report, check_json_file, closing_line, summary
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.results import object_numbers


def predict(
    checkpoint: str | Path,
    footage: str | Path,
    camera: str | Path,
    out: str | Path,
    boxes: str | Path | None = None,
    box: tuple[float, float, float, float] | None = None,
    smooth: float = 0.0,
    overlay: bool = True,
    progress: bool = True,
    rate: float | None = None,
    kinds: Sequence[str] = (),
    tracks: Sequence[str] = (),
    count_from: int | None = None,
    json_file: str | Path | None = None,
) -> list[Pose]:
    """Find the pose of the drone in every frame that has a box.

    The docstring of the package says what is written to `out`.

    Args:
        checkpoint: a folder of `save_pretrained`, a run folder, of which best/ is taken, or an ONNX file of
            `export`.
        footage: a video, a folder of images, or one image.
        camera: see `footage.read_cameras`.
        out: the folder to write to. A run that was begun in it goes on.
        boxes: see `footage.read_boxes`.
        box: (x, y, w, h) in the first frame, carried on by a tracker, where there are no `boxes`.
        smooth: sigma of a Gaussian over the poses, seconds (at least 0.001); 0 leaves them as they are.
        overlay: whether to draw the poses on the footage.
        progress: whether to print what was read of the camera and what was done, and to show a bar in a
            terminal.
        rate: frames a second, where the footage does not know better: of images (30 without), or of a video
            whose own times are wrong.
        kinds, tracks, count_from: which boxes of the file are meant, see `footage.read_boxes`.
        json_file: a file to write the numbers of the closing line to; None for no file.

    Raises:
        InputError: An input cannot be read, or `out` was begun with other inputs. A broken frame is no
            error: it gets a row that says so.
    """
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise InputError(f"--rate {rate}: frames a second, above 0")
    if not (smooth == 0 or (np.isfinite(smooth) and smooth >= 1e-3)):
        raise InputError(f"--smooth {smooth}: seconds, at least 0.001, or 0 for none")
    if boxes is None and (kinds or tracks or count_from is not None):
        raise InputError("--class, --track and --count-from choose among the boxes of --boxes FILE; give it")
    out = Path(out)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file, not a folder")
    if json_file:
        check_json_file(Path(json_file), out)  # before the work, not after it
    source = open_footage(footage)
    calibrations = read_cameras(camera, source)
    if rate is not None:
        source = replace(source, rate=rate, times=None)
    if (boxes is None) == (box is None):
        raise InputError("give either --boxes FILE or --box x,y,w,h of the drone in the first frame")
    network = load_network(checkpoint)
    settings = {
        "checkpoint": digest(weights_file(checkpoint).read_bytes()),
        "camera": digest(Path(camera).read_bytes()),
        "footage": [str(source.path.resolve()), len(source.names), source.digest()],
        "drones": {drone.name: drone.digest for drone in network.drones},
    }
    scene = source.bop_scene
    objects = bop.read_models(scene.root) if scene else {}
    names = names_of(network.drones)
    numbers = dict(zip(names, object_numbers(network.drones, objects), strict=True))
    width, height = _frame_size(source)
    calibrations = fit_to_frames(calibrations, width, height)
    if progress:
        print(calibrations[0].description)
        if source.times is not None:
            print(f"{source.path.name}: unevenly timed, {source.rate:.6g} frames a second on the average")
    given, first_box = None, None
    if boxes is not None:
        given = read_boxes(boxes, source.names, width, height, source.folder, kinds, tracks, count_from)
    else:
        first_box = check_box(box, width, height, "--box")
    settings["boxes"] = given.digest() if given is not None else first_box.tolist()
    out.mkdir(parents=True, exist_ok=True)
    check_folder(out)
    with lock_folder(out):
        start = begin(out, settings, network.drones)
        tracker = None
        if first_box is not None and start < len(source.names):
            tracker = tracker_after(source, first_box, start, (width, height))
        hidden = None if progress else True  # None: shown in a terminal only
        frames = tqdm(
            source.read(start), "predict", len(source.names), initial=start, disable=hidden, leave=False
        )
        batches = predicted(network, calibrations, (width, height), frames, given, tracker)
        append_to_journal(out / JOURNAL, batches, source.names)
        rows = read_journal(out / JOURNAL, names)
        poses = _poses(rows, source, out / JOURNAL)
        if smooth > 0:
            poses = smoothed(poses, smooth, source.frame_times())
        write_beside(out / POSES, bop_results(poses, numbers, scene).encode())
        with ThreadPoolExecutor(1) as thread:
            trajectory = thread.submit(lambda: write_beside(out / TRAJECTORY, draw_trajectory(poses)))
            if overlay:
                pose_of = {pose.frame: pose for pose in poses}
                write_overlay(out, source, calibrations, pose_of, network.drones)
        trajectory.result()  # raises what the thread raised
    report = box_report(rows, given, source.names[0])
    if json_file:
        write_json(Path(json_file), summary(rows, report), indent=1)
    if progress:
        print(closing_line(out, rows, report))
    return poses


def _frame_size(source: Footage) -> tuple[int, int]:
    """Return width and height of the first frame that can be read.

    Raises:
        InputError: There is no such frame.
    """
    for _, image in source.read():
        if image is not None:
            return image.shape[1], image.shape[0]
    raise InputError(f"{source.path}: not one frame can be read")


def tracker_after(source: Footage, box: np.ndarray, frames: int, size: tuple[int, int]) -> Tracker:
    """Return a tracker from the first frame's box, led through the `frames` that are done.

    So after a kill it is where it was. `size` is the frames' width and height.
    """
    tracker = Tracker(box)
    if frames == 0:
        return tracker
    for number, image in source.read():
        if number == frames:
            break
        if image is not None and image.shape[1::-1] == size:
            tracker.follow(image)
    return tracker


def append_to_journal(path: Path, batches: Iterable[list[Row]], names: Sequence[str]) -> None:
    """Write the rows of each batch as soon as they come.

    `names` are those of all frames.
    """
    with append_to(path) as file:
        journal = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        for rows in batches:
            for row in rows:
                journal.writerow({**row, "name": names[int(row["frame"])]})
            file.flush()


def _poses(rows: list[Row], source: Footage, journal: Path) -> list[Pose]:
    """Return the poses of a finished journal.

    Raises:
        InputError: The journal is not finished or has no pose.
    """
    if len(rows) != len(source.names):
        raise InputError(f"{journal} holds {len(rows)} of {len(source.names)} frames; run again")
    poses = []
    for row in rows:
        pose = to_pose(row)
        if pose is not None:
            poses.append(pose)
    if not poses:
        raise InputError(f"no frame of {source.path} has a pose; {journal} says why: {rows[0]['status']}")
    return poses


def smoothed(poses: Sequence[Pose], sigma: float, frame_times: np.ndarray) -> list[Pose]:
    """Smooth the poses by `sequences.gaussian`.

    A frame counts as much as the network trusts it. Its trust follows from the deviations that it claims, or,
    where it claims none, from its mirror doubt.

    Args:
        poses: the poses of the frames.
        sigma: the sigma of the Gaussian, seconds.
        frame_times: (F,) when each frame of the footage was taken, seconds.
    """
    from dronekeypp.sequences import gaussian  # scipy takes a fifth of a second, and few runs smooth

    claims = np.array([(pose.turn_sigma_deg, pose.shift_sigma_m) for pose in poses])  # (F, 2)
    if np.isfinite(claims).all():
        weights = 1 / np.square(claims)
    else:
        # In boxes: a near drone is large, not doubtful.
        doubt = np.array([pose.doubt_px / max(pose.box[2:]) for pose in poses])  # (F,)
        weights = 1 / (1 + np.square(doubt / max(np.median(doubt), 1e-6)))
    R = np.stack([pose.R for pose in poses])
    t = np.stack([pose.t for pose in poses])
    times = frame_times[[pose.frame for pose in poses]]
    R, t = gaussian(R, t, times, sigma, weights)
    return [replace(pose, R=R[i], t=t[i]) for i, pose in enumerate(poses)]
