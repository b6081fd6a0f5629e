"""Read our own table of boxes, as pandas and spreadsheets write it.

A header names the columns, in any order: frame, x, y, w, h in pixels, and score, class and track where you
have them. Other columns, such as the index of pandas, are passed over. `frame` is a file name, or a number
from 0. Empty cells say that there is no drone. Reference: RFC 4180.

    frame,x,y,w,h,score
    shot_0.jpg,1162.66,492.62,270.55,80.47,0.9
    shot_1.jpg,,,,,
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import BoxFile, BoxRow, Kind, as_box, as_score
from dronekeypp.footage.boxes.text import refuse_cut

COLUMNS = ("frame", "x", "y", "w", "h")


def read_csv(path: Path, text: str) -> BoxFile:
    """Read a table with a header.

    Raises:
        InputError: A column is missing or there twice, or a row has other cells than the header says.
    """
    refuse_cut(path, text)
    file = BoxFile(path, "CSV", first_number=0)
    for line, row in _table(path, text):
        where = f"{path} line {line}"
        cells = [row[key].strip() for key in COLUMNS[1:]]
        filled = [cell for cell in cells if cell]
        kind, track = row.get("class", "").strip(), row.get("track", "").strip()
        if not row["frame"].strip():
            raise InputError(f"{where}: the cell of frame is empty")
        file.rows.append(
            BoxRow(
                where,
                file.picture(row["frame"].strip(), where),
                as_box(cells if filled else (), where),
                as_score(row.get("score", "").strip(), where) if filled else None,
                Kind(None, kind) if kind else None,
                track.removesuffix(".0") or None,
            )
        )
    return file


def _table(path: Path, text: str) -> list[tuple[int, dict[str, str]]]:
    """Return the number of each line and its cells by column."""
    reader = csv.DictReader(io.StringIO(text, newline=""))
    try:
        header = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = header
        if not set(COLUMNS) <= set(header):
            raise InputError(
                f"{path}: the header needs frame, x, y, w, h[, score, class, track]; "
                f"it has {', '.join(header) or 'nothing'}"
            )
        named = [name for name in header if name]
        if len(set(named)) < len(named):
            raise InputError(f"{path}: the header has a column twice: {', '.join(header)}")
        rows = []
        for row in reader:
            if None in row or None in row.values():
                raise InputError(f"{path} line {reader.line_num}: {len(header)} cells are needed")
            rows.append((reader.line_num, row))
        return rows
    except csv.Error as error:
        raise InputError(f"{path}: not CSV ({error})") from None
