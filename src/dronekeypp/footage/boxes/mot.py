"""Read the text of multi-object trackers: frame, id, x, y, w, h[, score, class …], frames from 1.

Reference: MOTChallenge, https://motchallenge.net/instructions; VisDrone's ten columns are the same as far as
we read them. A score of 0 marks what is not to be used; id and class −1 mean none.

    1,7,1162.66,492.62,270.55,80.47,0.9,-1,-1,-1
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import BoxFile, BoxRow, Kind, as_box, as_score, as_whole
from dronekeypp.footage.boxes.text import NumberLine

FEWEST, MOST = 6, 10  # columns


def read_mot(path: Path, lines: Sequence[NumberLine]) -> BoxFile:
    """Read the lines of a MOT file.

    Raises:
        InputError: A line has too few or too many columns, or others than the first line, or a frame or an id
            is no whole number.
    """
    file = BoxFile(path, "MOT", first_number=1)
    columns = len(lines[0].values)
    for where, values in lines:
        if not FEWEST <= len(values) <= MOST or len(values) != columns:
            raise InputError(
                f"{where}: a MOT line is frame, id, x, y, w, h[, score, class …], "
                f"all with as many columns; this has {len(values)}"
            )
        frame = as_whole(values[0], "frame", where)
        track = as_whole(values[1], "id", where)
        score = as_score(values[6], where) if columns > 6 else None
        kind = None
        if columns > 7 and not math.isnan(values[7]) and values[7] >= 0:
            kind = Kind(str(as_whole(values[7], "class", where)), None)
        file.rows.append(
            BoxRow(
                where,
                file.picture(frame, where),
                as_box(values[2:6], where),
                score,
                kind,
                str(track) if track >= 0 else None,
                "marked as not to be used" if score == 0 else "",
            )
        )
    return file
