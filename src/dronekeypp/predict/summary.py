"""Say at the end of a run what came of it, in a line for people and in numbers for machines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.files import check_writable, read_json
from dronekeypp.footage import Boxes, BoxReport
from dronekeypp.predict.journal import BOX, FILES, GOOD, JOURNAL, Row

LISTED = 3  # reasons that the line names
PARTS = {"frames", "poses", "without_pose", "boxes"}  # of the numbers for machines


def check_json_file(path: Path, out: Path) -> None:
    """Check that the numbers of a run to the folder `out` may be written to a file.

    Raises:
        InputError: It cannot be written; or it holds anything but such numbers, as the camera or the boxes do
            when names are mixed up; or it is a file of the run itself.
    """
    check_writable(path)
    if path.name in FILES and path.resolve().parent == out.resolve():
        raise InputError(f"{path}: the run itself writes this file; choose another name for --json")
    if path.exists():
        mend = "choose another name for --json, or remove it"
        content = read_json(path, mend=mend)
        if not isinstance(content, dict) or set(content) != PARTS:
            raise InputError(f"{path}: is there already, and is no file of `predict --json`; {mend}")


def box_report(rows: Sequence[Row], given: Boxes | None, first_name: str) -> BoxReport:
    """Return what became of the boxes: of those that were given, or else of those that the tracker found.

    Args:
        rows: the finished journal.
        given: the boxes of a file, or None where a tracker carried `--box` on.
        first_name: the name of the footage's first frame.
    """
    used = sum(bool(row[BOX[0]]) for row in rows)
    if given is not None:
        left_out = dict(given.report.left_out)
        if given.report.used > used:
            left_out["on a frame that cannot be used"] = given.report.used - used
        return replace(given.report, used=used, left_out=left_out)
    return BoxReport(
        file="--box",
        format="tracker",
        boxes=used,
        used=used,
        left_out={},
        on_no_frame=0,
        no_drone=0,
        first_name=first_name,
        footage_first_name=first_name,
        first_number=None,
        scaled=0,
    )


def summary(rows: Sequence[Row], boxes: BoxReport) -> dict[str, Any]:
    """Return what `--json` holds: frames, poses, frames without a pose by reason, and the boxes' report."""
    without = Counter(row["status"] for row in rows if row["status"] != GOOD)
    return {
        "frames": len(rows),
        "poses": len(rows) - without.total(),
        "without_pose": dict(without),
        "boxes": boxes.as_dict(),
    }


def closing_line(out: Path, rows: Sequence[Row], boxes: BoxReport) -> str:
    """Return the same in one line."""
    without = Counter(row["status"] for row in rows if row["status"] != GOOD)
    line = f"{out}: {len(rows) - without.total()} poses of {len(rows)} frames"
    if without:
        reasons = ", ".join(f"{count} {status}" for status, count in without.most_common(LISTED))
        more = " …" if len(without) > LISTED else ""
        line += f", {without.total()} without one ({reasons}{more}), see {JOURNAL}"
    return f"{line}; {boxes.line()}"
