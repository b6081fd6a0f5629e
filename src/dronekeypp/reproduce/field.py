"""Add the field's measures, the recalls of ADD, MSSD and MSPD, to rows of a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.evaluate import BOP_MEASURES, MEASURES, answers_pose, bop_errors
from dronekeypp.evaluate.statistics import Frames, Measures
from dronekeypp.frame_dataset import FrameDataset
from dronekeypp.reproduce.flights import Name
from dronekeypp.reproduce.tables import FIELD, average, line, percent, title
from dronekeypp.sixdronesyn.object_shapes import read_shapes

TITLES = ("ADD < 0.1 d", "MSSD", "MSPD")  # in the order of FIELD


def field_errors(frames: Frames, dataset: FrameDataset) -> Frames:
    """Return the errors of `bop_errors`, or nothing if the method answers no pose.

    Args:
        frames: the arrays of `evaluate` on `dataset`.
        dataset: the frames.

    Raises:
        InputError: the data set lacks the mesh of an object.
    """
    if not answers_pose(frames):
        return {}
    shapes, missing = read_shapes(dataset.root, {frame.annotation.obj_id for frame in dataset.stored})
    if missing:
        raise InputError(f"no ADD, MSSD and MSPD: {missing}; make the data set again with `generate`")
    return bop_errors(frames, dataset, shapes)


def has_field_errors(frames: Frames) -> bool:
    """Tell whether `field_errors` were added to frames already."""
    return "add_recall" in frames


def measures_of(frames: Frames) -> Measures:
    """Return the columns of a row: with the field's where its errors were measured."""
    return {**MEASURES, **BOP_MEASURES} if has_field_errors(frames) else MEASURES


def field_lines(recorded: dict[str, Any], names: Sequence[Name]) -> list[str]:
    """Return a table of the recalls of rows, or nothing where they were not measured."""
    rows = {name: average(recorded, *name) for name in names}
    if all(row[key] is None for row in rows.values() for key in FIELD):
        return []
    lines = [
        "",
        "## The field's measures",
        "",
        "Recall, mean of the columns. ADD: the mean distance of the mesh's points is below a tenth of the "
        "diameter. MSSD and MSPD: mean over BOP's ten thresholds (0.05 to 0.5 of the diameter; 5 to 50 px at "
        "a width of 640), pixels of the whole frame. The shape is the true drone's, whichever one is named.",
        "",
        "| | " + " | ".join(TITLES) + " |",
        "|---|" + "---:|" * len(TITLES),
    ]
    for name, row in rows.items():
        lines.append(line([title(*name), *(percent(row[key]) for key in FIELD)]))
    return lines
