"""Exercises of notebook 11, from pictures to flights."""

import numpy as np
from scipy.spatial.transform import Rotation

from dronekeypp import sequences
from dronekeypp.checks import Exercise


def one_step(rng):
    """place (m), its standard deviation (m), speed (m/s), seconds, drift (m), measured (m), noise (m)."""
    place, speed, seconds = rng.uniform(2, 5), rng.uniform(-2, 2), rng.uniform(0.05, 0.3)
    measured = place + speed * seconds + rng.choice([-1, 1]) * rng.uniform(0.1, 0.5)
    return (
        place,
        rng.uniform(0.1, 0.3),
        speed,
        seconds,
        rng.uniform(0.04, 0.1),
        measured,
        rng.uniform(0.1, 0.4),
    )


def kalman_step(
    place,
    spread,
    speed,
    seconds,
    drift,
    measured,
    noise,
    power=2,
    moves=True,
    drifts=True,
    trust="measured",
    root=True,
    shrinks=True,
):
    """The solution, and with other arguments the mistakes."""
    place, variance = place + speed * seconds * moves, spread**power + drift**power * drifts
    gain = (variance if trust == "measured" else noise**power) / (variance + noise**power)
    place, variance = place + gain * (measured - place), (1 - gain) * variance if shrinks else variance
    return place, variance ** (1 / power) if root else variance


def flight_with_gaps(rng):
    """Places (30, 3) m, times (30,) s with two gaps, sigma (s), the longest gap (s) that is none."""
    steps = rng.uniform(0.05, 0.12, 30)
    steps[[rng.integers(8, 13), rng.integers(17, 22)]] = rng.uniform(0.55, 0.7, 2)
    return rng.normal(0, 0.2, (30, 3)).cumsum(axis=0) + [0, 0, 4], steps.cumsum(), rng.uniform(0.2, 0.3), 0.5


def smooth_across_gaps(
    t, time, sigma, longest_gap, gaps="cut", norm=True, frames=False, power=2, past=False, two=2
):
    """The solution, and with other arguments the mistakes."""
    clock = np.arange(len(t)) if frames else time
    apart = clock[:, None] - clock
    weights = np.exp(-(apart**2) / (two * sigma**power))
    flight = np.cumsum(np.diff(time, prepend=time[0]) > longest_gap)
    if gaps == "cut":
        weights = weights * (flight[:, None] == flight)
    elif gaps == "far":
        weights = weights * (np.abs(apart) <= longest_gap)
    weights = np.tril(weights) if past else weights
    return weights @ t / (weights.sum(axis=1, keepdims=True) if norm else 1)


def gaussian_positions(t, time, sigma, longest_gap):
    return sequences.gaussian(np.tile(np.eye(3), (len(t), 1, 1)), t, time, sigma, longest_gap=longest_gap)[1]


def wild_rotations(rng):
    """Rotations (4, 3, 3), so far apart that their mean matrix often mirrors, and weights (4,)."""
    mirrored = rng.random() < 0.7
    while True:
        R, weights = Rotation.from_quat(rng.normal(size=(4, 4))).as_matrix(), rng.uniform(0.2, 1, 4)
        mean = np.einsum("n,nij->ij", weights, R) / weights.sum()
        sizes = np.linalg.svd(mean, compute_uv=False)
        if (np.linalg.det(mean) < 0) == mirrored and sizes[2] > 0.02 and sizes[1] - sizes[2] > 0.05:
            return R, weights


def mean_rotation(R, weights, mend="last", project=True, transposed=False):
    """As the notebook's solution writes it, and with other arguments the mistakes."""
    mean = np.einsum("n,nij->ij", weights, R) / weights.sum()
    if not project:
        return mean
    U, _, Vt = np.linalg.svd(mean)
    sign = np.sign(np.linalg.det(U @ Vt))
    nearest = {
        "last": U @ np.diag([1, 1, sign]) @ Vt,
        "all": sign * U @ Vt,
        "none": U @ Vt,
        "first": U @ np.diag([sign, 1, 1]) @ Vt,
    }[mend]
    return nearest.T if transposed else nearest


def wild_flight(rng):
    """Measured places (60,) m, drift and noise (m): a random walk, and every fourth measurement or so is wild."""
    drift, noise = rng.uniform(0.06, 0.12), rng.uniform(0.1, 0.15)
    wild = (rng.random(60) < 0.25) * rng.choice([-1, 1], 60) * rng.uniform(3, 8, 60) * noise
    wild[0] = 0
    return rng.normal(0, drift, 60).cumsum() + 4 + rng.normal(0, noise, 60) + wild, drift, noise


