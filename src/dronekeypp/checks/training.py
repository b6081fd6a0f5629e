"""Exercises of notebook 07, training."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise, Mistake
from dronekeypp.checks.decoder import hubs_and_pose
from dronekeypp.sixdronesyn.drones import DRONES

S = np.diag([-1.0, 1, 1])  # mirrors left and right in camera axes
S_BODY = np.diag([1.0, -1, 1])  # mirrors left and right in body axes, where y points left
MIRRORED_ORDER = (1, 0, 3, 2)  # of the hubs front left, front right, rear right, rear left

Labels = tuple[np.ndarray, np.ndarray, np.ndarray]  # R (3, 3), t (3,) and pixels (4, 2)

# --- keypoint_loss ---


def keypoint_pairs(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Draw predicted and true keypoints (5, 4, 2) in crop units, and the crop's side in pixels."""
    true = rng.uniform(0.1, 0.9, (5, 4, 2))
    return true + rng.normal(0, 0.03, true.shape), true, float(rng.integers(64, 225))


def keypoint_loss(predicted: np.ndarray, true: np.ndarray, side: float) -> float:
    """Solve the exercise: the loss in squared pixels."""
    return np.square(side * (predicted - true)).mean()


def side_not_squared(predicted: np.ndarray, true: np.ndarray, side: float) -> float:
    return side * keypoint_loss(predicted, true, 1)


def sum_of_squares(predicted: np.ndarray, true: np.ndarray, side: float) -> float:
    return np.square(side * (predicted - true)).sum()


def absolute_errors(predicted: np.ndarray, true: np.ndarray, side: float) -> float:
    return np.abs(side * (predicted - true)).mean()


# --- circular_gradient ---


