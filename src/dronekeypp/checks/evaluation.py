"""Exercises of notebook 08, evaluation and the baselines."""

from functools import partial

import numpy as np
import torch

from dronekeypp import rotations
from dronekeypp.checks import Exercise, Mistake

# --- rotation_errors ---


def random_rotations(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Draw rotations (F, 3, 3), rounded to 32-bit floats and returned as 64-bit floats."""
    R = rotations.matrix_from_6d(torch.from_numpy(rng.normal(size=(frames, 6)))).numpy()
    return R.astype(np.float32).astype(float)


def rotation_pairs(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw R_pred and R_true (6, 3, 3). Frame 0 is right, and after rounding its trace is larger than 3."""
    pred, true = random_rotations(rng, 6), random_rotations(rng, 6)
    while np.square(true[0]).sum() < 3 + 1e-8:
        true[0] = random_rotations(rng, 1)[0]
    pred[0] = true[0]
    return pred, true


def cosines(R_pred: np.ndarray, R_true: np.ndarray, subtracted: int = 1) -> np.ndarray:
    """Return the cosine of each frame's error, (F,)."""
    return (np.einsum("fij,fij->f", R_true, R_pred) - subtracted) / 2


def rotation_errors(R_pred: np.ndarray, R_true: np.ndarray, *, subtracted: int = 1) -> np.ndarray:
    """Solve the exercise: the errors (F,) in degrees. Another `subtracted` makes a mistake."""
    return np.degrees(np.arccos(np.clip(cosines(R_pred, R_true, subtracted), -1, 1)))


def forgets_to_clip(R_pred: np.ndarray, R_true: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.degrees(np.arccos(cosines(R_pred, R_true)))


def angle_of_product(R_pred: np.ndarray, R_true: np.ndarray) -> np.ndarray:
    return rotation_errors(R_pred, R_true.transpose(0, 2, 1))


def length_of_difference(R_pred: np.ndarray, R_true: np.ndarray) -> np.ndarray:
    return np.linalg.norm(R_pred - R_true, axis=(1, 2))


# --- translation_errors ---

Averages = tuple[float, float, float]  # Euclidean MAE, Euclidean MedAE and per-axis MAE


def positions(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw t_pred and t_true (9, 3), metres in camera axes."""
    true = np.concatenate([rng.uniform(-2, 2, (9, 2)), rng.uniform(2, 7, (9, 1))], axis=1)
    return true + rng.normal(0, 0.3, true.shape), true


def translation_errors(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    """Solve the exercise: Euclidean MAE, Euclidean MedAE and per-axis MAE, in metres."""
    distances = np.linalg.norm(t_pred - t_true, axis=1)
    return distances.mean(), np.median(distances), np.abs(t_pred - t_true).mean()


def rms_instead_of_mean(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    _, median, per_axis = translation_errors(t_pred, t_true)
    return np.sqrt(np.square(t_pred - t_true).sum(axis=1).mean()), median, per_axis


def length_of_mean_error(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    _, median, per_axis = translation_errors(t_pred, t_true)
    return np.linalg.norm((t_pred - t_true).mean(axis=0)), median, per_axis


def median_of_single_axes(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    mean, _, per_axis = translation_errors(t_pred, t_true)
    return mean, np.median(np.abs(t_pred - t_true)), per_axis


def signed_per_axis_mean(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    mean, median, _ = translation_errors(t_pred, t_true)
    return mean, median, (t_pred - t_true).mean()


def sum_over_axes(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    mean, median, _ = translation_errors(t_pred, t_true)
    return mean, median, np.abs(t_pred - t_true).sum(axis=1).mean()


def swaps_mean_and_median(t_pred: np.ndarray, t_true: np.ndarray) -> Averages:
    mean, median, per_axis = translation_errors(t_pred, t_true)
    return median, mean, per_axis


def one_number_per_axis(t_pred: np.ndarray, t_true: np.ndarray) -> tuple[float, float, np.ndarray]:
    mean, median, _ = translation_errors(t_pred, t_true)
    return mean, median, np.abs(t_pred - t_true).mean(axis=0)


# --- along_and_across ---

AlongAcross = tuple[np.ndarray, np.ndarray]  # both (F,), metres


def along_and_across(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    """Solve the exercise: the error along and across the true way to the drone, both (F,) in metres."""
    return split_error(t_pred, t_true, way=t_true)


def split_error(t_pred: np.ndarray, t_true: np.ndarray, way: np.ndarray) -> AlongAcross:
    """Split the error into the parts along and across the directions `way` (F, 3)."""
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    error = t_pred - t_true
    along = (error * way).sum(axis=1)
    return along, np.linalg.norm(error - along[:, None] * way, axis=1)


def splits_along_z(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    return split_error(t_pred, t_true, way=np.tile([0.0, 0, 1], (len(t_true), 1)))


def splits_along_prediction(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    return split_error(t_pred, t_true, way=t_pred)


def forgets_sign(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    along, across = along_and_across(t_pred, t_true)
    return np.abs(along), across


def reverses_sign(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    along, across = along_and_across(t_pred, t_true)
    return -along, across


def difference_of_distances(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    _, across = along_and_across(t_pred, t_true)
    return np.linalg.norm(t_pred, axis=1) - np.linalg.norm(t_true, axis=1), across


def projects_on_long_vector(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    along, across = along_and_across(t_pred, t_true)
    return along * np.linalg.norm(t_true, axis=1), across


def whole_error_as_across(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    along, _ = along_and_across(t_pred, t_true)
    return along, np.linalg.norm(t_pred - t_true, axis=1)


def forgets_square_root(t_pred: np.ndarray, t_true: np.ndarray) -> AlongAcross:
    along, across = along_and_across(t_pred, t_true)
    return along, across**2


# --- paired_interval ---

Interval = tuple[float, float]  # low and high end


def two_methods(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Draw the errors of two methods on the same frames of eight sequences.

    Returns:
        errors_a (F,) and errors_b (F,) in degrees, sequence (F,), and draws (200, 8), positions among the
        sorted sequence numbers.
    """
    sequence = np.repeat(rng.choice(90, 8, replace=False), rng.integers(5, 30, 8))
    difficulty = rng.gamma(2, 5, 90)[sequence]  # (F,) degrees, the same for both methods
    frames = len(sequence)
    errors_a = difficulty * rng.gamma(4, 0.25, frames) + rng.gamma(2, 1, frames)
    errors_b = difficulty * rng.gamma(4, 0.25, frames) + rng.gamma(2, 1, frames)
    return errors_a, errors_b, sequence, rng.integers(8, size=(200, 8))


def sequence_means(errors: np.ndarray, sequence: np.ndarray) -> np.ndarray:
    """Return the mean error of each sequence, (S,), in the order of the sequence numbers."""
    return np.array([errors[sequence == number].mean() for number in np.unique(sequence)])


def interval_ends(means: np.ndarray, percentiles: tuple[float, float] = (2.5, 97.5)) -> Interval:
    """Return two percentiles of the means."""
    low, high = np.percentile(means, percentiles)
    return low, high


def paired_interval(
    errors_a: np.ndarray,
    errors_b: np.ndarray,
    sequence: np.ndarray,
    draws: np.ndarray,
    *,
    percentiles: tuple[float, float] = (2.5, 97.5),
) -> Interval:
    """Solve the exercise: the interval of the mean difference a - b. Other percentiles make mistakes."""
    differences = sequence_means(errors_a - errors_b, sequence)  # (S,)
    return interval_ends(differences[draws].mean(axis=1), percentiles)


def draws_frames(
    errors_a: np.ndarray, errors_b: np.ndarray, sequence: np.ndarray, draws: np.ndarray
) -> Interval:
    return interval_ends((errors_a - errors_b)[draws].mean(axis=1))


def pools_frames(
    errors_a: np.ndarray, errors_b: np.ndarray, sequence: np.ndarray, draws: np.ndarray
) -> Interval:
    frames = np.unique(sequence, return_counts=True)[1]  # (S,)
    sums = frames * sequence_means(errors_a - errors_b, sequence)
    return interval_ends(sums[draws].sum(axis=1) / frames[draws].sum(axis=1))


def subtracts_two_intervals(
    errors_a: np.ndarray, errors_b: np.ndarray, sequence: np.ndarray, draws: np.ndarray
) -> Interval:
    low_a, high_a = interval_ends(sequence_means(errors_a, sequence)[draws].mean(axis=1))
    low_b, high_b = interval_ends(sequence_means(errors_b, sequence)[draws].mean(axis=1))
    return low_a - low_b, high_a - high_b


def percentiles_of_sequences(
    errors_a: np.ndarray, errors_b: np.ndarray, sequence: np.ndarray, draws: np.ndarray
) -> Interval:
    return interval_ends(sequence_means(errors_a - errors_b, sequence))


EXERCISES = [
    Exercise(
        name="rotation_errors",
        solution=rotation_errors,
        inputs=rotation_pairs,
        mistakes=[
            Mistake(
                "Frame 0 is NaN, because rounding made its cosine larger than 1. Clip it before arccos.",
                forgets_to_clip,
            ),
            Mistake(
                "These are radians. Return degrees.",
                lambda R_pred, R_true: np.radians(rotation_errors(R_pred, R_true)),
            ),
            Mistake(
                "This is Eq. 13, which divides by pi. Return degrees.",
                lambda R_pred, R_true: rotation_errors(R_pred, R_true) / 180,
            ),
            Mistake(
                "This is the angle of the product. Transpose one of the two rotations.",
                angle_of_product,
            ),
            Mistake(
                "This is the Frobenius norm of R_pred - R_true. The error is an angle.",
                length_of_difference,
            ),
            Mistake(
                "The trace is 1 + 2 cos. Subtract 1 before you halve it.",
                partial(rotation_errors, subtracted=0),
            ),
            Mistake(
                "This is the mean. Return one error for each frame.",
                lambda R_pred, R_true: rotation_errors(R_pred, R_true).mean(),
            ),
        ],
        close=1e-3,
    ),
    Exercise(
        name="translation_errors",
        solution=translation_errors,
        inputs=positions,
        mistakes=[
            Mistake(
                "Your first answer is the root of the mean squared distance. The MAE is the mean distance.",
                rms_instead_of_mean,
            ),
            Mistake(
                "Your first answer is the length of the mean error, in which opposite errors cancel.",
                length_of_mean_error,
            ),
            Mistake(
                "Your second answer is a median over single axes. Take the median of the distances.",
                median_of_single_axes,
            ),
            Mistake(
                "The per-axis mean needs absolute values. Without them opposite errors cancel.",
                signed_per_axis_mean,
            ),
            Mistake(
                "You summed over the three axes. The per-axis MAE averages over the axes as well.",
                sum_over_axes,
            ),
            Mistake("Mean and median are swapped.", swaps_mean_and_median),
            Mistake(
                "Your third answer is one number per axis. Average over frames and axes.",
                one_number_per_axis,
            ),
        ],
    ),
    Exercise(
        name="along_and_across",
        solution=along_and_across,
        inputs=positions,
        mistakes=[
            Mistake(
                "You split along the camera's z axis. The way to the drone is t_true.",
                splits_along_z,
            ),
            Mistake(
                "You split along the predicted way. Use the true one, t_true.",
                splits_along_prediction,
            ),
            Mistake(
                "Your first answer needs a sign. Too far is positive, and too near is negative.",
                forgets_sign,
            ),
            Mistake("The sign is reversed. Too far should be positive.", reverses_sign),
            Mistake(
                "You subtracted two distances. Project the error on the true way with a dot product.",
                difference_of_distances,
            ),
            Mistake(
                "Project on a vector of length 1. Divide by the distance.",
                projects_on_long_vector,
            ),
            Mistake(
                "Your second answer is the whole error. Subtract the part along the way first.",
                whole_error_as_across,
            ),
            Mistake("The square root of the second answer is missing.", forgets_square_root),
        ],
    ),
    Exercise(
        name="paired_interval",
        solution=paired_interval,
        inputs=two_methods,
        mistakes=[
            Mistake("`draws` counts sequences. You used it to pick frames.", draws_frames),
            Mistake(
                "Every sequence counts once. Average within each sequence first, or long ones weigh more.",
                pools_frames,
            ),
            Mistake(
                "You subtracted two intervals. Subtract the errors first: both find the same frames hard.",
                subtracts_two_intervals,
            ),
            Mistake(
                "These are percentiles of the sequences. Average each draw, then take percentiles.",
                percentiles_of_sequences,
            ),
            Mistake(
                "This is the middle 90 %. For 95 % cut off 2.5 % on each side.",
                partial(paired_interval, percentiles=(5, 95)),
            ),
            Mistake(
                "Percentiles run from 0 to 100. Use 2.5 and 97.5, not 0.025 and 0.975.",
                partial(paired_interval, percentiles=(0.025, 0.975)),
            ),
            Mistake(
                "You computed b - a. Subtract b from a.",
                lambda a, b, sequence, draws: paired_interval(b, a, sequence, draws),
            ),
            Mistake(
                "Return the low end first and the high end second.",
                lambda *inputs: paired_interval(*inputs)[::-1],
            ),
        ],
    ),
]
