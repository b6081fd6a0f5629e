"""Rotations as angles, as six numbers and as matrices: they agree with SciPy and come back unchanged."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dronekeypp import rotations
from dronekeypp.errors import InputError


def random_rotations(n=200, seed=0):
    """Random rotation matrices (n, 3, 3), in double precision."""
    return torch.tensor(Rotation.random(n, random_state=seed).as_matrix())


def test_angles_agree_with_scipy():
    R = random_rotations()
    level = Rotation.from_matrix(np.array(rotations.LEVEL_FROM_CAMERA) @ R.numpy())
    expected = level.as_euler("ZYX") / (2 * np.pi) % 1
    np.testing.assert_allclose(rotations.matrix_to_angles(R).numpy(), expected, atol=1e-9)


def test_angles_round_trip():
    R = random_rotations()
    np.testing.assert_allclose(rotations.angles_to_matrix(rotations.matrix_to_angles(R)), R, atol=1e-9)


def test_angles_stay_below_one():
    """An angle just below zero becomes one just below a full turn, never the full turn itself."""
    tiny = rotations.angles_to_matrix(torch.tensor([-1e-9, 0.0, -1e-9]))
    assert (rotations.matrix_to_angles(tiny) < 1).all()


def test_a_level_drone_flying_away_has_yaw_zero():
    away = torch.tensor(rotations.LEVEL_FROM_CAMERA).T  # the body's x is the camera's z
    np.testing.assert_allclose(rotations.matrix_to_angles(away), 0, atol=1e-7)


def test_6d_round_trip_and_orthonormal():
    """A matrix comes back from its six numbers, and any six numbers give a rotation."""
    R = random_rotations()
    np.testing.assert_allclose(rotations.matrix_from_6d(rotations.matrix_to_6d(R)), R, atol=1e-9)
    numbers = torch.randn(50, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    rotations.check_rotation(rotations.matrix_from_6d(numbers))


def test_6d_gram_schmidt_by_hand():
    R = rotations.matrix_from_6d(torch.tensor([2.0, 0, 0, 5.0, 3.0, 0]))
    np.testing.assert_allclose(R, np.eye(3), atol=1e-7)


def test_towards_is_the_smallest_turn_to_a_ray():
    """The rotation takes z to the ray, and turns no further than the angle between the two."""
    ray = torch.tensor([[0.3, -0.4, 1.0], [0.0, 0.0, 2.0], [-2.0, 1.0, 0.5]], dtype=torch.double)
    R = rotations.towards(ray)
    rotations.check_rotation(R)
    unit = ray / ray.norm(dim=-1, keepdim=True)
    torch.testing.assert_close(R[:, :, 2], unit)
    turned = rotations.geodesic_degrees(R, torch.eye(3, dtype=torch.double).expand(3, 3, 3))
    torch.testing.assert_close(turned, torch.rad2deg(unit[:, 2].acos()))


def test_geodesic_agrees_with_scipy():
    A, B = random_rotations(seed=1), random_rotations(seed=2)
    difference = Rotation.from_matrix(A.numpy()).inv() * Rotation.from_matrix(B.numpy())
    expected = np.degrees(difference.magnitude())
    np.testing.assert_allclose(rotations.geodesic_degrees(A, B), expected, atol=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 179.999, 180.0])
def test_geodesic_is_exact_at_its_ends(degrees):
    """In single precision, angles near 0° and near 180° are right to 0.001°."""
    R = torch.tensor(Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix(), dtype=torch.float32)
    assert abs(float(rotations.geodesic_degrees(torch.eye(3), R)) - degrees) < 1e-3


@pytest.mark.parametrize(
    ("R", "message"),
    [
        (np.eye(2), "3×3"),
        (np.full((3, 3), np.nan), "NaN"),
        (np.eye(3) * 1.01, "orthonormal"),
        (np.diag([1.0, 1, -1]), "reflection"),
    ],
)
def test_not_a_rotation(R, message):
    with pytest.raises(InputError, match=message):
        rotations.check_rotation(R)


def test_no_rotations_are_all_rotations():
    """An empty stack of matrices is valid."""
    assert rotations.check_rotation(np.zeros((0, 3, 3))).shape == (0, 3, 3)
