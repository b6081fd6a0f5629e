"""Exercises of notebook 11, from pictures to flights."""

from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from dronekeypp import sequences
from dronekeypp.checks import Exercise, Mistake

# --- kalman_step ---


def one_step(rng: np.random.Generator) -> tuple[float, float, float, float, float, float, float]:
    """Draw place, spread, speed, seconds, drift, measured and noise.

    Lengths are metres, and the speed is metres per second. Spread, drift and noise are standard deviations.
    """
    place, speed, seconds = rng.uniform(2, 5), rng.uniform(-2, 2), rng.uniform(0.05, 0.3)
    measured = place + speed * seconds + rng.choice([-1, 1]) * rng.uniform(0.1, 0.5)
    spread, drift, noise = rng.uniform(0.1, 0.3), rng.uniform(0.04, 0.1), rng.uniform(0.1, 0.4)
    return place, spread, speed, seconds, drift, measured, noise


def kalman_step(
    place: float,
    spread: float,
    speed: float,
    seconds: float,
    drift: float,
    measured: float,
    noise: float,
    *,
    power: float = 2,
    moves: bool = True,
    drifts: bool = True,
    inverts_gain: bool = False,
    takes_root: bool = True,
    shrinks_variance: bool = True,
) -> tuple[float, float]:
    """Solve the exercise: the corrected place and its standard deviation, metres. Options make mistakes."""
    variance = spread**power
    if moves:
        place = place + speed * seconds
    if drifts:
        variance = variance + drift**power
    gain = (noise**power if inverts_gain else variance) / (variance + noise**power)
    place = place + gain * (measured - place)
    if shrinks_variance:
        variance = (1 - gain) * variance
    return place, variance ** (1 / power) if takes_root else variance


# --- smooth_across_gaps ---


