"""Exercises of notebook 10, the distances between sets of pictures."""

import numpy as np

from dronekeypp import realism
from dronekeypp.checks import Exercise


def whole_scores(rng):
    """Scores of real (8,) and of made pictures (11,), whole numbers: some are equal."""
    return rng.integers(0, 7, 8), rng.integers(2, 9, 11)


def pair_shares(real, made, tie=0.5):
    return (made[:, None] > real).mean() + tie * (made[:, None] == real).mean()


def two_sets(rng):
    """Features of two sets, (30, 5) and (24, 5)."""
    return rng.normal(0, 1, (30, 5)) * rng.uniform(0.5, 3, 5), rng.uniform(-1, 1, 5) + rng.normal(
        0, 1, (24, 5)
    ) * rng.uniform(0.5, 3, 5)


def frechet_diagonal(a, b, ddof=1, means=True):
    """The solution, and with other arguments the mistakes."""
    shift = np.square(a.mean(axis=0) - b.mean(axis=0)).sum()
    return shift * means + np.square(a.std(axis=0, ddof=ddof) - b.std(axis=0, ddof=ddof)).sum()


def frechet_of_variances(a, b, product=False):
    """Wrong: the second term from variances, as they are or with a cross term without its root."""
    A, B = a.var(axis=0, ddof=1), b.var(axis=0, ddof=1)
    return (
        np.square(a.mean(axis=0) - b.mean(axis=0)).sum()
        + ((A + B - 2 * A * B) if product else np.square(A - B)).sum()
    )


def two_sets_and_a_width(rng):
    """Features of two sets, (12, 3) and (9, 3), and the kernel's width."""
    return rng.normal(0, 1, (12, 3)), rng.normal(0.8, 1.5, (9, 3)), rng.uniform(2, 5)


def mmd_unbiased(a, b, width, self_pairs=False, divide_by_all=False, times=2, power=2, spread=None):
    """The solution, and with other arguments the mistakes."""

    def similarity(x, y):
        return np.exp(-(np.linalg.norm(x[:, None] - y, axis=2) ** power) / (spread or 2 * width))

    def within(x):
        k, n = similarity(x, x), len(x)
        return k.mean() if self_pairs else (k.sum() - n) / (n * n if divide_by_all else n * (n - 1))

    return within(a) + within(b) - times * similarity(a, b).mean()


def gap(a, b):
    """Fréchet distance of two sets of numbers."""
    return (a.mean() - b.mean()) ** 2 + (a.std() - b.std()) ** 2


def far_gap(a, b):
    """Difference of the means in standard deviations."""
    return abs(a.mean() - b.mean()) / (a.std() + b.std())


def videos(rng, count):
    """(numbers, videos): a number a picture, 2 to 5 pictures a video, each video with a look of its own."""
    of = np.repeat(rng.permutation(100)[:count], rng.integers(2, 6, count))
    looks = dict(zip(np.unique(of), rng.normal(0, 2, count), strict=True))
    return np.array([looks[v] for v in of]) + rng.normal(0, 0.3, len(of)), of


def distance_of_videos(rng):
    """A distance, real pictures (n,), made pictures (m,), the video of each (n,) and the flight of each (m,)."""
    (real, of_real), (made, of_made) = videos(rng, 7), videos(rng, 10)
    return gap if rng.random() < 0.5 else far_gap, real, made + 3, of_real, of_made


def jackknife_error(
    measure,
    real,
    made,
    videos,
    flights,
    frames=False,
    sets=(0, 1),
    only=False,
    root=True,
    factor=None,
    around="mean",
):
    """The solution, and with other arguments the mistakes."""
    groups = [np.arange(len(g)) if frames else g for g in (videos, flights)]
    variance = 0.0
    for i in sets:
        found = []
        for name in np.unique(groups[i]):
            kept = (groups[i] == name) if only else (groups[i] != name)
            found.append(measure(real[kept], made) if i == 0 else measure(real, made[kept]))
        g, centre = len(found), np.mean(found) if around == "mean" else measure(real, made)
        variance += (factor(g) if factor else (g - 1) / g) * np.square(np.array(found) - centre).sum()
    return np.sqrt(variance) if root else variance


