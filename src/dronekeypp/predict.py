"""`python -m dronekeypp predict`: poses of a drone in your own footage.

OUT holds
    frames.csv      the journal, a row a frame, written as it goes; a killed run goes on after its last row
    poses.csv       the poses in BOP's results format (scene_id, im_id, obj_id, score, R, t, time; millimetres there and only there); im_id counts
                    the frames of the footage from 0, whatever their files are called
    overlay.mp4     box, propellers, body axes, the drone's name and its distance, drawn on the footage (of one image: overlay.png)
    trajectory.png  the path in space
With `smooth`, poses.csv, overlay and trajectory hold the smoothed poses; the journal always holds the single frames'.
"""

from __future__ import annotations

import csv
import io
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
import torch
from tqdm import tqdm

from dronekeypp import plots
from dronekeypp.camera import clamp_square, crop_image, mirror_keypoints, project, square_around
from dronekeypp.errors import InputError
from dronekeypp.export import OnnxNetwork, load_checkpoint
from dronekeypp.files import digest, lock_folder, read_json, write_beside
from dronekeypp.footage import Calibration, Footage, Tracker, check_box, open_footage, read_boxes, read_camera
from dronekeypp.model import DroneKeyPP
from dronekeypp.sequences import gaussian
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.own import VARIABLE

JOURNAL, POSES, SETTINGS, TRAJECTORY, PICTURE = (
    "frames.csv",
    "poses.csv",
    "settings.json",
    "trajectory.png",
    "overlay.png",
)
COLUMNS = (
    "frame", "name", "status", "box_x", "box_y", "box_w", "box_h", "drone", "score", "doubt_px",
    *(f"kp{k}_{axis}" for k in range(4) for axis in "xy"), *(f"R{i}{j}" for i in range(3) for j in range(3)), "tx", "ty", "tz", "seconds",
    "turn_sigma_deg", "shift_sigma_m",
)  # fmt: skip
GOOD = "ok"  # the status of a frame with a pose; any other says why there is none
BATCH = 16


