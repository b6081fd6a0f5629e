"""Turn single frames into a flight: with a Gaussian over its poses (the paper's Fig. 4), or a live filter.

A pose is R (3, 3), camera←body, and t (3,) metres. A flight is one drone's poses at rising times in seconds.
Where the drone was lost for longer than `longest_gap` seconds, a new flight begins: neither the Gaussian nor
the filter carries anything across such a gap. The Gaussian also looks at later frames. The filter does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation

FAR = 6  # sigmas beyond which a neighbour counts for nothing
LONGEST_GAP = 0.5  # seconds, unless the frames lie far apart
START_SPEED = 3.0  # standard deviation of each component of the unknown velocity at the start, m/s
START_TURN_RATE = 2.0  # the same for the rate of turn, rad/s


def check_flight(
    R: ArrayLike, t: ArrayLike, time: ArrayLike, weights: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (R, t, time, weights) as float64 arrays of shapes (F, 3, 3), (F, 3), (F,) and (F, 2).

    The two columns of the weights belong to the rotation and to the translation. Weights (F,) stand for both,
    and None means that every frame counts 1.

    Raises:
        InputError: The shapes do not fit, a number is not finite, an R is no rotation, the times do not rise,
            or a weight is below 0.
    """
    R = np.asarray(R, dtype=np.float64)
    t = np.asarray(t, dtype=np.float64)
    time = np.asarray(time, dtype=np.float64)
    F = len(time)
    weights = np.ones(F) if weights is None else np.asarray(weights, dtype=np.float64)
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
    if (weights < 0).any():
        raise InputError("a weight below 0")
    return R, t, time, weights


def default_longest_gap(time: ArrayLike) -> float:
    """Return the longest step in seconds that does not begin a new flight, for frames at the times (F,).

    It is half a second, or five times the median step where that is longer: footage of one frame a second
    would otherwise fall apart into flights of one frame.
    """
    steps = np.diff(time)
    if len(steps) == 0:
        return LONGEST_GAP
    return max(LONGEST_GAP, 5 * float(np.median(steps)))


def flights(time: ArrayLike, longest_gap: float | None = None) -> list[slice]:
    """Return slices of the frames between gaps, for rising times (F,) in seconds.

    A step of more than `longest_gap` seconds begins a new flight. None means `default_longest_gap`.
    """
    if longest_gap is None:
        longest_gap = default_longest_gap(time)
    cuts = np.flatnonzero(np.diff(time) > longest_gap) + 1
    starts, stops = [0, *cuts.tolist()], [*cuts.tolist(), len(time)]
    return [slice(start, stop) for start, stop in zip(starts, stops, strict=True)]


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
        InputError: `check_flight` raises it, sigma is below 0, or all neighbours of a frame have weight 0.
    """
    R, t, time, weights = check_flight(R, t, time, weights)
    if not sigma >= 0:
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
    """
    variances = np.diagonal(np.asarray(covariance, dtype=np.float64), axis1=1, axis2=2)  # (F, 6)
    return 1 / np.stack([variances[:, :3].sum(axis=1), variances[:, 3:].sum(axis=1)], axis=1)


