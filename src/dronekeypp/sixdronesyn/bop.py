"""Read and write the on-disk format: BOP's folders and field names, plus the four keypoints.

    ROOT/manifest.json                      6DroneSyn only: settings, versions, a digest a frame
    ROOT/coco_train.json, …                 COCO-keypoints, in pixels of the stored images (see `coco`)
    ROOT/test_targets_bop19.json            what BOP's own scripts are to score
    ROOT/models/models_info.json, obj_000001.ply, …
    ROOT/models_eval/                       the same, with fewer triangles
    ROOT/train/000400/rgb/000000.jpg, …     one folder a flight; its name is the BOP scene's number
                      depth/, mask/, mask_visib/      on demand (see `depth`)
                      scene_camera.json     cam_K, cam_K_frame, cam_R_w2c, cam_t_w2c, depth_scale
                      scene_gt.json         obj_id, cam_R_m2c, cam_t_m2c, keypoints_2d, keypoints_3d,
                                            keypoints_body, keypoints_visible
                      scene_gt_info.json    bbox_obj, bbox_visib, visib_fract, crop
                      flight.json           scene, drone, take, environment, turn, seed, fps

Millimetres here and only here. All pixels in the three scene files are those of the stored image, and cam_K
is its camera matrix. Of a stored crop, cam_K_frame is the camera matrix of the full frame, and `crop` the
square (x, y, side) that it shows, in full-frame pixels; `crop` of a whole frame is null. keypoints_body are
the hubs in body axes. A mesh in models/ has no propellers, as it is what stands still; bbox_obj holds the
discs they sweep, so it is larger than the mesh's own. bbox_visib is the part of bbox_obj in the image.

A stored crop without cam_K_frame is one of the first edition: there cam_K and all pixels are those of the
full frame, and keypoints_body is missing.

Any BOP folder can be read, see `dronekeypp.data`: only cam_K, obj_id and bbox_obj must be there. What else is
not there is None in the frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp import files
from dronekeypp.camera import check_intrinsics, project
from dronekeypp.classes import DroneClass, check_hubs
from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation
from dronekeypp.sixdronesyn.annotation import MM, Frame
from dronekeypp.sixdronesyn.instances import Instances, one_value

SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json")
MODELS = "models"
INVISIBLE = [-1, -1, -1, -1]  # BOP's bbox_obj of an object that is not in the picture


def frames_from(
    folder: Path,
    rows: Sequence[tuple[int, dict, dict, dict]],
    models: Mapping[int, DroneClass] | None = None,
    size: tuple[int, int] | None = None,
) -> list[Frame]:
    """Make frames from what the scene files of a flight say of each: (number, camera, truth, info).

    Pixels of stored crops become those of the full frame. Keypoints that are not there follow from the pose
    and the hubs of `models`, or those of the frame itself, where they are known.

    Args:
        folder: of the flight, for the messages.
        rows: at least one.
        models: the drones of the data set by their number; None: any number will do.
        size: (width, height) of the whole frames; None: unknown.

    Raises:
        InputError: a missing field, a wrong shape, NaN, a matrix that is no rotation, an unknown drone, a
            drone behind the camera, a box or crop without area, a box whose middle lies outside the crop or
            the frame, a camera matrix that is not that of the crop.
    """
    instances = Instances([folder / name for name in SCENE_FILES], rows)
    square = _squares(instances)
    K, scale = _cameras(instances, square)
    camera_R = instances.optional(0, "cam_R_w2c", (3, 3))
    instances.check(check_rotation, camera_R, 0, "cam_R_w2c")
    camera_t = instances.optional(0, "cam_t_w2c", (3,))
    if camera_t is not None:
        camera_t = camera_t / MM
    R = instances.optional(1, "cam_R_m2c", (3, 3))
    instances.check(check_rotation, R, 1, "cam_R_m2c")
    t = instances.optional(1, "cam_t_m2c", (3,))
    if t is not None:
        instances.refuse(t[:, 2] <= 0, 1, "cam_t_m2c puts the drone behind the camera")
        t = t / MM
    obj_ids = []
    for i, truth in enumerate(instances.entries[1]):
        obj_ids.append(_object_id(truth, models, instances.where(1, i)))
    box = _boxes(instances, square, scale, size)

    hubs = instances.optional(1, "keypoints_body", (4, 3))
    if hubs is not None:
        hubs = hubs / MM
        for i, values in enumerate(hubs):
            check_hubs(values, f"{instances.where(1, i)}: keypoints_body")
    keypoints_3d = instances.optional(1, "keypoints_3d", (4, 3))
    if keypoints_3d is not None:
        keypoints_3d = keypoints_3d / MM
    elif R is not None and t is not None:
        keypoints_3d = _placed_hubs(obj_ids, models, hubs, R, t)
    keypoints_2d = instances.optional(1, "keypoints_2d", (4, 2))
    if keypoints_2d is not None and scale is not None:
        keypoints_2d = keypoints_2d / scale[:, None, None] + square[:, None, :2]
    if keypoints_2d is None and keypoints_3d is not None:
        keypoints_2d = project(keypoints_3d, K)
    visible = instances.optional(1, "keypoints_visible", (4,))
    if visible is not None:
        visible = visible.astype(bool)

    stacks = {
        "K": K,
        "camera_R": camera_R,
        "camera_t": camera_t,
        "R": R,
        "t": t,
        "keypoints_2d": keypoints_2d,
        "keypoints_3d": keypoints_3d,
        "visible": visible,
        "box": box,
        "square": square,
        "hubs": hubs,
    }
    frames = []
    for i, number in enumerate(instances.numbers):
        fields = {name: None if values is None else values[i] for name, values in stacks.items()}
        frames.append(Frame(number=number, obj_id=obj_ids[i], **fields))
    return frames


def _object_id(entry: dict, models: Mapping[int, DroneClass] | None, where: str) -> int:
    """Return the drone's number in an entry of scene_gt.json.

    Raises:
        InputError: it is not a number, or not one of `models`. The message begins with `where`.
    """
    number = entry.get("obj_id")
    if type(number) is not int or number < 1:
        raise InputError(f"{where}: obj_id {number!r} is not a number from 1 on")
    if models is not None and number not in models:
        raise InputError(f"{where}: obj_id {number} is not in models_info.json ({_ranges(models)})")
    return number


def _ranges(models: Mapping[int, DroneClass]) -> str:
    """Return the numbers of the drones, for a message."""
    known = sorted(models)
    if known == list(range(1, len(known) + 1)):
        return f"1 to {len(known)}"
    return ", ".join(str(number) for number in known)


def _squares(instances: Instances) -> np.ndarray | None:
    """Return the squares (F, 3) of stored crops, or None for whole frames."""
    square = instances.optional(2, "crop", (3,))
    if square is not None:
        instances.refuse(square[:, 2] <= 0, 2, "crop has no area (side {:g} px)", values=square[:, 2:])
    return square


def _cameras(instances: Instances, square: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the camera matrices (F, 3, 3) of the full frames, and the scales (F,) of stored crops.

    A scale is how many pixels of the stored image one pixel of the full frame is. It is None where the
    annotations are in full-frame pixels already.
    """
    K = instances.stack(0, "cam_K", (3, 3))
    instances.check(check_intrinsics, K, 0, "cam_K")
    whole = instances.optional(0, "cam_K_frame", (3, 3))
    if whole is None:
        return K, None
    instances.check(check_intrinsics, whole, 0, "cam_K_frame")
    if square is None:
        square = instances.stack(2, "crop", (3,))  # raises and names the frame
    scale = K[:, 0, 0] / whole[:, 0, 0]
    expected = whole.copy()
    expected[:, :2, 2] -= square[:, :2]
    expected[:, :2] *= scale[:, None, None]
    off = np.abs(K - expected).max(axis=(1, 2))
    message = "cam_K is not that of the crop in scene_gt_info.json ({:.2g} px off)"
    instances.refuse(off > 0.01, 0, message, values=off[:, None])
    return whole, scale


