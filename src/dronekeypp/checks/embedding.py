"""Exercises of notebook 05, the ray embedding."""

from functools import partial

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise, Mistake

# --- crop_rays ---


def keypoints_in_crop(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw keypoints (4, 2) in crop units, square (3,) in pixels, and K (3, 3) of a full HD frame."""
    K = camera.intrinsics(rng.uniform(800, 2500), 1920, 1080)
    return rng.uniform(0.2, 0.8, (4, 2)), np.array([*rng.uniform(100, 900, 2), rng.uniform(40, 300)]), K


def crop_rays(keypoints: np.ndarray, square: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Solve the exercise: the rays (4, 3) with third number 1, in camera axes."""
    return camera.rays(camera.from_crop(keypoints, square), K)


def unit_rays(keypoints: np.ndarray, square: np.ndarray, K: np.ndarray) -> np.ndarray:
    rays = crop_rays(keypoints, square, K)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


# --- centre_and_spread ---


def four_rays(rng: np.random.Generator) -> tuple[np.ndarray]:
    """Draw rays (4, 3) with third number 1."""
    points = rng.uniform(-0.4, 0.4, 2) + rng.normal(0, 0.03, (4, 2))
    return (np.concatenate([points, np.ones((4, 1))], axis=1),)


def centre_and_spread(rays: np.ndarray, *, dimensions: int = 2) -> tuple[np.ndarray, float]:
    """Solve the exercise: the centre (2,) of the rays and their spread. The option makes a mistake."""
    centre = rays[:, :dimensions].mean(axis=0)
    squared = np.square(rays[:, :dimensions] - centre).sum(axis=1)  # (4,)
    return centre, np.sqrt(squared.mean())


def averages_over_x_and_y(rays: np.ndarray) -> tuple[np.ndarray, float]:
    centre = rays[:, :2].mean(axis=0)
    return centre, np.sqrt(np.square(rays[:, :2] - centre).mean())


def mean_distance(rays: np.ndarray) -> tuple[np.ndarray, float]:
    centre = rays[:, :2].mean(axis=0)
    return centre, np.linalg.norm(rays[:, :2] - centre, axis=1).mean()


def forgets_square_root(rays: np.ndarray) -> tuple[np.ndarray, float]:
    centre, spread = centre_and_spread(rays)
    return centre, spread**2


# --- expected_distance ---


def spread_and_classes(rng: np.random.Generator) -> tuple[float, np.ndarray, np.ndarray]:
    """Draw the spread, the class probabilities (7,) and the radii of the classes (7,) in metres."""
    return rng.uniform(0.01, 0.1), rng.dirichlet(np.ones(7)), rng.uniform(0.05, 0.25, 7)


def expected_distance(spread: float, probs: np.ndarray, radii: np.ndarray) -> float:
    """Solve the exercise: the expected distance in metres."""
    return probs @ radii / spread


EXERCISES = [
    Exercise(
        name="crop_rays",
        solution=crop_rays,
        inputs=keypoints_in_crop,
        mistakes=[
            Mistake(
                "K belongs to the full frame. First convert the keypoints to full-frame pixels.",
                lambda keypoints, square, K: camera.rays(keypoints, K),
            ),
            Mistake(
                "You added the corner of the crop, but you did not multiply by its side.",
                lambda keypoints, square, K: camera.rays(keypoints + square[:2], K),
            ),
            Mistake(
                "You multiplied by the side, but you did not add the corner of the crop.",
                lambda keypoints, square, K: camera.rays(keypoints * square[2], K),
            ),
            Mistake("These rays have length 1. In Eq. 6 their third number is 1.", unit_rays),
            Mistake(
                "Your y axis points up. In this camera y points down.",
                lambda *inputs: crop_rays(*inputs) * [1, -1, 1],
            ),
            Mistake("x and y are swapped.", lambda *inputs: crop_rays(*inputs)[:, [1, 0, 2]]),
        ],
    ),
    Exercise(
        name="centre_and_spread",
        solution=centre_and_spread,
        inputs=four_rays,
        mistakes=[
            Mistake(
                "You also averaged over x and y. The squared distance of a ray is their sum.",
                averages_over_x_and_y,
            ),
            Mistake(
                "This is the mean distance. The spread is the root of the mean squared distance.",
                mean_distance,
            ),
            Mistake(
                "Leave the third number out of the centre. It is always 1.",
                partial(centre_and_spread, dimensions=3),
            ),
            Mistake("The square root is missing.", forgets_square_root),
        ],
    ),
    Exercise(
        name="expected_distance",
        solution=expected_distance,
        inputs=spread_and_classes,
        mistakes=[
            Mistake(
                "You took only the likeliest class. Average over all classes with their probabilities.",
                lambda spread, probs, radii: radii[probs.argmax()] / spread,
            ),
            Mistake(
                "Divide by the spread. A large spread means that the drone is near.",
                lambda spread, probs, radii: probs @ radii * spread,
            ),
            Mistake(
                "You averaged the radii without the probabilities.",
                lambda spread, probs, radii: radii.mean() / spread,
            ),
        ],
    ),
]
