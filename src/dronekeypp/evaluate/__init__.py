"""Evaluate networks (Sec. V-A).

There are the errors of every frame, the paper's and the field's, their summary by scene and drone, and the
command `evaluate`.
"""

from dronekeypp.evaluate.bootstrap import (
    ENOUGH_SEEDS,
    NOT_TOLD_APART,
    Difference,
    compare_rows,
    interval_of_row,
)
from dronekeypp.evaluate.bop_measures import BOP_COLUMNS, BOP_MEASURES, bop_errors
from dronekeypp.evaluate.command import answers_pose, evaluate_checkpoint
from dronekeypp.evaluate.errors import FORMAT, MARGIN, PCK, frame_errors
from dronekeypp.evaluate.run import (
    apply_model,
    batches_of,
    constant_baseline,
    evaluate,
    loading,
    share_drones,
    to_device,
)
from dronekeypp.evaluate.statistics import (
    FLIGHT_MEASURES,
    INTERVALS,
    MEASURES,
    averages,
    flight_errors,
    format_table,
    interval_of_mean,
    json_values,
    measure,
    summarise,
)

__all__ = [
    "BOP_COLUMNS",
    "BOP_MEASURES",
    "ENOUGH_SEEDS",
    "FLIGHT_MEASURES",
    "FORMAT",
    "INTERVALS",
    "MARGIN",
    "MEASURES",
    "NOT_TOLD_APART",
    "PCK",
    "Difference",
    "answers_pose",
    "apply_model",
    "averages",
    "batches_of",
    "bop_errors",
    "compare_rows",
    "constant_baseline",
    "evaluate",
    "evaluate_checkpoint",
    "flight_errors",
    "format_table",
    "frame_errors",
    "interval_of_mean",
    "interval_of_row",
    "json_values",
    "loading",
    "measure",
    "share_drones",
    "summarise",
    "to_device",
]