def _boxes(
    instances: Instances,
    square: np.ndarray | None,
    scale: np.ndarray | None,
    size: tuple[int, int] | None,
) -> np.ndarray:
    """Return the boxes (F, 4) in full-frame pixels.

    The middle of a box must lie in what is stored: in the crop, or in the frame of `size` (width, height).
    """
    box = instances.stack(2, "bbox_obj", (4,))
    instances.refuse(
        (box[:, 2:] <= 0).any(axis=1), 2, "bbox_obj has no area ({:g} × {:g} px)", values=box[:, 2:]
    )
    if scale is not None:
        box = box / scale[:, None]
        box[:, :2] += square[:, :2]
    if square is not None:
        corner, extent, place = square[:, :2], square[:, 2:], "stored crop"
    elif size is not None:
        corner, extent, place = np.zeros(2), np.array(size), "frame"
    else:
        return box
    middle = box[:, :2] + box[:, 2:] / 2  # (F, 2)
    outside = (middle < corner) | (middle > corner + extent)
    instances.refuse(outside.any(axis=1), 2, f"the middle of bbox_obj lies outside the {place}")
    return box


def _placed_hubs(
    obj_ids: Sequence[int],
    models: Mapping[int, DroneClass] | None,
    frame_hubs: np.ndarray | None,
    R: np.ndarray,
    t: np.ndarray,
) -> np.ndarray | None:
    """Return the hubs (F, 4, 3) in camera axes, or None where those of a drone are not known.

    They are those of `models` or, where one of them has none, `frame_hubs` (F, 4, 3) in body axes.
    """
    hubs = [None if models is None else models[number].hubs for number in obj_ids]
    if any(values is None for values in hubs):
        if frame_hubs is None:
            return None
        hubs = frame_hubs
    return np.stack(hubs) @ R.swapaxes(1, 2) + t[:, None]


