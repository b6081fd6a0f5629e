"""Exercises of notebook 10, the distances between sets of pictures."""

from collections.abc import Callable
from functools import partial

import numpy as np

from dronekeypp import realism
from dronekeypp.checks import Exercise, Mistake

Measure = Callable[[np.ndarray, np.ndarray], float]  # a distance between two sets of numbers

# --- auc_with_ties ---


def whole_number_scores(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw scores of real (8,) and of made pictures (11,). They are whole numbers, so some are equal."""
    return rng.integers(0, 7, 8), rng.integers(2, 9, 11)


def share_of_wins(real: np.ndarray, made: np.ndarray, tie: float = 0.5) -> float:
    """Return the share of pairs in which the made picture scores higher; an equal pair counts `tie`."""
    return (made[:, None] > real).mean() + tie * (made[:, None] == real).mean()


def number_of_wins(real: np.ndarray, made: np.ndarray) -> float:
    return share_of_wins(real, made) * len(real) * len(made)


# --- frechet_diagonal ---


def two_sets(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw features of two sets, (30, 5) and (24, 5)."""
    a = rng.normal(0, 1, (30, 5)) * rng.uniform(0.5, 3, 5)
    b = rng.uniform(-1, 1, 5) + rng.normal(0, 1, (24, 5)) * rng.uniform(0.5, 3, 5)
    return a, b


def squared_shift(a: np.ndarray, b: np.ndarray) -> float:
    """Return the squared distance of the two means."""
    return np.square(a.mean(axis=0) - b.mean(axis=0)).sum()


def frechet_diagonal(a: np.ndarray, b: np.ndarray, *, ddof: int = 1) -> float:
    """Solve the exercise: the squared distance. Another `ddof` makes a mistake."""
    return squared_shift(a, b) + np.square(a.std(axis=0, ddof=ddof) - b.std(axis=0, ddof=ddof)).sum()


def compares_variances(a: np.ndarray, b: np.ndarray) -> float:
    A, B = a.var(axis=0, ddof=1), b.var(axis=0, ddof=1)
    return squared_shift(a, b) + np.square(A - B).sum()


def cross_term_without_root(a: np.ndarray, b: np.ndarray) -> float:
    A, B = a.var(axis=0, ddof=1), b.var(axis=0, ddof=1)
    return squared_shift(a, b) + (A + B - 2 * A * B).sum()


def mean_over_features(a: np.ndarray, b: np.ndarray) -> float:
    return frechet_diagonal(a, b) / a.shape[1]


def ignores_means(a: np.ndarray, b: np.ndarray) -> float:
    return np.square(a.std(axis=0, ddof=1) - b.std(axis=0, ddof=1)).sum()


# --- mmd_unbiased ---


def two_sets_and_width(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Draw features of two sets, (12, 3) and (9, 3), and the width of the kernel."""
    return rng.normal(0, 1, (12, 3)), rng.normal(0.8, 1.5, (9, 3)), rng.uniform(2, 5)


def mmd_unbiased(
    a: np.ndarray,
    b: np.ndarray,
    width: float,
    *,
    self_pairs: bool = False,
    divides_by_n_squared: bool = False,
    across_factor: float = 2,
    distance_power: float = 2,
    width_factor: float = 2,
) -> float:
    """Solve the exercise: the squared MMD. Other options make mistakes."""

    def similarity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(x[:, None] - y, axis=2)
        return np.exp(-(distance**distance_power) / (width_factor * width))

    def mean_within(x: np.ndarray) -> float:
        similarities, n = similarity(x, x), len(x)
        if self_pairs:
            return similarities.mean()
        pairs = n * n if divides_by_n_squared else n * (n - 1)
        return (similarities.sum() - n) / pairs

    return mean_within(a) + mean_within(b) - across_factor * similarity(a, b).mean()


def squares_the_width(a: np.ndarray, b: np.ndarray, width: float) -> float:
    return mmd_unbiased(a, b, width**2)


# --- jackknife_error ---


def frechet_of_numbers(a: np.ndarray, b: np.ndarray) -> float:
    """Return the Fréchet distance of two sets of numbers."""
    return (a.mean() - b.mean()) ** 2 + (a.std() - b.std()) ** 2


def shift_in_deviations(a: np.ndarray, b: np.ndarray) -> float:
    """Return the difference of the means in standard deviations."""
    return abs(a.mean() - b.mean()) / (a.std() + b.std())


def numbers_of_videos(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a number for each picture, and the video of each picture, both (n,).

    A video has 2 to 5 pictures. Their numbers lie near a mean that differs from video to video.
    """
    video = np.repeat(rng.permutation(100)[:count], rng.integers(2, 6, count))
    video_means = rng.normal(0, 2, count)
    _, video_index = np.unique(video, return_inverse=True)  # (n,)
    return video_means[video_index] + rng.normal(0, 0.3, len(video)), video


def measure_and_two_sets(
    rng: np.random.Generator,
) -> tuple[Measure, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Draw a distance, numbers of real (n,) and made pictures (m,), their videos (n,) and flights (m,)."""
    real, videos = numbers_of_videos(rng, 7)
    made, flights = numbers_of_videos(rng, 10)
    measure = frechet_of_numbers if rng.random() < 0.5 else shift_in_deviations
    return measure, real, made + 3, videos, flights


def values_by_group(
    measure: Measure,
    real: np.ndarray,
    made: np.ndarray,
    videos: np.ndarray,
    flights: np.ndarray,
    keeps_one: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of `measure` without each video in turn, and without each flight in turn.

    With `keeps_one` each video or flight is kept and the others are left out, which is a mistake.
    """
    by_video, by_flight = [], []
    for video in np.unique(videos):
        used = videos == video if keeps_one else videos != video
        by_video.append(measure(real[used], made))
    for flight in np.unique(flights):
        used = flights == flight if keeps_one else flights != flight
        by_flight.append(measure(real, made[used]))
    return np.array(by_video), np.array(by_flight)


def jackknife_factor(groups: int) -> float:
    return (groups - 1) / groups


def mean_square_factor(groups: int) -> float:
    return 1 / groups


def ordinary_variance_factor(groups: int) -> float:
    return 1 / (groups - 1)


def jackknife_error(
    measure: Measure,
    real: np.ndarray,
    made: np.ndarray,
    videos: np.ndarray,
    flights: np.ndarray,
    *,
    keeps_one: bool = False,
    factor: Callable[[int], float] = jackknife_factor,
    around_whole: bool = False,
) -> float:
    """Solve the exercise: the standard error of `measure(real, made)`. Other options make mistakes."""
    variance = 0.0
    for values in values_by_group(measure, real, made, videos, flights, keeps_one):
        centre = measure(real, made) if around_whole else values.mean()
        variance += factor(len(values)) * np.square(values - centre).sum()
    return np.sqrt(variance)


def leaves_out_single_pictures(
    measure: Measure, real: np.ndarray, made: np.ndarray, videos: np.ndarray, flights: np.ndarray
) -> float:
    return jackknife_error(measure, real, made, np.arange(len(real)), np.arange(len(made)))


def ignores_flights(
    measure: Measure, real: np.ndarray, made: np.ndarray, videos: np.ndarray, flights: np.ndarray
) -> float:
    values, _ = values_by_group(measure, real, made, videos, flights)
    return np.sqrt(jackknife_factor(len(values)) * np.square(values - values.mean()).sum())


EXERCISES = [
    Exercise(
        name="auc_with_ties",
        solution=realism.auc,
        inputs=whole_number_scores,
        mistakes=[
            Mistake(
                "You gave equal scores nothing. A pair with equal scores counts half.",
                partial(share_of_wins, tie=0),
            ),
            Mistake(
                "You counted equal scores as a win. A pair with equal scores counts half.",
                partial(share_of_wins, tie=1),
            ),
            Mistake(
                "You counted the wins of the real pictures. Count the wins of the made pictures.",
                lambda real, made: share_of_wins(made, real),
            ),
            Mistake(
                "This is the number of wins. Divide it by the number of pairs.",
                number_of_wins,
            ),
            Mistake(
                "You compared with the mean of the real pictures. Compare with every real picture.",
                lambda real, made: (made > real.mean()).mean(),
            ),
        ],
    ),
    Exercise(
        name="frechet_diagonal",
        solution=frechet_diagonal,
        inputs=two_sets,
        mistakes=[
            Mistake(
                "You compared variances. The formula compares standard deviations, which are their roots.",
                compares_variances,
            ),
            Mistake(
                "The root in the cross term is missing. It is 2 times the root of A times B.",
                cross_term_without_root,
            ),
            Mistake("You took the mean over the features. Take the sum.", mean_over_features),
            Mistake("The squared difference of the means is missing.", ignores_means),
            Mistake(
                "This is the distance. Return its square, as the notebook does.",
                lambda a, b: np.sqrt(frechet_diagonal(a, b)),
            ),
            Mistake(
                "This is nearly right. You divided by n, but np.cov divides by n - 1 (ddof=1).",
                partial(frechet_diagonal, ddof=0),
            ),
        ],
    ),
    Exercise(
        name="mmd_unbiased",
        solution=mmd_unbiased,
        inputs=two_sets_and_width,
        mistakes=[
            Mistake(
                "A picture is not compared with itself. Leave the diagonal out of the mean within a set.",
                partial(mmd_unbiased, self_pairs=True),
            ),
            Mistake(
                "Without the diagonal a set of n has n (n - 1) pairs. You divided by n squared.",
                partial(mmd_unbiased, divides_by_n_squared=True),
            ),
            Mistake(
                "The mean over the pairs of both sets counts twice.",
                partial(mmd_unbiased, across_factor=1),
            ),
            Mistake("Square the distance in the exponent.", partial(mmd_unbiased, distance_power=1)),
            Mistake(
                "The width is a squared distance already. You squared it again.",
                squares_the_width,
            ),
            Mistake(
                "The exponent is divided by 2 w. You divided it by w.",
                partial(mmd_unbiased, width_factor=1),
            ),
        ],
    ),
    Exercise(
        name="jackknife_error",
        solution=jackknife_error,
        inputs=measure_and_two_sets,
        mistakes=[
            Mistake(
                "You left out single pictures. Leave out a whole video or a whole flight at a time.",
                leaves_out_single_pictures,
            ),
            Mistake(
                "You left out only videos of the real set. Add the variance from leaving out flights.",
                ignores_flights,
            ),
            Mistake(
                "This is the variance. The standard error is its root.",
                lambda *inputs: jackknife_error(*inputs) ** 2,
            ),
            Mistake(
                "The values with a video left out are much alike. Multiply their mean square by g - 1.",
                partial(jackknife_error, factor=mean_square_factor),
            ),
            Mistake(
                "This is an ordinary variance, divided by g - 1. The jackknife multiplies by (g - 1) / g.",
                partial(jackknife_error, factor=ordinary_variance_factor),
            ),
            Mistake(
                "You kept one video and left out the others. Leave out one and keep the others.",
                partial(jackknife_error, keeps_one=True),
            ),
            Mistake(
                "This is nearly right. Take deviations from the mean of the values, not from the whole sets.",
                partial(jackknife_error, around_whole=True),
            ),
        ],
    ),
]
