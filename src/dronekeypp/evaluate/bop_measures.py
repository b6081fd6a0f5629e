"""Measure what BOP and the field measure, on every frame: ADD or ADD-S, MSSD and MSPD, and their recalls.

A pose counts as correct where its error is below a threshold:

    ADD, ADD-S  a tenth of the object's diameter
    MSSD        0.05, 0.10, … 0.50 of the diameter; the recall is the mean over the ten
    MSPD        5r, 10r, … 50r pixels, where r is the frame's width over 640; the recall is the mean again

Pixels are always those of the whole frame. BOP's toolkit takes those of cam_K, and one width for all images.
So its MSPD of stored crops of the second edition, whose cam_K is the crop's, is another.

Like our other errors these are measured with the true drone's shape, whichever drone the network names, and
over the frames that there are. BOP's own score also counts a drone that was called by another name as missed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dronekeypp.data import read_annotations
from dronekeypp.evaluate.pose_errors import add, adds, mspd, mssd
from dronekeypp.evaluate.statistics import Columns, Frames, Measures
from dronekeypp.frame_dataset import FrameDataset, Relabelled
from dronekeypp.sixdronesyn.object_shapes import ObjectShape

ADD_THRESHOLD = 0.1  # of the diameter
MSSD_THRESHOLDS = np.arange(1, 11) * 0.05  # of the diameter
MSPD_THRESHOLDS = np.arange(1, 11) * 5.0  # pixels of a frame that is MSPD_WIDTH wide
MSPD_WIDTH = 640
POINTS_AT_A_TIME = 500_000  # of all poses of a batch; more only takes memory

# Columns of a row of results, like `statistics.MEASURES`.
BOP_MEASURES: Measures = {
    "add_mean_m": ("add_m", np.mean),
    "add_median_m": ("add_m", np.median),
    "add_recall": ("add_recall", np.mean),
    "mssd_mean_m": ("mssd_m", np.mean),
    "mssd_median_m": ("mssd_m", np.median),
    "mssd_recall": ("mssd_recall", np.mean),
    "mspd_mean_px": ("mspd_px", np.mean),
    "mspd_median_px": ("mspd_px", np.median),
    "mspd_recall": ("mspd_recall", np.mean),
}
# The columns of their table, see `statistics.format_table`.
BOP_COLUMNS: Columns = (
    ("ADD m", "add_mean_m", 3, 1),
    ("ADD Med", "add_median_m", 3, 1),
    ("ADD %", "add_recall", 1, 100),
    ("MSSD m", "mssd_mean_m", 3, 1),
    ("MSSD Med", "mssd_median_m", 3, 1),
    ("MSSD %", "mssd_recall", 1, 100),
    ("MSPD px", "mspd_mean_px", 2, 1),
    ("MSPD Med", "mspd_median_px", 2, 1),
    ("MSPD %", "mspd_recall", 1, 100),
)
LEGEND = (
    "ADD %: below a tenth of the diameter; MSSD %, MSPD %: mean over BOP's ten thresholds "
    "(0.05 to 0.5 of the diameter; 5 to 50 px at a width of 640)"
)
OF_CROPS = "MSPD is in pixels of the whole frame; BOP's toolkit takes those of cam_K (edition 2: of the crop)"


def bop_errors(
    frames: Frames, dataset: FrameDataset | Relabelled, shapes: Mapping[int, ObjectShape]
) -> Frames:
    """Return the field's errors of every frame.

    Args:
        frames: the arrays of `evaluate` on `dataset`. Of them R and t, the prediction, are read.
        dataset: the frames.
        shapes: of every object in them, by its number.

    Returns:
        add_m: (F,) ADD, or ADD-S where the object has a symmetry, metres.
        mssd_m: (F,) MSSD, metres.
        mspd_px: (F,) MSPD, pixels of the whole frame.
        add_recall, mssd_recall, mspd_recall: (F,) the share of the thresholds that the error is below.
    """
    truth = read_annotations(dataset)
    R, t, K = (truth[name].double().numpy() for name in ("R", "t", "K"))
    R_est, t_est = frames["R"].astype(np.float64), frames["t"].astype(np.float64)
    numbers = np.array([frame.annotation.obj_id for frame in dataset.stored])
    add_m, mssd_m, mspd_px = (np.empty(len(t)) for _ in range(3))
    for number in np.unique(numbers):
        shape = shapes[number]
        mean_distance = adds if shape.symmetric else add
        same_object = np.flatnonzero(numbers == number)
        at_a_time = max(1, POINTS_AT_A_TIME // len(shape.points))
        for start in range(0, len(same_object), at_a_time):
            part = same_object[start : start + at_a_time]
            poses = (R_est[part], t_est[part], R[part], t[part])
            add_m[part] = mean_distance(*poses, shape.points)
            mssd_m[part] = mssd(*poses, shape.points, shape.symmetries)
            mspd_px[part] = mspd(*poses, K[part], shape.points, shape.symmetries)
    diameter = np.array([shapes[number].diameter for number in numbers])
    width = np.array([frame.width for frame in dataset.stored])
    return {
        "add_m": add_m,
        "mssd_m": mssd_m,
        "mspd_px": mspd_px,
        "add_recall": recall(add_m / diameter, [ADD_THRESHOLD]),
        "mssd_recall": recall(mssd_m / diameter, MSSD_THRESHOLDS),
        "mspd_recall": recall(mspd_px * MSPD_WIDTH / width, MSPD_THRESHOLDS),
    }


def recall(errors: np.ndarray, thresholds: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return for each error (F,) the share (F,) of the thresholds that it is below."""
    return (errors[:, None] < np.asarray(thresholds)).mean(axis=1)
