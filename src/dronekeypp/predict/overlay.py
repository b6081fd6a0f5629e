"""Draw what people look at: the poses on the footage, and the path in space."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.camera import project
from dronekeypp.classes import DroneClass
from dronekeypp.colours import AXIS_COLOURS, KEYPOINT_COLOURS
from dronekeypp.errors import InputError
from dronekeypp.files import write_beside, writing_beside
from dronekeypp.footage import DEFAULT_RATE, Calibration, Footage, open_video, writable_rate
from dronekeypp.predict.ahead import ahead
from dronekeypp.predict.journal import PICTURE, POSES, VIDEO, Pose

AXIS_LENGTH = 0.1  # metres, for a drone whose size is not known
DRAWN_AHEAD = 2  # frames
WHITE, DARK = (255, 255, 255), (40, 40, 40)


def draw_overlay(image: np.ndarray, pose: Pose, calibration: Calibration, drone: DroneClass) -> np.ndarray:
    """Draw box, propellers, body axes and a line of text on a copy of the undistorted frame.

    The frame is (H, W, 3) uint8 RGB. `drone` is the pose's class: its title is written, and an axis is half
    its wheelbase long.
    """
    image = image.copy()
    thickness = max(1, round(image.shape[1] / 960))
    x, y, w, h = calibration.undistort_box(pose.box)
    cv2.rectangle(image, _pixel((x, y)), _pixel((x + w, y + h)), WHITE, thickness)
    _draw_axes(image, pose, calibration, drone, 2 * thickness)
    for point, colour in zip(pose.keypoints, KEYPOINT_COLOURS, strict=True):
        cv2.circle(image, _pixel(point), 3 * thickness, _rgb(colour), -1, cv2.LINE_AA)
    sigma = pose.shift_sigma_m
    unsure = "" if math.isnan(sigma) else f" +- {sigma:.2f}"  # OpenCV's letters have no better sign
    text = f"{drone.title} {100 * pose.score:.0f} %, {np.linalg.norm(pose.t):.2f}{unsure} m"
    _draw_label(image, text, (x, y, h), thickness)
    return image


def _draw_axes(
    image: np.ndarray, pose: Pose, calibration: Calibration, drone: DroneClass, thickness: int
) -> None:
    """Draw the body axes, unless one ends behind the camera or nearly."""
    length = AXIS_LENGTH if drone.wheelbase is None else 0.5 * drone.wheelbase
    points = np.concatenate([np.zeros((1, 3)), length * np.eye(3)]) @ pose.R.T + pose.t  # (4, 3)
    if points[:, 2].min() <= 0.05:  # metres
        return
    pixels = project(points, calibration.K)  # (4, 2)
    for tip, colour in zip(pixels[1:], AXIS_COLOURS, strict=True):
        start, end = _pixel(pixels[0]), _pixel(tip)
        cv2.arrowedLine(image, start, end, _rgb(colour), thickness, cv2.LINE_AA, tipLength=0.2)


def _draw_label(image: np.ndarray, text: str, box: tuple[float, float, float], thickness: int) -> None:
    """Write a line of text above a box (left, top, height), or below it where there is no room above."""
    x, y, h = box
    height, width = image.shape[:2]
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thickness
    (text_width, text_height), below = cv2.getTextSize(text, font, size, thickness)
    left = int(np.clip(x, 0, max(0, width - text_width)))
    if y > text_height + 3 * below:
        base = int(y) - 2 * below
    else:
        base = int(min(y + h, height - 2 * below)) + text_height + below
    corner = left, base - text_height - below // 2
    cv2.rectangle(image, corner, (left + text_width, base + below), DARK, -1)
    cv2.putText(image, text, (left, base), font, size, WHITE, thickness, cv2.LINE_AA)


def _rgb(colour: str) -> tuple[int, int, int]:
    """Return the three bytes of a colour such as "#D55E00"."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def _pixel(point: Sequence[float] | np.ndarray) -> tuple[int, int]:
    """Return a point (x, y) as OpenCV draws it, which counts pixel centres from 0."""
    x, y = np.clip(np.asarray(point, dtype=float), -1e4, 1e4)
    return round(float(x) - 0.5), round(float(y) - 0.5)


