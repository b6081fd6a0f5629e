"""Exercises of notebook 01, the data set."""

from functools import partial

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise, Mistake
from dronekeypp.sixdronesyn.drones import DRONES

WIDTH, HEIGHT = 1920, 1080  # the frame, pixels
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])  # camera axes


# --- hub_pixels ---


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """Draw a rotation (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def random_position(rng: np.random.Generator) -> np.ndarray:
    """Draw the position t (3,) of a drone inside the frame, metres in camera axes."""
    return rng.uniform(2, 8) * np.array([rng.uniform(0.1, 0.4), rng.uniform(-0.3, -0.1), 1])


def drone_and_camera(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Draw hubs (4, 3) in metres, R (3, 3), t (3,) in metres and K (3, 3)."""
    hubs = list(DRONES.values())[rng.integers(7)].hubs
    focal = rng.uniform(1150, 1850)
    centre = rng.normal([WIDTH / 2, HEIGHT / 2], 20)
    K = camera.intrinsics(focal, WIDTH, HEIGHT, centre=centre)
    return hubs.copy(), random_rotation(rng), random_position(rng), K


def hub_pixels(hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Solve the exercise: the pixels (4, 2) of the hubs.

    It is what `camera.project` computes, without its checks, so that the mistakes may go into it.
    """
    pixels = homogeneous_pixels(hubs, R, t, K)
    return pixels[:, :2] / pixels[:, 2:]


def homogeneous_pixels(hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Return the pixels before the division by the depth, (4, 3)."""
    return (hubs @ R.T + t) @ K.T


def keeps_third_number(hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray) -> np.ndarray:
    pixels = homogeneous_pixels(hubs, R, t, K)
    return pixels / pixels[:, 2:]


def translates_first(hubs: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray) -> np.ndarray:
    return camera.project((hubs + t) @ R.T, K)


# --- leaked_share ---


def environments_of_two_splits(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw the environment number of each training frame (n,) and of each test frame (m,).

    The test frames have six environments, and three of these also occur in the training frames.
    """
    environments = rng.permutation(22)
    train = np.repeat(environments[:14], rng.integers(10, 60, 14))
    test = np.repeat(environments[11:17], rng.integers(5, 40, 6))
    return rng.permutation(train), rng.permutation(test)


def leaked_share(train: np.ndarray, test: np.ndarray) -> float:
    """Solve the exercise: the share of the test frames whose environment occurs in training."""
    return np.isin(test, train).mean()


# --- opengl_pose ---


def random_pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw R (3, 3) and t (3,) in metres."""
    return random_rotation(rng), random_position(rng)


def opengl_pose(
    R: np.ndarray, t: np.ndarray, *, flip: np.ndarray = OPENGL_FROM_OPENCV
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the exercise: the pose in OpenGL's camera axes. Another `flip` makes a mistake."""
    return flip @ R, flip @ t


def turns_body_axes(R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return R @ OPENGL_FROM_OPENCV, OPENGL_FROM_OPENCV @ t


def turns_both_axes(R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return OPENGL_FROM_OPENCV @ R @ OPENGL_FROM_OPENCV, OPENGL_FROM_OPENCV @ t


# --- crop_squares ---


def boxes_and_frame(rng: np.random.Generator) -> tuple[np.ndarray, int, int]:
    """Draw six boxes (6, 4) as (x, y, width, height), and return the frame's width and height, all in pixels.

    The first box is in the middle, the next four are at the left, right, top and bottom edge. The square of
    the last box is higher than the frame.
    """
    w, h = rng.uniform(120, 300, 5), rng.uniform(60, 110, 5)
    x_middle, x_left, x_right = rng.uniform(600, 1000), rng.uniform(0, 5), WIDTH - w[2] - rng.uniform(0, 5)
    x = np.array([x_middle, x_left, x_right, *rng.uniform(600, 1000, 2)])
    y = np.array([*rng.uniform(400, 500, 3), rng.uniform(0, 5), HEIGHT - h[4] - rng.uniform(0, 5)])
    large = [rng.uniform(400, 480), rng.uniform(200, 300), rng.uniform(940, 1000), rng.uniform(400, 500)]
    return np.concatenate([np.stack([x, y, w, h], axis=1), [large]]), WIDTH, HEIGHT


def crop_squares(
    boxes: np.ndarray,
    width: int,
    height: int,
    *,
    longer_side: bool = True,
    centre: float = 0.5,
    shrinks: bool = True,
    keeps_middle: bool = True,
    limits_left_and_top: bool = True,
    limits_right_and_bottom: bool = True,
    limit_axes: tuple[int, int] = (0, 1),
) -> np.ndarray:
    """Solve the exercise: the squares (B, 3) as (x, y, side). Other options make mistakes."""
    frame = np.array([width, height])
    box_side = boxes[:, 2:].max(axis=1) if longer_side else boxes[:, 2:].min(axis=1)
    wanted = 1.2 * box_side  # (B,)
    side = np.minimum(wanted, frame.min()) if shrinks else wanted
    middle = boxes[:, :2] + centre * boxes[:, 2:]  # (B, 2)
    corner = middle - (side if keeps_middle else wanted)[:, None] / 2
    if limits_left_and_top:
        corner = np.maximum(corner, 0)
    if limits_right_and_bottom:
        corner = np.minimum(corner, frame[list(limit_axes)] - side[:, None])
    return np.concatenate([corner, side[:, None]], axis=1)


def cuts_at_edges(boxes: np.ndarray, width: int, height: int) -> np.ndarray:
    """Cut the squares at the frame's edges and return the shorter side of what remains."""
    squares = crop_squares(
        boxes, width, height, shrinks=False, limits_left_and_top=False, limits_right_and_bottom=False
    )
    low = np.maximum(squares[:, :2], 0)
    high = np.minimum(squares[:, :2] + squares[:, 2:], [width, height])
    return np.concatenate([low, (high - low).min(axis=1, keepdims=True)], axis=1)


EXERCISES = [
    Exercise(
        name="hub_pixels",
        solution=hub_pixels,
        inputs=drone_and_camera,
        mistakes=[
            Mistake(
                "R is transposed. The points are rows, so R X becomes `hubs @ R.T`.",
                lambda hubs, R, t, K: hub_pixels(hubs, R.T, t, K),
            ),
            Mistake(
                "K is transposed. The points are rows, so K X becomes `X @ K.T`.",
                lambda hubs, R, t, K: hub_pixels(hubs, R, t, K.T),
            ),
            Mistake(
                "The division by the depth is missing. The depth is the third number after K.",
                lambda *inputs: homogeneous_pixels(*inputs)[:, :2],
            ),
            Mistake("Return only u and v. The third number is always 1.", keeps_third_number),
            Mistake("The rotation comes first and t second: R X + t.", translates_first),
            Mistake(
                "You rotated the hubs, but you did not add t.",
                lambda hubs, R, t, K: hub_pixels(hubs, R, 0 * t, K),
            ),
            Mistake(
                "The principal point is missing. Add c_x and c_y.",
                lambda hubs, R, t, K: hub_pixels(hubs, R, t, K) - K[:2, 2],
            ),
            Mistake(
                "Your y axis points up. In this camera y points down.",
                lambda hubs, R, t, K: hub_pixels(hubs, R, t, K @ np.diag([1, -1, 1])),
            ),
        ],
    ),
    Exercise(
        name="leaked_share",
        solution=leaked_share,
        inputs=environments_of_two_splits,
        mistakes=[
            Mistake(
                "This is the share of the test environments. Count test frames instead.",
                lambda train, test: leaked_share(train, np.unique(test)),
            ),
            Mistake(
                "You swapped train and test. Count the test frames whose environment occurs in training.",
                lambda train, test: leaked_share(test, train),
            ),
            Mistake(
                "This is a number of frames. Divide it by the number of test frames.",
                lambda train, test: np.isin(test, train).sum(),
            ),
            Mistake(
                "This is the share that did not leak.", lambda train, test: 1 - leaked_share(train, test)
            ),
            Mistake(
                "Divide by the number of test frames, not by the number of training frames.",
                lambda train, test: np.isin(test, train).sum() / len(train),
            ),
        ],
    ),
    Exercise(
        name="opengl_pose",
        solution=opengl_pose,
        inputs=random_pose,
        mistakes=[
            Mistake(
                "You changed only t. R also leads to camera axes, so it changes too.",
                lambda R, t: (R, OPENGL_FROM_OPENCV @ t),
            ),
            Mistake(
                "You changed only R. t is also written in camera axes, so it changes too.",
                lambda R, t: (OPENGL_FROM_OPENCV @ R, t),
            ),
            Mistake(
                "You changed the body axes, the columns of R. Multiply R from the left.",
                turns_body_axes,
            ),
            Mistake("The body axes stay as they are. Multiply R only from the left.", turns_both_axes),
            Mistake(
                "You flipped only y. This is a mirror, with det R = -1. Flip z as well.",
                partial(opengl_pose, flip=np.diag([1, -1, 1])),
            ),
            Mistake(
                "You flipped only z. This is a mirror, with det R = -1. Flip y as well.",
                partial(opengl_pose, flip=np.diag([1, 1, -1])),
            ),
        ],
    ),
    Exercise(
        name="crop_squares",
        solution=crop_squares,
        inputs=boxes_and_frame,
        mistakes=[
            Mistake(
                "Some squares reach over the edge of the frame. Move them inside.",
                partial(crop_squares, limits_left_and_top=False, limits_right_and_bottom=False),
            ),
            Mistake(
                "You limit x and y at the left and the top. Limit them at the right and the bottom as well.",
                partial(crop_squares, limits_right_and_bottom=False),
            ),
            Mistake(
                "Do not cut a square at the edge. Move it: a square that is cut shows less around the drone.",
                cuts_at_edges,
            ),
            Mistake(
                "A square that is larger than the frame must shrink to the frame's shorter side.",
                partial(crop_squares, shrinks=False),
            ),
            Mistake(
                "A square that shrinks keeps its middle. Compute the corner with the new side.",
                partial(crop_squares, keeps_middle=False),
            ),
            Mistake(
                "Take the longer side of the box. Otherwise the drone does not fit.",
                partial(crop_squares, longer_side=False),
            ),
            Mistake(
                "The x and y of a box are its corner, not its middle.",
                partial(crop_squares, centre=0),
            ),
            Mistake(
                "The largest x depends on the frame's width, the largest y on the frame's height.",
                partial(crop_squares, limit_axes=(0, 0)),
            ),
        ],
    ),
]