@dataclass(frozen=True)
class Pose:
    """What was found in one frame, in full-frame pixels and metres: the undistorted frame's, but for the box, which is the one that was given.

    score: the class's probability. doubt_px: by how much the keypoints move when the crop is shown in a mirror (see `mirror_doubt`). turn_sigma_deg,
    shift_sigma_m: the deviations that a network with pose="geometric" claims for R and t (root of the trace); of any other NaN.
    """

    frame: int
    box: np.ndarray
    drone: str
    score: float
    doubt_px: float
    keypoints: np.ndarray
    R: np.ndarray
    t: np.ndarray
    seconds: float
    turn_sigma_deg: float
    shift_sigma_m: float


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
    rate: float = 30.0,
) -> list[Pose]:
    """Poses of the drone in every frame that has a box; see the module for what is written to `out`.

    Args:
        checkpoint: folder of `save_pretrained`, a run folder, of which best/ is taken, or an ONNX file of `export`.
        footage: a video, a folder of images, one image. camera: see `footage.read_camera`. boxes: see `footage.read_boxes`.
        box: (x, y, w, h) in the first frame, carried on by a tracker, where there are no `boxes`.
        smooth: sigma of a Gaussian over the poses, seconds (at least 0.001); 0 leaves them as they are.
        rate: frames a second of a folder of images; a video knows its own.

    Raises:
        InputError: an input that cannot be read, or `out` was begun with other inputs. A broken frame is no error: it gets a row that says so.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise InputError(f"--rate {rate}: frames a second, above 0")
    if not (smooth == 0 or (np.isfinite(smooth) and smooth >= 1e-3)):
        raise InputError(f"--smooth {smooth}: seconds, at least 0.001, or 0 for none")
    source, calibration = open_footage(footage), read_camera(camera)
    rate = source.rate or rate
    if (boxes is None) == (box is None):
        raise InputError("give either --boxes FILE or --box x,y,w,h of the drone in the first frame")
    network, weights = load_checkpoint(checkpoint)
    if network.config.classes > len(DRONES):
        raise InputError(
            f"{checkpoint} knows {network.config.classes} drones, here are {len(DRONES)}: set {VARIABLE} to the folder with yours"
        )
    if isinstance(network, DroneKeyPP):
        network.to("cuda" if torch.cuda.is_available() else "cpu")
    out = Path(out)
    settings = {
        "checkpoint": digest(weights.read_bytes()), "camera": digest(Path(camera).read_bytes()),
        "footage": [str(source.path.resolve()), len(source.names), source.digest()],
        "boxes": boxes_digest(boxes) if boxes is not None else [float(v) for v in box],
        "own_drones": {name: drone.digest for name, drone in DRONES.items() if drone.digest},
    }  # fmt: skip
    first = next((image for _, image in source.read() if image is not None), None)
    if first is None:
        raise InputError(f"{source.path}: not one frame can be read")
    height, width = first.shape[:2]
    calibration = calibration.for_frames(width, height)
    given = read_boxes(boxes, source.names, width, height, source.folder) if boxes is not None else None
    box = check_box(box, width, height, "--box") if box is not None else None
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file, not a folder")
    out.mkdir(parents=True, exist_ok=True)
    check_ours(out)
    with lock_folder(out):
        done = begin(out, settings)
        with open(out / JOURNAL, "a", newline="", encoding="utf-8", errors="surrogateescape") as file:
            journal = csv.writer(file, lineterminator="\n")
            if file.tell() == 0:
                journal.writerow(COLUMNS)
            hidden, start = not (progress and sys.stderr.isatty()), len(done)
            carried = (
                None
                if given is not None or start == len(source.names)
                else carry(source, box, start, (width, height))
            )
            steps = tqdm(
                source.read(start), "predict", len(source.names), initial=start, disable=hidden, leave=False
            )
            for rows in predicted(network, calibration, (width, height), steps, given, carried):
                journal.writerows([number, source.names[number], *rest] for number, *rest in rows)
                file.flush()
        rows = read_journal(out / JOURNAL)
        if len(rows) != len(source.names):
            raise InputError(f"{out / JOURNAL} holds {len(rows)} of {len(source.names)} frames; run again")
        poses = [pose for pose in map(to_pose, rows) if pose]
        if not poses:
            raise InputError(
                f"no frame of {source.path} has a pose; {out / JOURNAL} says why: {rows[0]['status']}"
            )
        if smooth > 0:
            poses = smoothed(poses, smooth, rate)
        write_beside(out / POSES, bop_results(poses).encode())
        write_beside(out / TRAJECTORY, draw_trajectory(poses))
        if overlay:
            write_overlay(out, source, calibration, {pose.frame: pose for pose in poses}, rate)
    skipped = [row for row in rows if row["status"] != GOOD]
    if progress:
        print(
            f"{out}: {len(poses)} poses of {len(rows)} frames"
            + (f"; {len(skipped)} without one, see {JOURNAL}" if skipped else "")
        )
    return poses


def boxes_digest(path: str | Path) -> str:
    """Of a file, or of every .txt in a folder. Raises InputError if there is none."""
    path = Path(path)
    files = sorted(path.glob("*.txt")) if path.is_dir() else [path]
    if not all(file.is_file() for file in files):
        raise InputError(f"{path}: boxes not found")
    return digest(b"".join(file.name.encode() + file.read_bytes() for file in files))


def check_ours(out: Path) -> dict[str, Any]:
    """The settings of the run in the folder `out`, {} of an empty one. Raises InputError for any other: it is not ours to write to."""
    old = read_json(out / SETTINGS, mend="choose another folder") if (out / SETTINGS).is_file() else {}
    there = [
        path.name
        for path in out.iterdir()
        if not (path.name == ".lock" or path.name.endswith((".tmp", ".tmp.mp4")))
    ]
    if there and not (isinstance(old, dict) and {"checkpoint", "footage"} <= old.keys()):
        raise InputError(f"{out} is not empty and not a run of predict: choose another folder")
    return old


def begin(out: Path, settings: dict[str, Any]) -> list[dict[str, str]]:
    """Take up what is in `out`, or begin: the journal's whole rows, anything half written cut off."""
    old = check_ours(out)
    for name in (SETTINGS, JOURNAL, POSES, TRAJECTORY, PICTURE):  # a kill while writing leaves one behind
        for left in out.glob(f".{name}.*.tmp"):
            left.unlink()
    rows = read_journal(out / JOURNAL) if (out / JOURNAL).is_file() else []
    for name, value in settings.items():
        if rows and old.get(name) != value:
            raise InputError(f"{out} was begun with another {name}; choose another folder, or remove it")
    write_beside(out / SETTINGS, (json.dumps(settings, indent=1) + "\n").encode())
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_beside(out / JOURNAL, text.getvalue().encode(errors="surrogateescape"))
    return rows


