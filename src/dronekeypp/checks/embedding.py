"""Exercises of notebook 05, the ray embedding."""

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise


def cropped_keypoints(rng):
    """keypoints (4, 2) in crop units, square (3,), K (3, 3) of a full HD frame."""
    K = camera.intrinsics(rng.uniform(800, 2500), 1920, 1080)
    return rng.uniform(0.2, 0.8, (4, 2)), np.array([*rng.uniform(100, 900, 2), rng.uniform(40, 300)]), K


def crop_rays(keypoints, square, K):
    return camera.rays(camera.from_crop(keypoints, square), K)


def four_rays(rng):
    """rays (4, 3) of a drone somewhere in the frame."""
    return (
        np.concatenate([rng.uniform(-0.4, 0.4, 2) + rng.normal(0, 0.03, (4, 2)), np.ones((4, 1))], axis=1),
    )


def centre_and_spread(rays, mean=True, squared=True, dims=2):
    """The solution, and with other arguments the mistakes."""
    centre = rays[:, :dims].mean(axis=0)
    offsets = rays[:, :dims] - centre
    if not squared:
        return centre, np.linalg.norm(offsets, axis=1).mean()
    return centre, np.sqrt(np.square(offsets).sum(axis=1).mean() if mean else np.square(offsets).mean())


def believed_sizes(rng):
    """spread (a number), class probabilities (7,), radius of every class (7,) m."""
    return rng.uniform(0.01, 0.1), rng.dirichlet(np.ones(7)), rng.uniform(0.05, 0.25, 7)


EXERCISES = [
    Exercise(
        "crop_rays",
        crop_rays,
        cropped_keypoints,
        {
            "your rays change with the crop: bring the keypoints to the full frame first, K is the full frame's": (
                lambda keypoints, square, K: camera.rays(keypoints, K)
            ),
            "you add the crop's corner but forget to multiply by its side": lambda keypoints, square, K: (
                camera.rays(keypoints + square[:2], K)
            ),
            "you multiply by the side but forget the crop's corner": lambda keypoints, square, K: camera.rays(
                keypoints * square[2], K
            ),
            "these rays have length 1; Eq. 6 leaves their third number at 1": (
                lambda *given: crop_rays(*given) / np.linalg.norm(crop_rays(*given), axis=1, keepdims=True)
            ),
            "your y points up; in this camera it points down": lambda *given: crop_rays(*given) * [1, -1, 1],
            "x and y are swapped": lambda *given: crop_rays(*given)[:, [1, 0, 2]],
        },
    ),
    Exercise(
        "centre_and_spread",
        centre_and_spread,
        four_rays,
        {
            "the spread is the root of the mean squared distance; you took the mean over x and y as well": (
                lambda rays: centre_and_spread(rays, mean=False)
            ),
            "this is the mean distance; the spread is the root of the mean squared distance": lambda rays: (
                centre_and_spread(rays, squared=False)
            ),
            "leave the third number out of the centre: it is always 1": lambda rays: centre_and_spread(
                rays, dims=3
            ),
            "you forgot the square root": lambda rays: (
                centre_and_spread(rays)[0],
                centre_and_spread(rays)[1] ** 2,
            ),
        },
    ),
    Exercise(
        "expected_distance",
        lambda spread, probs, radii: probs @ radii / spread,
        believed_sizes,
        {
            "you took the likeliest class alone; let every class vote with its probability": (
                lambda spread, probs, radii: radii[probs.argmax()] / spread
            ),
            "upside down: a large spread means that the drone is near": lambda spread, probs, radii: (
                probs @ radii * spread
            ),
            "this averages the sizes without the probabilities": lambda spread, probs, radii: (
                radii.mean() / spread
            ),
        },
    ),
]