def predicted_and_true_angles(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw predicted and true angles (5, 3), in turns."""
    return rng.uniform(size=(5, 3)), rng.uniform(size=(5, 3))


def short_way(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the signed difference on the short way round, from -0.5 to 0.5 turns."""
    return (predicted - true + 0.5) % 1 - 0.5


def circular_gradient(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Solve the exercise: the gradient (B, 3) of the mean of Eq. 10 with respect to `predicted`."""
    return 2 * short_way(predicted, true) / predicted.size


def takes_long_way(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    return 2 * (predicted - true) / predicted.size


def keeps_sign_of_long_way(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.sign(predicted - true) * np.abs(circular_gradient(predicted, true))


# --- warm_cosine ---


def training_plan(rng: np.random.Generator) -> tuple[int, float, int, float]:
    """Draw the number of steps, the learning rate, the warm-up steps, and the learning rate at the end."""
    lr = 10 ** rng.uniform(-4, -2)
    return int(rng.integers(20, 60)), lr, int(rng.integers(4, 9)), lr * rng.uniform(0.02, 0.2)


def half_cosine(x: np.ndarray) -> np.ndarray:
    """Fall from 1 to 0 while x grows from 0 to 1."""
    return (1 + np.cos(np.pi * x)) / 2


def cosine_from_1_to_minus_1(x: np.ndarray) -> np.ndarray:
    return np.cos(np.pi * x)


def straight_line(x: np.ndarray) -> np.ndarray:
    return 1 - x


def warm_cosine(
    steps: int,
    lr: float,
    warmup: int,
    end: float,
    *,
    falls_to_0: bool = False,
    cosine_from_step_0: bool = False,
    first: int = 1,
    shape: Callable[[np.ndarray], np.ndarray] = half_cosine,
) -> np.ndarray:
    """Solve the exercise: the learning rates (steps,). Other options make mistakes."""
    step = np.arange(steps)
    if falls_to_0:
        end = 0.0
    progress = step / steps if cosine_from_step_0 else (step - warmup) / (steps - warmup)
    return np.where(step < warmup, lr * (step + first) / (warmup + first), end + (lr - end) * shape(progress))


def multiplies_warmup_and_cosine(steps: int, lr: float, warmup: int, end: float) -> np.ndarray:
    """Compute the rates as `train.learning_rate` does."""
    step = np.arange(steps)
    warm_up = np.minimum(1, (step + 1) / (warmup + 1))
    return warm_up * (end + (lr - end) * (1 + np.cos(np.pi * step / steps)) / 2)


# --- mirrored_labels ---


def labelled_frame(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Draw R (3, 3), t (3,) m, the pixels (4, 2) of a drone's hubs, and cx in pixels."""
    _, R, t = hubs_and_pose(rng)
    hubs = list(DRONES.values())[rng.integers(len(DRONES))].hubs
    K = camera.intrinsics(rng.uniform(800, 2500), 1920, 1080)
    K[0, 2] += rng.uniform(-50, 50)
    return R, t, camera.project(hubs @ R.T + t, K), float(K[0, 2])


def mirrored_labels(
    R: np.ndarray,
    t: np.ndarray,
    pixels: np.ndarray,
    cx: float,
    *,
    body_mirror: np.ndarray = S_BODY,
    order: Sequence[int] = MIRRORED_ORDER,
) -> Labels:
    """Solve the exercise: R, t and pixels of the mirrored picture. Other options make mistakes."""
    reordered = pixels[list(order)]
    mirrored_pixels = np.stack([2 * cx - reordered[:, 0], reordered[:, 1]], axis=1)
    return S @ R @ body_mirror, S @ t, mirrored_pixels


def keeps_R(R: np.ndarray, t: np.ndarray, pixels: np.ndarray, cx: float) -> Labels:
    _, mirrored_t, mirrored_pixels = mirrored_labels(R, t, pixels, cx)
    return R, mirrored_t, mirrored_pixels


def swaps_the_mirrors(R: np.ndarray, t: np.ndarray, pixels: np.ndarray, cx: float) -> Labels:
    _, mirrored_t, mirrored_pixels = mirrored_labels(R, t, pixels, cx)
    return S_BODY @ R @ S, mirrored_t, mirrored_pixels


def keeps_t(R: np.ndarray, t: np.ndarray, pixels: np.ndarray, cx: float) -> Labels:
    mirrored_R, _, mirrored_pixels = mirrored_labels(R, t, pixels, cx)
    return mirrored_R, t, mirrored_pixels


def mirrors_pixels_at_0(R: np.ndarray, t: np.ndarray, pixels: np.ndarray, cx: float) -> Labels:
    return mirrored_labels(R, t, pixels, 0.0)


EXERCISES = [
    Exercise(
        name="keypoint_loss",
        solution=keypoint_loss,
        inputs=keypoint_pairs,
        mistakes=[
            Mistake(
                "This loss is in crop units. Return squared pixels.",
                lambda predicted, true, side: keypoint_loss(predicted, true, 1),
            ),
            Mistake(
                "The errors are squared, so their unit is squared too. Multiply by side squared.",
                side_not_squared,
            ),
            Mistake(
                "You divided by the side. A crop unit is many pixels, so multiply.",
                lambda predicted, true, side: keypoint_loss(predicted, true, 1 / side),
            ),
            Mistake("This is the sum of the squares. Return their mean.", sum_of_squares),
            Mistake(
                "You added x and y, and averaged over the keypoints. The MSE averages over all numbers.",
                lambda *inputs: 2 * keypoint_loss(*inputs),
            ),
            Mistake(
                "This is the root of the mean squared error. Leave the root out.",
                lambda *inputs: np.sqrt(keypoint_loss(*inputs)),
            ),
            Mistake("You averaged the absolute errors. Square the errors instead.", absolute_errors),
        ],
    ),
    Exercise(
        name="circular_gradient",
        solution=circular_gradient,
        inputs=predicted_and_true_angles,
        mistakes=[
            Mistake(
                "If the angles differ by more than half a turn, this takes the long way round.",
                takes_long_way,
            ),
            Mistake(
                "Beyond half a turn, the short way has the other direction, so the sign changes.",
                keeps_sign_of_long_way,
            ),
            Mistake(
                "This is the absolute value. A gradient has a sign.",
                lambda *inputs: np.abs(circular_gradient(*inputs)),
            ),
            Mistake(
                "The sign is wrong. The gradient points uphill, and the optimiser steps against it.",
                lambda *inputs: -circular_gradient(*inputs),
            ),
            Mistake(
                "The derivative of a square has a factor of 2.",
                lambda *inputs: circular_gradient(*inputs) / 2,
            ),
            Mistake(
                "The loss is a mean. Divide by the number of angles.",
                lambda *inputs: 2 * short_way(*inputs),
            ),
            Mistake(
                "The mean runs over all 3 B angles, not over the 3 angles of a frame.",
                lambda *inputs: 2 * short_way(*inputs) / 3,
            ),
            Mistake(
                "The mean runs over all 3 B angles, not over the B frames.",
                lambda predicted, true: 2 * short_way(predicted, true) / len(predicted),
            ),
        ],
    ),
    Exercise(
        name="warm_cosine",
        solution=warm_cosine,
        inputs=training_plan,
        mistakes=[
            Mistake(
                "Your cosine starts at step 0. It should start where the warm-up ends.",
                partial(warm_cosine, cosine_from_step_0=True),
            ),
            Mistake(
                "You multiplied warm-up and cosine, as the notebook does. Here one follows the other.",
                multiplies_warmup_and_cosine,
            ),
            Mistake(
                "The learning rate falls to 0. It should fall to `end`.",
                partial(warm_cosine, falls_to_0=True),
            ),
            Mistake(
                "Step 0 has the rate 0 and learns nothing. Count from 1: (step + 1) / (warmup + 1).",
                partial(warm_cosine, first=0),
            ),
            Mistake(
                "The warm-up is missing.",
                lambda steps, lr, warmup, end: warm_cosine(steps, lr, 0, end),
            ),
            Mistake(
                "The cosine falls from 1 to -1. Scale it so that it falls from 1 to 0.",
                partial(warm_cosine, shape=cosine_from_1_to_minus_1),
            ),
            Mistake(
                "This rate falls in a straight line, not as a cosine.",
                partial(warm_cosine, shape=straight_line),
            ),
        ],
        close=1e-7,
    ),
    Exercise(
        name="mirrored_labels",
        solution=mirrored_labels,
        inputs=labelled_frame,
        mistakes=[
            Mistake(
                "Your R is a reflection, with det R = -1. Mirror the drone's own left and right as well.",
                partial(mirrored_labels, body_mirror=np.eye(3)),
            ),
            Mistake(
                "In body axes you mirrored x, which points forward. Mirror y, which points left.",
                partial(mirrored_labels, body_mirror=S),
            ),
            Mistake("R is not mirrored.", keeps_R),
            Mistake(
                "S and S' are swapped. The camera's S stands on the left of R, the body's S' on the right.",
                swaps_the_mirrors,
            ),
            Mistake("t is not mirrored.", keeps_t),
            Mistake(
                "Mirror the pixels at the principal point, x = cx, and not at x = 0.",
                mirrors_pixels_at_0,
            ),
            Mistake(
                "Reorder the pixels. The propeller that was front left is now front right.",
                partial(mirrored_labels, order=(0, 1, 2, 3)),
            ),
            Mistake(
                "You swapped front and rear. A mirror swaps left and right.",
                partial(mirrored_labels, order=(3, 2, 1, 0)),
            ),
        ],
    ),
]