EXERCISES = [
    Exercise(
        "auc_with_ties",
        realism.auc,
        whole_scores,
        {
            "equal scores are a coin toss: such a pair counts half, not nothing": lambda real, made: (
                pair_shares(real, made, tie=0)
            ),
            "equal scores are a coin toss: such a pair counts half, not as a win": lambda real, made: (
                pair_shares(real, made, tie=1)
            ),
            "a win is a made picture that scores higher than a real one; you count the reverse": lambda real, made: (
                pair_shares(made, real)
            ),
            "this is the number of wins; divide it by the number of pairs": lambda real, made: (
                pair_shares(real, made) * len(real) * len(made)
            ),
            "you compare the made pictures with the real ones' mean; compare every one with every one": (
                lambda real, made: (made > real.mean()).mean()
            ),
        },
    ),
    Exercise(
        "frechet_diagonal",
        frechet_diagonal,
        two_sets,
        {
            "you compare variances; the formula compares standard deviations, their roots": frechet_of_variances,
            "the cross term is 2 times the root of A times B: you forgot the root": lambda a, b: (
                frechet_of_variances(a, b, product=True)
            ),
            "add up over the features; you took their mean": lambda a, b: frechet_diagonal(a, b) / a.shape[1],
            "the squared difference of the means is missing": lambda a, b: frechet_diagonal(
                a, b, means=False
            ),
            "this is d; as in the notebook, return its square": lambda a, b: np.sqrt(frechet_diagonal(a, b)),
            "nearly: you divide by n, np.cov by n - 1 (ddof=1)": lambda a, b: frechet_diagonal(a, b, ddof=0),
        },
    ),
    Exercise(
        "mmd_unbiased",
        mmd_unbiased,
        two_sets_and_a_width,
        {
            "a picture is not compared with itself: leave the diagonal out of the means within a set": (
                lambda *given: mmd_unbiased(*given, self_pairs=True)
            ),
            "without the diagonal a set of n has n (n - 1) pairs, you divide by n squared": lambda *given: (
                mmd_unbiased(*given, divide_by_all=True)
            ),
            "the pairs across count twice": lambda *given: mmd_unbiased(*given, times=1),
            "square the distance in the exponent": lambda *given: mmd_unbiased(*given, power=1),
            "the width is a squared distance already, you square it again": lambda a, b, width: mmd_unbiased(
                a, b, width, spread=2 * width**2
            ),
            "the exponent is divided by 2 w, you divide by w": lambda a, b, width: mmd_unbiased(
                a, b, width, spread=width
            ),
        },
    ),
    Exercise(
        "jackknife_error",
        jackknife_error,
        distance_of_videos,
        {
            "you leave out single pictures; leave out a whole video or flight at a time": lambda *given: (
                jackknife_error(*given, frames=True)
            ),
            "you leave out videos of the real set only; the flights of the made set are chance, too: add their variance": (
                lambda *given: jackknife_error(*given, sets=(0,))
            ),
            "this is the variance; the standard error is its root": lambda *given: jackknife_error(
                *given, root=False
            ),
            "values with one video left out are much alike: multiply the mean square by g - 1": (
                lambda *given: jackknife_error(*given, factor=lambda g: 1 / g)
            ),
            "this is an ordinary variance, divided by g - 1; the jackknife multiplies by (g - 1) / g": (
                lambda *given: jackknife_error(*given, factor=lambda g: 1 / (g - 1))
            ),
            "you keep one video and drop the others; drop one and keep the others": lambda *given: (
                jackknife_error(*given, only=True)
            ),
            "nearly: take the deviations from the mean of the values left over, not from the value of the whole sets": (
                lambda *given: jackknife_error(*given, around="whole")
            ),
        },
    ),
]
