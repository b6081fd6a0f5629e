"""This module holds the annotation of one drone in one frame, and what the scene files say of it.

In memory all pixels are those of the full frame. In the scene files they are those of the stored image, as
BOP wants it: `cam_K` is the camera matrix of that image. A stored crop has beside it `cam_K_frame`, the
camera matrix of the full frame, and `crop`, the square (x, y, side) that it shows, in full-frame pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dronekeypp.camera import crop_intrinsics

MM = 1000.0
CROP_DIGITS = 6  # a pixel of a small crop may be ten of the frame


@dataclass(frozen=True)
class Frame:
    """This is the annotation of one drone in one frame, in metres and full-frame pixels.

    Attributes:
        number: of the frame in its flight.
        K: (3, 3) camera matrix.
        camera_R, camera_t: (3, 3) and (3,), camera←world.
        obj_id: the drone's number in models/, from 1.
        R, t: (3, 3) and (3,), camera←body.
        keypoints_2d: (4, 2) pixels.
        keypoints_3d: (4, 3) in camera axes.
        visible: (4,) bool, in the frame and not hidden by the drone itself.
        box: x, y, width, height.
        square: x, y, side of a stored crop; None of a whole frame.
        hubs: (4, 3) in body axes, where the frame itself says them.
    """

    number: int
    K: np.ndarray
    camera_R: np.ndarray | None
    camera_t: np.ndarray | None
    obj_id: int
    R: np.ndarray | None
    t: np.ndarray | None
    keypoints_2d: np.ndarray | None
    keypoints_3d: np.ndarray | None
    visible: np.ndarray | None
    box: np.ndarray
    square: np.ndarray | None
    hubs: np.ndarray | None = field(default=None, repr=False)

    def to_bop(self, width: int, height: int) -> tuple[dict, dict, dict]:
        """Return the frame's entries in the three scene files: (camera, truth, info).

        No field but `square` may be None.

        Args:
            width, height: of the stored image, pixels. A crop is as high as it is wide.
        """
        box, keypoints = self.box, self.keypoints_2d
        matrices = {"cam_K": numbers(self.K)}
        square, digits = None, 4
        if self.square is not None:
            # All follows from the rounded numbers, so that what is read back fits together.
            square, digits = numbers(self.square), CROP_DIGITS
            scale, corner = width / square[2], np.array(square[:2])
            crop_K = crop_intrinsics(np.round(self.K, 4), square, width)
            matrices = {"cam_K": numbers(crop_K, digits), "cam_K_frame": matrices["cam_K"]}
            box = scale * np.concatenate([box[:2] - corner, box[2:]])
            keypoints = scale * (keypoints - corner)
        low = np.clip(box[:2], 0, [width, height])
        high = np.clip(box[:2] + box[2:], 0, [width, height])
        camera = {
            **matrices,
            "cam_R_w2c": numbers(self.camera_R, 9),
            "cam_t_w2c": numbers(self.camera_t * MM),
            "depth_scale": 1.0,
        }
        truth = {
            "obj_id": self.obj_id,
            "cam_R_m2c": numbers(self.R, 9),
            "cam_t_m2c": numbers(self.t * MM),
            "keypoints_2d": numbers(keypoints, digits),
            "keypoints_3d": numbers(self.keypoints_3d * MM),
            "keypoints_body": numbers(self.hubs * MM),
            "keypoints_visible": np.asarray(self.visible, dtype=bool).tolist(),
        }
        info = {
            "bbox_obj": numbers(box, digits),
            "bbox_visib": numbers(np.concatenate([low, high - low]), digits),
            "visib_fract": 1.0,
            "crop": square,
        }
        return camera, truth, info

    def to_first_edition(self) -> tuple[dict, dict, dict]:
        """Return what `to_bop` returns, as the first edition of the data set has it.

        There all pixels are full-frame pixels, whether whole frames or crops are stored.
        """
        box = numbers(self.box, 3)
        camera = {
            "cam_K": numbers(self.K),
            "cam_R_w2c": numbers(self.camera_R, 9),
            "cam_t_w2c": numbers(self.camera_t * MM),
            "depth_scale": 1.0,
        }
        truth = {
            "obj_id": self.obj_id,
            "cam_R_m2c": numbers(self.R, 9),
            "cam_t_m2c": numbers(self.t * MM),
            "keypoints_2d": numbers(self.keypoints_2d),
            "keypoints_3d": numbers(self.keypoints_3d * MM),
            "keypoints_visible": np.asarray(self.visible, dtype=bool).tolist(),
        }
        info = {
            "bbox_obj": box,
            "bbox_visib": box,
            "visib_fract": 1.0,
            "crop": None if self.square is None else numbers(self.square),
        }
        return camera, truth, info


def numbers(array: np.ndarray, digits: int = 4) -> list[float]:
    """Return an array as a flat list of rounded numbers."""
    return [round(float(v), digits) for v in np.asarray(array).ravel()]
