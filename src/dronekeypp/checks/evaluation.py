"""Exercises of notebook 08, evaluation and the baselines."""

import numpy as np
import torch

from dronekeypp import rotations
from dronekeypp.checks import Exercise


def random_rotations(rng, frames):
    """(F, 3, 3), rounded as 32-bit numbers are."""
    return (
        rotations.matrix_from_6d(torch.from_numpy(rng.normal(size=(frames, 6))))
        .numpy()
        .astype(np.float32)
        .astype(float)
    )


def rotation_pairs(rng):
    """R_pred and R_true (6, 3, 3); frame 0 is right, and rounding has made its trace larger than 3."""
    pred, true = random_rotations(rng, 6), random_rotations(rng, 6)
    while np.square(true[0]).sum() < 3 + 1e-8:
        true[0] = random_rotations(rng, 1)[0]
    pred[0] = true[0]
    return pred, true


def cosines(R_pred, R_true, less=1):
    return (np.einsum("fij,fij->f", R_true, R_pred) - less) / 2


def rotation_errors(R_pred, R_true, less=1):
    """The solution; with another `less`, a mistake."""
    return np.degrees(np.arccos(np.clip(cosines(R_pred, R_true, less), -1, 1)))


def rotation_errors_unclipped(R_pred, R_true):
    with np.errstate(invalid="ignore"):
        return np.degrees(np.arccos(cosines(R_pred, R_true)))


def positions(rng):
    """t_pred and t_true (9, 3), metres."""
    true = np.concatenate([rng.uniform(-2, 2, (9, 2)), rng.uniform(2, 7, (9, 1))], axis=1)
    return true + rng.normal(0, 0.3, true.shape), true


def translation_errors(t_pred, t_true):
    apart = np.linalg.norm(t_pred - t_true, axis=1)
    return apart.mean(), np.median(apart), np.abs(t_pred - t_true).mean()


def translation_but(part, value):
    """translation_errors with one of its three answers replaced by value(t_pred - t_true)."""

    def wrong(t_pred, t_true):
        answers = list(translation_errors(t_pred, t_true))
        answers[part] = value(t_pred - t_true)
        return tuple(answers)

    return wrong


def along_and_across(t_pred, t_true, way=None):
    """The solution; with another `way` (F, 3) than the true one, a mistake."""
    way = t_true if way is None else way
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    off = t_pred - t_true
    along = (off * way).sum(axis=1)
    return along, np.linalg.norm(off - along[:, None] * way, axis=1)


def along_but(along=lambda found, t_pred, t_true: found, across=lambda found, t_pred, t_true: found):
    """along_and_across with an answer changed."""

    def wrong(t_pred, t_true):
        one, other = along_and_across(t_pred, t_true)
        return along(one, t_pred, t_true), across(other, t_pred, t_true)

    return wrong


def two_methods(rng):
    """errors_a, errors_b (F,), sequence (F,), draws (200, 8): the positions of the drawn sequences among the sorted ones."""
    sequence = np.repeat(rng.choice(90, 8, replace=False), rng.integers(5, 30, 8))
    hard = rng.gamma(2, 5, 90)[sequence]  # degrees, for both methods
    errors = [hard * rng.gamma(4, 0.25, len(sequence)) + rng.gamma(2, 1, len(sequence)) for _ in range(2)]
    return *errors, sequence, rng.integers(8, size=(200, 8))


def by_sequence(errors, sequence):
    return np.array([errors[sequence == k].mean() for k in np.unique(sequence)])


def paired_interval(errors_a, errors_b, sequence, draws, ends=(2.5, 97.5)):
    """The solution; with other `ends`, a mistake."""
    low, high = np.percentile(by_sequence(errors_a - errors_b, sequence)[draws].mean(axis=1), ends)
    return low, high


def frames_drawn(errors_a, errors_b, sequence, draws):
    return tuple(np.percentile((errors_a - errors_b)[draws].mean(axis=1), [2.5, 97.5]))


def frames_pooled(errors_a, errors_b, sequence, draws):
    sizes = np.unique(sequence, return_counts=True)[1]
    sums = sizes * by_sequence(errors_a - errors_b, sequence)
    return tuple(np.percentile(sums[draws].sum(axis=1) / sizes[draws].sum(axis=1), [2.5, 97.5]))


def two_intervals(errors_a, errors_b, sequence, draws):
    low, high = (
        np.percentile(by_sequence(errors, sequence)[draws].mean(axis=1), [2.5, 97.5])
        for errors in (errors_a, errors_b)
    )
    return tuple(low - high)


