"""Read the pictures of some footage in order: the frames of a video, the images of a folder, or one image."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.files import digest, natural_order
from dronekeypp.footage.decoding import count_pictures, read_picture
from dronekeypp.footage.videos import count_frames, open_video

CAMERA_FILE = "scene_camera.json"  # of a scene of a BOP data set
# What OpenCV decodes, and what FFmpeg in it does. An animated GIF is a video.
IMAGES = (
    *(".jpg", ".jpeg", ".jpe", ".png", ".bmp", ".dib", ".tif", ".tiff", ".webp", ".avif", ".jp2"),
    *(".pbm", ".pgm", ".ppm", ".pnm", ".pxm", ".pfm", ".ras", ".sr", ".hdr", ".pic"),
)
# Pictures of cameras that OpenCV does not decode. In a folder they are frames that cannot be read.
OTHER_IMAGES = (
    *(".heic", ".heif", ".hif", ".jxl", ".exr", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf"),
    *(".rw2", ".raw"),
)
VIDEOS = (
    *(".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm", ".mpg", ".mpeg", ".m2v", ".mts", ".m2ts", ".ts"),
    *(".wmv", ".asf", ".flv", ".f4v", ".ogv", ".3gp", ".3g2", ".vob", ".mxf", ".gif", ".y4m"),
    *(".mjpg", ".mjpeg", ".h264", ".264", ".h265", ".265", ".hevc", ".lrv", ".insv", ".dav"),
)
DEFAULT_RATE = 30.0  # frames a second of images, which do not say when they were taken


@dataclass(frozen=True)
class BopScene:
    """Hold what a BOP data set calls its scene and the images in it.

    Attributes:
        folder: of the scene, which is called by its number.
        images: the number of each image, in the order of the footage.
    """

    folder: Path
    images: tuple[int, ...]

    @property
    def root(self) -> Path:
        """Return the data set, which holds models/ and the folder of the split."""
        return self.folder.parent.parent

    @property
    def number(self) -> int:
        """Return the number of the scene."""
        return int(self.folder.name)


@dataclass(frozen=True)
class Footage:
    """Hold frames in order.

    Attributes:
        path: the video, the folder of images, or the image.
        names: one for each frame: the name of its file, or its number in a video ("000012").
        rate: frames a second of a video, on the average. It is None for images, which do not say when they
            were taken.
        times: when each frame was taken, seconds, where a video's are uneven or its header names another
            rate.
    """

    path: Path
    names: tuple[str, ...]
    rate: float | None
    times: tuple[float, ...] | None = None

    def frame_times(self) -> np.ndarray:
        """Return when each frame was taken (F,), seconds; of images as if there were 30 a second."""
        if self.times is not None:
            return np.array(self.times)
        return np.arange(len(self.names)) / (self.rate or DEFAULT_RATE)

    @property
    def is_video(self) -> bool:
        """Tell whether it is a video file.

        A folder is none, whatever its name ends in.
        """
        return self.path.suffix.lower() in VIDEOS and not self.path.is_dir()

    @property
    def folder(self) -> Path:
        """Return the folder where its frames lie.

        Those of a video count as if they lay in a folder with its name.
        """
        if self.is_video:
            return self.path.with_suffix("")
        return self.path if self.path.is_dir() else self.path.parent

    @property
    def bop_scene(self) -> BopScene | None:
        """Return the scene of a BOP data set that the frames are of, or None for any other footage.

        They are, where they lie in a folder such as rgb/ beside a scene_camera.json, and where that folder's
        parent and all images have numbers for names, each image another.
        """
        scene = self.folder.resolve().parent
        if self.is_video or not (scene / CAMERA_FILE).is_file():
            return None
        stems = [Path(name).stem for name in self.names]
        if not all(name.isdecimal() for name in (scene.name, *stems)):
            return None
        images = tuple(int(stem) for stem in stems)
        if len(set(images)) < len(images):
            return None
        return BopScene(scene, images)

    def digest(self) -> str:
        """Return what tells it from other footage at the same place.

        This covers the names and sizes of its files.
        """
        files = [self.path] if self.is_video else [self.folder / name for name in self.names]
        lines = []
        for file in files:
            size = file.stat().st_size if file.is_file() else "missing"
            lines.append(f"{file.name} {size}")
        return digest(os.fsencode("\n".join(lines)))

    def read(self, start: int = 0) -> Iterator[tuple[int, np.ndarray | None]]:
        """Yield the frames from number `start` on.

        Yields:
            (number, image (H, W, 3) uint8 RGB). The image is None where the frame cannot be read.
        """
        if self.is_video:
            yield from self._read_video(start)
            return
        for number in range(start, len(self.names)):
            file = self.folder / self.names[number]
            yield number, read_picture(file) if file.suffix.lower() in IMAGES else None

    def _read_video(self, start: int) -> Iterator[tuple[int, np.ndarray | None]]:
        video = open_video(self.path)
        try:
            # From the first frame on: seeking in compressed video is not exact.
            for number in range(len(self.names)):
                readable = video.grab()
                if number < start:
                    continue
                image = None
                if readable:
                    readable, image = video.retrieve()
                yield number, cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if readable else None
        finally:
            video.release()


def open_footage(path: str | Path) -> Footage:
    """Open a video, a folder of images (in the order of their names) or one image.

    Of the folder of a scene of a BOP data set, rgb/ in it is taken.

    Raises:
        InputError: The path does not exist, the folder holds no image, or the file is neither an image nor a
            video, or an image file that holds several pictures.
    """
    path = Path(path)
    if (path / CAMERA_FILE).is_file() and (path / "rgb").is_dir():
        path = path / "rgb"
    if path.is_dir():
        return Footage(path, _image_names(path), None)
    if not path.exists():
        raise InputError(f"{path}: not found")
    if not path.is_file():
        raise InputError(f"{path}: a pipe or a device, which cannot be read twice; give a file")
    if path.suffix.lower() in IMAGES:
        pictures = count_pictures(path)
        if pictures > 1:
            raise InputError(
                f"{path}: holds {pictures} pictures, and only the first would be read; "
                "make a folder with a file for each, or a video"
            )
        return Footage(path, (path.name,), None)
    if path.suffix.lower() not in VIDEOS:
        raise InputError(f"{path}: neither an image ({', '.join(IMAGES)}) nor a video ({', '.join(VIDEOS)})")
    count, rate, times = count_frames(path)
    return Footage(path, tuple(f"{i:06d}" for i in range(count)), rate, times)


def _image_names(folder: Path) -> tuple[str, ...]:
    """Return the names of the images in a folder, in order.

    Images that are not decoded are among them, unless there is one of the same name that is: many cameras
    write a raw file beside each JPEG.
    """
    files = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    names = [path.name for path in files if path.suffix.lower() in IMAGES]
    if not names:
        found = Counter(path.suffix or ("folder" if path.is_dir() else "without suffix") for path in files)
        listed = ", ".join(f"{count} {suffix}" for suffix, count in found.most_common(3)) or "nothing"
        raise InputError(f"{folder}: no image in this folder ({', '.join(IMAGES)}); it holds {listed}")
    stems = {Path(name).stem for name in names}
    for path in files:
        if path.suffix.lower() in OTHER_IMAGES and path.stem not in stems:
            names.append(path.name)
    return tuple(sorted(names, key=natural_order))
