"""Your own pictures: a video, a folder or one image; the camera's calibration; boxes from any detector, or one box and a tracker."""

from __future__ import annotations

import contextlib
import csv
import ctypes
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.camera import check_intrinsics
from dronekeypp.errors import InputError
from dronekeypp.files import digest, read_json

IMAGES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
SLIVER = 1.0  # pixels: what a detector leaves of a box at the frame's edge
VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")


# --- pictures --------------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Footage:
    """Frames in order. `names`: one a frame (a file's name; of a video "000012"). `rate`: frames a second, None where pictures have no time."""

    path: Path
    names: tuple[str, ...]
    rate: float | None

    @property
    def is_video(self) -> bool:
        return self.path.suffix.lower() in VIDEOS

    @property
    def folder(self) -> Path:
        """Where its frames lie; those of a video as if they lay in a folder of its name."""
        return (
            self.path.with_suffix("")
            if self.is_video
            else self.path
            if self.path.is_dir()
            else self.path.parent
        )

    def digest(self) -> str:
        """What tells it from other footage at the same place: names and sizes of its files."""
        files = [self.path] if self.is_video else [self.folder / name for name in self.names]
        told = "\n".join(
            f"{file.name} {file.stat().st_size if file.is_file() else 'missing'}" for file in files
        )
        return digest(os.fsencode(told))

    def read(self, start: int = 0) -> Iterator[tuple[int, np.ndarray | None]]:
        """(number, image (H, W, 3) uint8 RGB or None where the frame cannot be read), from frame `start` on."""
        if not self.is_video:
            for i in range(start, len(self.names)):
                yield i, read_picture((self.path / self.names[i]) if self.path.is_dir() else self.path)
            return
        video = cv2.VideoCapture(str(self.path))
        try:
            for i in range(
                len(self.names)
            ):  # from the first frame on: seeking in compressed video is not exact
                good = video.grab()
                if i >= start:
                    good, image = video.retrieve() if good else (False, None)
                    yield i, cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if good else None
        finally:
            video.release()


def read_picture(path: Path) -> np.ndarray | None:
    """An image file as (H, W, 3) uint8 RGB, or None if it is missing or broken."""
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError:
        return None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    return None if image is None else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def open_footage(path: str | Path) -> Footage:
    """A video, a folder of images (in the order of their names) or one image.

    Raises:
        InputError: nothing there, no image in the folder, or a kind of file that is neither.
    """
    path = Path(path)
    if path.is_dir():
        names = (p.name for p in path.iterdir() if p.suffix.lower() in IMAGES and not p.name.startswith("."))
        numbers = lambda name: [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]  # noqa: E731 (2 before 10)
        names = tuple(sorted(names, key=lambda name: (numbers(name), name)))
        if not names:
            raise InputError(f"{path}: no image in this folder ({', '.join(IMAGES)})")
        return Footage(path, names, None)
    if not path.is_file():
        raise InputError(f"{path}: not found")
    if path.suffix.lower() in IMAGES:
        return Footage(path, (path.name,), None)
    if path.suffix.lower() not in VIDEOS:
        raise InputError(f"{path}: neither an image ({', '.join(IMAGES)}) nor a video ({', '.join(VIDEOS)})")
    video = cv2.VideoCapture(str(path))
    try:
        promised, rate, count = video.get(cv2.CAP_PROP_FRAME_COUNT), float(video.get(cv2.CAP_PROP_FPS)), 0
        while video.grab():  # the header's count may be wrong
            count += 1
        if count < 1:
            raise InputError(f"{path}: cannot be opened as a video; is it whole?")
        # What is promised and cannot be read is reported. But a frame takes a byte at least, and Matroska promises no frames, only a duration.
        if count < promised < path.stat().st_size and path.suffix.lower() not in (".mkv", ".webm"):
            count = int(promised)
    finally:
        video.release()
    return Footage(
        path, tuple(f"{i:06d}" for i in range(count)), rate if np.isfinite(rate) and rate > 0 else None
    )


# --- the camera ------------------------------------------------------------------------------------------------------------------------


