"""Smoothing a flight: noise goes down, nothing crosses a gap, the live filter keeps up and is not fooled by a flip."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dronekeypp.errors import InputError
from dronekeypp.sequences import LiveFilter, filtered, flights, gaussian, inverse_variances

RATE = 30.0  # frames a second


def true_flight(seconds=4.0):
    """A curve that banks: (R, t, time)."""
    time = np.arange(round(seconds * RATE)) / RATE
    t = np.stack([np.sin(1.2 * time), 0.3 * np.cos(time), 4 + 0.8 * time], axis=1)
    angles = np.stack([0.9 * time, 0.2 * np.sin(time), 0.3 * np.cos(1.5 * time)], axis=1)
    return Rotation.from_euler("ZYX", angles).as_matrix(), t, time


def noisy(R, t, seed=0, turn=0.15, place=0.15, flips=0.0):
    """Measured: rotations off by `turn` radians, positions by `place` metres, a share `flips` of headings the wrong way round."""
    rng = np.random.default_rng(seed)
    flipped = np.where(rng.random(len(t)) < flips, np.pi, 0.0)
    wrong = Rotation.from_rotvec(rng.normal(0, turn, (len(t), 3))) * Rotation.from_euler(
        "Z", flipped[:, None]
    )
    return (Rotation.from_matrix(R) * wrong).as_matrix(), t + rng.normal(0, place, t.shape)


def errors(R, t, true_R, true_t):
    """Mean (degrees, metres)."""
    turned = (Rotation.from_matrix(true_R).inv() * Rotation.from_matrix(R)).magnitude()
    return np.degrees(turned).mean(), np.linalg.norm(t - true_t, axis=1).mean()


def test_a_gaussian_halves_the_noise():
    R, t, time = true_flight()
    before = errors(*noisy(R, t), R, t)
    after = errors(*gaussian(*noisy(R, t), time, sigma=0.1), R, t)
    assert after[0] < 0.45 * before[0] and after[1] < 0.45 * before[1]


def test_a_gaussian_by_hand():
    R = Rotation.from_euler("Z", [[0.0], [20.0], [90.0]], degrees=True).as_matrix()
    t, time = np.array([[0.0, 0, 1], [0, 0, 2], [0, 0, 5]]), np.array([0.0, 0.1, 0.2])
    even_R, even_t = gaussian(R, t, time, sigma=1e6, weights=[1, 1, 0])
    assert np.degrees(Rotation.from_matrix(even_R[0]).as_euler("ZYX")[0]) == pytest.approx(10)
    np.testing.assert_allclose(even_t, np.tile([0, 0, 1.5], (3, 1)), atol=1e-9)
    w = np.exp(-np.square(time - 0.1) / (2 * 0.1**2))
    np.testing.assert_allclose(gaussian(R, t, time, sigma=0.1)[1][1], w @ t / w.sum())
    same_R, same_t = gaussian(R, t, time, sigma=0)
    assert np.array_equal(same_R, R) and np.array_equal(same_t, t)


def test_a_rotation_and_a_translation_may_be_trusted_differently():
    R = Rotation.from_euler("Z", [[0.0], [20.0], [90.0]], degrees=True).as_matrix()
    t, time = np.array([[0.0, 0, 1], [0, 0, 2], [0, 0, 5]]), np.array([0.0, 0.1, 0.2])
    even_R, even_t = gaussian(R, t, time, sigma=1e6, weights=[[1, 0], [1, 1], [0, 1]])
    assert np.degrees(Rotation.from_matrix(even_R[0]).as_euler("ZYX")[0]) == pytest.approx(10)
    np.testing.assert_allclose(even_t[0], [0, 0, 3.5], atol=1e-9)
    np.testing.assert_allclose(inverse_variances(np.diag([0.01, 0.04, 0.05, 1, 1, 2])[None]), [[10, 0.25]])


def uneven(seed):
    """A flight of which every third frame is ten times as noisy, and the covariance (F, 6, 6) that says so, in camera axes."""
    R, t, time = true_flight()
    bad = np.arange(len(time)) % 3 == 0
    fine, rough = noisy(R, t, seed, turn=0.05, place=0.05), noisy(R, t, seed + 100, turn=0.5, place=0.5)
    measured = [
        np.where(bad.reshape(-1, *[1] * (one.ndim - 1)), two, one)
        for one, two in zip(fine, rough, strict=True)
    ]
    return measured, np.where(bad, 0.25, 0.0025)[:, None, None] * np.eye(6), (R, t, time)


def test_a_covariance_that_is_right_is_worth_something():
    """Of the Gaussian and of the live filter: told which frames are bad, either is far better than when it takes them all alike."""
    ratios = []
    for seed in range(3):
        measured, covariance, (R, t, time) = uneven(seed)
        plain, told = (
            errors(*gaussian(*measured, time, 0.1, w), R, t) for w in (None, inverse_variances(covariance))
        )
        alike, aware = (errors(*filtered(*measured, time, None, c), R, t) for c in (None, covariance))
        ratios.append([np.divide(told, plain), np.divide(aware, alike)])
    told, aware = np.mean(ratios, axis=0)
    assert (told < 0.4).all() and (aware < 0.8).all()


def test_the_covariance_of_a_turn_is_in_camera_axes():
    """Sure about the camera's x axis alone: of a turn about it the filter takes over more than of a turn about the others."""
    start = np.eye(3)[
        [1, 2, 0]
    ]  # the camera's x axis is the body's y, its y the body's z, its z the body's x
    R = np.stack(
        [start] * 30 + [(Rotation.from_rotvec([0.1, 0.1, 0.0]) * Rotation.from_matrix(start)).as_matrix()]
    )
    covariance = np.tile(np.diag([1e-4, 1.0, 1.0, 1, 1, 1]), (31, 1, 1))
    covariance[:-1] = 0.01 * np.eye(6)
    turned = Rotation.from_matrix(
        filtered(R, np.tile([0.0, 0, 3], (31, 1)), np.arange(31) / RATE, None, covariance)[0][-1] @ start.T
    ).as_rotvec()
    assert turned[0] > 0.08 and abs(turned[1]) < 0.02


