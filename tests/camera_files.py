"""Write a camera as every program does whose files are read."""

import json
from dataclasses import dataclass

import cv2
import yaml


@dataclass(frozen=True)
class Camera:
    """A camera with pixel centres at +0.5.

    `lens` is "none", "brown" or "fisheye"; the distortion is in OpenCV's order.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    lens: str = "none"
    distortion: tuple[float, ...] = ()

    def matrix(self, first_centre=0.0):
        """Nine numbers, for files that count the first pixel's centre as `first_centre`."""
        shift = 0.5 - first_centre
        return [self.fx, 0.0, self.cx - shift, 0.0, self.fy, self.cy - shift, 0.0, 0.0, 1.0]


def rows(numbers):
    return [numbers[:3], numbers[3:6], numbers[6:]]


def plain_json(camera):
    """As the README writes it."""
    tree = {"camera_matrix": rows(camera.matrix()), "resolution": [camera.width, camera.height]}
    if camera.lens != "none":
        tree["dist_coeffs"] = [list(camera.distortion)]
    if camera.lens == "fisheye":
        tree["model"] = "equidistant"
    return tree


def opencv_matrix(numbers, count_of_rows):
    columns = len(numbers) // count_of_rows
    return {"type_id": "opencv-matrix", "rows": count_of_rows, "cols": columns, "dt": "d", "data": numbers}


def opencv_json(camera):
    """As OpenCV's calibration sample writes it."""
    zeros = (0.0,) * 5
    tree = {
        "calibration_time": "Tue 12 May",
        "image_width": camera.width,
        "image_height": camera.height,
        "board_width": 9,
        "square_size": 0.025,
        "flags": 0,
        "camera_matrix": opencv_matrix(camera.matrix(), 3),
        "distortion_coefficients": opencv_matrix(list(camera.distortion or zeros), 1),
    }
    if camera.lens == "fisheye":
        tree["fisheye_model"] = 1
    return tree


def opencv2_names(tree):
    """The names of OpenCV 2.4's sample."""
    old = {
        "calibration_time": "calibration_Time",
        "image_width": "image_Width",
        "image_height": "image_Height",
        "camera_matrix": "Camera_Matrix",
        "distortion_coefficients": "Distortion_Coefficients",
    }
    return {old.get(key, key): value for key, value in tree.items()}


def opencv_storage(camera, suffix):
    """The text that OpenCV itself writes, YAML or XML."""
    import numpy as np

    file = cv2.FileStorage(f"camera.{suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for key, value in opencv_json(camera).items():
        if isinstance(value, dict):
            value = np.array(value["data"]).reshape(value["rows"], value["cols"])
        file.write(key, value)
    return file.releaseAndGetString()


ROS_MODELS = {"none": "plumb_bob", "brown": "plumb_bob", "fisheye": "equidistant"}


def ros_model(camera):
    return "rational_polynomial" if len(camera.distortion) == 8 else ROS_MODELS[camera.lens]


def ros_coefficients(camera):
    return list(camera.distortion) or [0.0] * 5


def ros_file(camera):
    """As camera_calibration writes it."""
    K, D = camera.matrix(), ros_coefficients(camera)
    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": "front",
        "camera_matrix": {"rows": 3, "cols": 3, "data": K},
        "distortion_model": ros_model(camera),
        "distortion_coefficients": {"rows": 1, "cols": len(D), "data": D},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [*K[:3], 0, *K[3:6], 0, *K[6:], 0]},
    }


