"""Smoothing a flight: noise goes down, nothing crosses a gap, and the live filter recovers from flips."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dronekeypp.errors import InputError
from dronekeypp.sequences import (
    LiveFilter,
    default_longest_gap,
    filtered,
    flights,
    gaussian,
    inverse_variances,
)

RATE = 30.0  # frames a second
Poses = tuple[np.ndarray, np.ndarray]  # R (F, 3, 3), t (F, 3)
HALF_TURN = Rotation.from_euler("Z", np.pi).as_matrix()  # of the body about its own z axis


def true_flight(seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A curve that banks: (R, t, time)."""
    time = np.arange(round(seconds * RATE)) / RATE
    t = np.stack([np.sin(1.2 * time), 0.3 * np.cos(time), 4 + 0.8 * time], axis=1)
    angles = np.stack([0.9 * time, 0.2 * np.sin(time), 0.3 * np.cos(1.5 * time)], axis=1)
    return Rotation.from_euler("ZYX", angles).as_matrix(), t, time


def noisy(
    R: np.ndarray, t: np.ndarray, seed: int = 0, turn: float = 0.15, shift: float = 0.15, flips: float = 0.0
) -> Poses:
    """Measured poses: off by `turn` radians and `shift` metres, a share `flips` of the headings reversed."""
    rng = np.random.default_rng(seed)
    headings = np.where(rng.random(len(t)) < flips, np.pi, 0.0)
    error = Rotation.from_rotvec(rng.normal(0, turn, (len(t), 3)))
    flip = Rotation.from_euler("Z", headings[:, None])
    return (Rotation.from_matrix(R) * error * flip).as_matrix(), t + rng.normal(0, shift, t.shape)


def frame_errors(R: np.ndarray, t: np.ndarray, true_R: np.ndarray, true_t: np.ndarray) -> Poses:
    """Errors (F,) in degrees and (F,) in metres."""
    turned = (Rotation.from_matrix(true_R).inv() * Rotation.from_matrix(R)).magnitude()
    return np.degrees(turned), np.linalg.norm(t - true_t, axis=1)


def mean_errors(R: np.ndarray, t: np.ndarray, true_R: np.ndarray, true_t: np.ndarray) -> np.ndarray:
    """Mean errors (2,) in degrees and metres."""
    return np.mean(frame_errors(R, t, true_R, true_t), axis=1)


def test_a_gaussian_halves_the_noise() -> None:
    R, t, time = true_flight()
    before = mean_errors(*noisy(R, t), R, t)
    after = mean_errors(*gaussian(*noisy(R, t), time, sigma=0.1), R, t)
    assert (after < 0.45 * before).all()


def test_a_gaussian_by_hand() -> None:
    R = Rotation.from_euler("Z", [[0.0], [20.0], [90.0]], degrees=True).as_matrix()
    t, time = np.array([[0.0, 0, 1], [0, 0, 2], [0, 0, 5]]), np.array([0.0, 0.1, 0.2])
    even_R, even_t = gaussian(R, t, time, sigma=1e6, weights=[1, 1, 0])
    assert np.degrees(Rotation.from_matrix(even_R[0]).as_euler("ZYX")[0]) == pytest.approx(10)
    np.testing.assert_allclose(even_t, np.tile([0, 0, 1.5], (3, 1)), atol=1e-9)
    w = np.exp(-np.square(time - 0.1) / (2 * 0.1**2))
    np.testing.assert_allclose(gaussian(R, t, time, sigma=0.1)[1][1], w @ t / w.sum())
    same_R, same_t = gaussian(R, t, time, sigma=0)
    assert np.array_equal(same_R, R) and np.array_equal(same_t, t)


def test_a_rotation_and_a_translation_may_be_trusted_differently() -> None:
    R = Rotation.from_euler("Z", [[0.0], [20.0], [90.0]], degrees=True).as_matrix()
    t, time = np.array([[0.0, 0, 1], [0, 0, 2], [0, 0, 5]]), np.array([0.0, 0.1, 0.2])
    even_R, even_t = gaussian(R, t, time, sigma=1e6, weights=[[1, 0], [1, 1], [0, 1]])
    assert np.degrees(Rotation.from_matrix(even_R[0]).as_euler("ZYX")[0]) == pytest.approx(10)
    np.testing.assert_allclose(even_t[0], [0, 0, 3.5], atol=1e-9)
    np.testing.assert_allclose(inverse_variances(np.diag([0.01, 0.04, 0.05, 1, 1, 2])[None]), [[10, 0.25]])


