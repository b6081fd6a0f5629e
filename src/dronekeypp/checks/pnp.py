"""Exercises of notebook 02, PnP and the scale ambiguity."""

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise
from dronekeypp.checks.dataset import drone_before_a_camera, hub_pixels, position, rotation
from dronekeypp.sixdronesyn.drones import DRONES


def found_pose(rng):
    """hubs (4, 3), R, t, K, and pixels (4, 2) that do not fit quite."""
    hubs, R, t, K = drone_before_a_camera(rng)
    return hubs, R, t, K, hub_pixels(hubs, R, t, K) + rng.normal(0, 1.5, (4, 2))


def offsets(hubs, R, t, K, pixels):
    return hub_pixels(hubs, R, t, K) - pixels


def transposed_error(hubs, R, t, K, pixels):
    """With hubs @ R, the camera in front of them all the same."""
    return np.sqrt(np.square(camera.project(hubs @ R + t, K) - pixels).sum(axis=1).mean())


def ranged_positions(rng):
    """t (12, 3) m by PnP with a wrong size, distances (12,) m by a rangefinder, 3 % noise."""
    t = rng.uniform(1.5, 8, (12, 1)) * np.concatenate(
        [rng.uniform(-0.6, 0.6, (12, 2)), np.ones((12, 1))], axis=1
    )
    return t, rng.uniform(0.4, 2.5) * np.linalg.norm(t, axis=1) * (1 + rng.normal(0, 0.03, 12))


def size_factor(t, distances, length=np.linalg.norm):
    d = length(t, axis=1)
    return d @ distances / (d @ d)


def two_poses_each(rng):
    """R (20, 2, 3, 3)."""
    return (np.stack([[rotation(rng), rotation(rng)] for _ in range(20)]),)


def upright_poses(R, height=lambda R: -R[:, :, 1, 2]):
    """The solution, and with another height the mistakes."""
    return R[np.arange(len(R)), height(R).argmax(axis=1)]


def turned_drone(rng):
    """hubs (4, 3), R, t; the body axes are turned, or the plane's normal could be found by luck."""
    hubs = DRONES[rng.choice(list(DRONES))].hubs @ rotation(rng).T
    return hubs, rotation(rng), position(rng)


def flipped_pose(hubs, R, t, sight="middle", normal=lambda Vt: Vt[2], move=True, order="MRN"):
    """The solution, and with other arguments the mistakes."""
    middle = hubs.mean(axis=0)
    there = R @ middle + t
    v = {"middle": there, "t": t, "axis": np.array([0, 0, 1.0])}[sight]
    n = normal(np.linalg.svd(hubs - middle)[2])
    mirrors = {"M": np.eye(3) - 2 * np.outer(v, v) / (v @ v), "R": R, "N": np.eye(3) - 2 * np.outer(n, n)}
    flipped = np.linalg.multi_dot([mirrors[letter] for letter in order])
    return flipped, there - flipped @ middle if move else t


EXERCISES = [
    Exercise(
        "reprojection_error",
        lambda *given: np.sqrt(np.square(offsets(*given)).sum(axis=1).mean()),
        found_pose,
        {
            "this is the mean distance; take the root of the mean squared distance": lambda *given: (
                np.linalg.norm(offsets(*given), axis=1).mean()
            ),
            "you took the mean over u and v as well; add their squares first, then the mean over the points": (
                lambda *given: np.sqrt(np.square(offsets(*given)).mean())
            ),
            "you forgot the square root": lambda *given: np.square(offsets(*given)).sum(axis=1).mean(),
            "this is the root of the sum; take the mean over the points": lambda *given: np.sqrt(
                np.square(offsets(*given)).sum()
            ),
            "R is transposed: points lie in rows, so R h becomes `hubs @ R.T`": transposed_error,
            "one number, please: the root of the mean over the points, not each point's distance": (
                lambda *given: np.linalg.norm(offsets(*given), axis=1)
            ),
        },
    ),
    Exercise(
        "size_factor",
        size_factor,
        ranged_positions,
        {
            "a rangefinder measures the distance |t|, not the depth z": lambda t, d: size_factor(
                t, d, lambda t, axis: t[:, 2]
            ),
            "upside down: found too near means that the drone is larger than you told PnP": lambda t, d: (
                1 / size_factor(t, d)
            ),
            "this is the mean of the ratios; least squares divides sum(|t| d) by sum(|t|²)": lambda t, d: (
                d / np.linalg.norm(t, axis=1)
            ).mean(),
            "this is the ratio of the sums; least squares divides sum(|t| d) by sum(|t|²)": lambda t, d: (
                d.sum() / np.linalg.norm(t, axis=1).sum()
            ),
            "you let the line start anywhere; it goes through zero, so there is no offset to fit": (
                lambda t, d: np.polyfit(np.linalg.norm(t, axis=1), d, 1)[0]
            ),
        },
    ),
    Exercise(
        "upright_poses",
        upright_poses,
        two_poses_each,
        {
            "these hang upside down: in camera axes y points down": lambda R: upright_poses(
                R, lambda R: R[:, :, 1, 2]
            ),
            "you read a row of R; the drone's up direction is its third column": lambda R: upright_poses(
                R, lambda R: -R[:, :, 2, 1]
            ),
            "this is the drone's nose (first column); its up direction is the third": lambda R: upright_poses(
                R, lambda R: -R[:, :, 1, 0]
            ),
            "you took the z part of body z: away from the camera. Up in the picture is -y": lambda R: (
                upright_poses(R, lambda R: R[:, :, 2, 2])
            ),
            "you took the z part of body z: towards the camera. Up in the picture is -y": lambda R: (
                upright_poses(R, lambda R: -R[:, :, 2, 2])
            ),
            "you always take the first pose": lambda R: R[:, 0],
            "these are the numbers of the poses; return the rotations themselves": lambda R: R[
                :, :, 1, 2
            ].argmin(axis=1),
        },
    ),
    Exercise(
        "flipped_pose",
        flipped_pose,
        turned_drone,
        {
            "the rotation is right; but with the old t the hubs' middle moves. Choose t so that it stays": (
                lambda *given: flipped_pose(*given, move=False)
            ),
            "mirror along the line of sight, from the camera to the hubs' middle; you took the z axis": (
                lambda *given: flipped_pose(*given, sight="axis")
            ),
            "the line of sight runs to the hubs' middle, R @ middle + t; you took t": lambda *given: (
                flipped_pose(*given, sight="t")
            ),
            "one mirror alone has det -1: that is no rotation. You left out N": lambda *given: flipped_pose(
                *given, order="MR"
            ),
            "one mirror alone has det -1: that is no rotation. You left out M": lambda *given: flipped_pose(
                *given, order="RN"
            ),
            "N acts in body axes, before R; M in camera axes, after it. You swapped them": lambda *given: (
                flipped_pose(*given, order="NRM")
            ),
            "the normal is the direction of least spread, the last row of Vᵀ; you took a column": (
                lambda *given: flipped_pose(*given, normal=lambda Vt: Vt[:, 2])
            ),
            "the normal is the direction of least spread, the last row of Vᵀ; you took the first": (
                lambda *given: flipped_pose(*given, normal=lambda Vt: Vt[0])
            ),
        },
    ),
]