def read_json(path: str | Path) -> Any:
    """Read a JSON file of a data set.

    Raises:
        InputError: it is missing or not JSON. The message names the file.
    """
    missing = "missing; is this a data set, and did `python -m dronekeypp generate` finish it?"
    if Path(path).name in SCENE_FILES:
        missing = f"missing; a flight has {', '.join(SCENE_FILES)}"
    return files.read_json(path, missing, "mend it, or generate it again")


def write_flight(folder: Path, frames: Mapping[int, tuple[dict, dict, dict]], flight: dict) -> None:
    """Write the three scene files and flight.json of one flight.

    Args:
        folder: of the flight.
        frames: (camera, truth, info) by frame number, as `Frame.to_bop` returns them.
        flight: what flight.json is to hold.
    """
    cameras, truths, infos = {}, {}, {}
    for number, (camera, truth, info) in sorted(frames.items()):
        cameras[str(number)] = camera
        truths[str(number)] = [truth]  # BOP lists the objects of a frame
        infos[str(number)] = [info]
    for name, table in zip(SCENE_FILES, (cameras, truths, infos), strict=True):
        files.write_json(folder / name, table)
    files.write_json(folder / "flight.json", flight)


def read_flight(
    folder: str | Path,
    models: Mapping[int, DroneClass] | None = None,
    size: tuple[int, int] | None = None,
    strict: bool = True,
) -> tuple[list[Frame], dict[str, Any]]:
    """Read all frames of one flight folder, in order, and its flight.json ({} where there is none).

    A drone that BOP marks as not in the picture is left out.

    Args:
        folder: of the flight.
        models, size: as in `frames_from`.
        strict: whether every frame must hold a drone. Elsewhere a frame without one is left out.

    Raises:
        InputError: naming the file and the frame, see `frames_from`.
    """
    folder = Path(folder)
    rows = []
    for number, (camera, truths, infos) in read_entries(folder).items():
        if not strict and not truths and not infos:
            continue
        for name, part in zip(SCENE_FILES, (camera, truths, infos), strict=True):
            if not part:
                raise InputError(f"{folder / name} frame {number}: no annotation")
        if len(truths) != len(infos):
            raise InputError(
                f"{folder / SCENE_FILES[2]} frame {number}: {len(infos)} objects, "
                f"{SCENE_FILES[1]} has {len(truths)}"
            )
        for truth, info in zip(truths, infos, strict=True):
            if info.get("bbox_obj") != INVISIBLE:
                rows.append((number, camera, truth, info))
    flight = read_json(folder / "flight.json") if (folder / "flight.json").is_file() else {}
    frames = frames_from(folder, rows, models, size) if rows else []
    return frames, flight