def uneven(R: np.ndarray, t: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured poses, every third ten times as noisy, and the covariances (F, 6, 6) that say so."""
    measured_R, measured_t = noisy(R, t, seed, turn=0.05, shift=0.05)
    rough_R, rough_t = noisy(R, t, seed + 100, turn=0.5, shift=0.5)
    measured_R[::3], measured_t[::3] = rough_R[::3], rough_t[::3]
    covariance = np.tile(0.05**2 * np.eye(6), (len(t), 1, 1))
    covariance[::3] = 0.5**2 * np.eye(6)
    return measured_R, measured_t, covariance


def test_a_covariance_that_is_right_is_worth_something() -> None:
    """The Gaussian and the live filter are better when they know which frames are bad."""
    R, t, time = true_flight()
    gaussian_ratios, filter_ratios = [], []
    for seed in range(3):
        measured_R, measured_t, covariance = uneven(R, t, seed)
        measured = (measured_R, measured_t, time)
        weights = inverse_variances(covariance)
        unweighted = mean_errors(*gaussian(*measured, 0.1), R, t)
        weighted = mean_errors(*gaussian(*measured, 0.1, weights), R, t)
        gaussian_ratios.append(weighted / unweighted)
        own_noise = mean_errors(*filtered(*measured), R, t)
        given_noise = mean_errors(*filtered(*measured, covariance=covariance), R, t)
        filter_ratios.append(given_noise / own_noise)
    assert (np.mean(gaussian_ratios, axis=0) < 0.4).all()
    assert (np.mean(filter_ratios, axis=0) < 0.85).all()


def test_the_covariance_of_a_turn_is_in_camera_axes() -> None:
    """Sure about the camera's x axis only, the filter takes over most of a turn about it, and little else."""
    start = np.eye(3)[
        [1, 2, 0]
    ]  # the camera's x axis is the body's y, its y the body's z, its z the body's x
    R = np.tile(start, (31, 1, 1))
    R[-1] = Rotation.from_rotvec([0.1, 0.1, 0.0]).as_matrix() @ start
    t, time = np.tile([0.0, 0, 3], (31, 1)), np.arange(31) / RATE
    covariance = np.tile(0.01 * np.eye(6), (31, 1, 1))
    covariance[-1] = np.diag([1e-4, 1.0, 1.0, 1, 1, 1])
    filtered_R, _ = filtered(R, t, time, None, covariance)
    turned = Rotation.from_matrix(filtered_R[-1] @ start.T).as_rotvec()
    assert turned[0] > 0.08 and abs(turned[1]) < 0.02


def test_far_neighbours_count_for_nothing() -> None:
    R, t, time = true_flight()
    near = np.exp(-np.square(time[:, None] - time[None]) / (2 * 0.05**2))
    mean_t = near @ t / near.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(gaussian(R, t, time, sigma=0.05)[1], mean_t, atol=1e-6)


def gaussian_of_0_3(R: np.ndarray, t: np.ndarray, time: np.ndarray) -> Poses:
    return gaussian(R, t, time, sigma=0.3)


@pytest.mark.parametrize("smooth", [gaussian_of_0_3, filtered])
@pytest.mark.parametrize("step", [1 / RATE, 1.0])
def test_nothing_crosses_a_gap(smooth: Callable[..., Poses], step: float) -> None:
    R, t, _ = true_flight()
    R, t = noisy(R, t)
    time = step * np.arange(len(t))
    time[60:] += 18 * step  # 0.6 s at 30 frames a second
    assert flights(time) == [slice(0, 60), slice(60, 120)]
    whole_R, whole_t = smooth(R, t, time)
    for part in flights(time):
        part_R, part_t = smooth(R[part], t[part], time[part])
        np.testing.assert_allclose(whole_R[part], part_R, atol=1e-12)
        np.testing.assert_allclose(whole_t[part], part_t, atol=1e-12)


def test_the_longest_gap_suits_the_frames() -> None:
    second = np.arange(30) / RATE
    assert default_longest_gap(second) == 0.5
    assert default_longest_gap(np.delete(second, [3, 4, 5, 9])) == 0.5  # some frames are lost
    assert default_longest_gap(np.arange(30.0)) == 5.0
    assert default_longest_gap([2.0]) == default_longest_gap([]) == 0.5
    assert flights(np.arange(30.0)) == [slice(0, 30)]
    assert flights([0.0, 1.0, 2.0, 8.0, 9.0]) == [slice(0, 3), slice(3, 5)]
    assert flights([0.0, 1.0, 2.0], longest_gap=0.5) == [slice(0, 1), slice(1, 2), slice(2, 3)]


def test_one_frame_a_second_is_smoothed() -> None:
    time = np.arange(60.0)
    R = np.tile(np.eye(3), (60, 1, 1))
    t = np.stack([0.2 * time, np.zeros(60), np.full(60, 5.0)], axis=1)
    measured = noisy(R, t)
    before = mean_errors(*measured, R, t)
    assert (mean_errors(*gaussian(*measured, time, sigma=3), R, t) < 0.6 * before).all()
    apart_R, apart_t = gaussian(*measured, time, sigma=3, longest_gap=0.5)
    np.testing.assert_allclose(apart_R, measured[0], atol=1e-12)
    np.testing.assert_allclose(apart_t, measured[1], atol=1e-12)
    calm = LiveFilter(acceleration=0.01, turning=0.01, longest_gap=5.0)
    restarts = LiveFilter(acceleration=0.01, turning=0.01)  # after half a second, which is every frame here
    assert (mean_errors(*filtered(*measured, time, calm), R, t) < 0.6 * before).all()
    np.testing.assert_array_equal(filtered(*measured, time, restarts)[1], measured[1])
    usual = LiveFilter(longest_gap=5.0)
    np.testing.assert_array_equal(filtered(*measured, time)[1], filtered(*measured, time, usual)[1])


def test_the_live_filter_calms_and_keeps_up() -> None:
    R, t, time = true_flight()
    before, after = [], []
    for seed in range(5):
        measured = noisy(R, t, seed)
        before.append(mean_errors(*measured, R, t))
        after.append(mean_errors(*filtered(*measured, time), R, t))
    assert (np.mean(after, axis=0) < 0.6 * np.mean(before, axis=0)).all()
    # The lag is the delay at which the path, its noise averaged out over seeds, fits the true one best.
    paths = [filtered(*noisy(R, t, seed), time)[1] for seed in range(20)]
    path = np.mean(paths, axis=0)[15:]
    misfits = [np.abs(path - t[15 - delay : len(t) - delay]).mean() for delay in range(8)]
    assert np.argmin(misfits) <= 2  # at most 2 frames, 0.07 s


def test_the_live_filter_knows_no_future() -> None:
    R, t, time = true_flight()
    R, t = noisy(R, t)
    whole = filtered(R, t, time)
    part = filtered(R[:50], t[:50], time[:50])
    np.testing.assert_array_equal(whole[1][:50], part[1])


def test_flips_are_passed_over_and_a_lasting_change_is_believed() -> None:
    R, t, time = true_flight()
    measured = noisy(R, t, flips=0.1)
    before = mean_errors(*measured, R, t)
    after = mean_errors(*filtered(*measured, time), R, t)
    assert before[0] > 20 and after[0] < 10
    live = LiveFilter()
    for i in range(60):  # after a second the drone is somewhere else, and stays there
        live.update(time[i], R[0], t[0] + (0 if i < 30 else 3))
    assert np.linalg.norm(live.t - t[0] - 3) < 0.3


@pytest.mark.parametrize("flipped, lost", [(1, 1), (2, 4), (4, 8)])
def test_a_flight_that_begins_flipped_recovers(flipped: int, lost: int) -> None:
    """As many good frames as flipped ones bring it back, and from there it is as good as any other flight."""
    R, t, time = true_flight()
    for seed in range(5):
        measured_R, measured_t = noisy(R, t, seed)
        undisturbed, _ = frame_errors(*filtered(measured_R, measured_t, time), R, t)
        measured_R[:flipped] = measured_R[:flipped] @ HALF_TURN
        unfiltered, _ = frame_errors(measured_R, measured_t, R, t)
        after, _ = frame_errors(*filtered(measured_R, measured_t, time), R, t)
        assert (unfiltered[:flipped] > 120).all() and (after[:flipped] > 120).all()
        assert (after[lost:] < 45).all()
        assert after[lost:].mean() < 0.8 * unfiltered[lost:].mean()
        np.testing.assert_allclose(after[-30:], undisturbed[-30:], atol=0.5)  # degrees


def test_a_filter_is_as_stubborn_as_it_is_confirmed() -> None:
    """One measurement gives way to one that contradicts it, three to three, many to `patience` and one."""
    R = np.eye(3)
    for accepted, contradictions in ((1, 1), (3, 3), (30, 6)):
        live = LiveFilter()
        for i in range(accepted):
            live.update(i / RATE, R, np.zeros(3))
        for i in range(contradictions):
            assert np.linalg.norm(live.t) < 0.1
            live.update((accepted + i) / RATE, R, np.array([9.0, 0, 0]))
        np.testing.assert_array_equal(live.t, [9, 0, 0])


def test_without_a_measurement_it_predicts_then_gives_up() -> None:
    live, R = LiveFilter(), np.eye(3)
    assert live.update(0.0, None, None) is None
    for i in range(1, 31):
        live.update(i / RATE, R, np.array([0.1 * i, 0, 5]))
    _, ahead = live.update(31 / RATE, None, None)
    assert ahead[0] == pytest.approx(3.1, abs=0.05)  # it keeps its velocity
    assert live.update(2.0, None, None) is None
    _, back = live.update(2.1, R, np.array([9.0, 0, 5]))
    assert back[0] == 9  # a new flight


def test_a_better_measurement_counts_more() -> None:
    moved = []
    for variance in (0.01, 1.0):
        live = LiveFilter()
        live.update(0.0, np.eye(3), np.zeros(3))
        _, t = live.update(0.1, np.eye(3), np.array([0.2, 0, 0]), position_cov=variance * np.eye(3))
        moved.append(t[0])
    assert 0 < moved[1] < moved[0] <= 0.2


@pytest.mark.parametrize(
    "change, match",
    [
        (dict(t=np.zeros((3, 2))), "a flight needs R"),
        (dict(R=np.zeros((3, 3, 3))), "a flight's R: not orthonormal"),
        (dict(time=[0.0, 0.1, 0.1]), "times must rise"),
        (dict(weights=[1, -1, 1]), "below 0"),
        (dict(t=np.full((3, 3), np.nan)), "must be finite"),
        (dict(weights=[0, 0, 0]), "frame 0 and its neighbours have no weight"),
    ],
)
def test_bad_flights(change: dict, match: str) -> None:
    flight = {"R": np.tile(np.eye(3), (3, 1, 1)), "t": np.zeros((3, 3)), "time": [0.0, 0.1, 0.2], **change}
    with pytest.raises(InputError, match=match):
        gaussian(**flight)


@pytest.mark.parametrize("sigma", [-1.0, np.nan])
def test_bad_width(sigma: float) -> None:
    with pytest.raises(InputError, match="0 or more"):
        gaussian(np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)), [0.0, 0.1, 0.2], sigma=sigma)


