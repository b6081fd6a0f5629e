"""Cameras as other programs write them: each is read rightly, or refused by the name of what is wrong."""

import cv2
import numpy as np
import pytest

from dronekeypp.errors import InputError
from dronekeypp.footage import Calibration, read_camera


def test_opencvs_own_calibration_files(tmp_path):
    K = np.array([[1000.0, 0, 639.5], [0, 1001.0, 359.5], [0, 0, 1]])
    for suffix in ("yml", "xml", "json"):
        file = cv2.FileStorage(str(tmp_path / f"camera.{suffix}"), cv2.FILE_STORAGE_WRITE)
        file.write("calibration_time", "today")
        file.write("image_width", 1280)
        file.write("image_height", 720)
        file.write("camera_matrix", K)
        file.write("distortion_coefficients", np.array([[-0.2, 0.05, 0.001, 0, 0]]))
        file.release()
        found = read_camera(tmp_path / f"camera.{suffix}")
        np.testing.assert_allclose(found.K[:2, 2], [640, 360])  # our pixel centres lie at +0.5
        np.testing.assert_allclose(found.opencv_K, K)
        assert found.size == (1280, 720) and len(found.distortion) == 5
    half = found.for_frames(640, 360)
    np.testing.assert_allclose(half.K[:2], found.K[:2] / 2)
    np.testing.assert_allclose(
        found.for_frames(854, 480).K[0, 0], 1000 * 854 / 1280
    )  # 480p: a third of a pixel off
    with pytest.raises(InputError, match="not the same shape"):
        found.for_frames(640, 480)
    with pytest.raises(InputError, match="a focal length of 0.9 pixels"):
        Calibration(np.array([[0.9, 0, 0.5], [0, 0.9, 0.5], [0, 0, 1]])).for_frames(640, 480)


def test_a_distorted_frame_is_straightened():
    K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    bent = Calibration(K, np.array([-0.3, 0.1, 0.0, 0.0]))
    corners = np.array([[250.0, 60.0], [290.0, 90.0]])  # of a box in the distorted picture
    box = bent.undistort_box(np.array([*corners[0], *(corners[1] - corners[0])]))
    assert box[0] + box[2] > 290 and box[1] < 60  # barrel distortion drew it towards the middle
    image = np.zeros((240, 320, 3), np.uint8)
    image[60:90, 250:290] = 255
    bright = np.argwhere(bent.undistort(image)[..., 0] > 127)
    assert box[0] - 1 <= bright[:, 1].min() and bright[:, 1].max() <= box[0] + box[2] + 1
    straight = Calibration(K)
    assert straight.undistort(image) is image


@pytest.mark.parametrize(
    "name, text, match",
    [
        ("c.json", "{", "not valid JSON"),
        ("c.json", "[]", "holds no settings"),
        ("c.json", "{}", "holds no camera_matrix"),
        ("c.json", '{"K": [[1, 0], [0, 1]]}', "3×3 numbers"),
        ("c.yml", "hello\n", "not a calibration"),
        ("c.yml", "", "is empty"),
        ("c.json", '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "fisheye_model": 1}', "no coefficients of it"),
        ("c.json", '{"K": [[-5, 0, 1], [0, 5, 1], [0, 0, 1]]}', "focal lengths must be positive"),
        (
            "c.json",
            '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "dist_coeffs": [1, 2]}',
            "distortion has 2 numbers",
        ),
        (
            "c.json",
            '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "image_width": -32, "image_height": -24}',
            "must be positive",
        ),
        (
            "c.json",
            '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "image_width": 1e999, "image_height": 24}',
            "numbers",
        ),
        ("scene_camera.json", "{}", "not one camera for all"),
        ("scene_camera.json", '{"0": 1}', "3×3 numbers|no camera_matrix"),
    ],
)
def test_bad_cameras(name, text, match, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=match):
        read_camera(tmp_path / name)
