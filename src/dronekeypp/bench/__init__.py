"""`python -m dronekeypp bench` measures how fast each method is.

Every contender waits in a process of its own. All are asked in turn, round after round, so that a busy moment
hits all of them. Ratios are taken within a round.

A frame is what the methods are given: a full HD picture and a box. The stage *crop* cuts and resizes,
*network* goes from the crop to keypoints and class, and *pose* goes from there to R and t. *Whole* is all of
them, one after the other.
"""

from dronekeypp.bench.contender import (
    COMPILED,
    EAGER,
    GRAPHS,
    LIBRARY,
    ONNX,
    PAPER_SIZED,
    POSE34,
    YOLO,
    YOLO_IN_ONNX,
    Contender,
    contenders,
    named,
)
from dronekeypp.bench.rows import detector_of, detectors_beside, row_of, table
from dronekeypp.bench.run import bench

__all__ = [
    "COMPILED",
    "EAGER",
    "GRAPHS",
    "LIBRARY",
    "ONNX",
    "PAPER_SIZED",
    "POSE34",
    "YOLO",
    "YOLO_IN_ONNX",
    "Contender",
    "bench",
    "contenders",
    "detector_of",
    "detectors_beside",
    "named",
    "row_of",
    "table",
]
