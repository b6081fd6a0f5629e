"""Exercises of notebook 12, beyond the paper."""

from functools import partial

import numpy as np
from scipy.stats import chi2

from dronekeypp.checks import Exercise, Mistake

Estimate = tuple[np.ndarray, np.ndarray]  # a place (3,) and its covariance (3, 3)

# --- weighted_step ---


def least_squares_problem(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw residuals (9,), their Jacobian (9, 4) and their sigmas (9,)."""
    return rng.normal(size=9), rng.normal(size=(9, 4)), rng.uniform(0.2, 3.0, 9)


def weighted_step(
    residuals: np.ndarray, J: np.ndarray, sigmas: np.ndarray, *, power: float = 2, sign: float = -1
) -> np.ndarray:
    """Solve the exercise: the Gauss-Newton step (n,). Another power or sign makes a mistake."""
    W = np.diag(sigmas ** -float(power))
    return sign * np.linalg.solve(J.T @ W @ J, J.T @ W @ residuals)


# --- place_and_spread ---


def score_map(rng: np.random.Generator) -> tuple[np.ndarray]:
    """Draw a map of scores (12, 12)."""
    return (rng.normal(0, 2.0, (12, 12)),)


def place_and_spread(
    scores: np.ndarray, *, offset: float = 0.5, softmax_axis: int | None = None
) -> tuple[np.ndarray, float]:
    """Solve the exercise: the place (2,) as (x, y) and the spread, in crop units. Options make mistakes."""
    s = len(scores)
    share = np.exp(scores - scores.max(axis=softmax_axis, keepdims=True))
    share = share / share.sum(axis=softmax_axis, keepdims=True)
    y, x = (np.mgrid[0:s, 0:s] + offset) / s
    place = np.array([(share * x).sum(), (share * y).sum()])
    squared = (share * ((x - place[0]) ** 2 + (y - place[1]) ** 2)).sum()
    return place, np.sqrt(squared)


def swaps_xy(scores: np.ndarray) -> tuple[np.ndarray, float]:
    place, spread = place_and_spread(scores)
    return place[::-1], spread


def forgets_square_root(scores: np.ndarray) -> tuple[np.ndarray, float]:
    place, spread = place_and_spread(scores)
    return place, spread**2


def counts_in_cells(scores: np.ndarray) -> tuple[np.ndarray, float]:
    place, spread = place_and_spread(scores)
    return len(scores) * place, len(scores) * spread


# --- inside_share ---


def errors_and_covariances(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Draw errors (200, 3), the covariances (200, 3, 3) that they come from, and a level."""
    roots = rng.normal(size=(200, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.2 * np.eye(3)
    errors = np.einsum("fij,fj->fi", np.linalg.cholesky(covariances), rng.normal(size=(200, 3)))
    return errors, covariances, rng.uniform(0.4, 0.8)


def squared_mahalanobis(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return the squared Mahalanobis distance of each error, (F,)."""
    return np.einsum("fi,fij,fj->f", errors, np.linalg.inv(covariances), errors)


def inside_share(errors: np.ndarray, covariances: np.ndarray, level: float, *, degrees: int = 3) -> float:
    """Solve the exercise: a share between 0 and 1. Other degrees of freedom make a mistake."""
    return (squared_mahalanobis(errors, covariances) <= chi2.ppf(level, degrees)).mean()


def compares_the_root(errors: np.ndarray, covariances: np.ndarray, level: float) -> float:
    return (np.sqrt(squared_mahalanobis(errors, covariances)) <= chi2.ppf(level, 3)).mean()


def multiplies_by_covariance(errors: np.ndarray, covariances: np.ndarray, level: float) -> float:
    return inside_share(errors, np.linalg.inv(covariances), level)


def uses_only_the_diagonal(errors: np.ndarray, covariances: np.ndarray, level: float) -> float:
    return inside_share(errors, covariances * np.eye(3), level)


# --- fused ---


def two_estimates(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Draw two estimates of one place: a (3,) with covariance A (3, 3), and b (3,) with B (3, 3)."""
    roots = rng.normal(size=(2, 3, 3))
    A, B = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(3)
    return rng.normal(size=3), A, rng.normal(size=3), B


def fused(a: np.ndarray, A: np.ndarray, b: np.ndarray, B: np.ndarray) -> Estimate:
    """Solve the exercise: the best place and its covariance."""
    covariance = np.linalg.inv(np.linalg.inv(A) + np.linalg.inv(B))
    return covariance @ (np.linalg.inv(A) @ a + np.linalg.inv(B) @ b), covariance


def plain_average(a: np.ndarray, A: np.ndarray, b: np.ndarray, B: np.ndarray) -> Estimate:
    return (a + b) / 2, (A + B) / 4


def weights_with_covariances(a: np.ndarray, A: np.ndarray, b: np.ndarray, B: np.ndarray) -> Estimate:
    _, covariance = fused(a, A, b, B)
    return np.linalg.inv(A + B) @ (A @ a + B @ b), covariance


def sum_of_covariances(a: np.ndarray, A: np.ndarray, b: np.ndarray, B: np.ndarray) -> Estimate:
    place, _ = fused(a, A, b, B)
    return place, A + B


def returns_information(a: np.ndarray, A: np.ndarray, b: np.ndarray, B: np.ndarray) -> Estimate:
    place, _ = fused(a, A, b, B)
    return place, np.linalg.inv(A) + np.linalg.inv(B)


EXERCISES = [
    Exercise(
        name="weighted_step",
        solution=weighted_step,
        inputs=least_squares_problem,
        mistakes=[
            Mistake(
                "The sigmas are missing. All residuals have the same weight.",
                partial(weighted_step, power=0),
            ),
            Mistake("The weights are 1 / sigma squared, not 1 / sigma.", partial(weighted_step, power=1)),
            Mistake(
                "You multiplied by sigma squared. A residual with a large sigma must have a small weight.",
                partial(weighted_step, power=-2),
            ),
            Mistake("The sign is wrong. This step goes uphill.", partial(weighted_step, sign=1)),
            Mistake(
                "This is the negative gradient. Solve with J'WJ.",
                lambda residuals, J, sigmas: -J.T @ (residuals / sigmas**2),
            ),
        ],
    ),
    Exercise(
        name="place_and_spread",
        solution=place_and_spread,
        inputs=score_map,
        mistakes=[
            Mistake(
                "The place of a cell is its centre, half a cell further than its corner.",
                partial(place_and_spread, offset=0.0),
            ),
            Mistake("x and y are swapped. Columns are x, and rows are y.", swaps_xy),
            Mistake(
                "The softmax runs over the whole map. You took one softmax for each row.",
                partial(place_and_spread, softmax_axis=1),
            ),
            Mistake("The square root of the spread is missing.", forgets_square_root),
            Mistake(
                "You measured in cells. Divide by the number of cells to get crop units.",
                counts_in_cells,
            ),
        ],
    ),
    Exercise(
        name="inside_share",
        solution=inside_share,
        inputs=errors_and_covariances,
        mistakes=[
            Mistake(
                "You used the quantile for one degree of freedom. Three numbers have three.",
                partial(inside_share, degrees=1),
            ),
            Mistake(
                "Compare the squared distance with the quantile, not its root.",
                compares_the_root,
            ),
            Mistake(
                "Multiply by the inverse of the covariance, not by the covariance.",
                multiplies_by_covariance,
            ),
            Mistake("This is the share outside.", lambda *inputs: 1 - inside_share(*inputs)),
            Mistake(
                "This is per cent. A share lies between 0 and 1.",
                lambda *inputs: 100 * inside_share(*inputs),
            ),
            Mistake(
                "You used only the diagonal of the covariance. Use the whole matrix.",
                uses_only_the_diagonal,
            ),
        ],
        tries=6,
    ),
    Exercise(
        name="fused",
        solution=fused,
        inputs=two_estimates,
        mistakes=[
            Mistake(
                "This is the plain average. The estimate that is more certain must count more.",
                plain_average,
            ),
            Mistake(
                "You weighted with the covariances. Weight with their inverses.",
                weights_with_covariances,
            ),
            Mistake(
                "The place is right. Its covariance is the inverse of the sum of the inverses.",
                sum_of_covariances,
            ),
            Mistake(
                "The place is right, but you returned the information. The covariance is its inverse.",
                returns_information,
            ),
        ],
    ),
]
