"""Exercises of notebook 01, the data set."""

import numpy as np

from dronekeypp import camera
from dronekeypp.checks import Exercise
from dronekeypp.sixdronesyn.drones import DRONES

WIDTH, HEIGHT = 1920, 1080
OPENGL = np.diag([1.0, -1.0, -1.0])


def rotation(rng):
    """A random rotation (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def position(rng):
    """t (3,) m of a drone somewhere in the frame."""
    return rng.uniform(2, 8) * np.array([rng.uniform(0.1, 0.4), rng.uniform(-0.3, -0.1), 1])


def drone_before_a_camera(rng):
    """hubs (4, 3), R, t, K."""
    hubs = list(DRONES.values())[rng.integers(7)].hubs
    K = camera.intrinsics(
        rng.uniform(1150, 1850), WIDTH, HEIGHT, centre=rng.normal([WIDTH / 2, HEIGHT / 2], 20)
    )
    return hubs.copy(), rotation(rng), position(rng), K


def hub_pixels(hubs, R, t, K):
    return camera.project(hubs @ R.T + t, K)


def homogeneous(hubs, R, t, K):
    return (hubs @ R.T + t) @ K.T


def a_pose(rng):
    """R, t."""
    return rotation(rng), position(rng)


def boxes_everywhere(rng):
    """boxes (6, 4) in the middle, at each edge of the frame, and one whose square is higher than the frame; width, height."""
    w, h = rng.uniform(120, 300, 5), rng.uniform(60, 110, 5)
    x = np.array(
        [
            rng.uniform(600, 1000),
            rng.uniform(0, 5),
            WIDTH - w[2] - rng.uniform(0, 5),
            *rng.uniform(600, 1000, 2),
        ]
    )
    y = np.array([*rng.uniform(400, 500, 3), rng.uniform(0, 5), HEIGHT - h[4] - rng.uniform(0, 5)])
    large = [rng.uniform(400, 480), rng.uniform(200, 300), rng.uniform(940, 1000), rng.uniform(400, 500)]
    return np.concatenate([np.stack([x, y, w, h], axis=1), [large]]), WIDTH, HEIGHT


def crop_squares(
    boxes, width, height, longer=True, centre=0.5, limit=True, high=(0, 1), low=0.0, keep_middle=True
):
    """The solution, and with other arguments the mistakes."""
    frame = np.array([width, height])
    wanted = 1.2 * (boxes[:, 2:].max(axis=1) if longer else boxes[:, 2:].min(axis=1))  # (B,)
    side = np.minimum(wanted, frame.min()) if limit else wanted
    middle = boxes[:, :2] + centre * boxes[:, 2:]  # (B, 2)
    corner = middle - (side if keep_middle else wanted)[:, None] / 2
    last = np.inf if high is None else frame[list(high)] - side[:, None]
    return np.concatenate([np.minimum(np.maximum(corner, low), last), side[:, None]], axis=1)


def cut_squares(boxes, width, height):
    """Squares cut off at the frame's edge: (x, y, width, height) no longer square, of which the shorter side is kept."""
    squares = crop_squares(boxes, width, height, limit=False, high=None, low=-np.inf)
    low = np.maximum(squares[:, :2], 0)
    high = np.minimum(squares[:, :2] + squares[:, 2:], [width, height])
    return np.concatenate([low, (high - low).min(axis=1, keepdims=True)], axis=1)


def two_splits(rng):
    """Number of the environment behind every training frame (n,) and every test frame (m,); three of six test places are in both."""
    places = rng.permutation(22)
    train = np.repeat(places[:14], rng.integers(10, 60, 14))
    test = np.repeat(places[11:17], rng.integers(5, 40, 6))
    return rng.permutation(train), rng.permutation(test)