@pytest.mark.parametrize("smooth", [gaussian, filtered])
def test_a_flight_without_frames(smooth: Callable[..., Poses]) -> None:
    R, t = smooth(np.zeros((0, 3, 3)), np.zeros((0, 3)), [])
    assert R.shape == (0, 3, 3) and t.shape == (0, 3)


def test_the_live_filter_shares_no_array_with_its_caller() -> None:
    live, R, t = LiveFilter(), np.eye(3), np.zeros(3)
    live.update(0.0, R, t)
    R[:], t[:] = 0, 5  # a loop that fills one buffer again and again
    filtered_R, filtered_t = live.update(0.1, None, None)
    np.testing.assert_array_equal(filtered_R, np.eye(3))
    filtered_t[:] = 7
    assert np.abs(live.update(0.2, None, None)[1]).max() == 0


def test_bad_measurements() -> None:
    live = LiveFilter()
    live.update(1.0, np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="time 1 s does not come after 1 s"):
        live.update(1.0, np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="finite R"):
        live.update(2.0, np.eye(3) * np.nan, np.zeros(3))
    with pytest.raises(InputError, match="finite R"):
        live.update(2.0, np.eye(3), np.full(3, np.inf))
    with pytest.raises(InputError, match="not orthonormal"):
        live.update(2.0, 2 * np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="time nan"):
        live.update(np.nan, np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="rotation_cov holds NaN"):
        live.update(2.0, np.eye(3), np.zeros(3), rotation_cov=np.full((3, 3), np.nan))
    with pytest.raises(InputError, match=r"position_cov must be \(3, 3\)"):
        live.update(2.0, np.eye(3), np.zeros(3), position_cov=np.eye(2))
    assert live.accepted == 1 and live.passed_over == 0  # none of them counted


