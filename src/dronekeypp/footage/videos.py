"""Open videos, and find out how many frames they have and when those were taken."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.errors import InputError

EVEN = 0.25  # of the time between two frames: more is no rounding of the container
SAME_RATE = 0.01  # relative
# MPEG-4 counts time in parts of a second, at most so many; OpenCV keeps three decimals of a rate.
MOST_PARTS = 65535
SLOWEST = 0.01  # frames a second that OpenCV writes


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video for reading.

    The path is made absolute, because FFmpeg takes what stands before a colon in a name for a protocol.
    """
    return cv2.VideoCapture(os.fspath(path.absolute()))


def count_frames(path: Path) -> tuple[int, float | None, tuple[float, ...] | None]:
    """Count the frames of a video, and ask its container when they were taken.

    Returns:
        The number of frames; the frames a second where they are known; the time of each, seconds, where the
        frames are not evenly spaced, or not at the rate that the header names.

    Raises:
        InputError: It cannot be opened as a video.
    """
    video = open_video(path)
    try:
        promised = video.get(cv2.CAP_PROP_FRAME_COUNT)
        header_rate = float(video.get(cv2.CAP_PROP_FPS))
        times = []
        while video.grab():  # the header's count may be wrong
            times.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000)
    finally:
        video.release()
    count = len(times)
    if count < 1:
        raise InputError(f"{path}: cannot be opened as a video; is it whole?")
    # A frame that is promised and cannot be read gets a row that says so. But a frame takes a byte at least,
    # and Matroska promises no frames, only a duration.
    counts_frames = path.suffix.lower() not in (".mkv", ".webm")
    if counts_frames and count < promised < path.stat().st_size:
        count = int(promised)
    rate = header_rate if np.isfinite(header_rate) and header_rate > 0 else None
    return count, *_rate_and_times(count, rate, np.array(times))


def _rate_and_times(
    count: int, rate: float | None, times: np.ndarray
) -> tuple[float | None, tuple[float, ...] | None]:
    """Return the rate and the times as `count_frames` does, from the header's rate and the times (N,) found.

    Times that do not rise are none at all: raw streams without a container have zeros.
    """
    steps = np.diff(times)
    if len(steps) == 0 or not np.isfinite(times).all() or steps.min() <= 0:
        return rate, None
    mean = float(steps.mean())
    even = np.abs(steps - mean).max() <= EVEN * mean
    if rate is not None and even and abs(rate * mean - 1) <= SAME_RATE:
        return rate, None
    # Frames that are promised and cannot be read come last, one after the other.
    missing = times[-1] + mean * np.arange(1, count - len(times) + 1)
    return 1 / mean, tuple(np.concatenate([times, missing]).tolist())


def writable_rate(rate: float) -> float:
    """Return the rate next to this one that an MPEG-4 video can have, frames a second."""
    rate = float(np.clip(rate, SLOWEST, MOST_PARTS))
    for decimals in (3, 2, 1):
        if rate * 10**decimals <= MOST_PARTS:
            return round(rate, decimals)
    return float(round(rate))
