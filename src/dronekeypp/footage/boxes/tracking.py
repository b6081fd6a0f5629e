"""Read the text of single-object tracking: x, y, w, h, a line for every frame.

Commas, tabs or blanks stand between the numbers. Four zeros or NaN say that the drone is not there.
Reference: the ground truth of OTB and UAV123, https://cemse.kaust.edu.sa/ivul/uav123.

    1162.66,492.62,270.55,80.47
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import BoxFile, BoxRow, as_box
from dronekeypp.footage.boxes.text import NumberLine


def read_tracking(path: Path, lines: Sequence[NumberLine], frames: int) -> BoxFile:
    """Read a line for every one of the `frames`.

    Raises:
        InputError: There are more or fewer lines than frames, or a line has not four numbers.
    """
    if len(lines) != frames:
        raise InputError(
            f"{path}: {len(lines)} lines x, y, w, h for {frames} frames; "
            "without frame numbers it needs one for every frame"
        )
    file = BoxFile(path, "single-object tracking", first_number=0)
    for frame, (where, values) in enumerate(lines):
        file.rows.append(BoxRow(where, file.picture(frame, where), as_box(values, where)))
    return file
