"""Exercises of notebook 06, the pose decoder."""

from functools import partial

import numpy as np
import torch
from torch import Tensor

from dronekeypp import rotations
from dronekeypp.checks import Exercise, Mistake

TURN = 2 * np.pi  # radians
LEVEL_FROM_CAMERA = np.array(rotations.LEVEL_FROM_CAMERA)

# --- hubs_and_rays ---


def hubs_and_pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw hubs (4, 3) m in body axes, R (3, 3), and t (3,) m of a drone in front of the camera."""
    R = rotations.matrix_from_6d(torch.from_numpy(rng.normal(size=6))).numpy()
    return rng.normal(0, 0.1, (4, 3)), R, np.array([*rng.uniform(-1, 1, 2), rng.uniform(2, 6)])


def hubs_and_rays(hubs: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve the exercise: the hubs about the drone's centre (4, 3) m in camera axes, and the rays (4, 3)."""
    y3d = hubs @ R.T
    points = y3d + t
    return y3d, points / points[:, 2:]


def adds_t_to_hubs(hubs: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    y3d, rays = hubs_and_rays(hubs, R, t)
    return y3d + t, rays


def rays_without_t(hubs: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    y3d = hubs @ R.T
    return y3d, y3d / y3d[:, 2:]


def rays_of_length_1(hubs: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    y3d = hubs @ R.T
    return y3d, unit(y3d + t)


def divides_by_depth_of_centre(
    hubs: np.ndarray, R: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    y3d = hubs @ R.T
    return y3d, (y3d + t) / t[2]


def unit(v: np.ndarray) -> np.ndarray:
    """Scale the vectors (…, 3) to length 1."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


# --- camera_rotation ---


def random_turns(rng: np.random.Generator) -> tuple[np.ndarray]:
    """Draw yaw, pitch and roll (3,), in turns."""
    return (rng.uniform(size=3),)


def camera_rotation(turns: np.ndarray) -> np.ndarray:
    """Solve the exercise: the rotation (3, 3) from body to camera axes."""
    return rotations.angles_to_matrix(torch.from_numpy(turns)).numpy()


def level_rotation(angles: np.ndarray, *, reverses: bool = False, pitch_sign: int = 1) -> np.ndarray:
    """Return the rotation (3, 3) from body to level axes.

    Args:
        angles: yaw, pitch and roll (3,), in radians.
        reverses: multiply in the order Rx Ry Rz instead of Rz Ry Rx.
        pitch_sign: the sign of the pitch's sine; -1 makes a mistake.
    """
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles), np.sin(angles)
    sp = pitch_sign * sp
    Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return Rx @ Ry @ Rz if reverses else Rz @ Ry @ Rx


def takes_turns_for_radians(turns: np.ndarray) -> np.ndarray:
    return LEVEL_FROM_CAMERA.T @ level_rotation(turns)


def takes_turns_for_degrees(turns: np.ndarray) -> np.ndarray:
    return LEVEL_FROM_CAMERA.T @ level_rotation(np.radians(turns))


def reverses_the_order(turns: np.ndarray) -> np.ndarray:
    return LEVEL_FROM_CAMERA.T @ level_rotation(TURN * turns, reverses=True)


def stops_in_level_axes(turns: np.ndarray) -> np.ndarray:
    return level_rotation(TURN * turns)


def camera_to_level_twice(turns: np.ndarray) -> np.ndarray:
    return LEVEL_FROM_CAMERA @ level_rotation(TURN * turns)


def wrong_sign_of_pitch(turns: np.ndarray) -> np.ndarray:
    return LEVEL_FROM_CAMERA.T @ level_rotation(TURN * turns, pitch_sign=-1)


# --- rotation_from_rows ---


def six_numbers(rng: np.random.Generator) -> tuple[Tensor]:
    """Draw x (5, 6)."""
    return (torch.from_numpy(rng.normal(size=(5, 6))),)


def rotation_from_rows(x: Tensor) -> Tensor:
    """Solve the exercise: the rotations (B, 3, 3)."""
    return rotations.matrix_from_6d(x).mT


def row_1_and_vector_2(x: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Return row 1, of length 1, and the vector of row 2 as it is, both (B, 3)."""
    return unit(x.numpy()[:, :3]), x.numpy()[:, 3:]


def stacked_rows(row_1: np.ndarray, row_2: np.ndarray) -> np.ndarray:
    """Return (B, 3, 3) with the cross product as row 3."""
    return np.stack([row_1, row_2, np.cross(row_1, row_2)], axis=-2)


def rows_not_orthogonal(x: Tensor) -> np.ndarray:
    row_1, vector_2 = row_1_and_vector_2(x)
    return stacked_rows(row_1, unit(vector_2))


def row_2_scaled_too_early(x: Tensor) -> np.ndarray:
    row_1, vector_2 = row_1_and_vector_2(x)
    vector_2 = unit(vector_2)
    return stacked_rows(row_1, vector_2 - (row_1 * vector_2).sum(-1, keepdims=True) * row_1)


def projects_on_raw_vector(x: Tensor) -> np.ndarray:
    row_1, vector_2 = row_1_and_vector_2(x)
    vector_1 = x.numpy()[:, :3]
    return stacked_rows(row_1, unit(vector_2 - (vector_1 * vector_2).sum(-1, keepdims=True) * row_1))


def left_handed_rows(x: Tensor) -> Tensor:
    return rotation_from_rows(x) * torch.tensor([1.0, 1.0, -1.0])[:, None]


def starts_with_row_2(x: Tensor) -> Tensor:
    swapped = rotation_from_rows(torch.cat([x[:, 3:], x[:, :3]], dim=1))
    return torch.stack([swapped[:, 1], swapped[:, 0], -swapped[:, 2]], dim=1)


# --- mean_heading ---


def headings_around_north(rng: np.random.Generator) -> tuple[np.ndarray]:
    """Draw headings (6,) in turns on both sides of 0, and more of them below it."""
    return ((rng.uniform(-0.2, -0.1) + rng.uniform(-0.25, 0.25, 6)) % 1,)


def mean_heading(turns: np.ndarray, *, full_turn: float = TURN) -> float:
    """Solve the exercise: the mean heading in turns, from 0 up to 1. Another `full_turn` makes a mistake."""
    sine, cosine = np.sin(full_turn * turns).mean(), np.cos(full_turn * turns).mean()
    return np.arctan2(sine, cosine) / full_turn % 1


def signed_heading(turns: np.ndarray) -> float:
    """Return the mean heading between -0.5 and 0.5."""
    return (mean_heading(turns) + 0.5) % 1 - 0.5


EXERCISES = [
    Exercise(
        name="hubs_and_rays",
        solution=hubs_and_rays,
        inputs=hubs_and_pose,
        mistakes=[
            Mistake(
                "You used R transposed, from camera to body axes. For points in rows, write hubs @ R.T.",
                lambda hubs, R, t: hubs_and_rays(hubs, R.T, t),
            ),
            Mistake(
                "y3D is relative to the drone's centre, so it has no t. Only the rays need t.",
                adds_t_to_hubs,
            ),
            Mistake(
                "The rays need t, because they start at the camera and not at the drone's centre.",
                rays_without_t,
            ),
            Mistake(
                "These rays have length 1. In Eq. 6 their third number is 1, so divide by the depth.",
                rays_of_length_1,
            ),
            Mistake(
                "R is missing. The hubs are still in body axes.",
                lambda hubs, R, t: hubs_and_rays(hubs, np.eye(3), t),
            ),
            Mistake(
                "You divided by the depth of the drone's centre. Divide each hub by its own depth.",
                divides_by_depth_of_centre,
            ),
        ],
    ),
    Exercise(
        name="camera_rotation",
        solution=camera_rotation,
        inputs=random_turns,
        mistakes=[
            Mistake(
                "cos and sin take radians. Multiply the turns by 2 pi.",
                takes_turns_for_radians,
            ),
            Mistake(
                "These are turns, not degrees. Multiply by 2 pi instead of pi / 180.",
                takes_turns_for_degrees,
            ),
            Mistake("The order is reversed. Yaw stands on the left: Rz Ry Rx.", reverses_the_order),
            Mistake(
                "You stopped in level axes. One fixed matrix leads from there to camera axes.",
                stops_in_level_axes,
            ),
            Mistake(
                "The fixed matrix leads from camera to level axes. Use its transpose for the way back.",
                camera_to_level_twice,
            ),
            Mistake(
                "This rotation leads from camera to body axes. Transpose it.",
                lambda turns: camera_rotation(turns).T,
            ),
            Mistake(
                "The pitch has the wrong sign. In Ry, -sin is at the lower left.",
                wrong_sign_of_pitch,
            ),
        ],
    ),
    Exercise(
        name="rotation_from_rows",
        solution=rotation_from_rows,
        inputs=six_numbers,
        mistakes=[
            Mistake(
                "Your vectors are columns, as in the notebook. Here they are rows.",
                rotations.matrix_from_6d,
            ),
            Mistake(
                "Row 2 is not orthogonal to row 1. Subtract its projection on row 1.",
                rows_not_orthogonal,
            ),
            Mistake(
                "Row 2 does not have length 1. Scale it after you have subtracted its projection on row 1.",
                row_2_scaled_too_early,
            ),
            Mistake(
                "Compute the projection with row 1 of length 1, not with the first three numbers.",
                projects_on_raw_vector,
            ),
            Mistake(
                "The determinant is -1. Row 3 is row 1 x row 2, in this order.",
                left_handed_rows,
            ),
            Mistake(
                "Row 1 keeps its direction and row 2 changes. You did the opposite.",
                starts_with_row_2,
            ),
        ],
    ),
    Exercise(
        name="mean_heading",
        solution=mean_heading,
        inputs=headings_around_north,
        mistakes=[
            Mistake(
                "The mean of 0.9 and 0.1 is 0.5, the opposite heading. Average directions, not numbers.",
                np.mean,
            ),
            Mistake("The heading is right, but negative. % 1 brings it to 0 ... 1.", signed_heading),
            Mistake("This is in radians. Divide by 2 pi.", lambda turns: TURN * mean_heading(turns)),
            Mistake(
                "This is in radians, and negative. Divide by 2 pi, and then use % 1.",
                lambda turns: TURN * signed_heading(turns),
            ),
            Mistake(
                "This is in degrees. The answer should be in turns.",
                lambda turns: 360 * mean_heading(turns),
            ),
            Mistake(
                "This is in degrees, and negative. Divide by 360, and then use % 1.",
                lambda turns: 360 * signed_heading(turns),
            ),
            Mistake(
                "arctan2 takes the sine first and the cosine second.",
                lambda turns: (0.25 - mean_heading(turns)) % 1,
            ),
            Mistake(
                "cos and sin take radians. Multiply the turns by 2 pi.",
                partial(mean_heading, full_turn=1),
            ),
            Mistake("The median has the same seam. Average directions instead.", np.median),
        ],
    ),
]