@dataclass
class LiveFilter:
    """A `LiveFilter` is a Kalman filter for poses as they come.

    Its state is the position with its velocity, and the orientation with its rate of turn. It is an
    error-state filter as in Solà, "Quaternion kinematics for the error-state Kalman filter", 2017, with
    rotation matrices in place of quaternions.

    Between frames the drone is taken to keep its velocity, except for random accelerations. A measurement
    that lies absurdly far from the prediction (a heading read the wrong way round) is passed over. But the
    filter itself may be the one that is wrong, so it starts again in two cases:

    - It has passed over `patience` measurements in a row. It starts again from the next one.
    - It has passed over as many measurements in a row as it had accepted since its start. It starts again
      from the last of them. So a wild first frame is given up as soon as the second contradicts it, while a
      filter that has accepted many measurements has the full patience.

    Args:
        acceleration: standard deviation of what random accelerations add to the velocity in a second, m/s.
        turning: the same for the rate of turn, rad/s.
        position_noise, rotation_noise: standard deviations of one measurement, metres and radians. `update`
            takes a covariance for each measurement in their place.
        gate: share of the good measurements that are not passed over.
        longest_gap: seconds without a measurement after which the filter starts again.
        patience: measurements in a row that may be passed over.
    """

    acceleration: float = 3.0
    turning: float = 3.0
    position_noise: float = 0.15
    rotation_noise: float = 0.15
    gate: float = 0.999
    longest_gap: float = LONGEST_GAP
    patience: int = 5

    def __post_init__(self) -> None:
        self.time: float | None = None  # of the state, seconds
        self.measured_at: float | None = None  # time of the last measurement, seconds
        self.accepted = 0  # measurements since the start, the one it started from included
        self.passed_over = 0  # measurements in a row

    def update(
        self,
        time: float,
        R: ArrayLike | None,
        t: ArrayLike | None,
        position_cov: ArrayLike | None = None,
        rotation_cov: ArrayLike | None = None,
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the pose at `time` (seconds), given all measurements so far and this one.

        Args:
            time: in seconds.
            R (3, 3), t (3,) metres: the measurement. Both None: nothing was seen, the filter only predicts.
            position_cov, rotation_cov: covariances (3, 3) of this measurement, m² in camera axes and rad² in
                body axes. None takes the filter's own noise.

        Returns:
            (R, t). It is None before the first measurement, and once the drone has been lost for longer than
            `longest_gap`.

        Raises:
            InputError: The time does not rise, a measurement is not finite, R is no rotation, or a covariance
                is not finite or not (3, 3).
        """
        if not np.isfinite(time):
            raise InputError(f"time {time}: seconds, finite")
        if self.time is not None and time <= self.time:
            raise InputError(f"time {time:g} s does not come after {self.time:g} s")
        lost = self.measured_at is None or time - self.measured_at > self.longest_gap
        if R is None:
            if lost:
                return None
            self._predict(time)
            return self.R.copy(), self.t.copy()
        R, t = _checked_pose(R, t)
        position_cov = _checked_covariance(position_cov, self.position_noise, "position_cov")
        rotation_cov = _checked_covariance(rotation_cov, self.rotation_noise, "rotation_cov")
        if lost or self.passed_over >= self.patience:
            self._start(R, t, time, position_cov, rotation_cov)
        else:
            self._predict(time)
            self._correct(R, t, position_cov, rotation_cov)
            if self.passed_over >= self.accepted:
                self._start(R, t, time, position_cov, rotation_cov)
        self.measured_at = time
        return self.R.copy(), self.t.copy()

    def _start(
        self, R: np.ndarray, t: np.ndarray, time: float, position_cov: np.ndarray, rotation_cov: np.ndarray
    ) -> None:
        """Begin with this measurement: take its pose and covariance, with velocities unknown."""
        self.R, self.t, self.time = R, t, time
        self.velocity, self.turn_rate = np.zeros(3), np.zeros(3)  # m/s, camera axes; rad/s, body axes
        self.P_t = np.diag([0.0] * 3 + [START_SPEED**2] * 3)  # (6, 6) of position and velocity
        self.P_R = np.diag([0.0] * 3 + [START_TURN_RATE**2] * 3)  # (6, 6) of orientation and rate of turn
        self.P_t[:3, :3], self.P_R[:3, :3] = position_cov, rotation_cov
        self.accepted, self.passed_over = 1, 0

    def _predict(self, time: float) -> None:
        """Carry the state on to `time`."""
        dt = time - self.time
        self.time = time
        self.t = self.t + dt * self.velocity
        self.R = self.R @ Rotation.from_rotvec(dt * self.turn_rate).as_matrix()
        step = np.eye(6)
        step[:3, 3:] = dt * np.eye(3)
        noise = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))  # of a white acceleration
        turned_step = step.copy()
        # The rotation's error is in body axes, and they have turned.
        turned_step[:3, :3] = Rotation.from_rotvec(-dt * self.turn_rate).as_matrix()
        self.P_t = step @ self.P_t @ step.T + self.acceleration**2 * noise
        self.P_R = turned_step @ self.P_R @ turned_step.T + self.turning**2 * noise

    def _correct(
        self, R: np.ndarray, t: np.ndarray, position_cov: np.ndarray, rotation_cov: np.ndarray
    ) -> None:
        """Move the predicted state towards the measurement, or pass the measurement over."""
        offset = Rotation.from_matrix(self.R.T @ R).as_rotvec()  # (3,) body axes
        t_correction, P_t, t_distance = _kalman(self.P_t, t - self.t, position_cov)
        R_correction, P_R, R_distance = _kalman(self.P_R, offset, rotation_cov)
        if t_distance + R_distance > chi2.ppf(self.gate, df=6):
            self.passed_over += 1
            return
        self.accepted += 1
        self.passed_over = 0
        self.t, self.velocity, self.P_t = self.t + t_correction[:3], self.velocity + t_correction[3:], P_t
        self.R = self.R @ Rotation.from_rotvec(R_correction[:3]).as_matrix()
        self.turn_rate, self.P_R = self.turn_rate + R_correction[3:], P_R


def _checked_pose(R: ArrayLike, t: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return copies of a measured pose as float64, so that the caller may use his arrays again."""
    R, t = np.array(R, dtype=np.float64), np.array(t, dtype=np.float64)
    if R.shape != (3, 3) or t.shape != (3,) or not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise InputError(f"a measured pose needs a finite R (3, 3) and t (3,), got {R.shape} and {t.shape}")
    check_rotation(R, "a measured pose's R")
    return R, t


def _checked_covariance(covariance: ArrayLike | None, noise: float, name: str) -> np.ndarray:
    """Return the covariance (3, 3) as float64.

    None stands for the same standard deviation `noise` on every axis.
    """
    if covariance is None:
        covariance = np.eye(3) * noise**2
    covariance = np.asarray(covariance, dtype=np.float64)
    if covariance.shape != (3, 3) or not np.isfinite(covariance).all():
        raise InputError(f"{name} must be finite and (3, 3), got {covariance.shape}")
    return covariance


def _kalman(P: np.ndarray, offset: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Measure the first three of six numbers whose covariance is P (6, 6).

    The measurement lies by `offset` (3,) from the prediction, and its own covariance is `noise` (3, 3).

    Returns:
        The correction (6,), the covariance after it (6, 6), and the squared Mahalanobis distance of `offset`.
    """
    S = P[:3, :3] + noise
    gain = np.linalg.solve(S, P[:3]).T  # (6, 3)
    keep = np.eye(6)
    keep[:, :3] -= gain
    covariance = keep @ P @ keep.T + gain @ noise @ gain.T
    return gain @ offset, covariance, float(offset @ np.linalg.solve(S, offset))


def filtered(
    R: ArrayLike,
    t: ArrayLike,
    time: ArrayLike,
    live: LiveFilter | None = None,
    covariance: ArrayLike | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Run a `LiveFilter` over a whole recorded flight of F frames and return (R, t).

    It starts again after every gap.

    Args:
        R, t, time: (F, 3, 3), (F, 3) metres, (F,) seconds.
        live: a filter that has seen nothing yet. None takes one with the usual settings, and with
            `default_longest_gap` of these times.
        covariance: (F, 6, 6) of (turn in radians, shift in metres) in camera axes, as a geometric network
            claims them. None takes the filter's own noise.

    Raises:
        InputError: `check_flight` or `LiveFilter.update` raises it, or the covariances are not (F, 6, 6).
    """
    R, t, time, _ = check_flight(R, t, time)
    if live is None:
        live = LiveFilter(longest_gap=default_longest_gap(time))
    position_covs: list | np.ndarray = [None] * len(time)
    rotation_covs: list | np.ndarray = [None] * len(time)
    if covariance is not None:
        covariance = np.asarray(covariance, dtype=np.float64)
        if covariance.shape != (len(time), 6, 6):
            raise InputError(f"{len(time)} poses need covariance ({len(time)}, 6, 6), got {covariance.shape}")
        position_covs = covariance[:, 3:, 3:]
        rotation_covs = R.transpose(0, 2, 1) @ covariance[:, :3, :3] @ R  # the filter wants body axes
    filtered_R, filtered_t = np.empty_like(R), np.empty_like(t)
    for i in range(len(time)):
        filtered_R[i], filtered_t[i] = live.update(time[i], R[i], t[i], position_covs[i], rotation_covs[i])
    return filtered_R, filtered_t
