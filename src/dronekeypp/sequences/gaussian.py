"""Smooth a recorded flight by a Gaussian over its poses (the paper's Fig. 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dronekeypp.errors import InputError
from dronekeypp.sequences.flights import check_flight, checked_covariances, flights

FAR = 6  # sigmas beyond which a neighbour counts for nothing


def gaussian(
    R: ArrayLike,
    t: ArrayLike,
    time: ArrayLike,
    sigma: float = 0.1,
    weights: ArrayLike | None = None,
    longest_gap: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Make every pose a mean of its neighbours, weighted by exp(-dt² / 2 sigma²) and by `weights`.

    Rotations are averaged by scipy's `Rotation.mean`. It returns the rotation with the least sum of squared
    chordal distances.

    Args:
        R, t, time: (F, 3, 3), (F, 3) metres, (F,) seconds.
        sigma: seconds. 0 leaves all poses as they are.
        weights: (F,), or (F, 2) with one weight for the rotation and one for the translation. See
            `inverse_variances`.
        longest_gap: seconds. A longer step begins a new flight. None means `default_longest_gap`.

    Returns:
        (R, t), smoothed. Every pose depends on later frames too: for live use see `LiveFilter`.

    Raises:
        InputError: `check_flight` raises it, sigma is below 0 or not finite, `longest_gap` is not above 0, or
            all neighbours of a frame have weight 0.
    """
    R, t, time, weights = check_flight(R, t, time, weights)
    if not 0 <= sigma < np.inf:
        raise InputError(f"sigma={sigma}: seconds, 0 or more")
    smooth_R, smooth_t = R.copy(), t.copy()
    if sigma == 0:
        return smooth_R, smooth_t
    rotations = Rotation.from_matrix(R)
    for flight in flights(time, longest_gap):
        for i in range(flight.start, flight.stop):
            a = max(np.searchsorted(time, time[i] - FAR * sigma), flight.start)
            b = min(np.searchsorted(time, time[i] + FAR * sigma, side="right"), flight.stop)
            closeness = np.exp(-np.square(time[a:b] - time[i]) / (2 * sigma**2))  # (N,) of the neighbours
            R_weights, t_weights = (closeness[:, None] * weights[a:b]).T  # (N,) each
            if R_weights.sum() <= 0 or t_weights.sum() <= 0:
                raise InputError(f"frame {i} and its neighbours have no weight: nothing to average")
            counts = R_weights > 0
            smooth_R[i] = rotations[a:b][counts].mean(R_weights[counts]).as_matrix()
            smooth_t[i] = t_weights @ t[a:b] / t_weights.sum()
    return smooth_R, smooth_t


def inverse_variances(covariance: ArrayLike) -> np.ndarray:
    """Return weights (F, 2) for `gaussian`: 1 / variance of the rotation and 1 / variance of the translation.

    The covariances (F, 6, 6) are those of (turn in radians, shift in metres) that a geometric network claims.

    Raises:
        InputError: they are none: of another shape, not finite, not symmetric, indefinite, or 0.
    """
    covariance = checked_covariances(covariance)
    variances = np.diagonal(covariance, axis1=1, axis2=2)  # (F, 6)
    if (variances <= 0).any():
        raise InputError("covariance: a variance of 0, so its weight is infinite")
    return 1 / np.stack([variances[:, :3].sum(axis=1), variances[:, 3:].sum(axis=1)], axis=1)