def test_covariances_of_other_frames() -> None:
    R, t, time = true_flight(seconds=1)
    with pytest.raises(InputError, match="30 poses need as many covariances, got 29"):
        filtered(R, t, time, covariance=np.tile(np.eye(6), (29, 1, 1)))


# --- what other units and slips look like ---------------------------------------------------------------


def frames(count: int = 4) -> Poses:
    return np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))


@pytest.mark.parametrize("smooth", [gaussian, filtered])
def test_times_in_milliseconds_are_refused(smooth: Callable[..., Poses]) -> None:
    """Taken for seconds they would lie so far apart that no frame had a neighbour, without a word."""
    with pytest.raises(InputError, match="time.*33 a frame: they are in seconds"):
        smooth(*frames(), [0.0, 33.0, 67.0, 100.0])
    smooth(*frames(), [0.0, 1.0, 2.0, 40.0])  # one frame a second, and once lost for long


def test_a_live_filter_refuses_milliseconds() -> None:
    live = LiveFilter()
    with pytest.raises(InputError, match="time rises by 33 again and again: they are in seconds"):
        for frame in range(5):
            live.update(33.0 * frame, np.eye(3), np.zeros(3))


def test_a_live_filter_may_lose_the_drone_for_long() -> None:
    live = LiveFilter()
    for start in (0.0, 100.0, 200.0, 300.0, 400.0):
        for frame in range(3):
            assert live.update(start + 0.1 * frame, np.eye(3), np.zeros(3)) is not None
    for frame in range(100):
        live.update(500 + frame / 10, None, None)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("position_noise", -0.15),
        ("rotation_noise", 0.0),
        ("acceleration", -3.0),
        ("turning", np.nan),
        ("gate", 99.9),
        ("longest_gap", -1.0),
        ("patience", 0),
    ],
)
def test_impossible_settings_of_the_live_filter(setting: str, value: float) -> None:
    with pytest.raises(InputError, match=f"^{setting}={value}"):
        LiveFilter(**{setting: value})