MATRIX = ("camera_matrix", "K", "cameraMatrix")
DISTORTION = ("distortion_coefficients", "dist_coeffs", "dist_coeff", "distCoeffs", "D")
READ = (*MATRIX, *DISTORTION, "image_width", "image_height", "fisheye_model")


@dataclass(frozen=True)
class Calibration:
    """K (3, 3) of the whole frame, OpenCV's distortion coefficients (or none), and the frame's (width, height) where the file gives it."""

    K: np.ndarray
    distortion: np.ndarray | None = None
    size: tuple[int, int] | None = None

    def for_frames(self, width: int, height: int) -> Calibration:
        """The calibration of frames of another size, if they are the calibrated ones made smaller or larger.

        Raises:
            InputError: another shape: then they were cut, and the matrix cannot be known; or no lens has such a focal length.
        """
        wide = self.size[0] if self.size else width
        if not 0.05 < self.K[0, 0] / wide < 1000:
            raise InputError(
                f"a focal length of {self.K[0, 0]:g} pixels for a frame {wide} wide: is the matrix in pixels of the whole frame?"
            )
        if self.size is None or self.size == (width, height):
            return self
        if abs(width * self.size[1] / self.size[0] - height) > 1:  # pixels
            raise InputError(
                f"the camera was calibrated at {self.size[0]}×{self.size[1]}, the frames are {width}×{height}: not the same shape"
            )
        scale = np.diag([width / self.size[0], height / self.size[1], 1.0])
        return Calibration(scale @ self.K, self.distortion, (width, height))

    @property
    def opencv_K(self) -> np.ndarray:
        """K as OpenCV counts: pixel centres from 0, where ours lie at +0.5."""
        return self.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])

    def undistort(self, image: np.ndarray) -> np.ndarray:
        """The picture a pinhole camera with the same K would have taken."""
        return image if self.distortion is None else cv2.undistort(image, self.opencv_K, self.distortion)

    def undistort_box(self, box: np.ndarray) -> np.ndarray:
        """The box (x, y, w, h) around where the corners and edges of a box in the distorted picture lie in the undistorted one."""
        if self.distortion is None:
            return box
        x, y, w, h = box
        along = np.linspace(0, 1, 9)
        sides = [(x + along * w, np.full(9, v)) for v in (y, y + h)] + [
            (np.full(9, u), y + along * h) for u in (x, x + w)
        ]
        rim = np.concatenate([np.stack(side, axis=1) for side in sides])
        points = (
            cv2.undistortPoints(rim[:, None] - 0.5, self.opencv_K, self.distortion, P=self.opencv_K)[:, 0]
            + 0.5
        )
        low, high = points.min(axis=0), points.max(axis=0)
        return np.array([*low, *(high - low)])


