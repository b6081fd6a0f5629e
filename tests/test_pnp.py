"""The pose from four points is exact without noise and agrees with OpenCV. Bad points are refused."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dronekeypp.camera import intrinsics, project
from dronekeypp.errors import InputError
from dronekeypp.pnp import solve_pnp

K = intrinsics(1500.0, 1920, 1080)
# The hubs of the real Mini 2 are a trapezoid whose front is 21.5 mm higher than its rear.
# So their plane is neither z = 0 nor level.
HUBS = np.array([[64.3, 87.8, 24.7], [64.3, -87.8, 24.7], [-61.1, -85.5, 3.2], [-61.1, 85.5, 3.2]]) / 1000


def random_pose(rng):
    """A random rotation (3, 3) and a place (3,) 1.5 to 8 m ahead of the camera."""
    return Rotation.random(random_state=rng).as_matrix(), rng.uniform([-0.5, -0.3, 1.5], [0.5, 0.3, 8.0])


def test_the_true_pose_is_found_without_noise():
    rng = np.random.default_rng(0)
    for _ in range(100):
        R, t = random_pose(rng)
        best = solve_pnp(HUBS, project(HUBS @ R.T + t, K), K)[0]
        np.testing.assert_allclose(best.R, R, atol=1e-4)
        np.testing.assert_allclose(best.t, t, atol=1e-4)
        assert best.error_px < 1e-3


@pytest.mark.parametrize("tilt", [-60, -20, 5, 38])
@pytest.mark.parametrize("aside", [0.0, 0.001, 0.3])
def test_a_drone_seen_from_straight_behind_is_found(tilt, aside):
    """There the plane is tilted about exactly one of its own axes, and IPPE alone gives useless poses."""
    behind = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # camera←body: the tail towards us, level
    R, t = behind @ Rotation.from_euler("y", tilt, degrees=True).as_matrix(), np.array([aside, 0, 4])
    best = solve_pnp(HUBS, project(HUBS @ R.T + t, K), K)[0]
    np.testing.assert_allclose(best.R, R, atol=1e-4)
    np.testing.assert_allclose(best.t, t, atol=1e-4)


def test_solutions_are_sorted_rotations_and_at_most_a_few():
    """With noise there are at most four solutions, the best first, and each holds a proper rotation."""
    rng = np.random.default_rng(1)
    empty = 0  # A drone seen edge-on with a pixel of noise may have no pose at all: the list is then empty.
    for _ in range(50):
        R, t = random_pose(rng)
        solutions = solve_pnp(HUBS, project(HUBS @ R.T + t, K) + rng.normal(0, 1, (4, 2)), K)
        assert len(solutions) <= 4
        if not solutions:
            empty += 1
        errors = [solution.error_px for solution in solutions]
        assert errors == sorted(errors)
        for solution in solutions:
            np.testing.assert_allclose(solution.R @ solution.R.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(solution.R) > 0
    assert empty <= 3


def test_agrees_with_opencvs_iterative_refinement():
    rng = np.random.default_rng(2)
    for _ in range(20):
        R, t = random_pose(rng)
        pixels = project(HUBS @ R.T + t, K)
        best = solve_pnp(HUBS, pixels, K)[0]
        tilt = Rotation.from_rotvec(rng.normal(0, 0.05, 3)).as_matrix()
        start, near = cv2.Rodrigues(R @ tilt)[0], (t * 1.05).reshape(3, 1)
        rvec, tvec = cv2.solvePnPRefineLM(HUBS, pixels, K, None, start, near)
        np.testing.assert_allclose(best.t, tvec.ravel(), atol=1e-3)
        np.testing.assert_allclose(best.R, cv2.Rodrigues(rvec)[0], atol=1e-3)


def test_twice_as_large_is_twice_as_far():
    """The same picture explained by a drone twice as large puts it twice as far away."""
    R, t = random_pose(np.random.default_rng(3))
    pixels = project(HUBS @ R.T + t, K)
    np.testing.assert_allclose(solve_pnp(2 * HUBS, pixels, K)[0].t, 2 * t, rtol=1e-4)


def test_a_view_of_an_array_and_a_camera_with_skew():
    """Pixels may be a view into a larger array, and K may have skew; a stack of cameras is refused."""
    R, t = random_pose(np.random.default_rng(4))
    skewed = K + [[0, 80.0, 0], [0, 0, 0], [0, 0, 0]]
    # COCO stores keypoints as x, y, visible.
    coco_keypoints = np.column_stack([project(HUBS @ R.T + t, skewed), [2, 2, 2, 2]])
    best = solve_pnp(HUBS, coco_keypoints[:, :2], skewed)[0]
    np.testing.assert_allclose(best.t, t, atol=1e-4)
    np.testing.assert_allclose(best.R, R, atol=1e-4)
    with pytest.raises(InputError, match="one camera matrix"):
        solve_pnp(HUBS, coco_keypoints[:, :2], skewed[None])


@pytest.mark.parametrize(
    ("hubs", "pixels", "message"),
    [
        (HUBS[:3], np.zeros((3, 2)), "P ≥ 4"),
        (HUBS, np.zeros((4, 3)), "P ≥ 4"),
        (HUBS, np.full((4, 2), np.nan), "NaN"),
        (np.outer(np.arange(4.0), [1, 0, 0]), np.zeros((4, 2)), "one line"),
        (HUBS + [[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0, 0, 0]], np.zeros((4, 2)), "not coplanar"),
    ],
)
def test_bad_input(hubs, pixels, message):
    with pytest.raises(InputError, match=message):
        solve_pnp(hubs, pixels, K)