def flight_with_gaps(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Draw positions (30, 3) m, times (30,) s with two gaps, and sigma in seconds.

    The last number is the longest time in seconds that is not a gap.
    """
    steps = rng.uniform(0.05, 0.12, 30)
    steps[[rng.integers(8, 13), rng.integers(17, 22)]] = rng.uniform(0.55, 0.7, 2)
    return rng.normal(0, 0.2, (30, 3)).cumsum(axis=0) + [0, 0, 4], steps.cumsum(), rng.uniform(0.2, 0.3), 0.5


def gaussian_positions(t: np.ndarray, time: np.ndarray, sigma: float, longest_gap: float) -> np.ndarray:
    """Solve the exercise with the package: the smoothed positions (F, 3) in metres."""
    R = np.tile(np.eye(3), (len(t), 1, 1))
    return sequences.gaussian(R, t, time, sigma, longest_gap=longest_gap)[1]


def smooth_across_gaps(
    t: np.ndarray,
    time: np.ndarray,
    sigma: float,
    longest_gap: float,
    *,
    gaps: str = "cut",
    normalises: bool = True,
    counts_frames: bool = False,
    sigma_power: float = 2,
    sigma_factor: float = 2,
    past_only: bool = False,
) -> np.ndarray:
    """Solve the exercise: the smoothed positions (F, 3) in metres. Other options make mistakes.

    Args:
        t: (F, 3) positions in metres.
        time: (F,) seconds.
        sigma: seconds.
        longest_gap: seconds; a longer step begins a new flight.
        gaps: "cut" separates the flights. "far" drops neighbours that are far in time, and "none" drops none.
        normalises: divide by the sum of the weights.
        counts_frames: measure time in frames.
        sigma_power: the power of sigma in the exponent.
        sigma_factor: the factor of sigma in the exponent.
        past_only: ignore later frames.
    """
    clock = np.arange(len(t)) if counts_frames else time
    apart = clock[:, None] - clock  # (F, F)
    weights = np.exp(-(apart**2) / (sigma_factor * sigma**sigma_power))
    if gaps == "cut":
        flight = np.cumsum(np.diff(time, prepend=time[0]) > longest_gap)  # (F,)
        weights = weights * (flight[:, None] == flight)
    elif gaps == "far":
        weights = weights * (np.abs(apart) <= longest_gap)
    if past_only:
        weights = np.tril(weights)
    return weights @ t / (weights.sum(axis=1, keepdims=True) if normalises else 1)


# --- mean_rotation ---


def rotations_far_apart(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw rotations (4, 3, 3) and weights (4,). The mean matrix often has a negative determinant."""
    mirrored = rng.random() < 0.7
    while True:
        R, weights = Rotation.from_quat(rng.normal(size=(4, 4))).as_matrix(), rng.uniform(0.2, 1, 4)
        mean = weighted_mean(R, weights)
        singular_values = np.linalg.svd(mean, compute_uv=False)
        is_mirror = np.linalg.det(mean) < 0
        # The last axis must be clearly the least certain one, or the nearest rotation is not unique.
        clear = singular_values[2] > 0.02 and singular_values[1] - singular_values[2] > 0.05
        if is_mirror == mirrored and clear:
            return R, weights


def weighted_mean(R: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean (3, 3) of the matrices, which is no rotation."""
    return np.einsum("n,nij->ij", weights, R) / weights.sum()


def scipy_mean(R: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Solve the exercise with scipy: the mean rotation (3, 3)."""
    return Rotation.from_matrix(R).mean(weights).as_matrix()


def nearest_orthogonal(R: np.ndarray, weights: np.ndarray, turned_axes: list[int]) -> np.ndarray:
    """Return an orthogonal matrix near the mean matrix, (3, 3).

    If the nearest orthogonal matrix is a mirror, the signs of `turned_axes` are changed. [2] is right.
    """
    U, _, Vt = np.linalg.svd(weighted_mean(R, weights))
    signs = np.ones(3)
    signs[turned_axes] = np.sign(np.linalg.det(U @ Vt))
    return U @ np.diag(signs) @ Vt


def transposed_mean(R: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return nearest_orthogonal(R, weights, [2]).T


def ignores_weights(R: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return nearest_orthogonal(R, np.ones(len(R)), [2])


def averages_rotation_vectors(R: np.ndarray, weights: np.ndarray) -> np.ndarray:
    vectors = Rotation.from_matrix(R).as_rotvec()
    return Rotation.from_rotvec(np.average(vectors, axis=0, weights=weights)).as_matrix()


# --- gated_filter ---


def flight_with_outliers(rng: np.random.Generator) -> tuple[np.ndarray, float, float]:
    """Draw measured places (60,) of a random walk, and the standard deviations drift and noise, in metres.

    About every fourth measurement is wild. The first one is not.
    """
    drift, noise = rng.uniform(0.06, 0.12), rng.uniform(0.1, 0.15)
    outliers = (rng.random(60) < 0.25) * rng.choice([-1, 1], 60) * rng.uniform(3, 8, 60) * noise
    outliers[0] = 0
    walk = rng.normal(0, drift, 60).cumsum() + 4
    return walk + rng.normal(0, noise, 60) + outliers, drift, noise


def gated_filter(
    places: np.ndarray,
    drift: float,
    noise: float,
    *,
    gate: str = "both",
    grows_if_skipped: bool = True,
    power: float = 2,
    adopts_skipped: bool = False,
) -> np.ndarray:
    """Solve the exercise: the filter's places (F,) in metres. Other options make mistakes.

    Args:
        places: (F,) measurements in metres.
        drift: the standard deviation of the motion between two frames, metres.
        noise: the standard deviation of a measurement, metres.
        gate: the variance that sets the gate's width: that of the "noise", of the "prediction", of "both", or
            "none" for an open gate.
        grows_if_skipped: the variance grows although the measurement is skipped.
        power: what turns a standard deviation into a variance.
        adopts_skipped: move to a measurement that is skipped.
    """
    place, variance = places[0], noise**power
    filtered = [place]
    for measured in places[1:]:
        predicted_variance = variance + drift**power
        innovation_variance = predicted_variance + noise**power
        if gate == "both":
            gate_variance = innovation_variance
        elif gate == "noise":
            gate_variance = noise**power
        elif gate == "prediction":
            gate_variance = predicted_variance
        else:
            gate_variance = np.inf
        if abs(measured - place) <= 3 * gate_variance ** (1 / power):
            gain = predicted_variance / innovation_variance
            place = place + gain * (measured - place)
            variance = (1 - gain) * predicted_variance
        else:
            if grows_if_skipped:
                variance = predicted_variance
            if adopts_skipped:
                place = measured
        filtered.append(place)
    return np.array(filtered)


EXERCISES = [
    Exercise(
        name="kalman_step",
        solution=kalman_step,
        inputs=one_step,
        mistakes=[
            Mistake(
                "You added standard deviations. Add variances, which are their squares.",
                partial(kalman_step, power=1),
            ),
            Mistake(
                "The place is right, but the second number is a variance. Take its root.",
                partial(kalman_step, takes_root=False),
            ),
            Mistake(
                "Your prediction does not move. Add speed times seconds to the place.",
                partial(kalman_step, moves=False),
            ),
            Mistake(
                "The drift is missing. It makes the prediction less certain.",
                partial(kalman_step, drifts=False),
            ),
            Mistake(
                "Your gain is inverted. The less certain the prediction, the more the measurement counts.",
                partial(kalman_step, inverts_gain=True),
            ),
            Mistake(
                "The place is right, but the measurement reduces the variance. Multiply it by 1 - gain.",
                partial(kalman_step, shrinks_variance=False),
            ),
        ],
    ),
    Exercise(
        name="smooth_across_gaps",
        solution=gaussian_positions,
        inputs=flight_with_gaps,
        mistakes=[
            Mistake(
                "You averaged across gaps. Frames before and after a gap do not belong together.",
                partial(smooth_across_gaps, gaps="none"),
            ),
            Mistake(
                "You dropped frames that are far in time. Drop a frame if a gap lies between the two.",
                partial(smooth_across_gaps, gaps="far"),
            ),
            Mistake(
                "The weights do not sum to 1. Divide by their sum.",
                partial(smooth_across_gaps, normalises=False),
            ),
            Mistake(
                "You counted frames. Sigma is in seconds, and the time between frames varies.",
                partial(smooth_across_gaps, counts_frames=True),
            ),
            Mistake("Square sigma in the exponent.", partial(smooth_across_gaps, sigma_power=1)),
            Mistake(
                "The exponent is divided by 2 sigma squared. The 2 is missing.",
                partial(smooth_across_gaps, sigma_factor=1),
            ),
            Mistake(
                "You used only earlier frames. Later frames count as well.",
                partial(smooth_across_gaps, past_only=True),
            ),
        ],
    ),
    Exercise(
        name="mean_rotation",
        solution=scipy_mean,
        inputs=rotations_far_apart,
        mistakes=[
            Mistake(
                "If det(U @ Vt) is -1, your answer is a mirror. Change the sign of the last axis of U.",
                partial(nearest_orthogonal, turned_axes=[]),
            ),
            Mistake(
                "This is the mean matrix, which is no rotation. Find the nearest rotation with an SVD.",
                weighted_mean,
            ),
            Mistake("The weights are missing.", ignores_weights),
            Mistake(
                "Your answer is transposed. np.linalg.svd returns V transposed already, so use U @ Vt.",
                transposed_mean,
            ),
            Mistake(
                "You changed the sign of all axes. That is not the nearest rotation: change only the last.",
                partial(nearest_orthogonal, turned_axes=[0, 1, 2]),
            ),
            Mistake(
                "You changed the sign of the first axis, the most certain one. Change the last one.",
                partial(nearest_orthogonal, turned_axes=[0]),
            ),
            Mistake(
                "You averaged rotation vectors. Near half a turn their sign jumps. Average the matrices.",
                averages_rotation_vectors,
            ),
        ],
        tries=8,
    ),
    Exercise(
        name="gated_filter",
        solution=gated_filter,
        inputs=flight_with_outliers,
        mistakes=[
            Mistake(
                "You skip nothing. Skip a measurement more than 3 standard deviations from the prediction.",
                partial(gated_filter, gate="none"),
            ),
            Mistake(
                "Your gate uses only the variance of the measurement. Add that of the prediction.",
                partial(gated_filter, gate="noise"),
            ),
            Mistake(
                "Your gate uses only the variance of the prediction. Add that of the measurement.",
                partial(gated_filter, gate="prediction"),
            ),
            Mistake(
                "Time passes even if a measurement is skipped. Add drift squared in every frame.",
                partial(gated_filter, grows_if_skipped=False),
            ),
            Mistake(
                "You added standard deviations. Add variances, which are their squares.",
                partial(gated_filter, power=1),
            ),
            Mistake(
                "If a measurement is skipped, the place stays where it was. You moved it to the measurement.",
                partial(gated_filter, adopts_skipped=True),
            ),
            Mistake(
                "Return one place per frame. The place of the first frame is the first measurement.",
                lambda *inputs: gated_filter(*inputs)[1:],
            ),
        ],
    ),
]