def test_far_neighbours_count_for_nothing():
    R, t, time = true_flight()
    near = np.exp(-np.square(time[:, None] - time[None]) / (2 * 0.05**2))
    np.testing.assert_allclose(
        gaussian(R, t, time, sigma=0.05)[1], near @ t / near.sum(axis=1, keepdims=True), atol=1e-6
    )


def test_nothing_crosses_a_gap():
    R, t, time = true_flight()
    R, t = noisy(R, t)
    late = np.where(np.arange(len(time)) < 60, time, time + 0.6)
    assert flights(late) == [slice(0, 60), slice(60, 120)] and flights(time) == [slice(0, 120)]
    for smooth in (lambda *flight: gaussian(*flight, sigma=0.3), filtered):
        whole, parts = smooth(R, t, late), [smooth(R[s], t[s], late[s]) for s in flights(late)]
        for i in (0, 1):
            np.testing.assert_allclose(whole[i], np.concatenate([part[i] for part in parts]), atol=1e-12)


def test_the_live_filter_calms_and_keeps_up():
    R, t, time = true_flight()
    before, after = [], []
    for seed in range(5):
        measured = noisy(R, t, seed)
        before.append(errors(*measured, R, t))
        after.append(errors(*filtered(*measured, time), R, t))
    ratio = np.mean(after, axis=0) / np.mean(before, axis=0)
    assert ratio[0] < 0.6 and ratio[1] < 0.6
    # lag: the delay at which the filtered path, its noise averaged out over seeds, fits the true one best
    path = np.mean([filtered(*noisy(R, t, seed), time)[1] for seed in range(20)], axis=0)[15:]
    delays = np.arange(0, 8)
    fits = [np.abs(path - t[15 - d : len(t) - d]).mean() for d in delays]
    assert delays[np.argmin(fits)] <= 2  # at most 2 frames, 0.07 s