def write_overlay(
    out: Path,
    source: Footage,
    calibrations: Sequence[Calibration],
    poses: Mapping[int, Pose],
    drones: Sequence[DroneClass],
) -> None:
    """Write every frame that can be read to overlay.mp4 (of one image overlay.png) in the folder `out`.

    The file is written beside its place and then renamed.

    Args:
        out: the folder.
        source: the footage.
        calibrations: the camera's, for every frame.
        poses: {frame number: pose}. A frame without a pose is shown as it is.
        drones: the network's classes.

    Raises:
        InputError: OpenCV cannot write such a video here, or not the whole of it.
    """
    images = ahead(_drawn_frames(source, calibrations, poses, drones), DRAWN_AHEAD)
    if len(source.names) == 1:
        for image in images:
            write_beside(out / PICTURE, cv2.imencode(".png", image[..., ::-1])[1].tobytes())
        return
    with writing_beside(out / VIDEO) as beside:
        written = _write_video(beside, images, source.rate or DEFAULT_RATE)
        video = open_video(beside)  # OpenCV says nothing of a full disk
        readable = video.get(cv2.CAP_PROP_FRAME_COUNT)
        video.release()
        if readable != written:
            raise InputError(
                f"{out / VIDEO} could not be written whole; is the disk full? The poses are in {POSES}"
            )


def _drawn_frames(
    source: Footage,
    calibrations: Sequence[Calibration],
    poses: Mapping[int, Pose],
    drones: Sequence[DroneClass],
) -> Iterator[np.ndarray]:
    """Yield the frames that can be read, undistorted, with their poses drawn on them."""
    drone_of = {drone.name: drone for drone in drones}
    for number, image in source.read():
        if image is None:
            continue
        calibration = calibrations[number]
        image = calibration.undistort(image)
        if number in poses:
            pose = poses[number]
            image = draw_overlay(image, pose, calibration, drone_of[pose.drone])
        yield image


def _write_video(path: Path, images: Iterator[np.ndarray], rate: float) -> int:
    """Write the images that have the first one's size as an mp4, and return their number.

    The rate is made one that MPEG-4 can have.
    """
    writer, size, written = None, None, 0
    try:
        for image in images:
            if writer is None:
                size = image.shape[1::-1]
                # Absolute, because FFmpeg takes what stands before a colon in a name for a protocol.
                name, codec = str(path.absolute()), cv2.VideoWriter_fourcc(*"mp4v")
                writer = cv2.VideoWriter(name, codec, writable_rate(rate), size)
                if not writer.isOpened():
                    raise InputError(
                        f"{path}: OpenCV cannot write an mp4 here; run again without the overlay"
                    )
            if image.shape[1::-1] == size:
                writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
                written += 1
    finally:
        if writer is not None:
            writer.release()
    return written


def draw_trajectory(poses: Sequence[Pose]) -> bytes:
    """Draw the path in space, and the distance over the frames, as PNG.

    The axes are as people see them: x right, depth away, up. Any thread may call it.
    """
    # Imported here: this takes a third of a second, in which `predict` already draws the overlay.
    from matplotlib.figure import Figure  # not pyplot, whose windows belong to the main thread

    from dronekeypp import plots

    plots.style()
    t = np.stack([pose.t for pose in poses])  # (F, 3)
    frames = [pose.frame for pose in poses]
    distances = np.linalg.norm(t, axis=1)
    figure = Figure(figsize=(10, 4))
    path = figure.add_subplot(1, 2, 1, projection="3d")
    path.plot(t[:, 0], t[:, 2], -t[:, 1], "o-", markersize=2, linewidth=1)
    path.plot(t[:1, 0], t[:1, 2], -t[:1, 1], "o", color="#009E73", label="first frame")
    path.set(xlabel="x, m", ylabel="depth z, m", zlabel="up, m")
    path.legend()
    over_time = figure.add_subplot(1, 2, 2)
    over_time.plot(frames, distances, "o-", markersize=2, linewidth=1)
    over_time.set(xlabel="frame", ylabel="distance, m", ylim=(0, math.ceil(1.1 * distances.max())))
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=100)
    return content.getvalue()