def read_entries(folder: Path) -> dict[int, tuple[dict | None, list[dict], list[dict]]]:
    """Return {frame number: (camera, truths, infos)} of one flight folder, in order.

    `truths` and `infos` hold an entry for each drone. Where a file lacks the frame, or holds something else
    there, `camera` is None and the lists are empty.

    Raises:
        InputError: a file is missing, not JSON, or not a table of frames.
    """
    cameras = _read_table(folder / SCENE_FILES[0], "frames")
    truths = _read_table(folder / SCENE_FILES[1], "frames")
    infos = _read_table(folder / SCENE_FILES[2], "frames")
    entries = {}
    for number in sorted({*cameras, *truths, *infos}):
        camera = cameras.get(number)
        if not isinstance(camera, dict):
            camera = None
        entries[number] = (camera, _objects(truths.get(number)), _objects(infos.get(number)))
    return entries


def _read_table(path: Path, kind: str) -> dict[int, Any]:
    """Return what a JSON file says of each frame or object (`kind`, in the plural), by number."""
    table = read_json(path)
    if not isinstance(table, dict) or not all(key.isdecimal() and len(key) < 19 for key in table):
        raise InputError(f"{path}: not a table of {kind}")
    return {int(key): entry for key, entry in table.items()}


def _objects(entries: Any) -> list[dict]:
    """Return the objects of a frame, or [] unless they are a list of dicts."""
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        return []
    return entries


def image_path(folder: str | Path, number: int) -> Path:
    """Return the path of the picture of a frame of 6DroneSyn."""
    return Path(folder) / "rgb" / f"{number:06d}.jpg"


def flight_folders(root: str | Path, split: str) -> list[Path]:
    """Return the finished flights of a split of 6DroneSyn, in order."""
    return sorted(path for path in (Path(root) / split).glob("[0-9]" * 6) if path.is_dir())


def read_models(root: str | Path) -> dict[int, DroneClass]:
    """Return the drones of a data set by object number, from models_info.json; {} where there is none.

    Raises:
        InputError: the file is not a table of objects, two of them have one name, or the keypoints of one are
            not the four hubs of a drone in millimetres.
    """
    path = Path(root) / MODELS / "models_info.json"
    if not path.is_file():
        return {}
    models = {}
    for number, entry in sorted(_read_table(path, "objects").items()):
        if not isinstance(entry, dict):
            entry = {}
        hubs = None
        if entry.get("keypoints") is not None:
            where = f"{path} object {number}: keypoints"
            hubs = one_value(entry, "keypoints", 12, f"{path} object {number}").reshape(4, 3) / MM
            check_hubs(hubs, where)
        name = str(entry.get("name") or f"object {number}")
        for other, drone in models.items():
            if drone.name == name:
                raise InputError(f"{path}: objects {other} and {number} are both called {name}")
        models[number] = DroneClass(name, hubs, str(entry.get("label") or name))
    return models
