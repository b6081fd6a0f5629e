"""Exercises of notebook 09, the ablations."""

from functools import partial
from itertools import combinations
from math import comb

import numpy as np

from dronekeypp.checks import Exercise, Mistake

# --- direction_and_distance ---


def predicted_and_true_places(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw predicted and true places of the drone, (8, 3), metres in camera axes."""
    true = np.stack([rng.uniform(-2, 2, 8), rng.uniform(-1, 1, 8), rng.uniform(3, 8, 8)], axis=1)
    return true * rng.uniform(0.6, 1.4, (8, 1)) + rng.normal(0, 0.3, (8, 3)), true


def direction_and_distance(
    predicted: np.ndarray,
    true: np.ndarray,
    *,
    degrees: bool = True,
    divides_by_lengths: bool = True,
    signed: bool = False,
    relative_to_true: bool = True,
    percent: float = 100,
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the exercise: the angles (N,) in degrees and the distance errors (N,) in per cent.

    Other options make mistakes.
    """
    distance, true_distance = np.linalg.norm(predicted, axis=1), np.linalg.norm(true, axis=1)
    lengths = distance * true_distance if divides_by_lengths else 1
    with np.errstate(invalid="ignore"):  # without the lengths this is no cosine
        angle = np.arccos((predicted * true).sum(axis=1) / lengths)
    error = percent * (distance - true_distance) / (true_distance if relative_to_true else distance)
    return np.degrees(angle) if degrees else angle, error if signed else np.abs(error)


def whole_shift_as_distance(predicted: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    angle, _ = direction_and_distance(predicted, true)
    return angle, 100 * np.linalg.norm(predicted - true, axis=1) / np.linalg.norm(true, axis=1)


# --- loglog_slope ---


def sizes_and_distance_ratios(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw sizes (7,) in metres, and predicted over true distance (7, 7).

    The row is the true drone, and the column is the drone that the network is told.
    """
    sizes = np.exp(rng.permutation(np.linspace(-2.9, -1.6, 7)) + rng.normal(0, 0.05, 7))
    size_ratio = sizes / sizes[:, None]
    return sizes, size_ratio ** rng.uniform(0.6, 0.9) * np.exp(rng.normal(0, 0.1, (7, 7)))


def loglog_slope(
    sizes: np.ndarray,
    answer: np.ndarray,
    *,
    takes_logs: bool = True,
    inverts_size_ratio: bool = False,
    with_diagonal: bool = False,
    swaps_axes: bool = False,
    squares_r: bool = True,
) -> tuple[float, float]:
    """Solve the exercise: the slope of the line and r². Other options make mistakes."""
    size_ratio = sizes[None, :] / sizes[:, None]  # (7, 7): true drone, told drone
    if inverts_size_ratio:
        size_ratio = 1 / size_ratio
    used = np.ones((7, 7), bool) if with_diagonal else ~np.eye(7, dtype=bool)
    x, y = size_ratio[used], answer[used]
    if takes_logs:
        x, y = np.log(x), np.log(y)
    if swaps_axes:
        x, y = y, x
    r = np.corrcoef(x, y)[0, 1]
    return np.polyfit(x, y, 1)[0], r**2 if squares_r else r


# --- difference_verdict ---

Verdict = tuple[float, float, int]  # low and high end of the interval, and 1, -1 or 0


def two_trained_methods(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw the errors of A and B (3 seeds, 8 sequences), and sequences with replacement (400, 8)."""
    difficulty = rng.uniform(8, 25, 8)
    gap = rng.choice([-1, 1]) * rng.uniform(0.2, 1.5)
    difference = gap + rng.normal(0, rng.choice([0.3, 2.5]), 8)
    seeds_A, seeds_B = rng.normal(0, rng.choice([0.05, 0.5, 1.0]), (2, 3, 1))
    A = difficulty + seeds_A + rng.normal(0, 0.1, (3, 8))
    B = difficulty + difference + seeds_B + rng.normal(0, 0.1, (3, 8))
    return A, B, rng.integers(8, size=(400, 8))


def interval_of_difference(
    A: np.ndarray, B: np.ndarray, drawn: np.ndarray, kind: str, percentiles: tuple[float, float]
) -> tuple[float, float]:
    """Return both ends of an interval of B - A.

    Args:
        A: errors (3, S).
        B: errors (3, S).
        drawn: drawn sequences (D, S).
        kind: "paired" is right. "separate" draws for A and B apart, "sequences" does not draw, and
            "first seed" uses seed 0 only.
        percentiles: of the two ends.
    """
    if kind == "separate":
        low_A, high_A = np.percentile(A.mean(axis=0)[drawn].mean(axis=1), percentiles)
        low_B, high_B = np.percentile(B.mean(axis=0)[drawn].mean(axis=1), percentiles)
        return low_B - high_A, high_B - low_A
    if kind == "first seed":
        means = (B[0] - A[0])[drawn].mean(axis=1)
    elif kind == "sequences":
        means = B.mean(axis=0) - A.mean(axis=0)
    else:
        means = (B.mean(axis=0) - A.mean(axis=0))[drawn].mean(axis=1)
    low, high = np.percentile(means, percentiles)
    return low, high


def difference_verdict(
    A: np.ndarray,
    B: np.ndarray,
    drawn: np.ndarray,
    *,
    interval: str = "paired",
    percentiles: tuple[float, float] = (2.5, 97.5),
    all_pairs: bool = True,
    asks: str = "both",
) -> Verdict:
    """Solve the exercise: the interval of B - A and the verdict. Other options make mistakes.

    Args:
        A: errors (3, S).
        B: errors (3, S).
        drawn: drawn sequences (D, S).
        interval: see `interval_of_difference`.
        percentiles: of the two ends.
        all_pairs: compare every seed of B with every seed of A, and not only with the same seed.
        asks: "both" the interval and the seeds, "either" of them, or only the "interval" or the "seeds".
    """
    low, high = interval_of_difference(A, B, drawn, interval, percentiles)
    if all_pairs:
        by_seed = np.subtract.outer(B.mean(axis=1), A.mean(axis=1))  # (3, 3)
    else:
        by_seed = B.mean(axis=1) - A.mean(axis=1)  # (3,)
    interval_excludes_0 = low > 0 or high < 0
    seeds_agree = (by_seed > 0).all() or (by_seed < 0).all()
    if asks == "both":
        clear = interval_excludes_0 and seeds_agree
    elif asks == "either":
        clear = interval_excludes_0 or seeds_agree
    elif asks == "interval":
        clear = interval_excludes_0
    else:
        clear = seeds_agree
    sign = int(np.sign((B.mean(axis=0) - A.mean(axis=0)).mean()))
    return low, high, sign if clear else 0


# --- permutation_test ---


def errors_of_few_seeds(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw the errors of 3 to 5 trainings of A and of B, not equally many, in quarters of a degree."""
    trainings_A, trainings_B = ((3, 4), (4, 3), (3, 5), (5, 3))[rng.integers(4)]
    return rng.integers(40, 60, trainings_A) / 4, rng.integers(42, 62, trainings_B) / 4


def permutation_test(
    A: np.ndarray,
    B: np.ndarray,
    *,
    sign: int = 1,
    two_sided: bool = False,
    counts_equal: bool = True,
    swaps_sizes: bool = False,
) -> float:
    """Solve the exercise: the share of the deals whose gap is as large as it was. Options make mistakes."""
    errors, gaps = np.concatenate([A, B]), []
    for dealt in combinations(range(len(errors)), len(A) if swaps_sizes else len(B)):
        is_B = np.isin(np.arange(len(errors)), dealt)
        gaps.append(sign * (errors[is_B].mean() - errors[~is_B].mean()))
    gaps, observed = np.array(gaps), sign * (B.mean() - A.mean())
    if two_sided:
        gaps, observed = np.abs(gaps), abs(observed)
    # Rounding could make equal gaps unequal: allow 1e-9.
    return (gaps > observed - 1e-9).mean() if counts_equal else (gaps > observed + 1e-9).mean()


def share_of_pairs(A: np.ndarray, B: np.ndarray) -> float:
    return np.greater_equal.outer(B, A).mean()


def most_extreme_deal_only(A: np.ndarray, B: np.ndarray) -> float:
    return 1 / comb(len(A) + len(B), len(B))


EXERCISES = [
    Exercise(
        name="direction_and_distance",
        solution=direction_and_distance,
        inputs=predicted_and_true_places,
        mistakes=[
            Mistake(
                "Your angles are in radians. np.degrees turns them into degrees.",
                partial(direction_and_distance, degrees=False),
            ),
            Mistake(
                "arccos takes a cosine. First divide the product by both lengths.",
                partial(direction_and_distance, divides_by_lengths=False),
            ),
            Mistake(
                "Your second answer is the whole shift over the distance. Compare only the two distances.",
                whole_shift_as_distance,
            ),
            Mistake(
                "In a mean, too near and too far would cancel. Take the absolute value.",
                partial(direction_and_distance, signed=True),
            ),
            Mistake(
                "You divided by the predicted distance. Divide by the true one.",
                partial(direction_and_distance, relative_to_true=False),
            ),
            Mistake(
                "Your distance error is a share. Multiply it by 100 to get per cent.",
                partial(direction_and_distance, percent=1),
            ),
        ],
    ),
    Exercise(
        name="loglog_slope",
        solution=loglog_slope,
        inputs=sizes_and_distance_ratios,
        mistakes=[
            Mistake(
                "You fitted the ratios. A power law is a line only between the logarithms.",
                partial(loglog_slope, takes_logs=False),
            ),
            Mistake(
                "The slope should be positive. The size ratio is told (column) over true (row).",
                partial(loglog_slope, inverts_size_ratio=True),
            ),
            Mistake(
                "Leave out the diagonal, for the slope and for r². There the told drone is the true one.",
                partial(loglog_slope, with_diagonal=True),
            ),
            Mistake(
                "The slope is right, but the second number is r. The share of the variance is its square.",
                partial(loglog_slope, squares_r=False),
            ),
            Mistake(
                "You fitted the size ratio over the distance ratio. Swap the two.",
                partial(loglog_slope, swaps_axes=True),
            ),
        ],
    ),
    Exercise(
        name="difference_verdict",
        solution=difference_verdict,
        inputs=two_trained_methods,
        mistakes=[
            Mistake(
                "The interval is right. The seeds must agree too: compare each of B with each of A.",
                partial(difference_verdict, asks="interval"),
            ),
            Mistake(
                "The numbers are right, but you only ask the seeds. The interval must exclude 0 as well.",
                partial(difference_verdict, asks="seeds"),
            ),
            Mistake(
                "One reason is not enough. The interval must exclude 0, and the seeds must agree.",
                partial(difference_verdict, asks="either"),
            ),
            Mistake(
                "Seed 0 of A has nothing to do with seed 0 of B. Compare all nine pairs of seeds.",
                partial(difference_verdict, all_pairs=False),
            ),
            Mistake(
                "These are percentiles of the sequences. Average each draw, then take percentiles.",
                partial(difference_verdict, interval="sequences"),
            ),
            Mistake(
                "You drew for A and B separately. Subtract on each sequence first: its difficulty cancels.",
                partial(difference_verdict, interval="separate"),
            ),
            Mistake(
                "A 95 % interval leaves out 2.5 % on each side. You left out 5 %.",
                partial(difference_verdict, percentiles=(5, 95)),
            ),
            Mistake(
                "You used only the first seed. Average the seeds before you compare the sequences.",
                partial(difference_verdict, interval="first seed"),
            ),
            Mistake(
                "You computed A - B. These are errors, so B is worse where B - A is positive.",
                lambda A, B, drawn: difference_verdict(B, A, drawn),
            ),
        ],
        tries=40,
    ),
    Exercise(
        name="permutation_test",
        solution=permutation_test,
        inputs=errors_of_few_seeds,
        mistakes=[
            Mistake(
                "Count the deals whose gap equals the real one, too. The question is at least as large.",
                partial(permutation_test, counts_equal=False),
            ),
            Mistake(
                "You asked whether A is worse than B. The question is whether B is worse than A.",
                partial(permutation_test, sign=-1),
            ),
            Mistake(
                "You counted gaps of both signs. The question is only whether B is worse.",
                partial(permutation_test, two_sided=True),
            ),
            Mistake(
                "Deal as many trainings to B as B has. You dealt as many as A has.",
                partial(permutation_test, swaps_sizes=True),
            ),
            Mistake(
                "This is the share of pairs in which B is worse. Deal all trainings and compare means.",
                share_of_pairs,
            ),
            Mistake(
                "This is the share of the most extreme deal. Count all deals with at least the real gap.",
                most_extreme_deal_only,
            ),
        ],
        tries=8,
    ),
]
