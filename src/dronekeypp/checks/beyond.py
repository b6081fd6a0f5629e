"""Exercises of notebook 12, beyond the paper."""

import numpy as np
from scipy.stats import chi2

from dronekeypp.checks import Exercise


def a_problem(rng):
    """residuals (9,), J (9, 4), sigmas (9,)."""
    return rng.normal(size=9), rng.normal(size=(9, 4)), rng.uniform(0.2, 3.0, 9)


def weighted_step(residuals, J, sigmas, power=2, sign=-1.0):
    """The solution, and with another power or sign the mistakes."""
    W = np.diag(sigmas ** -float(power))
    return sign * np.linalg.solve(J.T @ W @ J, J.T @ W @ residuals)


def a_map(rng):
    """A map of scores (12, 12)."""
    return (rng.normal(0, 2.0, (12, 12)),)


def place_and_spread(scores, offset=0.5, swap=False, axis=None, square=True):
    """Centre of mass (x, y) in crop units of the softmax of a map, and the root mean squared distance from it."""
    s = len(scores)
    share = np.exp(scores - scores.max(axis=axis, keepdims=True))
    share = share / share.sum(axis=axis, keepdims=True)
    y, x = (np.mgrid[0:s, 0:s] + offset) / s
    place = np.array([(share * x).sum(), (share * y).sum()])
    squared = (share * ((x - place[0]) ** 2 + (y - place[1]) ** 2)).sum()
    return place[::-1] if swap else place, np.sqrt(squared) if square else squared


def errors_and_claims(rng):
    """errors (200, 3), covariances (200, 3, 3), level."""
    roots = rng.normal(size=(200, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.2 * np.eye(3)
    errors = np.einsum("fij,fj->fi", np.linalg.cholesky(covariances), rng.normal(size=(200, 3)))
    return errors, covariances, rng.uniform(0.4, 0.8)


def mahalanobis(errors, covariances):
    """Squared Mahalanobis distance (F,) of every error."""
    return np.einsum("fi,fij,fj->f", errors, np.linalg.inv(covariances), errors)


def inside_share(errors, covariances, level):
    return (mahalanobis(errors, covariances) <= chi2.ppf(level, 3)).mean()


def two_looks(rng):
    """Two estimates (3,) of one place, each with its covariance (3, 3)."""
    roots = rng.normal(size=(2, 3, 3))
    A, B = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(3)
    return rng.normal(size=3), A, rng.normal(size=3), B


def fused(a, A, b, B):
    both = np.linalg.inv(np.linalg.inv(A) + np.linalg.inv(B))
    return both @ (np.linalg.inv(A) @ a + np.linalg.inv(B) @ b), both


EXERCISES = [
    Exercise(
        "weighted_step",
        weighted_step,
        a_problem,
        {
            "you leave the sigmas out: every residual pulls alike": lambda *given: weighted_step(
                *given, power=0
            ),
            "the weights are 1 / sigma squared, not 1 / sigma": lambda *given: weighted_step(*given, power=1),
            "upside down: what is uncertain (a large sigma) must pull less": lambda *given: weighted_step(
                *given, power=-2
            ),
            "the sign: this step goes uphill": lambda *given: weighted_step(*given, sign=1.0),
            "this is the gradient; divide by J'WJ": lambda r, J, sigmas: -J.T @ (r / sigmas**2),
        },
    ),
    Exercise(
        "place_and_spread",
        place_and_spread,
        a_map,
        {
            "the place of a cell is its centre, half a cell further than its corner": lambda scores: (
                place_and_spread(scores, offset=0.0)
            ),
            "x and y are swapped: columns are x, rows are y": lambda scores: place_and_spread(
                scores, swap=True
            ),
            "the softmax runs over the whole map, not over every row by itself": lambda scores: (
                place_and_spread(scores, axis=1)
            ),
            "you forgot the square root of the spread": lambda scores: place_and_spread(scores, square=False),
            "in cells; divide by their number, for crop units": lambda scores: tuple(
                len(scores) * v for v in place_and_spread(scores)
            ),
        },
    ),
    Exercise(
        "inside_share",
        inside_share,
        errors_and_claims,
        {
            "three numbers have three degrees of freedom: this is the quantile for one": (
                lambda errors, covariances, level: (
                    mahalanobis(errors, covariances) <= chi2.ppf(level, 1)
                ).mean()
            ),
            "compare the squared distance with the quantile, not its root": (
                lambda errors, covariances, level: (
                    np.sqrt(mahalanobis(errors, covariances)) <= chi2.ppf(level, 3)
                ).mean()
            ),
            "multiply with the inverse of the covariance, not with the covariance": (
                lambda errors, covariances, level: (
                    mahalanobis(errors, np.linalg.inv(covariances)) <= chi2.ppf(level, 3)
                ).mean()
            ),
            "this is the share outside": lambda *given: 1 - inside_share(*given),
            "a share lies between 0 and 1; this is per cent": lambda *given: 100 * inside_share(*given),
            "take the whole covariance, not only its diagonal": (
                lambda errors, covariances, level: (
                    mahalanobis(errors, covariances * np.eye(3)) <= chi2.ppf(level, 3)
                ).mean()
            ),
        },
        tries=6,
    ),
    Exercise(
        "fused",
        fused,
        two_looks,
        {
            "this is the plain average; the surer of the two must count more": lambda a, A, b, B: (
                (a + b) / 2,
                (A + B) / 4,
            ),
            "upside down: weigh with the inverse covariances": lambda a, A, b, B: (
                np.linalg.inv(A + B) @ (A @ a + B @ b),
                fused(a, A, b, B)[1],
            ),
            "the place is right; its covariance is the inverse of the summed inverses": lambda a, A, b, B: (
                fused(a, A, b, B)[0],
                A + B,
            ),
            "the place is right; you return the information, the covariance is its inverse": (
                lambda a, A, b, B: (fused(a, A, b, B)[0], np.linalg.inv(A) + np.linalg.inv(B))
            ),
        },
    ),
]