EXERCISES = [
    Exercise(
        "hub_pixels",
        hub_pixels,
        drone_before_a_camera,
        {
            "R is transposed: points lie in rows, so R X becomes `hubs @ R.T`": lambda hubs, R, t, K: (
                camera.project(hubs @ R + t, K)
            ),
            "K is transposed: points lie in rows, so K X becomes `X @ K.T`": lambda hubs, R, t, K: hub_pixels(
                hubs, R, t, K.T
            ),
            "divide by the depth: the third number after multiplying with K": lambda *given: homogeneous(
                *given
            )[:, :2],
            "right, but keep u and v only: the third number is always 1": lambda *given: (
                homogeneous(*given) / homogeneous(*given)[:, 2:]
            ),
            "the rotation comes first, then t: R X + t": lambda hubs, R, t, K: camera.project(
                (hubs + t) @ R.T, K
            ),
            "you rotated the hubs but forgot to move them by t": lambda hubs, R, t, K: hub_pixels(
                hubs, R, 0 * t, K
            ),
            "you forgot the principal point: add c_x and c_y": lambda hubs, R, t, K: (
                hub_pixels(hubs, R, t, K) - K[:2, 2]
            ),
            "your y points up; in this camera it points down": lambda hubs, R, t, K: hub_pixels(
                hubs, R, t, K @ np.diag([1, -1, 1])
            ),
        },
    ),
    Exercise(
        "leaked_share",
        lambda train, test: np.isin(test, train).mean(),
        two_splits,
        {
            "this is the share of the test's places; count its frames": lambda train, test: np.isin(
                np.unique(test), train
            ).mean(),
            "other way round: of the test frames, how many stand before a training place?": lambda train, test: (
                np.isin(train, test).mean()
            ),
            "this is a number of frames; divide it by the number of test frames": lambda train, test: np.isin(
                test, train
            ).sum(),
            "this is the share that did not leak": lambda train, test: 1 - np.isin(test, train).mean(),
            "divide by the number of test frames, not of training frames": lambda train, test: (
                np.isin(test, train).sum() / len(train)
            ),
        },
    ),
    Exercise(
        "opengl_pose",
        lambda R, t: (OPENGL @ R, OPENGL @ t),
        a_pose,
        {
            "you changed t only; the rotation ends in camera axes too": lambda R, t: (R, OPENGL @ t),
            "you changed R only; t is written in camera axes too": lambda R, t: (OPENGL @ R, t),
            "you turned the drone's own axes (the columns of R); turn the camera's, from the left": lambda R, t: (
                R @ OPENGL,
                OPENGL @ t,
            ),
            "the body axes stay as they are: change R from the left only": lambda R, t: (
                OPENGL @ R @ OPENGL,
                OPENGL @ t,
            ),
            "you flipped y only; that is a mirror, det R = -1. z flips as well": lambda R, t: (
                np.diag([1, -1, 1]) @ R,
                np.diag([1, -1, 1]) @ t,
            ),
            "you flipped z only; that is a mirror, det R = -1. y flips as well": lambda R, t: (
                np.diag([1, 1, -1]) @ R,
                np.diag([1, 1, -1]) @ t,
            ),
        },
    ),
    Exercise(
        "crop_squares",
        crop_squares,
        boxes_everywhere,
        {
            "some squares reach over the frame's edge; move them inside": lambda *given: crop_squares(
                *given, low=-np.inf, high=None
            ),
            "you clamp at the left and the top only; the right and bottom edges count as well": lambda *given: (
                crop_squares(*given, high=None)
            ),
            "do not cut at the edge, move: a square that is cut shows less of the surroundings": cut_squares,
            "a square larger than the frame must shrink to the frame's shorter side": lambda *given: (
                crop_squares(*given, limit=False)
            ),
            "a square that shrinks keeps its middle: take the new side for the corner": lambda *given: (
                crop_squares(*given, keep_middle=False)
            ),
            "take the box's longer side, or the drone will not fit": lambda *given: crop_squares(
                *given, longer=False
            ),
            "a box's x and y are its corner, not its middle": lambda *given: crop_squares(*given, centre=0),
            "the last possible x hangs on the width, the last possible y on the height": lambda *given: (
                crop_squares(*given, high=(0, 0))
            ),
        },
    ),
]
