"""Exercises of notebook 04, the [cls] classifier."""

import math

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from dronekeypp.checks import Exercise, Mistake
from dronekeypp.sixdronesyn.drones import DRONES

# --- confusion_shares ---


def labels_and_answers(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, int]:
    """Draw label (90,), answer (90,), and return the number of classes, 5. Both hold every class."""
    label = np.concatenate([np.arange(5), rng.choice(5, 85, p=rng.dirichlet(4 * np.ones(5)))])
    answer = np.where(rng.random(90) < 0.6, label, rng.integers(0, 5, 90))
    answer[:5] = np.arange(5)
    return label, answer, 5


def confusion_counts(label: np.ndarray, answer: np.ndarray, classes: int) -> np.ndarray:
    """Count the pairs of true class (row) and answer (column)."""
    counts = np.zeros((classes, classes))
    np.add.at(counts, (label, answer), 1)
    return counts


def confusion_shares(label: np.ndarray, answer: np.ndarray, classes: int) -> np.ndarray:
    """Solve the exercise: the confusion matrix (classes, classes), in which every row sums to 1."""
    counts = confusion_counts(label, answer, classes)
    return counts / counts.sum(axis=1, keepdims=True)


def divides_by_all_frames(label: np.ndarray, answer: np.ndarray, classes: int) -> np.ndarray:
    return confusion_counts(label, answer, classes) / len(label)


def divides_columns(label: np.ndarray, answer: np.ndarray, classes: int) -> np.ndarray:
    counts = confusion_counts(label, answer, classes)
    return counts / counts.sum(axis=0)


# --- stable_cross_entropy ---


