"""Exercises of notebook 09, the ablations."""

from itertools import combinations

import numpy as np

from dronekeypp.checks import Exercise


def two_places(rng):
    """Predicted and true places of the drone (8, 3), metres in camera axes."""
    true = np.stack([rng.uniform(-2, 2, 8), rng.uniform(-1, 1, 8), rng.uniform(3, 8, 8)], axis=1)
    return true * rng.uniform(0.6, 1.4, (8, 1)) + rng.normal(0, 0.3, (8, 3)), true


def direction_and_distance(
    predicted, true, degrees=True, lengths=True, signed=False, over="true", percent=100
):
    """The solution, and with other arguments the mistakes."""
    far, true_far = np.linalg.norm(predicted, axis=1), np.linalg.norm(true, axis=1)
    with np.errstate(invalid="ignore"):
        angle = np.arccos((predicted * true).sum(axis=1) / (far * true_far if lengths else 1))
    off = percent * (far - true_far) / (true_far if over == "true" else far)
    return np.degrees(angle) if degrees else angle, off if signed else np.abs(off)


def relative_shift(predicted, true):
    return 100 * np.linalg.norm(predicted - true, axis=1) / np.linalg.norm(true, axis=1)


def told_drones(rng):
    """sizes (7,) m, predicted over true distance (7, 7) by true and told drone."""
    sizes = np.exp(rng.permutation(np.linspace(-2.9, -1.6, 7)) + rng.normal(0, 0.05, 7))
    return sizes, (sizes / sizes[:, None]) ** rng.uniform(0.6, 0.9) * np.exp(rng.normal(0, 0.1, (7, 7)))


def loglog_slope(sizes, answer, logs=True, told_over_true=True, diagonal=False, swapped=False, squared=True):
    """The solution, and with other arguments the mistakes."""
    ratio = sizes[None, :] / sizes[:, None]  # [true][told]
    chosen = np.ones((7, 7), bool) if diagonal else ~np.eye(7, dtype=bool)
    x, y = (ratio if told_over_true else 1 / ratio)[chosen], answer[chosen]
    x, y = (np.log(x), np.log(y)) if logs else (x, y)
    x, y = (y, x) if swapped else (x, y)
    r = np.corrcoef(x, y)[0, 1]
    return np.polyfit(x, y, 1)[0], r**2 if squared else r


def two_trained_methods(rng):
    """Errors of A and of B (3 seeds, 8 sequences), and sequences drawn with replacement (400, 8)."""
    hard, gap = rng.uniform(8, 25, 8), rng.choice([-1, 1]) * rng.uniform(0.2, 1.5)
    apart = gap + rng.normal(0, rng.choice([0.3, 2.5]), 8)
    seeds = rng.normal(0, rng.choice([0.05, 0.5, 1.0]), (2, 3, 1))
    A, B = hard + seeds[0] + rng.normal(0, 0.1, (3, 8)), hard + apart + seeds[1] + rng.normal(0, 0.1, (3, 8))
    return A, B, rng.integers(8, size=(400, 8))


def difference_verdict(A, B, drawn, interval="paired", tails=(2.5, 97.5), pairs="all", ask="both"):
    """The solution, and with other arguments the mistakes."""
    apart = B.mean(axis=0) - A.mean(axis=0)
    means = {
        "paired": apart[drawn].mean(axis=1),
        "sequences": apart,
        "first seed": (B[0] - A[0])[drawn].mean(axis=1),
    }
    if interval == "separate":
        (low_A, high_A), (low_B, high_B) = (
            np.percentile(v.mean(axis=0)[drawn].mean(axis=1), tails) for v in (A, B)
        )
        low, high = low_B - high_A, high_B - low_A
    else:
        low, high = np.percentile(means[interval], tails)
    by_seed = (
        np.subtract.outer(B.mean(axis=1), A.mean(axis=1))
        if pairs == "all"
        else B.mean(axis=1) - A.mean(axis=1)
    )
    clear, agreed = low > 0 or high < 0, (by_seed > 0).all() or (by_seed < 0).all()
    sure = {"both": clear and agreed, "either": clear or agreed, "interval": clear, "seeds": agreed}[ask]
    return low, high, int(np.sign(apart.mean())) * int(sure)


def few_seeds(rng):
    """Errors of the trainings of A and of B, 3 to 5 each and not equally many, degrees in quarters."""
    m, n = ((3, 4), (4, 3), (3, 5), (5, 3))[rng.integers(4)]
    return rng.integers(40, 60, m) / 4, rng.integers(42, 62, n) / 4