def spread_of_sequences(errors_a, errors_b, sequence, draws):
    return tuple(np.percentile(by_sequence(errors_a - errors_b, sequence), [2.5, 97.5]))


EXERCISES = [
    Exercise(
        "rotation_errors",
        rotation_errors,
        rotation_pairs,
        {
            "NaN in frame 0: rounding has made its cosine larger than 1; clip it before arccos": rotation_errors_unclipped,
            "this is in radians": lambda *given: np.radians(rotation_errors(*given)),
            "this is Eq. 13 with its division by pi; the answer should be in degrees": lambda *given: (
                rotation_errors(*given) / 180
            ),
            "one of the two must be transposed: this is the angle of their product, not between them": (
                lambda R_pred, R_true: rotation_errors(R_pred, R_true.transpose(0, 2, 1))
            ),
            "this is the length of R_pred - R_true (Frobenius norm); the error is an angle": (
                lambda R_pred, R_true: np.linalg.norm(R_pred - R_true, axis=(1, 2))
            ),
            "the trace is 1 + 2 cos: take 1 away before you halve it": lambda *given: rotation_errors(
                *given, less=0
            ),
            "this is the mean; give one error a frame": lambda *given: rotation_errors(*given).mean(),
        },
        close=1e-3,
    ),
    Exercise(
        "translation_errors",
        translation_errors,
        positions,
        {
            "your first answer is the root of the mean squared distance; MAE is the mean distance": translation_but(
                0, lambda off: np.sqrt(np.square(off).sum(axis=1).mean())
            ),
            "your first answer is the length of the mean error: opposite errors cancel in it": translation_but(
                0, lambda off: np.linalg.norm(off.mean(axis=0))
            ),
            "your second answer is a median over single axes; take it over distances": translation_but(
                1, lambda off: np.median(np.abs(off))
            ),
            "the per-axis mean needs absolute values: errors of opposite sign cancel": translation_but(
                2, np.mean
            ),
            "you summed over the three axes; the per-axis mean averages over them too": translation_but(
                2, lambda off: np.abs(off).sum(axis=1).mean()
            ),
            "mean and median have changed places": lambda *given: [
                translation_errors(*given)[i] for i in (1, 0, 2)
            ],
            "this leaves one number per axis; average over frames and axes": translation_but(
                2, lambda off: np.abs(off).mean(axis=0)
            ),
        },
    ),
    Exercise(
        "along_and_across",
        along_and_across,
        positions,
        {
            "you split along the camera's z axis; the way to the drone is t_true": (
                lambda t_pred, t_true: along_and_across(
                    t_pred, t_true, np.tile([0.0, 0, 1], (len(t_true), 1))
                )
            ),
            "you split along the predicted way; the true one is the measure": lambda t_pred, t_true: (
                along_and_across(t_pred, t_true, t_pred)
            ),
            "your first answer must have a sign: too far is positive, too near is negative": along_but(
                along=lambda found, *_: np.abs(found)
            ),
            "the sign is reversed: too far should be positive": along_but(along=lambda found, *_: -found),
            "the difference of two distances is not the share along the way: project with a dot product": along_but(
                along=lambda found, t_pred, t_true: (
                    np.linalg.norm(t_pred, axis=1) - np.linalg.norm(t_true, axis=1)
                )
            ),
            "project on a vector of length 1: divide by the distance": along_but(
                along=lambda found, t_pred, t_true: found * np.linalg.norm(t_true, axis=1)
            ),
            "your second answer is the whole error; take the part along the way out of it": along_but(
                across=lambda found, t_pred, t_true: np.linalg.norm(t_pred - t_true, axis=1)
            ),
            "you forgot the square root of the second answer": along_but(across=lambda found, *_: found**2),
        },
    ),
    Exercise(
        "paired_interval",
        paired_interval,
        two_methods,
        {
            "`draws` counts sequences; you picked frames with it": frames_drawn,
            "every sequence counts once: average within it first, else long sequences weigh more": frames_pooled,
            "subtract before you draw: two separate intervals know nothing of what both find hard": two_intervals,
            "this is the spread of the sequences themselves; draw, average each draw, then take percentiles": spread_of_sequences,
            "this is the middle 90 %; for 95 % cut off 2.5 % on each side": lambda *given: paired_interval(
                *given, ends=(5, 95)
            ),
            "percentiles run from 0 to 100: 2.5 and 97.5, not 0.025 and 0.975": lambda *given: (
                paired_interval(*given, ends=(0.025, 0.975))
            ),
            "you subtracted a from b": lambda a, b, sequence, draws: paired_interval(b, a, sequence, draws),
            "the high end comes second": lambda *given: paired_interval(*given)[::-1],
        },
    ),
]
