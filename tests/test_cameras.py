"""Cameras as other programs write them: each is read rightly, or refused by the name of what is wrong."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_files import TREES, Camera, ros_message, two_messages, yaml_text

from dronekeypp.errors import InputError
from dronekeypp.footage import Calibration, fit_to_frames, read_camera


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


CENTRED = "[[1600, 0, 959.5], [0, 1600, 539.5], [0, 0, 1]]"


def read_text(folder, text, name="camera.json"):
    (folder / name).write_text(text)
    return read_camera(folder / name)


def plain(entries):
    """A plain JSON file of a camera of 1920×1080, with more entries."""
    return f'{{"camera_matrix": {CENTRED}, {entries}}}'


@pytest.mark.parametrize(
    "entries, distortion",
    [
        ('"distortion": [[-0.1, 0.01, -0.004, -0.002, -0.001]]', [-0.1, 0.01, -0.004, -0.002, -0.001]),
        ('"dist_coefs": [-0.3, 0.4, 0, 0, -0.9], "CameraModel": "Brown"', [-0.3, 0.4, 0, 0, -0.9]),
        ('"lens": {"Dist": [-0.1, 0.01, 0, 0]}', [-0.1, 0.01, 0, 0]),
        ('"k1": -0.1, "k2": 0.01', [-0.1, 0.01, 0, 0]),
        ('"k1": -0.1, "k2": 0.01, "p1": 0.001, "p2": 0.002, "k3": 0.03', [-0.1, 0.01, 0.001, 0.002, 0.03]),
        ('"D": []', None),
        ('"dist_coeffs": [0, 0, 0, 0]', None),
    ],
)
def test_distortion_under_any_name(tmp_path, entries, distortion):
    found = read_text(tmp_path, plain(entries))
    assert (None if found.distortion is None else found.distortion.tolist()) == distortion
    assert not found.fisheye


@pytest.mark.parametrize(
    "entries",
    [
        '"resolution": [1920, 1080]',
        '"Image_Size": [1920, 1080]',
        '"img_size": {"Width": 1920, "Height": 1080}',
        '"width": 1920.0, "height": 1080',
        '"calibration": {"image_width": 1920, "image_height": 1080}',
        '"image_width": 1920, "image_height": 1080, "resolution": [1920, 1080], "board_width": 9',
    ],
)
def test_the_size_under_any_name(tmp_path, entries):
    found = read_text(tmp_path, plain(entries))
    assert found.size == (1920, 1080)
    np.testing.assert_allclose(found.for_frames(960, 540).K, [[800, 0, 480], [0, 800, 270], [0, 0, 1]])


@pytest.mark.parametrize(
    "entries, match",
    [
        ('"undistorted_coeff": [0.1]', "undistorted_coeff looks like the distortion"),
        ('"lens": {"distortion": {"a": 0.1}}', "lens.distortion.a looks like the distortion"),
        ('"radial": [0.1, 0.2]', "radial looks like the distortion"),
        ('"D1": [0.1, 0.2, 0, 0]', "D1 looks like the distortion"),
        ('"k1": 0.1', "k1 without k2"),
        ('"k1": 0.1, "k2": 0.1, "k3": 0.1, "k4": 0.1, "p1": 0, "p2": 0', "k4 means one thing in OpenCV"),
        ('"dist": [0.1, 0, 0, 0], "D": [0.2, 0, 0, 0]', "D and dist differ"),
        ('"dist": [0.1, 0, 0, 0], "k1": 0.1, "k2": 0', "keep one of them"),
        ('"dist": [0.1, 0, 0, true]', "dist needs numbers, not True"),
        ('"dist": [0.1, 0, 0, NaN]', "dist needs finite numbers"),
        ('"dist": [0.1, 0, 0, 1e9]', "no lens bends the picture so far"),
        ('"D": [0.1, 0, 0, 0, 1e9]', "no lens bends the picture so far"),
        ('"size": {"x": 1920, "y": 1080}', "size.x looks like the image size"),
        ('"video_shape": [1080, 1920]', "video_shape looks like the image size"),
        ('"image_width": 1920', "image_width is one side of the picture only"),
        ('"width": 1920, "height": 1080.5', "height must be positive whole pixels"),
        ('"width": 1280, "height": 720, "resolution": [1920, 1080]', "are different sizes"),
        ('"distortion_model": "fov", "D": [0.9]', "distortion_model 'fov' is no lens model that is read"),
        ('"camera": {"model": {"type": "mei"}}', "camera.model.type 'mei' is no lens model"),
        ('"xi": 1.2', "xi: an omnidirectional camera"),
        ('"omni": true', "omni True is no lens model"),
        ('"fisheye": 2, "D": [0, 0, 0, 0]', "fisheye must be true or false"),
        ('"fisheye_params": [0.1, 0, 0, 0]', "fisheye_params .* is no lens model"),
        ('"fisheye": true, "D": [0.1, 0, 0, 0, 0]', "a fisheye lens has 4 coefficients, not 5"),
        ('"model": "equidistant", "distortion_model": "plumb_bob"', "contradicts"),
        ('"model": "equidistant", "fisheye": false, "D": [0, 0, 0, 0]', "contradicts fisheye False"),
        ('"model": "", "D": [0.1, 0, 0, 0]', "model is empty"),
        ('"model": "none", "D": [0.1, 0, 0, 0]', "says that there is no distortion"),
        ('"K": [[800, 0, 480], [0, 800, 270], [0, 0, 1]]', "camera_matrix and K differ"),
        ('"fx": 1500', "fx and camera_matrix differ"),
        ('"left": 1, "left": 2', "left comes twice"),
    ],
)
def test_nothing_beside_a_matrix_is_passed_over(tmp_path, entries, match):
    with pytest.raises(InputError, match=match):
        read_text(tmp_path, plain(entries)).for_frames(1920, 1080)


FISHEYE = [0.08, -0.02, 0.004, -0.001]


def test_a_fisheye_lens_is_straightened():
    """The numbers are those of cv2.fisheye, whose pixel centres are counted from 0."""
    K = np.array([[960, 0, 960.5], [0, 960, 540.5], [0, 0, 1]])
    lens = Calibration(K, np.array(FISHEYE), (1920, 1080), fisheye=True)
    [point] = lens.undistort_points(np.array([[1800.5, 900.5]]))
    np.testing.assert_allclose(point - 0.5, [2080, 1020], atol=0.5)
    x, y, w, h = lens.undistort_box(np.array([1400.0, 700, 60, 40]))
    image = np.zeros((1080, 1920, 3), np.uint8)
    image[700:740, 1400:1460] = 255
    bright = np.argwhere(lens.undistort(image)[..., 0] > 127)
    np.testing.assert_allclose(bright.min(axis=0), [y, x], atol=2)
    np.testing.assert_allclose(bright.max(axis=0), [y + h, x + w], atol=2)
    assert np.isnan(lens.undistort_box(np.array([40000.0, 800, 60, 40]))).all()  # behind the camera


@pytest.mark.parametrize("fisheye", [False, True])
def test_skew_is_straightened_with_the_distortion(fisheye):
    """A point of a skewed camera, put where the lens shows it, comes back as the pinhole camera shows it."""
    K = np.array([[900, 20, 320.0], [0, 950, 240], [0, 0, 1]])
    lens = Calibration(K, np.array([-0.2, 0.05, 0.002, -0.001]), fisheye=fisheye)
    ray = np.array([0.2, -0.15])
    if fisheye:
        bent = cv2.fisheye.distortPoints(ray.reshape(1, 1, 2), np.eye(3), lens.distortion)[0, 0]
    else:
        bent = cv2.projectPoints(np.array([[*ray, 1]]), np.zeros(3), np.zeros(3), np.eye(3), lens.distortion)
        bent = bent[0][0, 0]
    seen, wanted = K @ [*bent, 1], K @ [*ray, 1]
    np.testing.assert_allclose(lens.undistort_points(seen[None, :2])[0], wanted[:2], atol=1e-4)
    image = np.zeros((480, 640, 3), np.uint8)
    cv2.circle(image, (round(seen[0] - 0.5), round(seen[1] - 0.5)), 6, (255, 255, 255), -1)
    centre = np.argwhere(lens.undistort(image)[..., 0] > 127).mean(axis=0)
    np.testing.assert_allclose(centre[::-1] + 0.5, wanted[:2], atol=1)


def test_where_coefficients_cannot_be_inverted_there_is_no_box():
    """Strong barrel distortion folds far from the middle."""
    lens = Calibration(np.array([[300.0, 0, 320], [0, 300, 240], [0, 0, 1]]), np.array([-0.4, 0.0, 0, 0]))
    assert np.isnan(lens.undistort_box(np.array([600.0, 400, 30, 30]))).all()
    assert np.isfinite(lens.undistort_box(np.array([340.0, 250, 30, 30]))).all()


@pytest.mark.parametrize(
    "matrix, match",
    [
        ("[[1000, 0, 960], [0, 100, 540], [0, 0, 1]]", "no lens has pixels so unequal"),
        ("[[1600, 0, 960], [0, 1, 540], [0, 0, 1]]", "a focal length of 1 pixels for a frame 1080 high"),
        ("[[1600, 1e6, 960], [0, 1600, 540], [0, 0, 1]]", "no sensor leans so"),
        ("[[1600, 0, 1e6], [0, 1600, 540], [0, 0, 1]]", "is far outside a frame"),
        ("[[1600, 0, 960], [0, 1600, -900], [0, 0, 1]]", "is far outside a frame"),
    ],
)
@pytest.mark.parametrize("size", ["", ', "resolution": [1920, 1080]'])
def test_absurd_cameras(tmp_path, matrix, match, size):
    with pytest.raises(InputError, match=match):
        read_text(tmp_path, f'{{"camera_matrix": {matrix}{size}}}').for_frames(1920, 1080)


@pytest.mark.parametrize("frames", [(3840, 2160), (1280, 720), (960, 540), (2304, 1296)])
def test_a_matrix_of_another_resolution_is_noticed(tmp_path, frames):
    """Its principal point is far from the middle of the frames. With the size, it is scaled."""
    with pytest.raises(InputError, match="of another resolution. Add the size"):
        read_text(tmp_path, f'{{"camera_matrix": {CENTRED}}}').for_frames(*frames)
    scaled = read_text(tmp_path, plain('"resolution": [1920, 1080]')).for_frames(*frames)
    np.testing.assert_allclose(scaled.K[0], [1600 * frames[0] / 1920, 0, frames[0] / 2])


def test_what_was_read_is_told(tmp_path):
    text = plain('"D": [-0.1, 0.01, 0, 0], "model": "radtan", "resolution": [1920, 1080]')
    assert read_text(tmp_path, text).for_frames(960, 540).description == (
        "camera.json: OpenCV: fx 1600, fy 1600, cx 959.5, cy 539.5 from camera_matrix; size 1920x1080 from "
        "resolution; distortion -0.1, 0.01, 0, 0 from D; lens model from model; scaled to frames of 960x540"
    )
    off = '{"K": [[2400, 0, 759.5], [0, 1600, 539.5], [0, 0, 1]]}'
    told = read_text(tmp_path, off).for_frames(1920, 1080).description
    assert "no size, so that of the frames; no distortion" in told
    assert "NOTE: fx and fy differ by 50 %" in told and "NOTE: the principal point is far" in told


DEEP = 100_000


@pytest.mark.parametrize(
    "name, content, match",
    [
        ("c.json", "[" * DEEP, "nested more than 32 deep"),
        ("c.json", '{"a":' * 100 + "1" + "}" * 100, "nested more than 32 deep"),
        ("c.yml", "a: " + "[" * DEEP + "]", "not valid YAML|nested"),
        ("c.yml", "%YAML:1.0\n---\n" + "- " * DEEP + "1\n", "nested more than 32 deep"),
        ("c.xml", "<opencv_storage>" + "<a>" * DEEP, "nested more than 32 deep"),
        ("c.xml", '<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage/>', "declares a document type"),
        ("c.xml", "<calibration><f>1</f></calibration>", "its root is calibration"),
        ("c.xml", "<opencv_storage><K>1</K><K>2</K></opencv_storage>", "K comes twice"),
        ("c.yml", "a: &a [1]\nb: *a\n", "line 2: an alias"),
        ("c.yml", "a: !!python/object/apply:os.getcwd []\n", "not valid YAML"),
        ("c.yml", "? [1, 2]\n: 3\n", "line 1 is no name"),
        ("c.yml", f"K: {CENTRED}\ndist:\n", "dist needs numbers, not ''"),
        ("c.yml", "k: [1600, 0, 960", "ends in the middle of a line"),
        ("c.yml", "a" * (5 * 2**20) + "\n", "larger than 4 MiB"),
        ("c.json", bytes(range(256)), "not a text file"),
        ("c.json", "{\0}", "holds NUL bytes"),
    ],
)
def test_bombs_and_damaged_text(tmp_path, name, content, match):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=match) as refused:
        read_camera(path)
    assert "\n" not in str(refused.value)


def test_only_a_file_is_a_camera(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", tmp_path, Path("/dev/zero")):
        with pytest.raises(InputError, match="give the camera as a plain file"):
            read_camera(path)


CAMERA = Camera(1600.0, 1601.0, 950.0, 545.0, 1920, 1080)


@pytest.mark.parametrize(
    "name, damage, match",
    [
        ("ros.yaml", lambda t: t.pop("distortion_model"), "a camera_info without distortion_model"),
        ("ros.yaml", lambda t: t["camera_matrix"].update(cols=2), "3×2 numbers, but 9 are there"),
        ("ros.yaml", lambda t: t.pop("distortion_coefficients"), "without D or distortion_coefficients"),
        ("ros_echo.txt", lambda t: t.update(binning_x=2), "binning_x is 2"),
        ("ros_echo.txt", lambda t: t["roi"].update(width=640), "roi.width is 640: the camera sent a part"),
        ("kalibr.yaml", lambda t: t.update(cam1={"camera_model": "omni"}), r"holds 2 cameras \(cam0, cam1\)"),
        ("kalibr.yaml", lambda t: t["cam0"].update(camera_model="omni"), "'omni' is not read, only pinhole"),
        ("kalibr.yaml", lambda t: t["cam0"].update(distortion_model="fov"), "'fov' is no lens model"),
        ("kalibr.yaml", lambda t: t["cam0"].pop("resolution"), "cam0 has no resolution"),
        ("camera.json", lambda t: t.pop("fy"), "holds no fy"),
        ("camera.json", lambda t: t.update(dist=[0.1]), "distortion has 1 numbers"),
        ("scene_camera.json", lambda t: t["7"].update(distortion=[0.1]), "7.distortion looks like"),
        ("transforms.json", lambda t: t.pop("h"), "w is one side of the picture only"),
        ("transforms.json", lambda t: t.update(camera_angle_x=1.5), "the angles of view say a focal length"),
        ("transforms.json", lambda t: t["frames"][0].update(fl_x=9.0), "fl_x and frames.0..fl_x differ"),
    ],
)
def test_what_each_format_must_hold(tmp_path, name, damage, match):
    build, text, _ = TREES[name]
    tree = json.loads(json.dumps(build(CAMERA)))
    damage(tree)
    with pytest.raises(InputError, match=match):
        read_text(tmp_path, text(tree), name)


def test_a_region_of_the_whole_picture_is_none(tmp_path):
    message = ros_message(CAMERA)
    message["roi"].update(width=1920, height=1080)
    assert read_text(tmp_path, yaml_text(message)).size == (1920, 1080)


PLAIN = {"K": [[1600, 0, 960], [0, 1600, 540], [0, 0, 1]], "D": [-0.1, 0.02, 0, 0, 0]}


def test_the_roi_of_a_straightened_picture_is_passed_over(tmp_path):
    """Many programs save all that cv2.getOptimalNewCameraMatrix returns beside the calibration."""
    found = read_text(tmp_path, json.dumps({**PLAIN, "newcameramtx": PLAIN["K"], "roi": [9, 5, 1900, 1060]}))
    assert found.opencv_K.tolist() == PLAIN["K"] and found.distortion.tolist() == PLAIN["D"]


@pytest.mark.parametrize(
    "more",
    [
        {"crop": [100, 50, 1280, 720]},
        {"binning": 2},
        {"binning_x": 2, "binning_y": 2},
        {"roi": {"x": 9, "y": 5, "w": 1280, "h": 720}},
        {"image": {"crop_left": 100}},
    ],
)
def test_a_part_of_the_picture_is_refused(tmp_path, more):
    """It moves the principal point, or changes the focal length, and nothing else would show it."""
    with pytest.raises(InputError, match="a part of what the lens saw|without distortion_model"):
        read_text(tmp_path, json.dumps({**PLAIN, **more}))
    off = {key: 0 for key in more if key != "image"}
    if "binning_x" not in more:
        assert read_text(tmp_path, json.dumps({**PLAIN, **off})).size is None


def test_four_coefficients_in_a_column_need_a_lens_model(tmp_path):
    """cv2.fisheye.calibrate returns such a column, and means other coefficients than k1, k2, p1, p2."""
    tree = {"K": PLAIN["K"], "D": [[0.08], [-0.02], [0.004], [-0.001]]}
    with pytest.raises(InputError, match="D: four coefficients in a column, as cv2.fisheye"):
        read_text(tmp_path, json.dumps(tree))
    assert read_text(tmp_path, json.dumps({**tree, "model": "fisheye"})).fisheye
    assert not read_text(tmp_path, json.dumps({**tree, "model": "plumb_bob"})).fisheye
    assert read_text(tmp_path, json.dumps({**tree, "D": [[0], [0], [0], [0]]})).distortion is None


def test_messages_of_one_recording_must_agree(tmp_path):
    first, other = ros_message(CAMERA), {**ros_message(CAMERA), "width": 1280, "height": 720}
    assert read_text(tmp_path, two_messages(first)).size == (1920, 1080)
    with pytest.raises(InputError, match="document 2 holds another camera"):
        read_text(tmp_path, f"{yaml_text(first)}---\n{yaml_text(other)}")


@pytest.mark.parametrize(
    "line, distortion, fisheye",
    [
        ("SIMPLE_PINHOLE 640 480 500 320 240", None, False),
        ("SIMPLE_RADIAL 640 480 500 320 240 0.1", [0.1, 0, 0, 0], False),
        ("RADIAL 640 480 500 320 240 0.1 0.2", [0.1, 0.2, 0, 0], False),
        ("RADIAL_FISHEYE 640 480 500 320 240 0.1 0.2", [0.1, 0.2, 0, 0], True),
        ("FOV 640 480 500 500 320 240 0.9", "'FOV' is not read", None),
        ("PINHOLE 640 480 500 500 320", "PINHOLE has 4 parameters, not 3", None),
        ("PINHOLE 640 480.5 500 500 320 240", "not numbers behind PINHOLE", None),
        ("PINHOLE 640 480 500 500 320 nan", ".*every parameter finite", None),
    ],
)
def test_models_of_colmap(tmp_path, line, distortion, fisheye):
    if isinstance(distortion, str):
        with pytest.raises(InputError, match=f"line 1: {distortion}"):
            read_text(tmp_path, f"1 {line}\n")
        return
    found = read_text(tmp_path, f"1 {line}\n")
    np.testing.assert_array_equal(found.K, [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    assert (None if found.distortion is None else found.distortion.tolist()) == distortion
    assert found.fisheye == fisheye
    with pytest.raises(InputError, match="holds 2 cameras"):
        read_text(tmp_path, f"1 {line}\n2 PINHOLE 640 480 501 500 320 240\n")
    with pytest.raises(InputError, match="number comes twice"):
        read_text(tmp_path, f"1 {line}\n" * 2)


def test_angles_of_view(tmp_path):
    """Blender's sets have one angle; the pixels are square and the centre is the middle."""
    tree = {"camera_angle_x": 2 * np.arctan(0.5), "w": 800, "h": 600, "frames": []}
    found = read_text(tmp_path, json.dumps(tree))
    np.testing.assert_allclose(found.K, [[800, 0, 400], [0, 800, 300], [0, 0, 1]])
    with pytest.raises(InputError, match="holds no w and h"):
        read_text(tmp_path, '{"camera_angle_x": 0.7, "frames": []}')


def test_numbers_in_yaml_are_those_of_today(tmp_path):
    """YAML 1.1 has octal and sexagesimal numbers, and takes 1e3 for a word."""
    found = read_text(tmp_path, "K: [1.6e3, 0, 0960, 0, 16e2, 0540, 0, 0, 1]\n", "c.yaml")
    np.testing.assert_array_equal(found.opencv_K, [[1600, 0, 960], [0, 1600, 540], [0, 0, 1]])
    with pytest.raises(InputError, match="needs numbers, not '12:30'"):
        read_text(tmp_path, "K: [12:30, 0, 960, 0, 1600, 540, 0, 0, 1]\n", "c.yaml")


def test_frames_that_share_a_camera_share_its_maps():
    K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    shared = Calibration(K, np.array([-0.3, 0.1, 0, 0]), (320, 240))
    other = Calibration(2 * K * [[1], [1], [0.5]])
    first, second, third = fit_to_frames([shared, other, shared], 640, 480)
    assert first is third and first is not second and first.size == (640, 480)