def extreme_logits(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Draw logits (6, 7) and label (6,).

    In rows 0 to 2 the logits are so large that exp overflows. In row 4 the probability of the label is so
    small that it rounds to 0.
    """
    logits, label = 2 * rng.normal(size=(6, 7)), rng.integers(0, 7, 6)
    logits[:3] += rng.uniform(800, 1500, (3, 1))
    logits[3:, 0] += 3  # makes class 0 the likeliest answer in these rows
    label[4] = 1 + (logits[4, 1:]).argmin()
    logits[4, label[4]] -= rng.uniform(800, 1200)
    return torch.tensor(logits), torch.tensor(label)


def exp_overflows(logits: Tensor, label: Tensor) -> Tensor:
    powers = logits.exp()
    return -(powers / powers.sum(dim=1, keepdim=True))[range(len(label)), label].log().mean()


def log_of_softmax(logits: Tensor, label: Tensor) -> Tensor:
    return -torch.softmax(logits, dim=1)[range(len(label)), label].log().mean()


def cross_entropies(logits: Tensor, label: Tensor, dim: int = 1) -> Tensor:
    """Return the cross-entropy of each row, (B,), in nats."""
    return -torch.log_softmax(logits, dim=dim)[range(len(label)), label]


def uses_answer_as_label(logits: Tensor, label: Tensor) -> Tensor:
    return cross_entropies(logits, logits.argmax(dim=1)).mean()


# --- hedged_size ---


def probabilities_and_sizes(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw probs (7,) and sizes (7,), metres."""
    probs = rng.dirichlet(np.ones(7))
    wheelbases = np.array([drone.wheelbase for drone in DRONES.values()])
    return probs, wheelbases * rng.uniform(0.8, 1.2, 7)


def hedged_size(probs: np.ndarray, sizes: np.ndarray) -> float:
    """Solve the exercise: the size in metres with the smallest expected squared relative error."""
    return (probs / sizes).sum() / (probs / sizes**2).sum()


def ignores_probabilities(probs: np.ndarray, sizes: np.ndarray) -> float:
    return (1 / sizes).sum() / (1 / sizes**2).sum()


def error_relative_to_guess(probs: np.ndarray, sizes: np.ndarray) -> float:
    return (probs * sizes**2).sum() / (probs * sizes).sum()


# --- calibration_error ---


def probabilities_and_labels(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, int]:
    """Draw probs (400, 7), label (400,) and the number of bins.

    The share of right answers is the same at any confidence. So confident answers are too confident, and
    unsure answers are too unsure.
    """
    z = rng.normal(size=(400, 7)) * rng.uniform(0.3, 4, (400, 1))
    probs = np.exp(z) / np.exp(z).sum(axis=1, keepdims=True)
    answer = probs.argmax(axis=1)
    label = np.where(rng.random(400) < 0.45, answer, (answer + rng.integers(1, 7, 400)) % 7)
    return probs, label, int(rng.choice([5, 8, 10]))


def bin_gaps(
    probs: np.ndarray, label: np.ndarray, bins: int, confidence: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Compare accuracy and confidence in each bin that is not empty.

    Args:
        probs: (n, C) probabilities.
        label: (n,) true classes.
        bins: the number of bins between 0 and 1.
        confidence: (n,); None takes the probability of the answer.

    Returns:
        Accuracy minus mean confidence of each bin, and the share of the frames in each bin.
    """
    if confidence is None:
        confidence = probs.max(axis=1)
    right = probs.argmax(axis=1) == label
    bin_index = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps, shares = [], []
    for index in np.unique(bin_index):
        in_bin = bin_index == index
        gaps.append(right[in_bin].mean() - confidence[in_bin].mean())
        shares.append(in_bin.mean())
    return np.array(gaps), np.array(shares)


def calibration_error(probs: np.ndarray, label: np.ndarray, bins: int) -> float:
    """Solve the exercise: the expected calibration error, between 0 and 1."""
    gaps, shares = bin_gaps(probs, label, bins)
    return np.abs(gaps) @ shares


def same_weight_for_all_bins(probs: np.ndarray, label: np.ndarray, bins: int) -> float:
    return np.abs(bin_gaps(probs, label, bins)[0]).mean()


def signed_gaps(probs: np.ndarray, label: np.ndarray, bins: int) -> float:
    gaps, shares = bin_gaps(probs, label, bins)
    return gaps @ shares


def probability_of_label(probs: np.ndarray, label: np.ndarray, bins: int) -> float:
    confidence = probs[np.arange(len(label)), label]
    gaps, shares = bin_gaps(probs, label, bins, confidence)
    return np.abs(gaps) @ shares


def compares_single_frames(probs: np.ndarray, label: np.ndarray, bins: int) -> float:
    right = probs.argmax(axis=1) == label
    return np.abs(right - probs.max(axis=1)).mean()


def largest_gap(probs: np.ndarray, label: np.ndarray, bins: int) -> float:
    return np.abs(bin_gaps(probs, label, bins)[0]).max()


EXERCISES = [
    Exercise(
        name="confusion_shares",
        solution=confusion_shares,
        inputs=labels_and_answers,
        mistakes=[
            Mistake("These are counts. Divide each row by its sum.", confusion_counts),
            Mistake(
                "Rows and columns are swapped. The row is the true class.",
                lambda *inputs: confusion_shares(*inputs).T,
            ),
            Mistake(
                "You divided by the number of all frames. Divide each row by its own sum.",
                divides_by_all_frames,
            ),
            Mistake("Your columns sum to 1. Divide each row by its own sum.", divides_columns),
            Mistake(
                "Your rows are the answers. The row is the true class.",
                lambda label, answer, classes: confusion_shares(answer, label, classes),
            ),
        ],
    ),
    Exercise(
        name="stable_cross_entropy",
        solution=functional.cross_entropy,
        inputs=extreme_logits,
        mistakes=[
            Mistake(
                "exp overflows. First subtract the largest logit of each row: the softmax stays the same.",
                exp_overflows,
            ),
            Mistake(
                "A probability rounded to 0, and its log is infinite. Use log-sum-exp, not log(softmax).",
                log_of_softmax,
            ),
            Mistake(
                "This is the sum over the batch. Take the mean.",
                lambda *inputs: cross_entropies(*inputs).sum(),
            ),
            Mistake("Return one number, the mean over the batch.", cross_entropies),
            Mistake(
                "The sign is wrong. The log of a probability is negative, but the loss is positive.",
                lambda *inputs: -cross_entropies(*inputs).mean(),
            ),
            Mistake(
                "The unit of this loss is bits. Take the natural logarithm.",
                lambda *inputs: cross_entropies(*inputs).mean() / math.log(2),
            ),
            Mistake(
                "The softmax runs over the wrong dimension. It runs over the classes, not over the batch.",
                lambda *inputs: cross_entropies(*inputs, dim=0).mean(),
            ),
            Mistake(
                "You took the probability of the answer (the largest logit). Take that of the label.",
                uses_answer_as_label,
            ),
        ],
    ),
    Exercise(
        name="hedged_size",
        solution=hedged_size,
        inputs=probabilities_and_sizes,
        mistakes=[
            Mistake(
                "This is the mean size. It is best for squared metres, but not for squared per cent.",
                lambda probs, sizes: probs @ sizes,
            ),
            Mistake(
                "This is the size of the likeliest class. It ignores the other classes.",
                lambda probs, sizes: sizes[probs.argmax()],
            ),
            Mistake(
                "This is the harmonic mean. Set the derivative of the sum of p (D / D_c - 1)² to zero.",
                lambda probs, sizes: 1 / (probs / sizes).sum(),
            ),
            Mistake("The probabilities are missing. Multiply each term by its own.", ignores_probabilities),
            Mistake(
                "Numerator and denominator are swapped.",
                lambda probs, sizes: 1 / hedged_size(probs, sizes),
            ),
            Mistake(
                "This minimises D_c / D - 1, the error relative to the guess. Divide by the true size D_c.",
                error_relative_to_guess,
            ),
        ],
    ),
    Exercise(
        name="calibration_error",
        solution=calibration_error,
        inputs=probabilities_and_labels,
        mistakes=[
            Mistake(
                "You gave all bins the same weight. Weight each bin with its share of the frames.",
                same_weight_for_all_bins,
            ),
            Mistake(
                "Positive and negative differences cancel here. Take the absolute difference of each bin.",
                signed_gaps,
            ),
            Mistake(
                "You averaged confidence minus accuracy. Take the absolute difference in each bin.",
                lambda *inputs: -signed_gaps(*inputs),
            ),
            Mistake(
                "The confidence is the probability of the answer, the largest. You took that of the label.",
                probability_of_label,
            ),
            Mistake(
                "You compare single frames. First average confidence and right answers in each bin.",
                compares_single_frames,
            ),
            Mistake(
                "This is the largest difference of a bin. Take the weighted mean over the bins.",
                largest_gap,
            ),
        ],
    ),
]
