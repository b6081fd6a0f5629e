"""Check the poses, times and covariances of a flight, and cut it at its gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dronekeypp.checked import as_float64, check_covariance
from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation

LONGEST_GAP = 0.5  # seconds, unless the frames lie far apart
LONGEST_STEP = 8.0  # seconds; milliseconds of up to 120 frames a second are further apart
NO_SECONDS = "they are in seconds; divide milliseconds by 1000"


def check_flight(
    R: ArrayLike, t: ArrayLike, time: ArrayLike, weights: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (R, t, time, weights) as float64 arrays of shapes (F, 3, 3), (F, 3), (F,) and (F, 2).

    The two columns of the weights belong to the rotation and to the translation. Weights (F,) stand for both,
    and None means that every frame counts 1.

    Raises:
        InputError: The shapes do not fit, a number is not finite, an R is no rotation, the times do not rise
            or are not in seconds, or a weight is below 0.
    """
    R, t, time = as_float64(R, "R"), as_float64(t, "t"), checked_times(time)
    F = len(time)
    weights = np.ones(F) if weights is None else as_float64(weights, "weights")
    if weights.ndim == 1:
        weights = np.stack([weights, weights], axis=-1)
    if R.shape != (F, 3, 3) or t.shape != (F, 3) or time.shape != (F,) or weights.shape != (F, 2):
        raise InputError(
            f"a flight needs R (F, 3, 3), t (F, 3), time (F,); "
            f"got {R.shape}, {t.shape}, {time.shape}, weights {weights.shape}"
        )
    for values in (R, t, time, weights):
        if not np.isfinite(values).all():
            raise InputError("a flight's poses, times and weights must be finite; leave lost frames out")
    check_rotation(R, "a flight's R")
    if (np.diff(time) <= 0).any():
        raise InputError("a flight's times must rise from frame to frame")
    if F > 1 and np.median(np.diff(time)) > LONGEST_STEP:
        raise InputError(f"a flight's times rise by {np.median(np.diff(time)):g} a frame: {NO_SECONDS}")
    if (weights < 0).any():
        raise InputError("a weight below 0")
    return R, t, time, weights


def checked_times(time: ArrayLike) -> np.ndarray:
    """Return times (F,) as float64, or raise InputError unless they are a list of numbers."""
    time = as_float64(time, "time")
    if time.ndim != 1:
        raise InputError(f"time has shape {time.shape}, needed is (F,)")
    return time


def default_longest_gap(time: ArrayLike) -> float:
    """Return the longest step in seconds that does not begin a new flight, for frames at the times (F,).

    It is half a second, or five times the median step where that is longer: footage of one frame a second
    would otherwise fall apart into flights of one frame.
    """
    steps = np.diff(checked_times(time))
    if len(steps) == 0:
        return LONGEST_GAP
    return max(LONGEST_GAP, 5 * float(np.median(steps)))


def flights(time: ArrayLike, longest_gap: float | None = None) -> list[slice]:
    """Return slices of the frames between gaps, for rising times (F,) in seconds.

    A step of more than `longest_gap` seconds begins a new flight. None means `default_longest_gap`.

    Raises:
        InputError: `longest_gap` is not above 0, or the times are no list of numbers.
    """
    time = checked_times(time)
    if longest_gap is None:
        longest_gap = default_longest_gap(time)
    if not longest_gap > 0:
        raise InputError(f"longest_gap={longest_gap}: seconds, above 0")
    cuts = np.flatnonzero(np.diff(time) > longest_gap) + 1
    starts, stops = [0, *cuts.tolist()], [*cuts.tolist(), len(time)]
    return [slice(start, stop) for start, stop in zip(starts, stops, strict=True)]


def checked_covariances(covariance: ArrayLike) -> np.ndarray:
    """Return covariances (F, 6, 6) as float64, or raise InputError if they are none."""
    covariance = as_float64(covariance, "covariance")
    if covariance.ndim != 3 or covariance.shape[1:] != (6, 6):
        raise InputError(f"covariance has shape {covariance.shape}, needed is (F, 6, 6)")
    check_covariance("covariance", covariance)
    return covariance
