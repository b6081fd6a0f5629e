"""Projection, rays and crops agree with OpenCV and with each other; an impossible camera is refused."""

import cv2
import numpy as np
import pytest
import torch

from dronekeypp import camera
from dronekeypp.errors import InputError

K = camera.intrinsics(1500.0, 1920, 1080)


def random_points(rng, n=6):
    """Points (n, 3) in metres, 2 to 8 m ahead of the camera."""
    return rng.uniform([-1, -1, 2], [1, 1, 8], (n, 3))


def test_projection_agrees_with_opencv():
    points = random_points(np.random.default_rng(0))
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, None)[0][:, 0]
    np.testing.assert_allclose(camera.project(points, K), expected, atol=1e-9)


def test_rays_invert_projection_and_work_in_torch_batches():
    points = random_points(np.random.default_rng(1), 8).reshape(2, 4, 3)
    expected = points / points[..., 2:]
    np.testing.assert_allclose(camera.rays(camera.project(points, K), K), expected, atol=1e-12)
    batch_K = torch.tensor(K).expand(2, 3, 3)
    rays = camera.rays(camera.project(torch.tensor(points), batch_K), batch_K)
    np.testing.assert_allclose(rays.numpy(), expected, atol=1e-12)


def test_rays_handle_skew():
    skewed = K + [[0, 3.0, 0], [0, 0, 0], [0, 0, 0]]
    points = random_points(np.random.default_rng(2))
    rays = camera.rays(camera.project(points, skewed), skewed)
    np.testing.assert_allclose(rays, points / points[:, 2:], atol=1e-12)


def test_a_crop_never_changes_a_ray():
    """Pixels of a crop with the crop's own camera matrix give the rays of the whole picture."""
    pixels = camera.project(random_points(np.random.default_rng(3)), K)
    for square in (np.array([100.0, 50.0, 300.0]), np.array([812.3, 410.7, 61.9])):
        units = camera.to_crop(pixels, square)
        np.testing.assert_allclose(camera.from_crop(units, square), pixels, atol=1e-9)
        cropped = camera.rays(units * 96, camera.crop_intrinsics(K, square, 96))
        np.testing.assert_allclose(cropped, camera.rays(pixels, K), atol=1e-9)


def test_square_is_centred_on_the_box():
    np.testing.assert_allclose(camera.square_around((10, 20, 40, 20), margin=1.5), [0, 0, 60])


@pytest.mark.parametrize("box", [(0, 0, 0, 5), (0, 0, 5, -1), (np.nan, 0, 5, 5)])
def test_bad_box(box):
    with pytest.raises(InputError, match="width and height"):
        camera.square_around(box)


@pytest.mark.parametrize(
    ("K_bad", "message"),
    [
        (np.eye(4), "3×3"),
        (K * np.nan, "NaN"),
        (np.diag([-1.0, 1, 1]), "positive"),
        (K.T, "transposed"),
        (np.eye(3) * 2, "rows"),
    ],
)
def test_bad_intrinsics(K_bad, message):
    with pytest.raises(InputError, match=message):
        camera.check_intrinsics(K_bad)


def test_crop_image_is_subpixel_exact():
    """A linear ramp stays the same linear function of the full-frame pixel position, whatever the crop."""
    x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(120) + 0.5)
    ramp = np.stack([x, y, x + y], -1).astype(np.float32)
    for square, size in (([20.3, 11.7, 48.0], 48), ([10.25, 8.5, 96.0], 24), ([50.1, 40.2, 12.0], 36)):
        square = np.array(square)
        units = (np.arange(size) + 0.5) / size
        expected = square[:2] + units[:, None] * square[2]
        crop = camera.crop_image(ramp, square, size)
        np.testing.assert_allclose(crop[size // 2, :, 0], expected[:, 0], atol=0.05)
        np.testing.assert_allclose(crop[:, size // 2, 1], expected[:, 1], atol=0.05)


def test_crop_image_rejects_an_empty_square():
    with pytest.raises(InputError, match="side"):
        camera.crop_image(np.zeros((10, 10, 3), np.uint8), (0, 0, 0), 8)


def test_nothing_in_nothing_out():
    """An empty stack of camera matrices is valid."""
    assert camera.check_intrinsics(np.zeros((0, 3, 3))).shape == (0, 3, 3)


def test_a_square_larger_than_the_frame_shrinks():
    square = camera.clamp_square((-10, 0, 3000), 1920, 1080)
    assert square.dtype == np.float64
    assert square.tolist() == [840.0, 0.0, 1080.0]