def gated_filter(places, drift, noise, gate="both", grows=True, power=2, adopts=False):
    """The solution, and with other arguments the mistakes."""
    place, variance, found = places[0], noise**power, [places[0]]
    for measured in places[1:]:
        grown = variance + drift**power
        width = {"both": grown + noise**power, "noise": noise**power, "state": grown, "none": np.inf}[
            gate
        ] ** (1 / power)
        if abs(measured - place) <= 3 * width:
            gain = grown / (grown + noise**power)
            place, variance = place + gain * (measured - place), (1 - gain) * grown
        else:
            variance = grown if grows else variance
            place = measured if adopts else place
        found.append(place)
    return np.array(found)


EXERCISES = [
    Exercise(
        "kalman_step",
        kalman_step,
        one_step,
        {
            "what adds up are variances, squares of the standard deviations; you forgot the squares": lambda *given: (
                kalman_step(*given, power=1)
            ),
            "the place is right; the second number is a variance: the standard deviation is its root": lambda *given: (
                kalman_step(*given, root=False)
            ),
            "the prediction does not move: add speed times seconds to the place": lambda *given: kalman_step(
                *given, moves=False
            ),
            "you forgot the drift: predicting makes the filter less sure": lambda *given: kalman_step(
                *given, drifts=False
            ),
            "your gain is upside down: the less sure the filter is of itself, the more it trusts the measurement": (
                lambda *given: kalman_step(*given, trust="self")
            ),
            "the place is right, but the measurement makes the filter surer: multiply the variance by 1 - gain": (
                lambda *given: kalman_step(*given, shrinks=False)
            ),
        },
    ),
    Exercise(
        "smooth_across_gaps",
        gaussian_positions,
        flight_with_gaps,
        {
            "you average across the gaps: frames before and after one do not belong together": lambda *given: (
                smooth_across_gaps(*given, gaps="none")
            ),
            "you drop neighbours that are far in time; what counts is whether a gap lies between the two frames": (
                lambda *given: smooth_across_gaps(*given, gaps="far")
            ),
            "the weights do not add up to 1: divide by their sum": lambda *given: smooth_across_gaps(
                *given, norm=False
            ),
            "you counted frames; sigma is in seconds, and frames do not come evenly": lambda *given: (
                smooth_across_gaps(*given, frames=True)
            ),
            "sigma is squared in the exponent": lambda *given: smooth_across_gaps(*given, power=1),
            "the exponent is divided by 2 sigma squared; your 2 is missing": lambda *given: (
                smooth_across_gaps(*given, two=1)
            ),
            "you look only at the past; here the frames after this one count as well": lambda *given: (
                smooth_across_gaps(*given, past=True)
            ),
        },
    ),
    Exercise(
        "mean_rotation",
        lambda R, weights: Rotation.from_matrix(R).mean(weights).as_matrix(),
        wild_rotations,
        {
            "where det(U @ Vt) is -1 your answer is a mirror, no rotation: turn the sign of the last axis of U": (
                lambda *given: mean_rotation(*given, mend="none")
            ),
            "this is the mean matrix; it is no rotation: find the nearest one with an SVD": lambda *given: (
                mean_rotation(*given, project=False)
            ),
            "you forgot the weights": lambda R, weights: mean_rotation(R, np.ones(len(R))),
            "your answer is transposed: np.linalg.svd returns U and V transposed, so the product is U @ Vt": (
                lambda *given: mean_rotation(*given, transposed=True)
            ),
            "turning all three axes does make a rotation, but not the nearest: turn only the last, the least certain": (
                lambda *given: mean_rotation(*given, mend="all")
            ),
            "you turned the first axis, the surest; turn the last, which costs least": lambda *given: (
                mean_rotation(*given, mend="first")
            ),
            "you averaged rotation vectors; near half a turn their sign jumps. Average the matrices": (
                lambda R, weights: Rotation.from_rotvec(
                    np.average(Rotation.from_matrix(R).as_rotvec(), axis=0, weights=weights)
                ).as_matrix()
            ),
        },
        tries=8,
    ),
    Exercise(
        "gated_filter",
        gated_filter,
        wild_flight,
        {
            "nothing is passed over: skip a measurement farther than 3 standard deviations from the prediction": (
                lambda *given: gated_filter(*given, gate="none")
            ),
            "your gate knows only the measurement's noise; the prediction is unsure as well: add its variance": (
                lambda *given: gated_filter(*given, gate="noise")
            ),
            "your gate knows only the prediction's variance; add the measurement's": lambda *given: (
                gated_filter(*given, gate="state")
            ),
            "passed over or not, time goes by: add drift squared in every frame": lambda *given: gated_filter(
                *given, grows=False
            ),
            "what adds up are variances, squares of the standard deviations; you forgot the squares": lambda *given: (
                gated_filter(*given, power=1)
            ),
            "a measurement that is passed over leaves the place where it was; you took it over": lambda *given: (
                gated_filter(*given, adopts=True)
            ),
            "one answer a frame, also for the first: it is the first measurement": lambda *given: (
                gated_filter(*given)[1:]
            ),
        },
    ),
]
