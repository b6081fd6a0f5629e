"""Read the drone's box of every frame from the files that detectors and annotation programs write."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.files import digest
from dronekeypp.footage.boxes.choose import choose_kind, choose_track, surest
from dronekeypp.footage.boxes.coco import read_coco
from dronekeypp.footage.boxes.content import BoxFile, BoxRow
from dronekeypp.footage.boxes.csv_table import is_header, read_csv
from dronekeypp.footage.boxes.doubts import check_corners, remark_on_outside, remark_on_quarter
from dronekeypp.footage.boxes.match import Match, match_pictures
from dronekeypp.footage.boxes.mot import read_mot
from dronekeypp.footage.boxes.report import BoxReport
from dronekeypp.footage.boxes.text import number_lines, read_text, refuse_cut
from dronekeypp.footage.boxes.tracking import read_tracking
from dronekeypp.footage.boxes.voc import read_voc
from dronekeypp.footage.boxes.yolo import CLASSES, FORMAT, read_yolo

SLIVER = 1.0  # pixels: what a detector leaves of a box at the frame's edge


class Boxes(Mapping[int, np.ndarray]):
    """Map frame numbers to boxes (4,) x, y, w, h in pixels, in the order of the frames.

    Attributes:
        report: what became of all boxes of the file.
    """

    def __init__(self, box_of: Mapping[int, np.ndarray], report: BoxReport) -> None:
        self._box_of = dict(sorted(box_of.items()))
        self.report = report

    def __getitem__(self, frame: int) -> np.ndarray:
        return self._box_of[frame]

    def __iter__(self) -> Iterator[int]:
        return iter(self._box_of)

    def __len__(self) -> int:
        return len(self._box_of)

    def digest(self) -> str:
        """Return what tells these boxes from others."""
        lines = [f"{frame} {box.tolist()}" for frame, box in self._box_of.items()]
        return digest("\n".join(lines).encode())


def read_boxes(
    path: str | Path,
    names: Sequence[str],
    width: int,
    height: int,
    folder: str | Path = ".",
    kinds: Sequence[str] = (),
    tracks: Sequence[str] = (),
    count_from: int | None = None,
) -> Boxes:
    """Read one box for each frame. The README says which formats there are; the format follows from the file.

    Of several boxes in a frame the one with the highest score counts. A box whose centre lies outside the
    frame, or of less than a pixel, is left out. A box that reaches over the frame's edge is taken as it is,
    because it is the whole drone's.

    Args:
        path: the file or folder of boxes.
        names: the footage's frames (`Footage.names`).
        width, height: the frames' size, pixels.
        folder: where the footage lies (`Footage.folder`). Pictures of other folders are not those.
        kinds: names or numbers of the classes to take; needed where the frames' boxes have several.
        tracks: the numbers of the tracks to take; needed where there are several.
        count_from: 0 or 1: the number of the first frame, where a file has numbers and does not tell.

    Raises:
        InputError: The path is not found, it is not one of these formats, a line is not valid (the message
            names it), no box can be used, or it stays unclear which box is the drone's in which frame.
    """
    path = Path(path)
    if count_from not in (None, 0, 1):
        raise InputError(f"--count-from {count_from}: 0 or 1")
    file = _read_file(path, len(names), width, height, folder)
    match = match_pictures(file, names, folder, count_from)
    for picture, frame in zip(file.pictures, match.frames, strict=True):
        if frame is not None and picture.fault:
            raise InputError(picture.fault)
    rows = [row for row in file.rows if row.box is not None]
    here = [row for row in rows if match.frames[row.picture] is not None]
    if not here:
        raise InputError(_nothing(file, rows, names))
    left_out: Counter[str] = Counter()
    remarks = match.remarks + _doubts(file, here, (width, height))
    chosen = _fit(file, here, (width, height), left_out)
    remarks += remark_on_outside(left_out["outside the frame"])
    of_kind = choose_kind(path, chosen, kinds)
    of_track = choose_track(path, of_kind, tracks)
    box_of = _surest_boxes(path, of_track, match, names)
    left_out["of another class"] = len(chosen) - len(of_kind)
    left_out["of another track"] = len(of_kind) - len(of_track)
    left_out["not the surest of their frame"] = len(of_track) - len(box_of)
    left_out = +left_out
    if not box_of:
        reasons = ", ".join(f"{count} {reason}" for reason, count in left_out.items())
        raise InputError(f"{path}: none of its {len(rows)} boxes can be used: {reasons}")
    report = BoxReport(
        file=path.name,
        format=file.format,
        boxes=len(rows),
        used=len(box_of),
        left_out=dict(left_out),
        on_no_frame=len(rows) - len(here),
        no_drone=len(file.rows) - len(rows),
        first_name=str(file.pictures[0].name),
        footage_first_name=names[0],
        first_number=match.first_number,
        scaled=sum(_scale(file, row, (width, height)) != (1, 1) for row in here),
        remarks=tuple(remarks),
    )
    return Boxes(box_of, report)


def _read_file(path: Path, frames: int, width: int, height: int, folder: str | Path) -> BoxFile:
    """Read a file or folder in the format that it has."""
    if path.is_dir():
        return _read_folder(path, width, height)
    suffix = path.suffix.lower()
    if suffix == ".xml":
        return read_voc(path, [path])
    text = read_text(path)
    if suffix == ".json":
        return read_coco(path, text, folder)
    first = next((line for line in text.splitlines() if line.strip()), "")
    if is_header(first) or (suffix == ".csv" and any(character.isalpha() for character in first)):
        return read_csv(path, text)
    lines = number_lines(path, text, "," if "," in first else None)
    if not lines:
        raise InputError(f"{path}: holds no box")
    if len(lines[0].values) == 4:
        refuse_cut(path, text)
        return read_tracking(path, lines, frames)
    if "," in first:
        refuse_cut(path, text, ends=len(lines) == 1)  # there is no other line to compare with
        return read_mot(path, lines)
    return read_yolo(path, [path], width, height)


def _read_folder(path: Path, width: int, height: int) -> BoxFile:
    """Read a folder with a label file for each picture."""
    labels, annotations = sorted(path.glob("*.txt")), sorted(path.glob("*.xml"))
    if annotations and all(label.stem in CLASSES for label in labels):
        return read_voc(path, annotations)
    if labels and not annotations:
        return read_yolo(path, labels, width, height)
    found = Counter(file.suffix or "without suffix" for file in path.iterdir())
    listed = ", ".join(f"{count} {suffix}" for suffix, count in found.most_common(3)) or "nothing"
    raise InputError(
        f"{path}: needs either .txt files (YOLO) or .xml files (Pascal VOC), one a picture; it holds {listed}"
    )


def _fit(
    file: BoxFile, rows: Sequence[BoxRow], size: tuple[int, int], left_out: Counter[str]
) -> list[BoxRow]:
    """Return the boxes that can be used, in pixels of the frames. The others are counted in `left_out`.

    Raises:
        InputError: Most boxes lie outside the frames.
    """
    fitting, outside = [], []
    for row in rows:
        scale_x, scale_y = _scale(file, row, size)
        x, y, w, h = row.box
        box = (x * scale_x, y * scale_y, w * scale_x, h * scale_y)
        if row.unfit:
            left_out[row.unfit] += 1
        elif min(box[2:]) < SLIVER:
            left_out["smaller than a pixel"] += 1
        elif not (0 <= box[0] + box[2] / 2 < size[0] and 0 <= box[1] + box[3] / 2 < size[1]):
            outside.append(row)
        else:
            fitting.append(replace(row, box=box))
    if outside:
        left_out["outside the frame"] = len(outside)
    if len(outside) > len(fitting):
        raise InputError(
            f"{outside[0].where}: the box {list(outside[0].box)} lies outside the {size[0]}×{size[1]} frame, "
            f"as do {len(outside)} of {len(rows)}; are these boxes of another resolution?"
        )
    return fitting


def _doubts(file: BoxFile, rows: Sequence[BoxRow], size: tuple[int, int]) -> list[str]:
    """Return what may be wrong with the boxes of frames, or raise InputError where it must be."""
    scales = [np.tile(_scale(file, row, size), 2) for row in rows]
    boxes = np.array([row.box for row in rows]) * scales  # (N, 4) x, y, w, h
    shares = file.format == FORMAT
    remarks = check_corners(file.path, boxes, size, centred=shares)
    if not shares and all(file.pictures[row.picture].size is None for row in rows):
        remarks += remark_on_quarter(boxes, size)
    return remarks


def _scale(file: BoxFile, row: BoxRow, size: tuple[int, int]) -> tuple[float, float]:
    """Return what makes a box of a file's picture one of the frame, in x and in y.

    Raises:
        InputError: The picture has another shape than the frames.
    """
    picture = file.pictures[row.picture]
    if picture.size is None:
        return 1, 1
    width, height = picture.size
    if abs(size[0] * height / width - size[1]) > 1:  # pixels
        raise InputError(
            f"{picture.where}: its picture {picture.name} is {width:g}×{height:g}, the frames are "
            f"{size[0]}×{size[1]}: not the same shape, so it was cut, stretched or turned"
        )
    return size[0] / width, size[1] / height


def _surest_boxes(
    path: Path, rows: Sequence[BoxRow], match: Match, names: Sequence[str]
) -> dict[int, np.ndarray]:
    """Return the surest box of each frame."""
    rows_of: dict[int, list[BoxRow]] = {}
    for row in rows:
        rows_of.setdefault(match.frames[row.picture], []).append(row)
    return {frame: np.array(surest(path, some, names[frame]).box) for frame, some in rows_of.items()}


def _nothing(file: BoxFile, rows: Sequence[BoxRow], names: Sequence[str]) -> str:
    """Say why there is no box for any frame."""
    first = str(file.pictures[0].name) if file.pictures else "missing"
    faults = [picture.fault for picture in file.pictures if picture.fault]
    if faults and len(faults) == len(file.pictures):
        return faults[0]
    if not rows and not faults:
        return f"{file.path}: holds no box; its first name is {first}, the footage's {names[0]}"
    return (
        f"{file.path}: none of its {len(rows)} boxes is on any of the {len(names)} frames; "
        f"its first name is {first}, the footage's {names[0]}"
    )


def check_box(box: Sequence[float] | np.ndarray, width: int, height: int, where: str) -> np.ndarray:
    """Return the box (x, y, w, h) as a float64 array (4,).

    Raises:
        InputError: The box is not finite, has no area, is in shares of the frame, lies wholly outside the
            frame of `width` × `height` pixels, or is two corners. The message begins with `where`.
    """
    box = np.array(box, dtype=np.float64)
    if box.shape != (4,) or not np.isfinite(box).all() or box[2] <= 0 or box[3] <= 0:
        raise InputError(
            f"{where}: a box needs four finite numbers, width and height above 0, got {box.tolist()}"
        )
    if np.abs(box).max() <= 1:
        raise InputError(f"{where}: {box.tolist()} are shares of the frame; pixels are needed")
    if box[0] >= width or box[1] >= height or box[0] + box[2] <= 0 or box[1] + box[3] <= 0:
        raise InputError(f"{where}: the box {box.tolist()} lies outside the {width}×{height} frame")
    check_corners(where, box[None], (width, height), centred=False)
    return box