def ros_message(camera):
    """As `topic echo` prints it."""
    K = camera.matrix()
    return {
        "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "front"},
        "height": camera.height,
        "width": camera.width,
        "distortion_model": ros_model(camera),
        "d": ros_coefficients(camera),
        "k": K,
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def kalibr(camera):
    """A camchain of one camera."""
    K = camera.matrix()
    models = {"none": "none", "brown": "radtan", "fisheye": "equidistant"}
    entry = {
        "cam_overlaps": [],
        "camera_model": "pinhole",
        "distortion_coeffs": list(camera.distortion),
        "distortion_model": models[camera.lens],
        "intrinsics": [K[0], K[4], K[2], K[5]],
        "resolution": [camera.width, camera.height],
        "rostopic": "/cam0/image_raw",
    }
    return {"cam0": entry}


def colmap(camera):
    """cameras.txt, which counts as we do."""
    models = {"none": "PINHOLE", "brown": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
    model = "FULL_OPENCV" if len(camera.distortion) == 8 else models[camera.lens]
    values = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
    numbers = " ".join(repr(value) for value in values)
    head = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    return f"{head}1 {model} {camera.width} {camera.height} {numbers}\n"


def bop_camera(camera):
    """camera.json of a data set, which counts as we do."""
    return {
        "cx": camera.cx,
        "cy": camera.cy,
        "depth_scale": 0.1,
        "fx": camera.fx,
        "fy": camera.fy,
        "height": camera.height,
        "width": camera.width,
    }


def bop_scene(camera):
    """scene_camera.json of a scene of three images, which has no size."""
    entry = {"cam_K": camera.matrix(0.5), "depth_scale": 1.0}
    return {str(number): entry for number in (0, 7, 12)}


def nerf(camera):
    """transforms.json, which counts as we do."""
    tree = {
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
    }
    names = {"none": (), "brown": ("k1", "k2", "p1", "p2"), "fisheye": ("k1", "k2", "k3", "k4")}[camera.lens]
    tree.update(zip(names, camera.distortion, strict=True))
    models = {"none": "PINHOLE", "brown": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
    tree["camera_model"] = models[camera.lens]
    tree["frames"] = [{"file_path": "images/1.jpg", "transform_matrix": [[1.0, 0, 0, 0]] * 4}]
    return tree


def json_text(tree):
    return json.dumps(tree, indent=1)


def yaml_text(tree):
    return yaml.safe_dump(tree, sort_keys=False)


def two_messages(tree):
    return f"{yaml_text(tree)}---\n{yaml_text(tree)}---\n"


BROWN5, BROWN8 = ("brown", 5), ("brown", 8)
BROWN4, FISHEYE, NONE = ("brown", 4), ("fisheye", 4), ("none", 0)
EVERY = (NONE, BROWN4, BROWN5, BROWN8, FISHEYE)
# name: (what the camera becomes, how that becomes text, which lenses it can have)
TREES = {
    "plain.json": (plain_json, json_text, EVERY),
    "opencv.json": (opencv_json, json_text, EVERY),
    "opencv2.json": (lambda camera: opencv2_names(opencv_json(camera)), json_text, EVERY),
    "ros.yaml": (ros_file, yaml_text, EVERY),
    "ros_echo.txt": (ros_message, two_messages, EVERY),
    "kalibr.yaml": (kalibr, yaml_text, (NONE, BROWN4, FISHEYE)),
    "camera.json": (bop_camera, json_text, (NONE,)),
    "scene_camera.json": (bop_scene, json_text, (NONE,)),
    "transforms.json": (nerf, json_text, (NONE, BROWN4, FISHEYE)),
}
TEXTS = {
    "cameras.txt": (colmap, (NONE, BROWN4, BROWN8, FISHEYE)),
    "opencv.yml": (lambda camera: opencv_storage(camera, "yml"), EVERY),
    "opencv.xml": (lambda camera: opencv_storage(camera, "xml"), EVERY),
}


def written(name, camera):
    """The text of a file of this name."""
    if name in TEXTS:
        return TEXTS[name][0](camera)
    build, text, _ = TREES[name]
    return text(build(camera))


def lenses(name):
    """The kinds of lenses, and how many coefficients they have, that a file of this name can hold."""
    return TEXTS[name][1] if name in TEXTS else TREES[name][2]
