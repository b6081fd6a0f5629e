"""Make frames, in metres and full-frame pixels, of what BOP's three scene files say.

`bop` reads the files, and says what they hold. Every fault is named by file and frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dronekeypp.camera import check_intrinsics, project
from dronekeypp.classes import DroneClass, check_hubs
from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation
from dronekeypp.sixdronesyn.annotation import MM, Frame
from dronekeypp.sixdronesyn.instances import Instances

FEW_BOXES = 3  # of a flight: from fewer nothing is concluded
SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json")


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
            drone behind the camera or far from its box, a box or crop without area, a box whose middle lies
            outside the crop or the frame, a camera matrix that is not that of the crop.
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
    if t is not None:
        _check_place(instances, K, t, box)

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
    visible = instances.optional(1, "keypoints_visible", (4,), truth=True)
    if visible is not None:
        strange = ((visible != 0) & (visible != 1)).any(axis=1)
        instances.refuse(strange, 1, "keypoints_visible is not a list of true and false")
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


def _check_place(instances: Instances, K: np.ndarray, t: np.ndarray, box: np.ndarray) -> None:
    """Check that the camera matrix and the translations are those of the boxes (F, 4).

    A drone's centre is seen in its box, or at most the box's size beside it. A few boxes may be odd. Where
    every one of a flight is, it is the matrix.

    Raises:
        InputError: no drone of the flight is near its box.
    """
    if len(box) < FEW_BOXES:
        return
    seen = project(t[:, None], K)[:, 0]
    off = np.abs(seen - box[:, :2] - box[:, 2:] / 2).max(axis=1)
    far = off > 1.5 * box[:, 2:].max(axis=1) + 2
    message = (
        "cam_t_m2c and cam_K put the drone {:.0f} px from the middle of its bbox_obj, and all others of the "
        "flight beside theirs: is cam_K that of frames of this size?"
    )
    instances.refuse(far & far.all(), 1, message, values=off[:, None])


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
