"""Exercises of notebook 02, PnP and the scale ambiguity."""

from functools import partial

import numpy as np

from dronekeypp.checks import Exercise, Mistake
from dronekeypp.checks.dataset import drone_and_camera, hub_pixels, random_position, random_rotation
from dronekeypp.sixdronesyn.drones import DRONES

# --- reprojection_error ---


def pose_and_detections(
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Draw hubs (4, 3) m, R (3, 3), t (3,) m, K (3, 3), and detected pixels (4, 2) with some noise."""
    hubs, R, t, K = drone_and_camera(rng)
    return hubs, R, t, K, hub_pixels(hubs, R, t, K) + rng.normal(0, 1.5, (4, 2))


def residuals(
    hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray, pixels: np.ndarray
) -> np.ndarray:
    """Return projected minus detected pixels, (4, 2)."""
    return hub_pixels(hubs, R, t, K) - pixels


def reprojection_error(
    hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray, pixels: np.ndarray
) -> float:
    """Solve the exercise: the RMS reprojection error in pixels."""
    return np.sqrt(np.square(residuals(hubs, R, t, K, pixels)).sum(axis=1).mean())


def transposes_R(hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray, pixels: np.ndarray) -> float:
    return reprojection_error(hubs, R.T, t, K, pixels)


# --- size_factor ---


def positions_and_distances(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw the answers of PnP with a wrong size and those of a rangefinder.

    Returns:
        t (12, 3) in metres, and distances (12,) in metres with 3 % noise.
    """
    depth = rng.uniform(1.5, 8, (12, 1))
    rays = np.concatenate([rng.uniform(-0.6, 0.6, (12, 2)), np.ones((12, 1))], axis=1)
    t = depth * rays
    distances = rng.uniform(0.4, 2.5) * np.linalg.norm(t, axis=1) * (1 + rng.normal(0, 0.03, 12))
    return t, distances


def size_factor(t: np.ndarray, distances: np.ndarray, *, uses_depth: bool = False) -> float:
    """Solve the exercise: the factor of the size by least squares. The option makes a mistake."""
    d = t[:, 2] if uses_depth else np.linalg.norm(t, axis=1)
    return d @ distances / (d @ d)


def mean_of_ratios(t: np.ndarray, distances: np.ndarray) -> float:
    return (distances / np.linalg.norm(t, axis=1)).mean()


def ratio_of_sums(t: np.ndarray, distances: np.ndarray) -> float:
    return distances.sum() / np.linalg.norm(t, axis=1).sum()


def slope_with_offset(t: np.ndarray, distances: np.ndarray) -> float:
    return np.polyfit(np.linalg.norm(t, axis=1), distances, 1)[0]


# --- upright_poses ---


def two_rotations_per_frame(rng: np.random.Generator) -> tuple[np.ndarray]:
    """Draw R (20, 2, 3, 3)."""
    rotations = [random_rotation(rng) for _ in range(40)]
    return (np.reshape(rotations, (20, 2, 3, 3)),)


def upright_poses(R: np.ndarray, *, row: int = 1, column: int = 2, sign: int = -1) -> np.ndarray:
    """Solve the exercise: the rotation (n, 3, 3) of each frame in which body z points more upwards.

    Up in the picture is -y, so the height of body z is -R[1, 2]. Another entry or sign makes a mistake.
    """
    height = sign * R[:, :, row, column]  # (n, 2)
    return R[np.arange(len(R)), height.argmax(axis=1)]


# --- flipped_pose ---


def flat_drone_and_pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw hubs (4, 3) m, R (3, 3) and t (3,) m.

    The body axes are turned at random. Without that, a wrong normal could be right by chance.
    """
    hubs = DRONES[rng.choice(list(DRONES))].hubs @ random_rotation(rng).T
    return hubs, random_rotation(rng), random_position(rng)


def flipped_pose(
    hubs: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    *,
    sight: str = "middle",
    normal_row: int = 2,
    transposes_Vt: bool = False,
    keeps_t: bool = False,
    order: str = "MRN",
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the exercise: the second pose, R' (3, 3) and t' (3,). Other options make mistakes.

    Args:
        hubs: (4, 3), metres in body axes, in one plane.
        R: (3, 3), from body to camera axes.
        t: (3,), metres in camera axes.
        sight: where the line of sight leads: to the "middle" of the hubs, along "t" or along the "axis" z.
        normal_row: the row of Vᵀ that is taken for the plane's normal.
        transposes_Vt: take a column of Vᵀ instead of a row.
        keeps_t: return t as it is.
        order: the factors of R' from left to right.
    """
    middle = hubs.mean(axis=0)
    middle_in_camera = R @ middle + t
    if sight == "middle":
        v = middle_in_camera
    elif sight == "t":
        v = t
    else:
        v = np.array([0, 0, 1.0])
    Vt = np.linalg.svd(hubs - middle)[2]
    n = Vt.T[normal_row] if transposes_Vt else Vt[normal_row]
    factors = {"M": np.eye(3) - 2 * np.outer(v, v) / (v @ v), "R": R, "N": np.eye(3) - 2 * np.outer(n, n)}
    flipped = np.linalg.multi_dot([factors[letter] for letter in order])
    if keeps_t:
        return flipped, t
    return flipped, middle_in_camera - flipped @ middle


EXERCISES = [
    Exercise(
        name="reprojection_error",
        solution=reprojection_error,
        inputs=pose_and_detections,
        mistakes=[
            Mistake(
                "This is the mean distance. Take the root of the mean squared distance.",
                lambda *inputs: np.linalg.norm(residuals(*inputs), axis=1).mean(),
            ),
            Mistake(
                "You also took the mean over u and v. Add their squares first, then average over the points.",
                lambda *inputs: np.sqrt(np.square(residuals(*inputs)).mean()),
            ),
            Mistake(
                "The square root is missing.",
                lambda *inputs: np.square(residuals(*inputs)).sum(axis=1).mean(),
            ),
            Mistake(
                "This is the root of the sum. Take the mean over the points instead of the sum.",
                lambda *inputs: np.sqrt(np.square(residuals(*inputs)).sum()),
            ),
            Mistake("R is transposed. The points are rows, so R h becomes `hubs @ R.T`.", transposes_R),
            Mistake(
                "These are the distances of the points. Return one number, the root of their mean square.",
                lambda *inputs: np.linalg.norm(residuals(*inputs), axis=1),
            ),
        ],
    ),
    Exercise(
        name="size_factor",
        solution=size_factor,
        inputs=positions_and_distances,
        mistakes=[
            Mistake(
                "A rangefinder measures the distance |t|, not the depth z.",
                partial(size_factor, uses_depth=True),
            ),
            Mistake(
                "This is the inverse of the factor. If PnP's answer is too near, the drone is larger.",
                lambda t, distances: 1 / size_factor(t, distances),
            ),
            Mistake(
                "This is the mean of the ratios. Least squares divides sum(|t| d) by sum(|t|²).",
                mean_of_ratios,
            ),
            Mistake(
                "This is the ratio of the sums. Least squares divides sum(|t| d) by sum(|t|²).",
                ratio_of_sums,
            ),
            Mistake(
                "You fitted a line with an offset. The line must go through zero, so it has no offset.",
                slope_with_offset,
            ),
        ],
    ),
    Exercise(
        name="upright_poses",
        solution=upright_poses,
        inputs=two_rotations_per_frame,
        mistakes=[
            Mistake(
                "These drones hang upside down. In camera axes y points down.",
                partial(upright_poses, sign=1),
            ),
            Mistake(
                "You read a row of R. The drone's up direction is the third column.",
                partial(upright_poses, row=2, column=1),
            ),
            Mistake(
                "This is the drone's forward direction, the first column. Its up direction is the third.",
                partial(upright_poses, column=0),
            ),
            Mistake(
                "You took the z component of body z, away from the camera. Up in the picture is -y.",
                partial(upright_poses, row=2, sign=1),
            ),
            Mistake(
                "You took the z component of body z, towards the camera. Up in the picture is -y.",
                partial(upright_poses, row=2),
            ),
            Mistake("You always take the first pose.", lambda R: R[:, 0]),
            Mistake(
                "These are the numbers of the poses. Return the rotations themselves.",
                lambda R: R[:, :, 1, 2].argmin(axis=1),
            ),
        ],
    ),
    Exercise(
        name="flipped_pose",
        solution=flipped_pose,
        inputs=flat_drone_and_pose,
        mistakes=[
            Mistake(
                "The rotation is right, but the old t moves the hubs' middle. Choose t so that it stays.",
                partial(flipped_pose, keeps_t=True),
            ),
            Mistake(
                "You mirrored along the z axis. Mirror along the line from the camera to the hubs' middle.",
                partial(flipped_pose, sight="axis"),
            ),
            Mistake(
                "You mirrored along t. The line of sight leads to the hubs' middle, R @ middle + t.",
                partial(flipped_pose, sight="t"),
            ),
            Mistake(
                "You left out N. With a single mirror the determinant is -1, which is no rotation.",
                partial(flipped_pose, order="MR"),
            ),
            Mistake(
                "You left out M. With a single mirror the determinant is -1, which is no rotation.",
                partial(flipped_pose, order="RN"),
            ),
            Mistake(
                "You swapped M and N. N acts in body axes, before R. M acts in camera axes, after R.",
                partial(flipped_pose, order="NRM"),
            ),
            Mistake(
                "You took a column of Vᵀ. The normal is the direction of least spread, the last row of Vᵀ.",
                partial(flipped_pose, transposes_Vt=True),
            ),
            Mistake(
                "You took the first row of Vᵀ. The normal is the direction of least spread, the last row.",
                partial(flipped_pose, normal_row=0),
            ),
        ],
    ),
]