INDEFINITE = np.eye(3)
INDEFINITE[0, 1] = INDEFINITE[1, 0] = 2.0


@pytest.mark.parametrize(
    ("covariance", "match"),
    [
        (INDEFINITE, "position_cov is no covariance: indefinite"),
        (-np.eye(3), "position_cov is no covariance: a variance is -1"),
        (np.triu(np.ones((3, 3))), "position_cov is no covariance: not symmetric"),
        (np.eye(3) * 1j, "position_cov holds complex"),
    ],
)
def test_what_is_no_covariance(covariance: np.ndarray, match: str) -> None:
    with pytest.raises(InputError, match=match):
        LiveFilter().update(0.0, np.eye(3), np.zeros(3), position_cov=covariance)


def test_indefinite_covariances_of_a_flight() -> None:
    covariance = np.tile(np.eye(6), (4, 1, 1))
    covariance[2, 0, 1] = covariance[2, 1, 0] = 2.0
    with pytest.raises(InputError, match="covariance is no covariance: indefinite"):
        filtered(*frames(), [0.0, 0.1, 0.2, 0.3], covariance=covariance)
    with pytest.raises(InputError, match="covariance is no covariance: indefinite"):
        inverse_variances(covariance)
    with pytest.raises(InputError, match=r"needed is \(F, 6, 6\)"):
        inverse_variances(covariance[0])


def test_a_pose_needs_both_its_parts() -> None:
    with pytest.raises(InputError, match="both R and t"):
        LiveFilter().update(0.0, None, np.zeros(3))


def test_gaps_are_seconds_above_0() -> None:
    with pytest.raises(InputError, match="longest_gap=-1.0"):
        gaussian(*frames(), [0.0, 0.1, 0.2, 0.3], longest_gap=-1.0)
    with pytest.raises(InputError, match=r"time has shape \(4, 1\)"):
        gaussian(*frames(), np.zeros((4, 1)))