def read_journal(path: Path) -> list[dict[str, str]]:
    """The rows of a journal as far as they are whole, in order and can be read.

    Raises:
        InputError: another file of that name.
    """
    with open(path, newline="", encoding="utf-8", errors="surrogateescape") as file:
        text = file.read()
    table = csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1]))
    if tuple(table.fieldnames or COLUMNS) != COLUMNS:
        raise InputError(f"{path} is not a journal of predict: choose another folder")
    whole = []
    try:
        for number, row in enumerate(table):
            if None in row.values() or None in row or row["frame"] != str(number):
                break
            pose = to_pose(row)
            if pose and pose.drone not in DRONES:
                break
            whole.append(row)
    except (ValueError, csv.Error):
        pass  # what cannot be read is done again
    return whole


def carry(source: Footage, box: np.ndarray, done: int, size: tuple[int, int]) -> Tracker:
    """A tracker from the first frame's box, led through the frames that are done: after a kill it is where it was."""
    tracker = Tracker(box)
    for number, image in source.read() if done else ():
        if number == done:
            break
        if image is not None and image.shape[1::-1] == size:
            tracker.follow(image)
    return tracker


def predicted(
    network: DroneKeyPP | OnnxNetwork,
    calibration: Calibration,
    size: tuple[int, int],
    frames: Iterator,
    given: dict[int, np.ndarray] | None,
    carried: Tracker | None,
) -> Iterator[list[tuple]]:
    """Journal rows without their names, a list a batch, in the order of the frames."""
    rows: list[tuple] = []
    crops, waiting = [], []  # of frames with a box, and their place in rows
    for number, image in frames:
        status, box = GOOD, None
        if image is None:
            status = "cannot be read"
        elif image.shape[:2] != size[::-1]:
            status = f"is {image.shape[1]}x{image.shape[0]}, the first frame {size[0]}x{size[1]}"
        else:
            box = given.get(number) if given is not None else carried.follow(image)
            status = GOOD if box is not None else "no box" if given is not None else "lost by the tracker"
        if box is not None:
            x, y, w, h = straight = calibration.undistort_box(box)
            if not (
                0 <= x + w / 2 < size[0] and 0 <= y + h / 2 < size[1]
            ):  # straightening cuts the corners off
                status = "outside the undistorted frame"
        if status == GOOD:
            square = clamp_square(square_around(straight), *size)
            crops.append(
                (crop_image(calibration.undistort(image), square, network.config.image_size), square)
            )
            waiting.append(len(rows))
        rows.append(
            (
                number,
                status,
                *(("", "", "", "") if box is None else (f"{v:.2f}" for v in box)),
                *[""] * (len(COLUMNS) - 7),
            )
        )
        if len(rows) == BATCH:
            yield fill(network, calibration, rows, crops, waiting)
            rows, crops, waiting = [], [], []
    if rows:
        yield fill(network, calibration, rows, crops, waiting)


def fill(
    network: DroneKeyPP | OnnxNetwork,
    calibration: Calibration,
    rows: list[tuple],
    crops: list,
    waiting: list[int],
) -> list[tuple]:
    """The rows, those with a crop completed by what the network says."""
    if not crops:
        return rows
    device, tic = (
        next(network.parameters()).device if isinstance(network, DroneKeyPP) else "cpu",
        time.perf_counter(),
    )
    images = (
        torch.from_numpy(np.stack([crop for crop, _ in crops]))
        .permute(0, 3, 1, 2)
        .float()
        .div(255)
        .to(device)
    )
    squares = torch.tensor(np.stack([square for _, square in crops]), dtype=torch.float32, device=device)
    K = torch.tensor(calibration.K, dtype=torch.float32, device=device).expand(len(crops), 3, 3)
    with torch.inference_mode():
        found = {
            name: value.cpu() for name, value in network(images, K, squares).items() if torch.is_tensor(value)
        }
        seconds = (time.perf_counter() - tic) / len(crops)
        doubt = mirror_doubt(network, images, K, squares, found["keypoints"].to(device)).cpu()
    for i, place in enumerate(waiting):
        share, drone = found["class_probs"][i].max(dim=0)
        numbers = [
            *found["keypoints_px"][i].flatten().tolist(),
            *found["R"][i].flatten().tolist(),
            *found["t"][i].tolist(),
        ]
        status = GOOD if np.isfinite(numbers).all() else "the network's answer is not finite"
        claims = ("", "")
        if "covariance" in found:
            variances = found["covariance"][i].diagonal()
            claims = (f"{math.degrees(variances[:3].sum().sqrt()):.3f}", f"{variances[3:].sum().sqrt():.4f}")
        named = [list(DRONES)[int(drone)], f"{share:.4f}", f"{doubt[i] * crops[i][1][2]:.3f}"]
        rest = [*named, *(f"{v:.6f}" for v in numbers), f"{seconds:.5f}", *claims]
        rows[place] = (rows[place][0], status, *rows[place][2:6], *rest)
    return rows


