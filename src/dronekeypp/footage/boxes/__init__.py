"""Read boxes of the drone that other programs found or people drew: one file here for each format.

A reader turns its format into a `content.BoxFile`. `match` finds the frame of each of its pictures, `choose`
the drone's box in each frame, and `report` says what became of all others.
"""

from dronekeypp.footage.boxes.read import Boxes, check_box, read_boxes
from dronekeypp.footage.boxes.report import BoxReport

__all__ = ["BoxReport", "Boxes", "check_box", "read_boxes"]
