"""Exercises of notebook 04, the [cls] classifier."""

import math

import numpy as np
import torch
from torch.nn import functional

from dronekeypp.checks import Exercise
from dronekeypp.sixdronesyn.drones import DRONES


def extreme_logits(rng):
    """logits (6, 7), label (6,): rows far from zero, where exp overflows, and one truth that is nearly ruled out, where exp is 0."""
    logits, label = 2 * rng.normal(size=(6, 7)), rng.integers(0, 7, 6)
    logits[:3] += rng.uniform(800, 1500, (3, 1))
    logits[3:, 0] += 3  # so that the rows do not share a likeliest class by chance
    label[4] = 1 + (logits[4, 1:]).argmin()
    logits[4, label[4]] -= rng.uniform(800, 1200)
    return torch.tensor(logits), torch.tensor(label)


def naive_cross_entropy(logits, label):
    powers = logits.exp()
    return -(powers / powers.sum(dim=1, keepdim=True))[range(len(label)), label].log().mean()


def negative_log_likelihood(logits, label, dim=1):
    return -torch.log_softmax(logits, dim=dim)[range(len(label)), label]


def labels_and_answers(rng):
    """label (90,), answer (90,), number of classes 5; every class is there and is answered."""
    label = np.concatenate([np.arange(5), rng.choice(5, 85, p=rng.dirichlet(4 * np.ones(5)))])
    answer = np.where(rng.random(90) < 0.6, label, rng.integers(0, 5, 90))
    answer[:5] = np.arange(5)
    return label, answer, 5


def counts(label, answer, classes):
    matrix = np.zeros((classes, classes))
    np.add.at(matrix, (label, answer), 1)
    return matrix


def confusion_shares(label, answer, classes):
    matrix = counts(label, answer, classes)
    return matrix / matrix.sum(axis=1, keepdims=True)


def probabilities(rng):
    """probs (400, 7), label (400,), bins: right in under half of the frames however sure: sure answers are too sure, unsure ones too modest."""
    z = rng.normal(size=(400, 7)) * rng.uniform(0.3, 4, (400, 1))
    probs = np.exp(z) / np.exp(z).sum(axis=1, keepdims=True)
    answer = probs.argmax(axis=1)
    label = np.where(rng.random(400) < 0.45, answer, (answer + rng.integers(1, 7, 400)) % 7)
    return probs, label, int(rng.choice([5, 8, 10]))


def gaps(probs, label, bins, sure=None, signed=False):
    """Of every bin that is not empty: accuracy minus confidence, and the bin's share of the frames."""
    sure = probs.max(axis=1) if sure is None else sure
    right = probs.argmax(axis=1) == label
    which = np.minimum((sure * bins).astype(int), bins - 1)
    used = np.unique(which)
    gap = np.array([right[which == b].mean() - sure[which == b].mean() for b in used])
    return gap if signed else np.abs(gap), np.array([(which == b).mean() for b in used])


def calibration_error(*given, **options):
    gap, share = gaps(*given, **options)
    return gap @ share


def truth_probability(probs, label, bins):
    return calibration_error(probs, label, bins, sure=probs[np.arange(len(label)), label])


def believed_wheelbases(rng):
    """probs (7,), wheelbases (7,) m."""
    return rng.dirichlet(np.ones(7)), np.array([drone.wheelbase for drone in DRONES.values()]) * rng.uniform(
        0.8, 1.2, 7
    )


EXERCISES = [
    Exercise(
        "confusion_shares",
        confusion_shares,
        labels_and_answers,
        {
            "these are counts; divide each row by its sum": counts,
            "rows and columns are swapped: the row is the true class": lambda *given: (
                confusion_shares(*given).T
            ),
            "you divided by the number of all frames; divide each row by its own sum": lambda *given: (
                counts(*given) / len(given[0])
            ),
            "your columns sum to 1; divide each row by its own sum": lambda *given: (
                counts(*given) / counts(*given).sum(axis=0)
            ),
            "rows are the answer here; the row is the true class": lambda label, answer, classes: (
                confusion_shares(answer, label, classes)
            ),
        },
    ),
    Exercise(
        "stable_cross_entropy",
        functional.cross_entropy,
        extreme_logits,
        {
            "exp overflows here: take each row's largest logit away first, the softmax stays the same": naive_cross_entropy,
            "a probability became 0, its log infinite: work with logits and log-sum-exp, not with log(softmax)": (
                lambda logits, label: -torch.softmax(logits, dim=1)[range(len(label)), label].log().mean()
            ),
            "this is the sum over the batch; take the mean": lambda *given: negative_log_likelihood(
                *given
            ).sum(),
            "one number, please: the mean over the batch": negative_log_likelihood,
            "the sign is wrong: a log of a probability is negative, the loss is positive": lambda *given: (
                -negative_log_likelihood(*given).mean()
            ),
            "this is in bits; take the natural logarithm": lambda *given: (
                negative_log_likelihood(*given).mean() / math.log(2)
            ),
            "softmax over the wrong dimension: over the classes, not over the batch": lambda *given: (
                negative_log_likelihood(*given, dim=0).mean()
            ),
            "you used the answer (the largest logit) for the truth; take the label's": (
                lambda logits, label: negative_log_likelihood(logits, logits.argmax(dim=1)).mean()
            ),
        },
    ),
    Exercise(
        "hedged_size",
        lambda probs, sizes: (probs / sizes).sum() / (probs / sizes**2).sum(),
        believed_wheelbases,
        {
            "this is the mean size: best for squared metres, not for squared per cent": lambda probs, sizes: (
                probs @ sizes
            ),
            "this is the likeliest class's size; it does not hedge": lambda probs, sizes: sizes[
                probs.argmax()
            ],
            "this is the harmonic mean; set the derivative of the sum of p (D / D_c - 1)² to zero": lambda probs, sizes: (
                1 / (probs / sizes).sum()
            ),
            "every term needs its probability": lambda probs, sizes: (1 / sizes).sum() / (1 / sizes**2).sum(),
            "upside down": lambda probs, sizes: (probs / sizes**2).sum() / (probs / sizes).sum(),
            "this minimises the error relative to the guess, D_c / D - 1; divide by the true size": (
                lambda probs, sizes: (probs * sizes**2).sum() / (probs * sizes).sum()
            ),
        },
    ),
    Exercise(
        "calibration_error",
        calibration_error,
        probabilities,
        {
            "weigh each bin with its share of the frames; you gave all bins the same weight": lambda *given: (
                gaps(*given)[0].mean()
            ),
            "too sure and too modest cancel out here; take each bin's absolute difference": lambda *given: (
                calibration_error(*given, signed=True)
            ),
            "this is how much too sure the network is overall; take the absolute difference in each bin, then the weighted mean": (
                lambda *given: -calibration_error(*given, signed=True)
            ),
            "confidence is the probability of the answer, the largest; you took that of the truth": truth_probability,
            "you compare frame by frame; average confidence and rightness in each bin first": (
                lambda probs, label, bins: np.abs((probs.argmax(axis=1) == label) - probs.max(axis=1)).mean()
            ),
            "this is the largest gap of a bin; take the mean, weighted with the bins' shares of the frames": lambda *given: (
                gaps(*given)[0].max()
            ),
        },
    ),
]
