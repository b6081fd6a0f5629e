"""Give intervals and verdicts to rows of a table, by a bootstrap over flights and seeds.

A row is a matrix of errors, one line for each seed of the training and one column for each flight. Frames of
a flight resemble each other, and so do the flights of one training. So both are drawn: flights with
replacement, and of every row its seeds with replacement. Two rows that saw the same flights are drawn the
same flights.

Three seeds drawn with replacement vary less than three trainings do. So the deviation of the drawn seeds from
all seeds of the row is widened, by sqrt(n / (n - 1)) for n seeds and by Student's t over the normal
quantile for the degrees of freedom of all rows. Without it, rows that do not differ at all are told apart in
up to one case of ten where the seeds vary more than the flights, with it in about one of twenty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

from dronekeypp.evaluate.statistics import percentiles

DRAWS = 1000
LEVEL = 0.95
ENOUGH_SEEDS = 3  # with fewer in a row, a verdict keeps its question mark
NOT_TOLD_APART = "not told apart"


@dataclass(frozen=True)
class Difference:
    """Describe a row's measure minus another's.

    Args:
        mean: over the flights, with the seeds averaged.
        interval: its 95 % interval.
        seeds: (n, m), every seed of the row (first axis) against every seed of the other.
        more_is_better: whether the measure is a share of successes. Else it is an error.
    """

    mean: float
    interval: tuple[float, float]
    seeds: np.ndarray
    more_is_better: bool = False

    @property
    def verdict(self) -> str:
        """Say "better" or "worse" only if the interval leaves out 0 and all seeds lie on one side of 0.

        With fewer than three seeds in either row a question mark stays.
        """
        if self.interval[0] <= 0 <= self.interval[1] or len(np.unique(np.sign(self.seeds))) > 1:
            return NOT_TOLD_APART
        word = "better" if (self.mean < 0) != self.more_is_better else "worse"
        return word if min(self.seeds.shape) >= ENOUGH_SEEDS else f"{word}?"


def compare_rows(
    ours: np.ndarray, theirs: np.ndarray, more_is_better: bool = False, seed: int = 0
) -> Difference:
    """Return the difference of two rows that saw the same flights.

    Args:
        ours, theirs: (n, F) and (m, F), a measure of every seed and flight; the flights in one order.
        more_is_better: whether the measure is a share of successes.
        seed: of the draws.
    """
    generator = np.random.default_rng(seed)
    flights = generator.integers(ours.shape[1], size=(DRAWS, ours.shape[1]))
    widening = t_over_normal(ours, theirs)
    drawn = drawn_means(ours, flights, generator, widening)
    drawn = drawn - drawn_means(theirs, flights, generator, widening)
    low, high = percentiles(drawn)
    seeds = np.subtract.outer(ours.mean(axis=1), theirs.mean(axis=1))
    return Difference(float(ours.mean() - theirs.mean()), (low, high), seeds, more_is_better)


def interval_of_row(values: np.ndarray, seed: int = 0) -> list[float]:
    """Return the 95 % interval [low, high] of a row's mean.

    Args:
        values: (n, F), a measure of every seed and flight.
        seed: of the draws.
    """
    generator = np.random.default_rng(seed)
    flights = generator.integers(values.shape[1], size=(DRAWS, values.shape[1]))
    return percentiles(drawn_means(values, flights, generator, t_over_normal(values)))


def drawn_means(
    values: np.ndarray, flights: np.ndarray, generator: np.random.Generator, widening: float
) -> np.ndarray:
    """Return the mean of a row in every draw (D,).

    Args:
        values: (n, F), a measure of every seed and flight.
        flights: (D, F), the flights of every draw.
        generator: draws the seeds.
        widening: of the seeds' deviation, see `t_over_normal`.
    """
    count = len(values)
    of_seeds = values[:, flights].mean(axis=2).T  # (D, n)
    of_all = of_seeds.mean(axis=1)
    if count == 1:
        return of_all
    chosen = generator.integers(count, size=of_seeds.shape)
    deviation = np.take_along_axis(of_seeds, chosen, axis=1).mean(axis=1) - of_all
    return of_all + widening * np.sqrt(count / (count - 1)) * deviation


def t_over_normal(*rows: Sequence) -> float:
    """Return Student's 97.5 % quantile over the normal one, for the seeds of all rows together.

    It is 1 where no row has a second seed.
    """
    freedom = sum(len(row) - 1 for row in rows)
    upper = (1 + LEVEL) / 2
    return float(t.ppf(upper, freedom) / norm.ppf(upper)) if freedom else 1.0