def mirror_doubt(
    network: Callable, image: torch.Tensor, K: torch.Tensor, square: torch.Tensor, keypoints: torch.Tensor
) -> torch.Tensor:
    """Mean distance (B,), crop units, between the keypoints (B, 4, 2) and those of the same crop seen in a mirror, mirrored back.

    A mirror swaps left and right hubs and changes nothing else, so a network that sees clearly answers the same: no truth is needed to ask.
    """
    x, y, side = square.unbind(1)
    other = network(image.flip(3), K, torch.stack([2 * K[:, 0, 2] - x - side, y, side], dim=1))[
        "keypoints"
    ].to(keypoints)
    return (mirror_keypoints(other) - keypoints).norm(dim=-1).mean(dim=-1)


def to_pose(row: dict[str, str]) -> Pose | None:
    """A journal's row as numbers; None where the frame has no pose."""
    if row["status"] != GOOD:
        return None
    return Pose(
        frame=int(row["frame"]), box=np.array([float(row[f"box_{key}"]) for key in "xywh"]), drone=row["drone"], score=float(row["score"]),
        doubt_px=float(row["doubt_px"]), keypoints=np.array([[float(row[f"kp{k}_{axis}"]) for axis in "xy"] for k in range(4)]),
        R=np.array([[float(row[f"R{i}{j}"]) for j in range(3)] for i in range(3)]), t=np.array([float(row[f"t{axis}"]) for axis in "xyz"]),
        seconds=float(row["seconds"]), **{name: float(row[name] or "nan") for name in ("turn_sigma_deg", "shift_sigma_m")},
    )  # fmt: skip


def smoothed(poses: list[Pose], sigma: float, rate: float) -> list[Pose]:
    """Smoothed by `sequences.gaussian`; a frame counts as much as the network trusts it: by the deviations it claims, or else by its mirror doubt."""
    claims = np.array([(pose.turn_sigma_deg, pose.shift_sigma_m) for pose in poses])  # (F, 2)
    if np.isfinite(claims).all():
        weights = 1 / np.square(claims)
    else:
        doubt = np.array(
            [pose.doubt_px / max(pose.box[2:]) for pose in poses]
        )  # in boxes: a near drone is large, not doubtful
        weights = 1 / (1 + np.square(doubt / max(np.median(doubt), 1e-6)))
    R, t = gaussian(
        np.stack([p.R for p in poses]),
        np.stack([p.t for p in poses]),
        np.array([p.frame / rate for p in poses]),
        sigma,
        weights,
    )
    return [Pose(**{**vars(pose), "R": R[i], "t": t[i]}) for i, pose in enumerate(poses)]


def bop_results(poses: list[Pose]) -> str:
    """The CSV that BOP's toolkit reads: R row by row, t in millimetres, time in seconds; scene 0, the footage's frame numbers."""
    lines = ["scene_id,im_id,obj_id,score,R,t,time"]
    for p in poses:
        R, t = (" ".join(f"{v:.6f}" for v in values.ravel()) for values in (p.R, 1000 * p.t))
        lines.append(f"0,{p.frame},{DRONES[p.drone].index + 1},{p.score:.4f},{R},{t},{p.seconds:.5f}")
    return "\n".join(lines) + "\n"