def test_the_live_filter_knows_no_future():
    R, t, time = true_flight()
    R, t = noisy(R, t)
    whole = filtered(R, t, time)
    part = filtered(R[:50], t[:50], time[:50])
    np.testing.assert_array_equal(whole[1][:50], part[1])


def test_flips_are_passed_over_and_a_lasting_change_is_believed():
    R, t, time = true_flight()
    R_measured, t_measured = noisy(R, t, flips=0.1)
    before, after = (
        errors(R_measured, t_measured, R, t),
        errors(*filtered(R_measured, t_measured, time), R, t),
    )
    assert before[0] > 20 and after[0] < 10
    live = LiveFilter()
    for i in range(60):  # after two seconds the drone is somewhere else, and stays there
        live.update(time[i], R[0], t[0] + (0 if i < 30 else 3))
    assert np.linalg.norm(live.t - t[0] - 3) < 0.3


def test_without_a_measurement_it_predicts_then_gives_up():
    live, R = LiveFilter(), np.eye(3)
    assert live.update(0.0, None, None) is None
    for i in range(1, 31):
        live.update(i / RATE, R, np.array([0.1 * i, 0, 5]))
    _, ahead = live.update(31 / RATE, None, None)
    assert ahead[0] == pytest.approx(3.1, abs=0.05)  # it keeps its velocity
    assert live.update(2.0, None, None) is None
    _, back = live.update(2.1, R, np.array([9.0, 0, 5]))
    assert back[0] == 9  # a new flight


def test_a_better_measurement_counts_more():
    found = []
    for noise in (0.01, 1.0):
        live = LiveFilter()
        live.update(0.0, np.eye(3), np.zeros(3))
        found.append(live.update(0.1, np.eye(3), np.array([0.2, 0, 0]), position_cov=noise * np.eye(3))[1][0])
    assert 0 < found[1] < found[0] <= 0.2


@pytest.mark.parametrize(
    "change, match",
    [
        (dict(t=np.zeros((3, 2))), "a flight needs R"), (dict(R=np.zeros((3, 3, 3))), "a flight's R: not orthonormal"),
        (dict(time=[0.0, 0.1, 0.1]), "times must rise"), (dict(weights=[1, -1, 1]), "below 0"),
        (dict(t=np.full((3, 3), np.nan)), "must be finite"), (dict(weights=[0, 0, 0]), "frame 0 and its neighbours have no weight"),
    ],
)  # fmt: skip
def test_bad_flights(change, match):
    flight = {"R": np.tile(np.eye(3), (3, 1, 1)), "t": np.zeros((3, 3)), "time": [0.0, 0.1, 0.2], **change}
    with pytest.raises(InputError, match=match):
        gaussian(**flight)


@pytest.mark.parametrize("sigma", [-1.0, np.nan])
def test_bad_width(sigma):
    with pytest.raises(InputError, match="0 or more"):
        gaussian(np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)), [0.0, 0.1, 0.2], sigma=sigma)


def test_a_flight_without_frames():
    R, t = gaussian(np.zeros((0, 3, 3)), np.zeros((0, 3)), [])
    assert R.shape == (0, 3, 3) and t.shape == (0, 3)


def test_the_live_filter_shares_no_array_with_its_caller():
    live, R, t = LiveFilter(), np.eye(3), np.zeros(3)
    live.update(0.0, R, t)
    R[:], t[:] = 0, 5  # a loop that fills one buffer again and again
    found = live.update(0.1, None, None)
    np.testing.assert_array_equal(found[0], np.eye(3))
    found[1][:] = 7
    assert np.abs(live.update(0.2, None, None)[1]).max() == 0


def test_bad_measurements():
    live = LiveFilter()
    live.update(1.0, np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="time 1 s does not come after 1 s"):
        live.update(1.0, np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="finite R"):
        live.update(2.0, np.eye(3) * np.nan, np.zeros(3))
    with pytest.raises(InputError, match="not orthonormal"):
        live.update(2.0, 2 * np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="time nan"):
        live.update(np.nan, np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="rotation_cov must be finite"):
        live.update(2.0, np.eye(3), np.zeros(3), rotation_cov=np.full((3, 3), np.nan))
