"""Smooth the poses of whole flights, with and without the covariance that a geometric network claims."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dronekeypp import rotations
from dronekeypp.evaluate import interval_of_mean
from dronekeypp.evaluate.statistics import flights_of
from dronekeypp.reproduce.beyond_uncertainty import Answers
from dronekeypp.sequences import LiveFilter, filtered, gaussian, inverse_variances
from dronekeypp.sixdronesyn.scenes import FPS

Poses = tuple[np.ndarray, np.ndarray]  # R (F, 3, 3) and t (F, 3) metres
# (R, t, seconds (F,), covariance (F, 6, 6), strength) -> the smoothed poses
Smoother = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float], Poses]


def unchanged(
    R: np.ndarray, t: np.ndarray, time: np.ndarray, covariance: np.ndarray, strength: float
) -> Poses:
    """Return the poses as they are."""
    return R, t


def smoothed(
    R: np.ndarray, t: np.ndarray, time: np.ndarray, covariance: np.ndarray, strength: float
) -> Poses:
    """Smooth the poses with a Gaussian of `strength` seconds."""
    return gaussian(R, t, time, strength)


def smoothed_by_covariance(
    R: np.ndarray, t: np.ndarray, time: np.ndarray, covariance: np.ndarray, strength: float
) -> Poses:
    """Smooth in the same way, with every frame weighted by the covariance claimed for it."""
    return gaussian(R, t, time, strength, inverse_variances(covariance))


def live(R: np.ndarray, t: np.ndarray, time: np.ndarray, covariance: np.ndarray, strength: float) -> Poses:
    """Run a live filter whose random accelerations have this strength."""
    return filtered(R, t, time, LiveFilter(strength, strength))


def live_by_covariance(
    R: np.ndarray, t: np.ndarray, time: np.ndarray, covariance: np.ndarray, strength: float
) -> Poses:
    """Run the same live filter, with the claimed covariance as the noise of each measurement."""
    return filtered(R, t, time, LiveFilter(strength, strength), covariance)


# Each filter, and the strengths to choose from.
FILTERS: dict[str, tuple[Smoother, tuple[float, ...]]] = {
    "frame by frame": (unchanged, (0.0,)),
    "Gaussian": (smoothed, (0.03, 0.05, 0.1, 0.2)),
    "Gaussian, weighted by the covariance": (smoothed_by_covariance, (0.03, 0.05, 0.1, 0.2)),
    "live filter": (live, (1.0, 3.0, 10.0, 30.0)),
    "live filter, told the covariance": (live_by_covariance, (1.0, 3.0, 10.0, 30.0)),
}


def over_flights(
    answered: Answers, truth: dict[str, Tensor], smooth: Smoother, strength: float, every: int = 1
) -> np.ndarray:
    """Return the mean errors of the flights after smoothing.

    The result has shape (n, 2), with the rotation in degrees and the translation in metres.

    Args:
        answered: what the network says of the frames.
        truth: their annotations.
        smooth: one of FILTERS.
        strength: the filter's strength.
        every: take every `every`-th flight only.
    """
    frames = answered.whole
    _, members = flights_of(frames)
    rows = []
    for chosen in members[::every]:
        R, t = frames["R"][chosen].astype(float), frames["t"][chosen].astype(float)
        time = frames["frame"][chosen] / FPS
        R, t = smooth(R, t, time, answered.covariance[chosen], strength)
        turned = rotations.geodesic_degrees(torch.tensor(R), truth["R"][chosen].double())
        shifted = np.linalg.norm(t - truth["t"][chosen].double().numpy(), axis=1)
        rows.append((float(turned.mean()), float(shifted.mean())))
    return np.array(rows)


def sequences(
    test: Answers, truth: dict[str, Tensor], val: Answers, val_truth: dict[str, Tensor]
) -> list[dict[str, Any]]:
    """Measure every filter on the test flights, with the change against single frames.

    Each filter has the strength that serves it best on every second validation flight.

    Args:
        test: answers to the test frames.
        truth: their annotations.
        val: answers to the validation frames.
        val_truth: their annotations.
    """
    rows = []
    single_frames = None
    for name, (smooth, strengths) in FILTERS.items():
        best = best_strength(val, val_truth, smooth, strengths)
        errors = over_flights(test, truth, smooth, best)  # (n, 2)
        if single_frames is None:  # the first filter changes nothing
            single_frames = errors
        row = {"filter": name, "strength": best, "flights": len(errors)}
        for k, key in enumerate(("R_deg", "t_m")):
            row[key] = float(errors[:, k].mean())
            row[f"{key}_change_ci95"] = interval_of_mean((errors - single_frames)[:, k])
        rows.append(row)
    return rows


def best_strength(
    val: Answers, truth: dict[str, Tensor], smooth: Smoother, strengths: tuple[float, ...]
) -> float:
    """Return the strength with the lowest errors on every second flight.

    Rotation and translation count alike, each over its error with the first strength.
    """
    errors = []
    for strength in strengths:
        errors.append(over_flights(val, truth, smooth, strength, every=2).mean(axis=0))
    scores = [R / errors[0][0] + t / errors[0][1] for R, t in errors]
    return strengths[int(np.argmin(scores))]