def draw_overlay(image: np.ndarray, pose: Pose, calibration: Calibration) -> np.ndarray:
    """A copy of the undistorted frame (H, W, 3) with box, propellers, body axes and a line of text."""
    image, thick = image.copy(), max(1, round(image.shape[1] / 960))

    def colour(text: str) -> tuple[int, ...]:
        return tuple(int(text[i : i + 2], 16) for i in (1, 3, 5))

    def pixel(point: np.ndarray) -> tuple[int, int]:
        return int(round(float(np.clip(point[0], -1e4, 1e4)) - 0.5)), int(
            round(float(np.clip(point[1], -1e4, 1e4)) - 0.5)
        )

    x, y, w, h = calibration.undistort_box(pose.box)
    cv2.rectangle(image, pixel(np.array([x, y])), pixel(np.array([x + w, y + h])), (255, 255, 255), thick)
    axes = 0.5 * DRONES[pose.drone].wheelbase * np.eye(3)
    points = np.concatenate([np.zeros((1, 3)), axes]) @ pose.R.T + pose.t
    if points[:, 2].min() > 0.05:
        tips = project(points, calibration.K)
        for tip, name in zip(tips[1:], plots.AXIS_COLOURS, strict=True):
            cv2.arrowedLine(
                image, pixel(tips[0]), pixel(tip), colour(name), 2 * thick, cv2.LINE_AA, tipLength=0.2
            )
    for point, name in zip(pose.keypoints, plots.KEYPOINT_COLOURS, strict=True):
        cv2.circle(image, pixel(point), 3 * thick, colour(name), -1, cv2.LINE_AA)
    unsure = (
        "" if math.isnan(pose.shift_sigma_m) else f" +- {pose.shift_sigma_m:.2f}"
    )  # OpenCV's letters have no better sign
    text = f"{DRONES[pose.drone].label} {100 * pose.score:.0f} %, {np.linalg.norm(pose.t):.2f}{unsure} m"
    (wide, high), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thick, thick)
    left = int(np.clip(x, 0, max(0, image.shape[1] - wide)))
    base = (
        int(y) - 2 * below
        if y > high + 3 * below
        else int(min(y + h, image.shape[0] - 2 * below)) + high + below
    )
    cv2.rectangle(image, (left, base - high - below // 2), (left + wide, base + below), (40, 40, 40), -1)
    cv2.putText(
        image, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thick, (255, 255, 255), thick, cv2.LINE_AA
    )
    return image


def write_overlay(
    out: Path, source: Footage, calibration: Calibration, poses: dict[int, Pose], rate: float
) -> None:
    """overlay.mp4 (of one image overlay.png): every frame that can be read; written beside, then renamed."""
    writer, written, beside = None, 0, out / ".overlay.tmp.mp4"
    try:
        for number, image in source.read():
            if image is None:
                continue
            image = calibration.undistort(image)
            if number in poses:
                image = draw_overlay(image, poses[number], calibration)
            if len(source.names) == 1:
                write_beside(out / PICTURE, cv2.imencode(".png", image[..., ::-1])[1].tobytes())
                return
            if writer is None:
                size = image.shape[1::-1]
                writer = cv2.VideoWriter(str(beside), cv2.VideoWriter_fourcc(*"mp4v"), rate, size)
                if not writer.isOpened():
                    raise InputError(
                        f"{beside}: OpenCV cannot write an mp4 here; run again without the overlay"
                    )
            if image.shape[1::-1] == size:
                writer.write(np.ascontiguousarray(image[..., ::-1]))
                written += 1
    finally:
        if writer is not None:
            writer.release()
    video = cv2.VideoCapture(str(beside))  # OpenCV says nothing of a full disk
    whole = video.get(cv2.CAP_PROP_FRAME_COUNT) == written
    video.release()
    if not whole:
        beside.unlink(missing_ok=True)
        raise InputError(
            f"{out / 'overlay.mp4'} could not be written whole; is the disk full? The poses are in {POSES}"
        )
    beside.replace(out / "overlay.mp4")


def draw_trajectory(poses: list[Pose]) -> bytes:
    """The path in space, and distance over the frames, as PNG. Axes as people see them: x right, depth away, up."""
    plots.style()
    t, frames = np.stack([p.t for p in poses]), np.array([p.frame for p in poses])
    figure = plt.figure(figsize=(10, 4))
    ax = figure.add_subplot(1, 2, 1, projection="3d")
    ax.plot(t[:, 0], t[:, 2], -t[:, 1], "o-", markersize=2, linewidth=1)
    ax.plot(*np.array([t[0, 0], t[0, 2], -t[0, 1]])[:, None], "o", color="#009E73", label="first frame")
    ax.set(xlabel="x, m", ylabel="depth z, m", zlabel="up, m")
    ax.legend()
    ax = figure.add_subplot(1, 2, 2)
    ax.plot(frames, np.linalg.norm(t, axis=1), "o-", markersize=2, linewidth=1)
    ax.set(xlabel="frame", ylabel="distance, m", ylim=(0, math.ceil(1.1 * np.linalg.norm(t, axis=1).max())))
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=100)
    plt.close(figure)
    return content.getvalue()
