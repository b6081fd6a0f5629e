"""This module holds what one frame of 6DroneSyn must have, and what may be geometrically wrong with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from dronekeypp.camera import project
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn.drones import EDITIONS, SEVEN
from dronekeypp.sixdronesyn.folders import edition_of

# What a frame of 6DroneSyn has in each of the three scene files. Any other BOP folder may lack some of it.
FIELDS = (
    ("cam_K", "cam_R_w2c", "cam_t_w2c"),
    ("obj_id", "cam_R_m2c", "cam_t_m2c", "keypoints_2d", "keypoints_3d", "keypoints_visible"),
    ("bbox_obj",),
)
# And what the second edition has beside it.
SECOND_FIELDS = ((), ("keypoints_body",), ("bbox_visib",))
CROP_FIELDS = (("cam_K_frame",), (), ("crop",))


def needed_fields(manifest: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the fields that a frame of a data set must have in each of the three scene files."""
    fields = list(FIELDS)
    if edition_of(manifest) != 1:
        fields = [ours + more for ours, more in zip(fields, SECOND_FIELDS, strict=True)]
        if manifest["settings"]["frames"] == "crop":
            fields = [ours + more for ours, more in zip(fields, CROP_FIELDS, strict=True)]
    return fields


def frame_faults(frame: bop.Frame, hubs: np.ndarray | None = None) -> list[str]:
    """Return what is geometrically wrong with one frame of 6DroneSyn, in short sentences.

    Args:
        frame: the frame, with all of its fields.
        hubs: (4, 3) of its drone in models_info.json, body axes, metres. None takes what the frame itself
            says. A frame of the first edition says nothing; there the numbers 1 to 7 are the seven, and a
            drone of your own is not compared with its hubs.
    """
    faults = []
    if hubs is None:
        hubs = frame.hubs
    if hubs is None and frame.obj_id <= len(SEVEN):
        hubs = EDITIONS[1][SEVEN[frame.obj_id - 1]].hubs
    if hubs is not None:
        off = np.abs(frame.keypoints_3d - (hubs @ frame.R.T + frame.t)).max()
        if off > 1e-5:
            faults.append(f"keypoints_3d are {off:.2g} m from R · hubs + t")
        if frame.hubs is not None and np.abs(frame.hubs - hubs).max() > 1e-5:
            faults.append("keypoints_body are not the hubs of models_info.json")
    if (frame.keypoints_3d[:, 2] <= 0).any():
        faults.append("a keypoint lies behind the camera")
    else:
        off = np.abs(project(frame.keypoints_3d, frame.K) - frame.keypoints_2d).max()
        if off > 0.01:
            faults.append(f"keypoints_2d are {off:.2g} px from the projection of keypoints_3d")
    frame_size = np.array([scenes.WIDTH, scenes.HEIGHT])
    low, high = frame.box[:2], frame.box[:2] + frame.box[2:]
    if (low < -0.01).any() or (high > frame_size + 0.01).any():
        faults.append("bbox_obj reaches outside the frame")
    if ((frame.keypoints_2d < low - 0.01) | (frame.keypoints_2d > high + 0.01)).any():
        faults.append("a keypoint lies outside bbox_obj")
    if frame.square is not None:
        low, high = frame.square[:2], frame.square[:2] + frame.square[2]
        if (low < -0.01).any() or (high > frame_size + 0.01).any():
            faults.append("the crop reaches outside the frame")
    return faults