def permutation_test(A, B, sign=1, two_sided=False, strict=False, size=None):
    """The solution, and with other arguments the mistakes."""
    pooled, gaps = np.concatenate([A, B]), []
    for dealt in combinations(range(len(pooled)), size(A) if size else len(B)):
        chosen = np.isin(np.arange(len(pooled)), dealt)
        gaps.append(sign * (pooled[chosen].mean() - pooled[~chosen].mean()))
    gaps, seen = np.array(gaps), sign * (B.mean() - A.mean())
    if two_sided:
        gaps, seen = np.abs(gaps), abs(seen)
    return (gaps > seen + 1e-9).mean() if strict else (gaps > seen - 1e-9).mean()


EXERCISES = [
    Exercise(
        "direction_and_distance",
        direction_and_distance,
        two_places,
        {
            "your angles are radians; np.degrees makes them degrees": lambda *given: direction_and_distance(
                *given, degrees=False
            ),
            "arccos wants a cosine: divide the product by both lengths first": lambda *given: (
                direction_and_distance(*given, lengths=False)
            ),
            "your second answer is the whole shift over the distance; compare only the two distances, how far predicted and how far true": (
                lambda predicted, true: (
                    direction_and_distance(predicted, true)[0],
                    relative_shift(predicted, true),
                )
            ),
            "too near and too far would cancel in a mean: take the absolute value": lambda *given: (
                direction_and_distance(*given, signed=True)
            ),
            "you divide by the predicted distance; the true one is the yardstick": lambda *given: (
                direction_and_distance(*given, over="predicted")
            ),
            "the distance is off by a share; times 100 makes it per cent": lambda *given: (
                direction_and_distance(*given, percent=1)
            ),
        },
    ),
    Exercise(
        "loglog_slope",
        loglog_slope,
        told_drones,
        {
            "you fitted the ratios; a power law is a line only between their logarithms": lambda *given: (
                loglog_slope(*given, logs=False)
            ),
            "your slope is negative: the size ratio is told over true, the row is the true drone and the column the told one": (
                lambda *given: loglog_slope(*given, told_over_true=False)
            ),
            "the slope is right, but leave the diagonal out of both: there the told drone is the true one": (
                lambda *given: loglog_slope(*given, diagonal=True)
            ),
            "the slope is right, the second number is r; the share of the variance is its square": lambda *given: (
                loglog_slope(*given, squared=False)
            ),
            "you fitted the size ratio to the distance ratio; the question is the other way round": lambda *given: (
                loglog_slope(*given, swapped=True)
            ),
        },
    ),
    Exercise(
        "difference_verdict",
        difference_verdict,
        two_trained_methods,
        {
            "the interval is right, but you never ask the seeds: every training of B against every one of A": (
                lambda *given: difference_verdict(*given, ask="interval")
            ),
            "the numbers are right, but you only ask the seeds: the interval must leave out 0 as well": (
                lambda *given: difference_verdict(*given, ask="seeds")
            ),
            "one reason is not enough: the interval must leave out 0, and the seeds must agree": (
                lambda *given: difference_verdict(*given, ask="either")
            ),
            "seed 0 of A has nothing to do with seed 0 of B: compare every seed with every seed, nine pairs": (
                lambda *given: difference_verdict(*given, pairs="same")
            ),
            "these are percentiles of the sequences; take the mean of each draw first, then percentiles of the means": (
                lambda *given: difference_verdict(*given, interval="sequences")
            ),
            "you drew A and B apart; take the difference on each sequence first, so that what makes it hard cancels": (
                lambda *given: difference_verdict(*given, interval="separate")
            ),
            "a 95 % interval leaves out 2.5 % on each side, yours 5 %": lambda *given: difference_verdict(
                *given, tails=(5, 95)
            ),
            "you used the first seed alone; average the seeds before the sequences are compared": (
                lambda *given: difference_verdict(*given, interval="first seed")
            ),
            "you took A minus B: these are errors, B is worse where B minus A is positive": lambda A, B, drawn: (
                difference_verdict(B, A, drawn)
            ),
        },
        tries=40,
    ),
    Exercise(
        "permutation_test",
        permutation_test,
        few_seeds,
        {
            "count the deals that are as bad as what happened, too: at least, not more than": lambda A, B: (
                permutation_test(A, B, strict=True)
            ),
            "you ask whether A is worse than B; the question is whether B is worse": lambda A, B: (
                permutation_test(A, B, sign=-1)
            ),
            "you count both signs; the question is only whether B is worse": lambda A, B: permutation_test(
                A, B, two_sided=True
            ),
            "deal as many to B as B has; you dealt as many as A has": lambda A, B: permutation_test(
                A, B, size=len
            ),
            "this is the share of pairs, one of A and one of B; shuffle who belongs to whom and compare the means": (
                lambda A, B: np.greater_equal.outer(B, A).mean()
            ),
            "this is the chance of the most extreme deal alone; count the deals that are at least as bad as yours": (
                lambda A, B: 1 / len(list(combinations(range(len(A) + len(B)), len(B))))
            ),
        },
        tries=8,
    ),
]
