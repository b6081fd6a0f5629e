"""Exercises of notebook 06, the pose decoder."""

import numpy as np
import torch

from dronekeypp import rotations
from dronekeypp.checks import Exercise

TURN = 2 * np.pi
LEVEL = np.array(rotations.LEVEL_FROM_CAMERA)


def posed_hubs(rng):
    """hubs (4, 3) in body axes, R (3, 3), t (3,) of a drone in front of the camera."""
    R = rotations.matrix_from_6d(torch.from_numpy(rng.normal(size=6))).numpy()
    return rng.normal(0, 0.1, (4, 3)), R, np.array([*rng.uniform(-1, 1, 2), rng.uniform(2, 6)])


def hubs_and_rays(hubs, R, t):
    y3d = hubs @ R.T
    return y3d, (y3d + t) / (y3d + t)[:, 2:]


def length_1(v, axis=-1):
    return v / np.linalg.norm(v, axis=axis, keepdims=True)


def level_rotation(angles, order="zyx", pitch_sign=1):
    """The product of three turns; angles (3,) in radians."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles), np.sin(angles)
    sp = pitch_sign * sp
    about = {
        "z": np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]),
        "y": np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]),
        "x": np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]]),
    }
    return about[order[0]] @ about[order[1]] @ about[order[2]]


def camera_rotation(turns):
    return rotations.angles_to_matrix(torch.from_numpy(turns)).numpy()


def rotation_from_rows(x):
    return rotations.matrix_from_6d(x).mT


def stacked_rows(first, second):
    return np.stack([first, second, np.cross(first, second)], axis=-2)


def vectors(x):
    """x (B, 6): first unit vector, second vector, both (B, 3)."""
    return length_1(x.numpy()[:, :3]), x.numpy()[:, 3:]


def rows_not_orthogonal(x):
    first, b = vectors(x)
    return stacked_rows(first, length_1(b))


def rows_scaled_too_early(x):
    first, b = vectors(x)
    b = length_1(b)
    return stacked_rows(first, b - (first * b).sum(-1, keepdims=True) * first)


def rows_share_of_raw(x):
    first, b = vectors(x)
    return stacked_rows(first, length_1(b - (x.numpy()[:, :3] * b).sum(-1, keepdims=True) * first))


def rows_left_handed(x):
    return rotation_from_rows(x) * torch.tensor([1.0, 1.0, -1.0])[:, None]


def rows_second_first(x):
    swapped = rotation_from_rows(torch.cat([x[:, 3:], x[:, :3]], dim=1))
    return torch.stack([swapped[:, 1], swapped[:, 0], -swapped[:, 2]], dim=1)


def around_north(rng):
    """turns (6,) on both sides of 0, a little more of them below it."""
    return ((rng.uniform(-0.2, -0.1) + rng.uniform(-0.25, 0.25, 6)) % 1,)


def mean_heading(turns, whole=TURN):
    """The solution; with another `whole` for one turn, a mistake."""
    return np.arctan2(np.sin(whole * turns).mean(), np.cos(whole * turns).mean()) / whole % 1


EXERCISES = [
    Exercise(
        "hubs_and_rays",
        hubs_and_rays,
        posed_hubs,
        {
            "this is R transposed, from camera to body axes; for points in rows it is hubs @ R.T": lambda hubs, R, t: (
                hubs_and_rays(hubs, R.T, t)
            ),
            "y3D is relative to the drone's centre: leave t out of it, and add it for the rays": (
                lambda hubs, R, t: (hubs @ R.T + t, hubs_and_rays(hubs, R, t)[1])
            ),
            "the rays lack t: they start at the camera, not at the drone's centre": (
                lambda hubs, R, t: (hubs @ R.T, hubs @ R.T / (hubs @ R.T)[:, 2:])
            ),
            "these rays have length 1; Eq. 6 leaves their third number at 1, so divide by the depth": (
                lambda hubs, R, t: (hubs @ R.T, length_1(hubs @ R.T + t))
            ),
            "R is missing: the hubs are still in body axes": lambda hubs, R, t: hubs_and_rays(
                hubs, np.eye(3), t
            ),
            "you divided by the depth of the drone's centre; every hub has a depth of its own": (
                lambda hubs, R, t: (hubs @ R.T, (hubs @ R.T + t) / t[2])
            ),
        },
    ),
    Exercise(
        "camera_rotation",
        camera_rotation,
        lambda rng: (rng.uniform(size=3),),
        {
            "cos and sin take radians; a turn is 2 pi of them": lambda turns: LEVEL.T @ level_rotation(turns),
            "these are turns, not degrees: multiply by 2 pi instead of pi / 180": lambda turns: (
                LEVEL.T @ level_rotation(np.radians(turns))
            ),
            "the order is reversed: yaw stands on the left, Rz Ry Rx": lambda turns: (
                LEVEL.T @ level_rotation(TURN * turns, "xyz")
            ),
            "you stopped in the level frame: camera axes are one fixed matrix away": lambda turns: (
                level_rotation(TURN * turns)
            ),
            "the fixed matrix leads from camera to level axes; you need the way back, its transpose": (
                lambda turns: LEVEL @ level_rotation(TURN * turns)
            ),
            "this leads from camera to body axes: transpose it": lambda turns: camera_rotation(turns).T,
            "the pitch has the wrong sign: Ry has its -sin at the lower left": lambda turns: (
                LEVEL.T @ level_rotation(TURN * turns, pitch_sign=-1)
            ),
        },
    ),
    Exercise(
        "rotation_from_rows",
        rotation_from_rows,
        lambda rng: (torch.from_numpy(rng.normal(size=(5, 6))),),
        {
            "your vectors are columns, as in the notebook; here they are rows": rotations.matrix_from_6d,
            "row 2 is not at right angles to row 1: take away its share along row 1": rows_not_orthogonal,
            "row 2 is not of length 1: scale it after its share along row 1 is taken away": rows_scaled_too_early,
            "measure the share with row 1 at length 1, not with the raw first vector": rows_share_of_raw,
            "determinant -1: row 3 is row 1 x row 2, in this order": rows_left_handed,
            "row 1 keeps its direction and row 2 gives way; you have it the other way round": rows_second_first,
        },
    ),
    Exercise(
        "mean_heading",
        mean_heading,
        around_north,
        {
            "the plain mean of 0.9 and 0.1 is 0.5, the opposite heading: average directions, not numbers": lambda turns: (
                turns.mean()
            ),
            "right, but negative: % 1 brings it to 0 ... 1": lambda turns: (
                (mean_heading(turns) + 0.5) % 1 - 0.5
            ),
            "this is in radians; divide by 2 pi": lambda turns: TURN * mean_heading(turns),
            "this is in radians, and negative: divide by 2 pi, then % 1": lambda turns: (
                TURN * ((mean_heading(turns) + 0.5) % 1 - 0.5)
            ),
            "this is in degrees; the answer should be in turns": lambda turns: 360 * mean_heading(turns),
            "this is in degrees, and negative: divide by 360, then % 1": lambda turns: (
                360 * ((mean_heading(turns) + 0.5) % 1 - 0.5)
            ),
            "arctan2 takes the sine first, then the cosine": lambda turns: (0.25 - mean_heading(turns)) % 1,
            "cos and sin take radians; a turn is 2 pi of them": lambda turns: mean_heading(turns, whole=1),
            "the median has a seam too; average directions instead": np.median,
        },
    ),
]