def read_camera(path: str | Path) -> Calibration:
    """A calibration in OpenCV's own format (YAML, XML or JSON, as its calibration sample writes it) or plain JSON.

    Read are `camera_matrix` (or cameraMatrix, K), `distortion_coefficients` (or dist_coeffs, distCoeffs, D), `image_width` and `image_height`.
    OpenCV counts pixel centres from 0, this package from 0.5: the principal point is moved by half a pixel. The `scene_camera.json` of a flight of
    6DroneSyn is read as well, and counts as this package does.

    Raises:
        InputError: not found, unreadable, no camera matrix, one that is none, or a fisheye's; a flight with several cameras.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: camera file not found")
    found = _plain_json(path) or _opencv_nodes(path)
    matrix = next((found[key] for key in MATRIX if found.get(key) is not None), None)
    if matrix is None:
        example = '"camera_matrix": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]'
        raise InputError(
            f"{path}: holds no camera_matrix; write OpenCV's calibration format, or JSON with {example}"
        )
    try:
        K = np.array(matrix, dtype=np.float64).reshape(3, 3)
        fisheye = bool(found.get("fisheye_model"))
        distortion = next((found[key] for key in DISTORTION if found.get(key) is not None), None)
        distortion = None if distortion is None else np.array(distortion, dtype=np.float64).ravel()
        size = (
            (int(found["image_width"]), int(found["image_height"]))
            if found.get("image_width") and found.get("image_height")
            else None
        )
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{path}: camera_matrix needs 3×3 numbers, distortion a list of numbers ({error})"
        ) from None
    if fisheye:
        raise InputError(
            f"{path}: a fisheye camera; undistort the footage with OpenCV's fisheye module first, and give the matrix of the result"
        )
    check_intrinsics(K, f"{path}: camera_matrix")
    if distortion is not None and (
        len(distortion) not in (4, 5, 8, 12, 14) or not np.isfinite(distortion).all()
    ):
        raise InputError(
            f"{path}: distortion has {len(distortion)} numbers; OpenCV knows 4, 5, 8, 12 or 14, all finite"
        )
    if size and min(size) < 1:
        raise InputError(
            f"{path}: image_width and image_height must be positive, got {size[0]} and {size[1]}"
        )
    K[:2, 2] += 0.0 if found.get("bop") else 0.5
    return Calibration(K, distortion if distortion is not None and distortion.any() else None, size)


def _plain_json(path: Path) -> dict | None:
    """JSON as anyone would write it, or OpenCV's with its matrices' data; None if it is no JSON."""
    if path.suffix.lower() != ".json":
        return None
    found = read_json(path)
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds no settings but a {type(found).__name__}")
    if path.name == "scene_camera.json":
        cameras = [frame.get("cam_K") if isinstance(frame, dict) else None for frame in found.values()]
        if not cameras or any(camera != cameras[0] for camera in cameras):
            raise InputError(f"{path}: {len(cameras)} frames, and not one camera for all of them")
        return {"K": cameras[0], "bop": True}
    return {
        key: value["data"] if isinstance(value, dict) and "data" in value else value
        for key, value in found.items()
    }


def _opencv_nodes(path: Path) -> dict:
    try:
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        root = file.root()
        nodes = {key: root.getNode(key) for key in root.keys() if key in READ}
        found = {
            key: node.mat() if node.isMap() else node.real()
            for key, node in nodes.items()
            if not node.isString()
        }
        file.release()
    except (cv2.error, SystemError) as error:
        raise InputError(
            f"{path}: not a calibration in OpenCV's YAML, XML or JSON ({str(error).strip().splitlines()[-1]})"
        ) from None
    return found


# --- boxes -----------------------------------------------------------------------------------------------------------------------------


def read_boxes(
    path: str | Path, names: tuple[str, ...], width: int, height: int, folder: str | Path = "."
) -> dict[int, np.ndarray]:
    """One box (x, y, w, h) in pixels a frame: {frame number: box}. Of several in a frame the most confident counts.

    The format follows from the file. COCO (.json: a list of detections, or a data set with images and annotations) · YOLO (a folder with one
    .txt a frame, named like it, or NAME_1.txt, NAME_2.txt … for a video: class cx cy w h [confidence], shares of the frame) · MOT (.txt: frame,
    id, x, y, w, h, confidence …, frames from 1) · CSV with a header: frame (all file names, or all numbers from 0), x, y, w, h[, score].
    `names` are the footage's, `folder` is where it lies: of a COCO data set of several flights, those are meant whose images lie there.

    Raises:
        InputError: not found, not one of these, or a line that is none (it is named).
    """
    path = Path(path)
    by_name = {name: i for i, name in enumerate(names)} | {Path(name).stem: i for i, name in enumerate(names)}
    if path.is_dir():
        labels = (
            (file, _frame_of(file.stem, names, by_name)) for file in sorted(path.glob("*.txt"))
        )  # classes.txt is none
        rows = [row for file, frame in labels if frame >= 0 for row in _yolo(file, frame, width, height)]
    elif not path.is_file():
        raise InputError(f"{path}: boxes not found")
    elif path.suffix.lower() == ".json":
        folders = [Path(os.path.abspath(folder)), Path(folder).resolve()]
        rows = _coco(
            path,
            by_name,
            [tuple((one / name).with_suffix("").as_posix() for one in folders) for name in names],
        )
    elif path.suffix.lower() == ".csv":
        rows = _csv(path, by_name)
    elif "," in path.read_text(errors="replace").split("\n", 1)[0]:
        rows = _mot(path)
    else:
        rows = _yolo(path, 0, width, height)
    best: dict[int, tuple[float, np.ndarray]] = {}
    for where, frame, box, score in rows:
        box = check_box(box, width, height, where)
        if box[2:].min() < SLIVER:
            continue
        if frame < 0:
            raise InputError(f"{where}: frame {frame}; the first is number 0")
        if not np.isfinite(score):
            raise InputError(f"{where}: the score is {score}")
        if frame < len(names) and score > best.get(frame, (-np.inf,))[0]:
            best[frame] = (score, box)
    if not best:
        raise InputError(
            f"{path}: no box for any of the {len(names)} frames; the first is number 0 and is called {names[0]}"
        )
    return {frame: box for frame, (_, box) in sorted(best.items())}


def check_box(box, width: int, height: int, where: str) -> np.ndarray:
    """The box (x, y, w, h) as numbers.

    Raises:
        InputError: not finite, no area, or wholly outside the frame; the message begins with `where`.
    """
    box = np.array(box, dtype=np.float64)
    if box.shape != (4,) or not np.isfinite(box).all() or box[2] <= 0 or box[3] <= 0:
        raise InputError(
            f"{where}: a box needs four finite numbers, width and height above 0, got {box.tolist()}"
        )
    if np.abs(box).max() <= 1:
        raise InputError(f"{where}: {box.tolist()} are shares of the frame; pixels are needed")
    if box[0] >= width or box[1] >= height or box[0] + box[2] <= 0 or box[1] + box[3] <= 0:
        raise InputError(f"{where}: the box {box.tolist()} lies outside the {width}×{height} frame")
    return box


def _frame_of(stem: str, names: tuple[str, ...], by_name: dict[str, int]) -> int:
    """Frame number of a YOLO label file; -1: none of the footage's. Detectors call a video's labels NAME_1, NAME_2 …"""
    if stem not in by_name and names[0] == "000000" and (counted := re.search(r"_(\d+)$", stem)):
        return int(counted[1]) - 1
    return by_name.get(stem, -1)


def _lines(path: Path, split: str | None) -> Iterator[tuple[str, list[float]]]:
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        if line.strip():
            try:
                yield f"{path} line {number}", [float(part) for part in line.split(split)]
            except ValueError:
                raise InputError(f"{path} line {number}: not numbers: {line.strip()[:60]!r}") from None


def _yolo(path: Path, frame: int, width: int, height: int) -> Iterator[tuple]:
    for where, row in _lines(path, None):
        if len(row) < 5:
            raise InputError(f"{where}: a YOLO line is class cx cy w h [confidence]")
        cx, cy, w, h = np.array(row[1:5]) * [width, height, width, height]
        yield (
            where,
            frame,
            (cx - w / 2, cy - h / 2, w, h),
            row[5] if len(row) in (6, 7) else 1.0,
        )  # a seventh: the track


def _mot(path: Path) -> Iterator[tuple]:
    for where, row in _lines(path, ","):
        if len(row) < 6:
            raise InputError(f"{where}: a MOT line is frame, id, x, y, w, h[, confidence …]")
        if not np.isfinite(row).all():
            raise InputError(f"{where}: not finite")
        if row[0] < 1:
            raise InputError(f"{where}: frame {row[0]:g}; MOT counts from 1")
        yield where, int(row[0]) - 1, row[2:6], row[6] if len(row) > 6 else 1.0


def _csv(path: Path, by_name: dict[str, int]) -> Iterator[tuple]:
    with open(
        path, newline="", encoding="utf-8-sig", errors="replace"
    ) as file:  # Excel writes a mark in front
        reader = csv.DictReader(file)
        try:
            if not {"frame", "x", "y", "w", "h"} <= set(reader.fieldnames or ()):
                raise InputError(
                    f"{path}: the header needs frame, x, y, w, h[, score]; it has {', '.join(reader.fieldnames or ()) or 'nothing'}"
                )
            rows = list(reader)
        except csv.Error as error:
            raise InputError(f"{path}: not CSV ({error})") from None
    named = all(
        row["frame"] in by_name for row in rows
    )  # "12" may be a name or a number, but not both in one file
    for number, row in enumerate(rows, 2):
        try:
            frame = by_name[row["frame"]] if named else int(row["frame"])
            yield (
                f"{path} line {number}",
                frame,
                [float(row[key]) for key in "xywh"],
                float(row.get("score") or 1.0),
            )
        except (TypeError, ValueError, OverflowError):
            raise InputError(
                f"{path} line {number}: not a frame of the footage and four numbers: {row}"
            ) from None


def _coco(path: Path, by_name: dict[str, int], places: list[tuple[str, str]]) -> Iterator[tuple]:
    """`places`: of every frame its path without suffix, as given and with links resolved."""
    found = read_json(path)
    images: dict = {}
    if isinstance(found, dict):
        known: dict[int | None, list] = {}  # frame of the footage: the images that could be it
        for image in found["images"] if isinstance(found.get("images"), list) else []:
            if not isinstance(image, dict) or not isinstance(image.get("id"), int | float | str):
                raise InputError(f"{path}: an image without id and file_name: {image!r}")
            name = Path(str(image.get("file_name", "")))
            known.setdefault(by_name.get(name.name, by_name.get(name.stem)), []).append(
                (image["id"], name.as_posix())
            )
        images = {number: None for number, _ in known.pop(None, [])}
        for frame, found_here in known.items():
            here = {name for _, name in found_here}
            if len(here) > 1:  # several flights have an image of that name
                tails = {name: f"/{Path(name).with_suffix('').as_posix().lstrip('/')}" for name in here}
                here = {
                    name
                    for name, tail in tails.items()
                    if any(place.endswith(tail) for place in places[frame])
                }
            if len(here) != 1:
                raise InputError(
                    f"{path}: {len(found_here)} images could be {places[frame][0]}; give file_name with its folders"
                )
            images |= {number: frame if name in here else None for number, name in found_here}
        found = found.get("annotations")
    if not isinstance(found, list):
        raise InputError(f"{path}: neither a COCO list of detections nor a COCO data set")
    for number, entry in enumerate(found):
        where = f"{path} entry {number}"
        try:
            image = entry["image_id"]
            frame = images[image] if images else by_name[image] if isinstance(image, str) else int(image)
            if frame is not None:
                yield where, frame, [float(v) for v in entry["bbox"]], float(entry.get("score", 1.0))
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputError(
                f"{where}: needs image_id (a frame of the footage) and bbox [x, y, w, h]"
            ) from None


class Tracker:
    """Carries a first-frame box through the footage: OpenCV's MIL tracker, which needs no model file.

    It follows what looks most alike, and does not notice when the drone is gone: look at the overlay.
    """

    def __init__(self, box: np.ndarray):
        self.box, self.tracker = np.asarray(box, dtype=np.float64), None

    def follow(self, image: np.ndarray) -> np.ndarray | None:
        """The box (x, y, w, h) in this frame, or None where the tracker gives up. The first call takes the box as it was given.

        Raises:
            InputError: less than two pixels of the first box lie in the frame.
        """
        picture = np.ascontiguousarray(image[..., ::-1])
        if self.tracker is None:
            low = np.clip(np.round(self.box[:2]), 0, None).astype(int)
            high = np.minimum(np.round(self.box[:2] + self.box[2:]), image.shape[1::-1]).astype(int)
            if (high - low).min() < 2:
                raise InputError(
                    f"box {self.box.tolist()}: nothing of it to track in the {image.shape[1]}×{image.shape[0]} frame"
                )
            with contextlib.suppress(TypeError, OSError, AttributeError):  # not on Windows
                ctypes.CDLL(None).srand(0)  # MIL draws from the C library: the same box gives the same path
            self.tracker = cv2.TrackerMIL_create()
            self.tracker.init(picture, (*low.tolist(), *(high - low).tolist()))
            return self.box
        good, box = self.tracker.update(picture)
        return np.array(box, dtype=np.float64) if good and min(box[2:]) > 0 else None
