"""Compute the errors of every frame (Sec. V-A, Eq. 13-14).

The paper's Eq. 13 divides the angle by pi, and its tables print degrees; we print degrees. It calls the
translation error a Euclidean distance, for the mean (MAE) and the median (MedAE). Such errors have a long
tail, so their mean lies above their median. Its averages of Table 3, in metres:

    method              MAE     MedAE   MedAE / MAE
    DroneKey++          0.135   0.242   1.79
    DronePose           0.163   0.317   1.94
    DroneKey            0.533   0.370   0.69
    YOLOv8n-pose + PnP  0.391   0.105   0.27

A mean over the three axes is about 1 / √3 of the mean distance, and √3 = 1.73. So for the first two the MAE
fits a per-axis mean, and for the other two it does not. We report the Euclidean distance for both, and the
per-axis mean beside them.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dronekeypp import rotations
from dronekeypp.checked import check_shapes
from dronekeypp.errors import InputError
from dronekeypp.model.encoder import layer_spread

MARGIN = 1.2  # side of the crops that are evaluated over the longer side of the box
PCK = 0.05  # share of the box's longer side within which a keypoint counts as correct
# This number is raised when an array of `frame_errors` is added or changes its meaning, so that stored arrays
# are made again.
FORMAT = 2


def frame_errors(output: dict, batch: dict) -> dict[str, np.ndarray]:
    """Return the errors of one batch, one array for each measure.

    An array is NaN where `output` lacks the part, for example for a baseline without a class.

    Args:
        output: what a network answers, see `PoseNetwork`. class_probs that are all 0 mean "no answer".
        batch: R, t, square, label, scene, frame, subsequence, and keypoints if any are predicted: a batch of
            a data set, or its annotations. Of image only the width is read, for keypoint_crop_px.

    Returns:
        R_deg: geodesic angle of the rotation error, degrees.
        t_m: Euclidean distance of the translation error, metres.
        t_axis_m: (B, 3) the same per camera axis.
        distance_m: true distance.
        distance_ratio: predicted over true distance.
        direction_deg: angle between the predicted and the true direction to the drone.
        heading_deg: angle between the true nose and the direction to the camera (0: it looks at us, 180: away
            from us).
        flip: 1 where the predicted nose points more than 90 degrees away from the true one.
        class_correct, label, predicted: predicted is -1 where there is no answer.
        keypoint_units: mean distance of the four keypoints in crop units.
        keypoint_px: the same in full-frame pixels.
        keypoint_crop_px: the same in pixels of the resized crop.
        pck: share of the four within 5 % of the box's longer side. This holds for crops with the margin 1.2,
            as all are but augmented ones.
        failed: no pose was found, and R and t are the method's constant answer.
        R, t, keypoints: the prediction itself.
        scene, frame, subsequence: as in the batch.
        gate, layer_spread: (B, N) of Eq. 3, and crop units; only of a network that has them.

    Raises:
        InputError: an array has not one entry a frame, an R is no rotation (NaN stands for "no pose"), or a
            label is not one of the network's classes.
    """
    check_frames(output, batch)
    R, t = batch["R"], batch["t"]
    output = in_precision_of(t, output)
    nothing = torch.full_like(t[:, 0], torch.nan)  # (B,)
    errors = {"label": batch["label"], "distance_m": t.norm(dim=-1)}
    facing = -(R[:, :, 0] * t).sum(dim=-1) / t.norm(dim=-1)  # cosine
    errors["heading_deg"] = torch.rad2deg(torch.acos(facing.clamp(-1, 1)))
    errors |= rotation_errors(output.get("R"), R, nothing)
    errors |= translation_errors(output.get("t"), t, nothing)
    errors |= keypoint_errors(output.get("keypoints"), batch, nothing)
    errors |= class_errors(output.get("class_probs"), batch["label"], nothing)
    failed = output.get("failed")
    errors["failed"] = torch.zeros_like(batch["label"], dtype=torch.bool) if failed is None else failed
    if output.get("cr") is not None:
        errors |= {"gate": output["gate"], "layer_spread": layer_spread(output)}
    for name in ("scene", "frame", "subsequence"):
        errors[name] = batch[name]
    return {name: value.detach().cpu().numpy() for name, value in errors.items()}


def check_frames(output: dict, batch: dict) -> None:
    """Check that a network's answers and the truth are of the same frames, and that rotations are rotations.

    Raises:
        InputError: they are not. The message names the array.
    """
    check_shapes(
        **{
            "the batch's t": (batch["t"], ("B", 3)),
            "the batch's R": (batch["R"], ("B", 3, 3)),
            "the batch's label": (batch["label"], ("B",)),
            "the batch's square": (batch["square"], ("B", 3)),
            "the batch's keypoints": (batch.get("keypoints"), ("B", 4, 2)),
            "the predicted R": (output.get("R"), ("B", 3, 3)),
            "the predicted t": (output.get("t"), ("B", 3)),
            "the predicted keypoints": (output.get("keypoints"), ("B", 4, 2)),
            "the predicted class_probs": (output.get("class_probs"), ("B", "C")),
            "the answer's failed": (output.get("failed"), ("B",)),
        }
    )
    rotations.check_rotation(batch["R"], "the batch's R", rotations.PREDICTED)
    if output.get("R") is not None:
        rotations.check_rotation(output["R"], "the predicted R", rotations.PREDICTED, nan=True)
    probs, label = output.get("class_probs"), batch["label"]
    if probs is not None and len(label) and not 0 <= int(label.min()) <= int(label.max()) < probs.shape[1]:
        raise InputError(
            f"labels from {int(label.min())} to {int(label.max())}, "
            f"and the network tells {probs.shape[1]} classes apart, counted from 0"
        )


def in_precision_of(truth: Tensor, output: dict) -> dict:
    """Return the output with its floating point tensors in the precision of the truth."""
    result = {}
    for name, value in output.items():
        floating = torch.is_tensor(value) and value.is_floating_point()
        result[name] = value.to(truth.dtype) if floating else value
    return result


def rotation_errors(predicted: Tensor | None, R: Tensor, nothing: Tensor) -> dict[str, Tensor]:
    """Return R_deg, flip and R; they are NaN without a prediction."""
    if predicted is None:
        return {"R_deg": nothing, "flip": nothing, "R": nothing[:, None, None].expand(-1, 3, 3)}
    nose = (predicted[:, :, 0] * R[:, :, 0]).sum(dim=-1)  # cosine between the two noses
    flip = torch.where(nose.isnan(), nose, (nose < 0).to(R.dtype))
    return {"R_deg": rotations.geodesic_degrees(predicted, R), "flip": flip, "R": predicted}


def translation_errors(predicted: Tensor | None, t: Tensor, nothing: Tensor) -> dict[str, Tensor]:
    """Return t_m, t_axis_m, distance_ratio, direction_deg and t; they are NaN without a prediction."""
    if predicted is None:
        axes = nothing[:, None].expand(-1, 3)
        names = ("t_m", "distance_ratio", "direction_deg")
        return {**dict.fromkeys(names, nothing), "t_axis_m": axes, "t": axes}
    away = predicted - t
    across = torch.linalg.cross(predicted, t).norm(dim=-1)  # exact at 0 degrees, where acos is not
    along = (predicted * t).sum(dim=-1)
    return {
        "t_m": away.norm(dim=-1),
        "t_axis_m": away.abs(),
        "distance_ratio": predicted.norm(dim=-1) / t.norm(dim=-1),
        "direction_deg": torch.rad2deg(torch.atan2(across, along)),
        "t": predicted,
    }


def keypoint_errors(predicted: Tensor | None, batch: dict, nothing: Tensor) -> dict[str, Tensor]:
    """Return keypoint_units, keypoint_px, keypoint_crop_px, pck and keypoints.

    They are NaN without a prediction or without a truth.
    """
    if predicted is None or "keypoints" not in batch:
        names = ("keypoint_units", "keypoint_px", "keypoint_crop_px", "pck")
        if predicted is None:
            predicted = nothing[:, None, None].expand(-1, 4, 2)
        return {**dict.fromkeys(names, nothing), "keypoints": predicted}
    apart = (predicted - batch["keypoints"]).norm(dim=-1)  # (B, 4) crop units
    units = apart.mean(dim=-1)
    near = torch.where(apart.isnan(), apart, (apart * MARGIN < PCK).to(apart.dtype))
    return {
        "keypoint_units": units,
        "keypoint_px": units * batch["square"][:, 2],
        "keypoint_crop_px": units * batch["image"].shape[-1] if "image" in batch else nothing,
        "pck": near.mean(dim=-1),
        "keypoints": predicted,
    }


def class_errors(probs: Tensor | None, label: Tensor, nothing: Tensor) -> dict[str, Tensor]:
    """Return class_correct and predicted.

    A distribution that is all zeros (a detector that found nothing) or holds NaN is no answer.
    """
    none = torch.full_like(label, -1)
    if probs is None:
        return {"class_correct": nothing, "predicted": none}
    answered = (probs != 0).any(dim=-1) & probs.isfinite().all(dim=-1)
    predicted = torch.where(answered, probs.argmax(dim=-1), none)
    return {"class_correct": (predicted == label).to(nothing.dtype), "predicted": predicted}
