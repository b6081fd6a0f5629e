"""Exercises of notebook 07, training."""

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise
from dronekeypp.checks.decoder import posed_hubs
from dronekeypp.sixdronesyn.drones import DRONES

S = np.diag([-1.0, 1, 1])  # camera axes: left and right
S_BODY = np.diag([1.0, -1, 1])  # body axes: y points left
SWAP = [1, 0, 3, 2]  # FL, FR, RR, RL


def keypoint_pairs(rng):
    """predicted and true (5, 4, 2) in crop units, the crop's side in pixels."""
    true = rng.uniform(0.1, 0.9, (5, 4, 2))
    return true + rng.normal(0, 0.03, true.shape), true, float(rng.integers(64, 225))


def keypoint_loss(predicted, true, side):
    return np.square(side * (predicted - true)).mean()


def short_way(predicted, true):
    """Signed, -0.5 to 0.5 turns."""
    return (predicted - true + 0.5) % 1 - 0.5


def circular_gradient(predicted, true):
    return 2 * short_way(predicted, true) / predicted.size


def training_plan(rng):
    """steps, lr, warmup, end."""
    lr = 10 ** rng.uniform(-4, -2)
    return int(rng.integers(20, 60)), lr, int(rng.integers(4, 9)), lr * rng.uniform(0.02, 0.2)


def warm_cosine(
    steps, lr, warmup, end, floor=True, start=True, first=1, shape=lambda x: (1 + np.cos(np.pi * x)) / 2
):
    """The solution, and with other arguments the mistakes."""
    step = np.arange(steps)
    end = end if floor else 0.0
    progress = (step - warmup) / (steps - warmup) if start else step / steps
    return np.where(step < warmup, lr * (step + first) / (warmup + first), end + (lr - end) * shape(progress))


def both_at_once(steps, lr, warmup, end):
    """Warm-up times cosine, as in `train.learning_rate`."""
    step = np.arange(steps)
    return np.minimum(1, (step + 1) / (warmup + 1)) * (
        end + (lr - end) * (1 + np.cos(np.pi * step / steps)) / 2
    )


def labelled_frame(rng):
    """R (3, 3), t (3,), pixels (4, 2) of a real drone's hubs, cx."""
    _, R, t = posed_hubs(rng)
    hubs = list(DRONES.values())[rng.integers(len(DRONES))].hubs
    K = camera.intrinsics(rng.uniform(800, 2500), 1920, 1080)
    K[0, 2] += rng.uniform(-50, 50)
    return R, t, camera.project(hubs @ R.T + t, K), float(K[0, 2])


def mirrored_labels(R, t, pixels, cx, body=S_BODY, order=SWAP):
    """The solution, and with other arguments the mistakes."""
    return S @ R @ body, S @ t, np.stack([2 * cx - pixels[order, 0], pixels[order, 1]], axis=1)


def mirrored_but(part, value):
    """mirrored_labels with one of its three answers replaced by `value(R, t, pixels, cx)`."""

    def wrong(*given):
        answers = list(mirrored_labels(*given))
        answers[part] = value(*given)
        return tuple(answers)

    return wrong


EXERCISES = [
    Exercise(
        "keypoint_loss",
        keypoint_loss,
        keypoint_pairs,
        {
            "this is still in crop units": lambda predicted, true, side: keypoint_loss(predicted, true, 1),
            "the errors are squared, so the unit counts twice: side squared": lambda predicted, true, side: (
                side * keypoint_loss(predicted, true, 1)
            ),
            "upside down: a crop unit is many pixels, so the loss grows": lambda predicted, true, side: (
                keypoint_loss(predicted, true, 1 / side)
            ),
            "this is the sum of the squares, not their mean": lambda predicted, true, side: np.square(
                side * (predicted - true)
            ).sum(),
            "you added x and y and averaged over keypoints; the MSE averages over all numbers": (
                lambda *given: 2 * keypoint_loss(*given)
            ),
            "leave the root out: this is the root of the mean squared error": lambda *given: np.sqrt(
                keypoint_loss(*given)
            ),
            "square the errors; these are their absolute values": lambda predicted, true, side: np.abs(
                side * (predicted - true)
            ).mean(),
        },
    ),
    Exercise(
        "circular_gradient",
        circular_gradient,
        lambda rng: (rng.uniform(size=(5, 3)), rng.uniform(size=(5, 3))),
        {
            "this takes the long way round where the angles are more than half a turn apart": (
                lambda predicted, true: 2 * (predicted - true) / predicted.size
            ),
            "beyond half a turn the short way goes in the other direction: the sign changes": (
                lambda predicted, true: np.sign(predicted - true) * np.abs(circular_gradient(predicted, true))
            ),
            "a gradient has a sign; this is its absolute value": lambda *given: np.abs(
                circular_gradient(*given)
            ),
            "this points down the hill; the gradient points up, and the optimiser steps against it": lambda *given: (
                -circular_gradient(*given)
            ),
            "the derivative of a square has a factor 2": lambda *given: circular_gradient(*given) / 2,
            "the loss is a mean: divide by the number of angles": lambda *given: 2 * short_way(*given),
            "the mean is over all 3 B angles, not over the 3 of one frame": lambda *given: (
                2 * short_way(*given) / 3
            ),
            "the mean is over all 3 B angles, not over the B frames": lambda *given: (
                2 * short_way(*given) / len(given[0])
            ),
        },
    ),
    Exercise(
        "warm_cosine",
        warm_cosine,
        training_plan,
        {
            "your cosine starts at step 0; here it starts where the warm-up ends": lambda *given: warm_cosine(
                *given, start=False
            ),
            "this multiplies warm-up and cosine, as the notebook does; here one follows the other": both_at_once,
            "it falls to 0; it should end at `end`": lambda *given: warm_cosine(*given, floor=False),
            "step 0 has the rate 0 and learns nothing: count from 1, (step + 1) / (warmup + 1)": lambda *given: (
                warm_cosine(*given, first=0)
            ),
            "the warm-up is missing": lambda steps, lr, warmup, end: warm_cosine(steps, lr, 0, end),
            "a cosine falls from 1 to -1; bring it to 1 ... 0 first": lambda *given: warm_cosine(
                *given, shape=lambda x: np.cos(np.pi * x)
            ),
            "this falls in a straight line": lambda *given: warm_cosine(*given, shape=lambda x: 1 - x),
        },
        close=1e-7,
    ),
    Exercise(
        "mirrored_labels",
        mirrored_labels,
        labelled_frame,
        {
            "your R has determinant -1, a reflection: the drone's own left and right change too": (
                lambda *given: mirrored_labels(*given, body=np.eye(3))
            ),
            "on the body's side you mirrored x, its nose; left and right are y": lambda *given: (
                mirrored_labels(*given, body=S)
            ),
            "R is not mirrored": mirrored_but(0, lambda R, t, pixels, cx: R),
            "S and S' are on the wrong sides: body axes on the right, camera axes on the left": mirrored_but(
                0, lambda R, *_: S_BODY @ R @ S
            ),
            "t is not mirrored": mirrored_but(1, lambda R, t, pixels, cx: t),
            "the pixels turn about the principal point, x = cx, not about x = 0": mirrored_but(
                2, lambda R, t, pixels, cx: (pixels * [-1, 1])[SWAP]
            ),
            "the hubs keep their names: the propeller that was front left is now front right": (
                lambda *given: mirrored_labels(*given, order=[0, 1, 2, 3])
            ),
            "you swapped front and rear; a mirror swaps left and right": lambda *given: mirrored_labels(
                *given, order=[3, 2, 1, 0]
            ),
        },
    ),
]
