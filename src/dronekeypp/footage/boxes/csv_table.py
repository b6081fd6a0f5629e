"""Read our own table of boxes, as pandas and spreadsheets write it.

A header names the columns, in any order: frame, x, y, w, h in pixels, and score, class and track where you
have them. Capitals do not count. Other columns, such as the index of pandas, are passed over. `frame` is a
file name, or a number from 0. Empty cells say that there is no drone. Commas stand between the cells, or
semicolons or tabs, and then a comma in a number is a decimal one, as spreadsheets in much of the world write
it. Reference: RFC 4180.

    frame,x,y,w,h,score
    shot_0.jpg,1162.66,492.62,270.55,80.47,0.9
    shot_1.jpg,,,,,
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import BoxFile, BoxRow, Kind, as_box, as_score
from dronekeypp.footage.boxes.text import refuse_cut

COLUMNS = ("frame", "x", "y", "w", "h")
NUMBERS = ("x", "y", "w", "h", "score", "track")
SEPARATORS = (",", ";", "\t")
THOUSANDS = re.compile(r"[-+]?\d{1,3}(?:,\d{3})+")  # 1,162 is one thousand, or a little more than one

Row = dict[str, str]  # the cells of a line by column


def is_header(line: str) -> bool:
    """Tell whether a line names the columns of such a table."""
    return "frame" in _names(line.split(_separator(line)))


def read_csv(path: Path, text: str) -> BoxFile:
    """Read a table with a header.

    Raises:
        InputError: A column is missing or there twice, or a row has other cells than the header says.
    """
    separator = _separator(text.lstrip().partition("\n")[0])
    refuse_cut(path, text if separator == "," else text.replace(",", ".").replace(separator, ","))
    file = BoxFile(path, "CSV", first_number=0)
    rows = _table(path, text, separator)
    if separator != ",":
        _write_points(path, rows)
    for line, row in rows:
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


def _separator(header: str) -> str:
    """Return what stands between the cells of a header."""
    return max(SEPARATORS, key=header.count)


def _names(cells: list[str]) -> list[str]:
    """Return the names of columns in small letters."""
    return [cell.strip().lower() for cell in cells]


def _table(path: Path, text: str, separator: str) -> list[tuple[int, Row]]:
    """Return the number of each line and its cells by column."""
    reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        header = _names(list(reader.fieldnames or ()))
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


def _write_points(path: Path, rows: list[tuple[int, Row]]) -> None:
    """Write the decimal commas in the numbers of a table as points.

    Raises:
        InputError: All commas may as well stand between thousands.
    """
    with_comma = []
    for line, row in rows:
        for column in NUMBERS:
            if "," in row.get(column, ""):
                with_comma.append((line, row, column))
    if with_comma and all(THOUSANDS.fullmatch(row[column].strip()) for _, row, column in with_comma):
        line, row, column = with_comma[0]
        raise InputError(
            f"{path} line {line}: the comma of {row[column].strip()} may be a decimal one, or stand between "
            "thousands; write a point"
        )
    for _, row, column in with_comma:
        row[column] = row[column].replace(",", ".")
