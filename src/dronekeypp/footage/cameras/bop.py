"""Read the cameras of BOP data sets (docs/bop_datasets_format.md of https://github.com/thodan/bop_toolkit).

`scene_camera.json` holds `cam_K` of every image of a scene, `camera.json` holds fx, fy, cx, cy, width and
height of a whole data set. Both count pixels as this package does, with pixel centres at +0.5.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.files import read_json
from dronekeypp.footage.cameras import opencv
from dronekeypp.footage.cameras.keys import Entries
from dronekeypp.footage.cameras.readings import FOCAL, Reading, intrinsics_matrix, take_size
from dronekeypp.footage.pictures import CAMERA_FILE, BopScene

INFO_FILE = "scene_gt_info.json"  # of a scene; it says which images are crops
OF_AN_IMAGE = {"cam_K", "cam_K_frame", "cam_R_w2c", "cam_t_w2c", "depth_scale"}


def recognise_scene(tree: Any, path: Path) -> bool:
    """Tell whether a file holds the cameras of a scene, by its name or by its entries."""
    if path.name == CAMERA_FILE:
        return True
    if not isinstance(tree, dict) or not tree:
        return False
    return all(
        key.isdecimal() and isinstance(entry, dict) and "cam_K" in entry for key, entry in tree.items()
    )


def recognise_camera(tree: dict[str, Any]) -> bool:
    """Tell whether a file is a camera.json."""
    return any(name in tree for name in (*FOCAL, "cam_K"))


def read_camera_file(tree: dict[str, Any], entries: Entries) -> Reading:
    """Read a camera.json, or one entry of a scene_camera.json.

    Raises:
        InputError: An entry is missing or not valid.
    """
    keys: dict[str, str] = {}
    if "cam_K" in tree:
        found = entries.take("camk")
        K = intrinsics_matrix(found.value if found else None, f"{entries.file}: cam_K")
        keys["K"] = "cam_K"
    else:
        K = opencv.matrix_from(entries, FOCAL, keys)
    distortion, fisheye = opencv.take_distortion(entries, keys)
    size, keys["size"] = take_size(entries)
    return Reading("BOP", K, 0.5, distortion, fisheye, size, keys)


def read_scene(tree: Any, path: Path) -> Reading:
    """Read the camera that all images of a scene share.

    Raises:
        InputError: They do not share one, or it is not valid.
    """
    table = as_object(tree, path)
    check_entries(table, path)
    cameras = [matrix_of(entry) for entry in table.values()]
    if not cameras or any(camera != cameras[0] for camera in cameras):
        raise InputError(
            f"{path}: {len(cameras)} frames, and not one camera for all of them; each frame gets its own "
            f"where the pictures have numbers for names, in a folder beside {CAMERA_FILE} in a folder that "
            "has a number for a name, too"
        )
    if cameras[0] is None:
        raise InputError(f"{path}: its frames have no cam_K, which needs 3×3 numbers")
    K = intrinsics_matrix(cameras[0], f"{path}: cam_K")
    return Reading("BOP scene_camera.json", K, 0.5, keys={"K": "cam_K"})


def read_image(entry: Any, where: str) -> Reading:
    """Read the camera of one image of a scene; `where` begins the messages."""
    K = intrinsics_matrix(matrix_of(entry), f"{where}: cam_K")
    return Reading("BOP scene_camera.json", K, 0.5, keys={"K": "cam_K of the first frame; each has its own"})


def matrix_of(entry: Any) -> Any:
    """Return the cam_K in an entry of a scene_camera.json, or None."""
    return entry.get("cam_K") if isinstance(entry, dict) else None


def as_object(tree: Any, path: Path) -> dict[str, Any]:
    """Return what a JSON file holds, or raise InputError unless it is an object."""
    if not isinstance(tree, dict):
        raise InputError(f"{path}: holds no settings but a {type(tree).__name__}")
    return tree


def by_number(table: dict[str, Any]) -> dict[int, Any]:
    """Return what a file of a BOP scene says of each frame, by the frame's number."""
    return {int(key): entry for key, entry in table.items() if key.isdecimal()}


def check_entries(table: dict[str, Any], path: Path) -> None:
    """Raise InputError where an entry holds distortion, a size or a lens model, which BOP's do not."""
    strange: dict[str, Any] = {}
    for number, entry in table.items():
        if isinstance(entry, dict) and not entry.keys() <= OF_AN_IMAGE:
            strange[number] = entry
    Entries(strange, path).refuse_rest()


def check_crops(scene: BopScene, cameras: dict[str, Any], own: bool) -> None:
    """Raise InputError where the frames of a scene are crops, and the camera that is given is not theirs.

    A crop has `crop` in scene_gt_info.json, and `cam_K_frame` beside its own cam_K; crops of the first
    edition have the cam_K of the whole frame.

    Args:
        scene: of the frames.
        cameras: its scene_camera.json.
        own: whether the camera that is given is that file.
    """
    path = scene.folder / INFO_FILE
    if not path.is_file():
        return
    infos = by_number(as_object(read_json(path), path))
    table = by_number(cameras)
    for number in scene.images:
        info, camera = infos.get(number), table.get(number)
        if not isinstance(info, list) or not any(isinstance(i, dict) and i.get("crop") for i in info):
            continue
        if not isinstance(camera, dict) or camera.get("cam_K_frame") is None:
            raise InputError(
                f"{path} frame {number}: crops of the first edition, whose cam_K is not theirs; "
                "use `evaluate`, or whole frames"
            )
        if not own:
            raise InputError(
                f"{path} frame {number}: crops, and each has a camera of its own; "
                f"give {scene.folder / CAMERA_FILE}"
            )
