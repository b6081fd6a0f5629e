"""From single frames to a flight: a Gaussian over its poses (the paper's Fig. 4), and a filter that needs no future.

A pose is R (3, 3), camera←body, and t (3,) metres. A flight is poses at rising times in seconds. Neither function looks across a gap: where
the drone was lost for longer than `longest_gap`, a new flight begins. NumPy throughout; one drone at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation

FAR = 6  # sigmas beyond which a neighbour counts for nothing


def check_flight(R, t, time, weights=None):
    """(R, t, time, weights) as float64 arrays (F, 3, 3), (F, 3), (F,), (F, 2): the rotation's weights and the translation's.

    `weights` may also be (F,), for both alike.

    Raises:
        InputError: shapes that do not fit, a number that is not finite, an R that is no rotation, times that do not rise, or a weight below 0.
    """
    R, t, time = (np.asarray(v, dtype=np.float64) for v in (R, t, time))
    F = len(time)
    weights = np.ones(F) if weights is None else np.asarray(weights, dtype=np.float64)
    weights = np.stack([weights, weights], axis=-1) if weights.ndim == 1 else weights
    if R.shape != (F, 3, 3) or t.shape != (F, 3) or time.shape != (F,) or weights.shape != (F, 2):
        raise InputError(
            f"a flight needs R (F, 3, 3), t (F, 3), time (F,); got {R.shape}, {t.shape}, {time.shape}, weights {weights.shape}"
        )
    if not all(np.isfinite(v).all() for v in (R, t, time, weights)):
        raise InputError("a flight's poses, times and weights must be finite; leave lost frames out")
    check_rotation(R, "a flight's R")
    if (np.diff(time) <= 0).any():
        raise InputError("a flight's times must rise from frame to frame")
    if (weights < 0).any():
        raise InputError("a weight below 0")
    return R, t, time, weights


def flights(time, longest_gap=0.5):
    """Slices of the frames between gaps: a step of more than `longest_gap` seconds begins a new one."""
    cuts = np.flatnonzero(np.diff(time) > longest_gap) + 1
    edges = [0, *cuts.tolist(), len(time)]
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def gaussian(R, t, time, sigma=0.1, weights=None, longest_gap=0.5):
    """Every pose becomes a mean of its neighbours, weighted by exp(-dt² / 2 sigma²) and by `weights` (see `inverse_variances`).

    Rotations are averaged by `scipy`'s `Rotation.mean`: the rotation with the least sum of squared chordal distances.

    Args:
        R, t, time: (F, 3, 3), (F, 3) metres, (F,) seconds. sigma: seconds; 0 leaves all as it is.
        weights: (F,), or (F, 2) with one for the rotation and one for the translation.

    Returns:
        (R, t), smoothed. It looks into the future: for live use see `LiveFilter`.

    Raises:
        InputError: see `check_flight`; a sigma below 0; or a flight whose weights are all 0.
    """
    R, t, time, weights = check_flight(R, t, time, weights)
    if not sigma >= 0:
        raise InputError(f"sigma={sigma}: seconds, 0 or more")
    smooth_R, smooth_t, turns = R.copy(), t.copy(), Rotation.from_matrix(R)
    for part in flights(time, longest_gap) if sigma > 0 else []:
        low = np.maximum(np.searchsorted(time, time[part] - FAR * sigma), part.start)
        high = np.minimum(np.searchsorted(time, time[part] + FAR * sigma, side="right"), part.stop)
        for i, a, b in zip(range(part.start, part.stop), low, high, strict=True):
            turn, shift = (
                np.exp(-np.square(time[a:b] - time[i]) / (2 * sigma**2))[:, None] * weights[a:b]
            ).T  # (N,) of the neighbours
            if turn.sum() <= 0 or shift.sum() <= 0:
                raise InputError(f"frame {i} and its neighbours have no weight: nothing to average")
            smooth_R[i] = turns[a:b][turn > 0].mean(turn[turn > 0]).as_matrix()
            smooth_t[i] = shift @ t[a:b] / shift.sum()
    return smooth_R, smooth_t


def inverse_variances(covariance):
    """Weights (F, 2) for `gaussian` from the covariances (F, 6, 6) of (turn, shift) that a geometric network claims: 1 / their variances."""
    variances = np.diagonal(np.asarray(covariance, dtype=np.float64), axis1=1, axis2=2)  # (F, 6)
    return 1 / np.stack([variances[:, :3].sum(axis=1), variances[:, 3:].sum(axis=1)], axis=1)


@dataclass
class LiveFilter:
    """A Kalman filter for poses as they come: position with its velocity, orientation with its rate of turn (an error-state filter, as in
    Solà, "Quaternion kinematics for the error-state Kalman filter", 2017, with rotations in place of quaternions).

    Between frames the drone is taken to keep its velocity, but for random accelerations. A measurement that lies absurdly far from where
    the drone can be (a heading read the wrong way round) is passed over; after `patience` of them in a row the filter believes them.

    Args:
        acceleration: how hard the drone accelerates at random: after a second its velocity may be off by so many m/s (standard deviation).
        turning: the same for its rate of turn, rad/s.
        position_noise, rotation_noise: of one measurement, metres and radians; `update` takes better ones.
        gate: share of good measurements that pass. longest_gap: seconds after which it starts again. patience: frames.
    """

    acceleration: float = 3.0
    turning: float = 3.0
    position_noise: float = 0.15
    rotation_noise: float = 0.15
    gate: float = 0.999
    longest_gap: float = 0.5
    patience: int = 5

    def __post_init__(self):
        self.time = None
        self.passed_over = 0  # measurements in a row

    def _start(self, R, t, time, position_cov, rotation_cov):
        self.R, self.t, self.time, self.passed_over = R, t, time, 0
        self.velocity, self.turn_rate = np.zeros(3), np.zeros(3)  # m/s camera axes; rad/s body axes
        self.P_t, self.P_R = (
            np.diag([0.0] * 3 + [3.0**2] * 3),
            np.diag([0.0] * 3 + [2.0**2] * 3),
        )  # of the velocities not sure at all
        self.P_t[:3, :3], self.P_R[:3, :3] = (
            position_cov,
            rotation_cov,
        )  # of the pose as sure as of a measurement

    def update(self, time, R, t, position_cov=None, rotation_cov=None):
        """The pose at `time` (seconds), given all so far and this measurement.

        Args:
            R (3, 3), t (3,) metres; both None: nothing was seen, the filter only predicts.
            position_cov, rotation_cov: (3, 3) of this measurement, m² camera axes and rad² body axes, in place of the usual noise.

        Returns:
            (R, t), or None before the first measurement and once the drone has been lost for longer than `longest_gap`.

        Raises:
            InputError: a time that does not rise, a measurement that is not finite, or an R that is no rotation.
        """
        if not np.isfinite(time):
            raise InputError(f"time {time}: seconds, finite")
        if self.time is not None and time <= self.time:
            raise InputError(f"time {time:g} s does not come after {self.time:g} s")
        if R is None:
            if self.time is None or time - self.seen > self.longest_gap:
                return None
            self._predict(time)
            return self.R.copy(), self.t.copy()
        R, t = (
            np.array(R, dtype=np.float64),
            np.array(t, dtype=np.float64),
        )  # copies: the caller may use his arrays again
        if R.shape != (3, 3) or t.shape != (3,) or not (np.isfinite(R).all() and np.isfinite(t).all()):
            raise InputError(
                f"a measured pose needs a finite R (3, 3) and t (3,), got {R.shape} and {t.shape}"
            )
        check_rotation(R, "a measured pose's R")
        position_cov = (
            np.eye(3) * self.position_noise**2
            if position_cov is None
            else np.asarray(position_cov, dtype=np.float64)
        )
        rotation_cov = (
            np.eye(3) * self.rotation_noise**2
            if rotation_cov is None
            else np.asarray(rotation_cov, dtype=np.float64)
        )
        for name, cov in (("position_cov", position_cov), ("rotation_cov", rotation_cov)):
            if cov.shape != (3, 3) or not np.isfinite(cov).all():
                raise InputError(f"{name} must be finite and (3, 3), got {cov.shape}")
        if self.time is None or time - self.seen > self.longest_gap or self.passed_over >= self.patience:
            self._start(R, t, time, position_cov, rotation_cov)
        else:
            self._predict(time)
            self._correct(R, t, position_cov, rotation_cov)
        self.seen = time
        return self.R.copy(), self.t.copy()

    def _predict(self, time):
        dt = time - self.time
        self.time = time
        self.t = self.t + dt * self.velocity
        self.R = self.R @ Rotation.from_rotvec(dt * self.turn_rate).as_matrix()
        step = np.eye(6)
        step[:3, 3:] = dt * np.eye(3)
        noise = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))  # of a white acceleration
        turn = step.copy()
        turn[:3, :3] = Rotation.from_rotvec(
            -dt * self.turn_rate
        ).as_matrix()  # the error is in body axes, and they turned
        self.P_t = step @ self.P_t @ step.T + self.acceleration**2 * noise
        self.P_R = turn @ self.P_R @ turn.T + self.turning**2 * noise

    def _correct(self, R, t, position_cov, rotation_cov):
        away = Rotation.from_matrix(self.R.T @ R).as_rotvec()  # (3,) body axes
        place, P_t, far = _kalman(self.P_t, t - self.t, position_cov)
        turn, P_R, turned = _kalman(self.P_R, away, rotation_cov)
        if far + turned > chi2.ppf(self.gate, df=6):
            self.passed_over += 1
            return
        self.passed_over = 0
        self.t, self.velocity, self.P_t = self.t + place[:3], self.velocity + place[3:], P_t
        self.R, self.turn_rate, self.P_R = (
            self.R @ Rotation.from_rotvec(turn[:3]).as_matrix(),
            self.turn_rate + turn[3:],
            P_R,
        )


def _kalman(P, away, noise):
    """One measurement of the first three of six numbers: their correction (6,), the covariance after it (6, 6), its squared Mahalanobis distance."""
    S = P[:3, :3] + noise
    gain = np.linalg.solve(S, P[:3]).T  # (6, 3)
    keep = np.eye(6)
    keep[:, :3] -= gain
    return gain @ away, keep @ P @ keep.T + gain @ noise @ gain.T, float(away @ np.linalg.solve(S, away))


def filtered(R, t, time, live=None, covariance=None):
    """`LiveFilter` over a whole recorded flight (F frames): (R, t). Every gap starts it again. `live`: one that has seen nothing yet.

    covariance: (F, 6, 6) of (turn in radians, shift in metres), camera axes, as a geometric network claims them; None: the filter's own noise.
    """
    R, t, time, _ = check_flight(R, t, time)
    live = live or LiveFilter()
    if covariance is None:
        found = [live.update(*frame) for frame in zip(time, R, t, strict=True)]
    else:
        covariance = np.asarray(covariance, dtype=np.float64)
        turn, shift = (
            R.transpose(0, 2, 1) @ covariance[:, :3, :3] @ R,
            covariance[:, 3:, 3:],
        )  # the filter wants turns in body axes
        found = [live.update(*frame) for frame in zip(time, R, t, shift, turn, strict=True)]
    return np.stack([R for R, _ in found]), np.stack([t for _, t in found])
