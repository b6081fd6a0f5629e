"""Filter poses as they come, with a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import gammaincinv

from dronekeypp.checked import as_float64, check_covariance
from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation
from dronekeypp.sequences.flights import (
    LONGEST_GAP,
    LONGEST_STEP,
    NO_SECONDS,
    check_flight,
    checked_covariances,
    default_longest_gap,
)

START_SPEED = 3.0  # standard deviation of each component of the unknown velocity at the start, m/s
START_TURN_RATE = 2.0  # the same for the rate of turn, rad/s


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

    Raises:
        InputError: a deviation is not above 0 (0 is allowed for `acceleration` and `turning`), `gate` is no
            share, `longest_gap` is not above 0, or `patience` is below 1.
    """

    acceleration: float = 3.0
    turning: float = 3.0
    position_noise: float = 0.15
    rotation_noise: float = 0.15
    gate: float = 0.999
    longest_gap: float = LONGEST_GAP
    patience: int = 5

    def __post_init__(self) -> None:
        self._check_settings()
        self.asked_at: float | None = None  # time of the last call of `update`, seconds
        self.long_steps = 0  # steps of more than LONGEST_STEP from call to call, in a row
        self.time: float | None = None  # of the state, seconds
        self.measured_at: float | None = None  # time of the last measurement, seconds
        self.accepted = 0  # measurements since the start, the one it started from included
        self.passed_over = 0  # measurements in a row

    def _check_settings(self) -> None:
        """Raise InputError for the first setting that is out of its range."""
        for name in ("acceleration", "turning"):
            if not 0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name}={getattr(self, name)}: a standard deviation, 0 or more")
        for name in ("position_noise", "rotation_noise"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name}={getattr(self, name)}: a standard deviation, above 0")
        if not 0 < self.gate < 1:
            raise InputError(f"gate={self.gate}: a share of the measurements, between 0 and 1")
        if not self.longest_gap > 0:
            raise InputError(f"longest_gap={self.longest_gap}: seconds, above 0")
        if not self.patience >= 1:
            raise InputError(f"patience={self.patience}: measurements, at least 1")

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
            InputError: The time does not rise or is not in seconds, a measurement is not finite, R is no
                rotation, only one of R and t is there, or a covariance is none.
        """
        if not np.isfinite(time):
            raise InputError(f"time {time}: seconds, finite")
        if (R is None) != (t is None):
            raise InputError("a measured pose needs both R and t; where nothing was seen, both are None")
        if self.time is not None and time <= self.time:
            raise InputError(f"time {time:g} s does not come after {self.time:g} s")
        self._count_long_step(time)
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

    def _count_long_step(self, time: float) -> None:
        """Raise InputError where the times are not in seconds: the filter would start again at each of them.

        A drone may be lost for long, once. From one frame to the next it is not, three times in a row.
        """
        step = 0.0 if self.asked_at is None else time - self.asked_at
        self.asked_at = time
        self.long_steps = self.long_steps + 1 if step > LONGEST_STEP else 0
        if self.long_steps >= 3 and self.longest_gap < LONGEST_STEP:
            raise InputError(f"time rises by {step:g} again and again: {NO_SECONDS}")

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
        # The quantile of chi-squared with 6 degrees of freedom; scipy.stats takes most of a second to import.
        if t_distance + R_distance > 2 * gammaincinv(6 / 2, self.gate):
            self.passed_over += 1
            return
        self.accepted += 1
        self.passed_over = 0
        self.t, self.velocity, self.P_t = self.t + t_correction[:3], self.velocity + t_correction[3:], P_t
        self.R = self.R @ Rotation.from_rotvec(R_correction[:3]).as_matrix()
        self.turn_rate, self.P_R = self.turn_rate + R_correction[3:], P_R


def _checked_pose(R: ArrayLike, t: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return copies of a measured pose as float64, so that the caller may use his arrays again."""
    R, t = as_float64(R, "R"), as_float64(t, "t")
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
    covariance = as_float64(covariance, name)
    if covariance.shape != (3, 3):
        raise InputError(f"{name} must be (3, 3), got {covariance.shape}")
    check_covariance(name, covariance)
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
        InputError: `check_flight` or `LiveFilter.update` raises it, or the covariances are none of F poses.
    """
    R, t, time, _ = check_flight(R, t, time)
    if live is None:
        live = LiveFilter(longest_gap=default_longest_gap(time))
    position_covs: list | np.ndarray = [None] * len(time)
    rotation_covs: list | np.ndarray = [None] * len(time)
    if covariance is not None:
        covariance = checked_covariances(covariance)
        if len(covariance) != len(time):
            raise InputError(f"{len(time)} poses need as many covariances, got {len(covariance)}")
        position_covs = covariance[:, 3:, 3:]
        rotation_covs = R.transpose(0, 2, 1) @ covariance[:, :3, :3] @ R  # the filter wants body axes
    filtered_R, filtered_t = np.empty_like(R), np.empty_like(t)
    for i in range(len(time)):
        filtered_R[i], filtered_t[i] = live.update(time[i], R[i], t[i], position_covs[i], rotation_covs[i])
    return filtered_R, filtered_t
