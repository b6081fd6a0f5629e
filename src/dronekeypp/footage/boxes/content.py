"""What a file of boxes holds, whichever program wrote it: the readers make it, `read.read_boxes` takes it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from dronekeypp.errors import InputError

Box = tuple[float, float, float, float]  # x, y, w, h in pixels of the picture that the file speaks of


class Kind(NamedTuple):
    """Hold the class of a box: what the file calls it, by number, by name, or by both."""

    number: str | None
    name: str | None

    def __str__(self) -> str:
        if self.number is None or self.name is None:
            return self.name or self.number or ""
        return f"{self.name} ({self.number})"


@dataclass(frozen=True)
class Picture:
    """Hold what the file says of a picture.

    Attributes:
        name: its file name, with folders where the file gives them, or its number.
        where: the file and line that say so, for messages.
        size: width and height that the file gives, or None.
        fault: why its boxes cannot be read. It matters only if the picture is a frame of the footage.
    """

    name: str | int
    where: str
    size: tuple[float, float] | None = None
    fault: str = ""


@dataclass(frozen=True)
class BoxRow:
    """Hold one box of a file.

    Attributes:
        where: its file and line, for messages.
        picture: the index of its picture in `BoxFile.pictures`.
        box: None where the file says that there is no drone.
        score: how sure the detector is, on any scale; None where the file does not say.
        kind: its class, or None.
        track: the number of its track, or None.
        unfit: why the file itself wants it to be left out, or "".
    """

    where: str
    picture: int
    box: Box | None
    score: float | None = None
    kind: Kind | None = None
    track: str | None = None
    unfit: str = ""


@dataclass
class BoxFile:
    """Hold all pictures and boxes of a file or folder.

    Attributes:
        path: the file or folder.
        format: what the README calls its format.
        pictures: in the order of the file, also those without a box.
        rows: the boxes.
        first_number: 0 or 1 where the format says from which number it counts, else None.
        named: whether its pictures have file names, so that a name of digits is no number.
    """

    path: Path
    format: str
    pictures: list[Picture] = field(default_factory=list)
    rows: list[BoxRow] = field(default_factory=list)
    first_number: int | None = None
    named: bool = False

    def picture(self, name: str | int, where: str, size: tuple[float, float] | None = None) -> int:
        """Return the index of the picture with this name, which is entered if it is new."""
        index = self._index.get(name)
        if index is None:
            index = self._index[name] = len(self.pictures)
            self.pictures.append(Picture(name, where, size))
        return index

    _index: dict[str | int, int] = field(default_factory=dict, repr=False)


def number(value: Any) -> float:
    """Return a number of a file as a float. Text that is a number will do, true and false will not.

    Raises:
        ValueError: It is no number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"not a number: {value!r}")
    if isinstance(value, str) and "_" in value:  # Python reads 1_000
        raise ValueError(f"not a number: {value!r}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def as_box(values: Iterable[Any], where: str, pixels: bool = True) -> Box | None:
    """Return a box (x, y, w, h), or None for what programs write where there is no drone.

    That is nothing, four zeros, or four times "not a number". Where the file should hold `pixels`, shares of
    the frame are refused.

    Raises:
        InputError: These are not four finite numbers, or width or height are negative.
    """
    given = list(values)
    if not given:
        return None
    try:
        box = [number(value) for value in given]
    except ValueError:
        box = []
    if len(box) == 4 and (all(map(math.isnan, box)) or not any(box)):
        return None
    if len(box) != 4 or not all(map(math.isfinite, box)) or min(box[2:]) < 0:
        raise InputError(
            f"{where}: a box needs four finite numbers, width and height not below 0, got {given}"
        )
    if pixels and max(map(abs, box)) <= 1:
        raise InputError(f"{where}: {box} are shares of the frame; pixels are needed")
    return box[0], box[1], box[2], box[3]


def as_score(value: Any, where: str) -> float | None:
    """Return a score, or None where there is none.

    Raises:
        InputError: It is no finite number.
    """
    if value is None or value == "":
        return None
    try:
        score = number(value)
    except ValueError:
        score = math.nan
    if not math.isfinite(score):
        raise InputError(f"{where}: the score is {value}")
    return score


def as_size(width: Any, height: Any, where: str) -> tuple[float, float] | None:
    """Return the size of a picture, or None where a file gives none. Some programs write 0 × 0 for that.

    Raises:
        InputError: One side is missing, or they are not numbers above 0.
    """
    if width in (None, "", 0, "0") and height in (None, "", 0, "0"):
        return None
    try:
        size = number(width), number(height)
    except ValueError:
        size = (math.nan, math.nan)
    if not (math.isfinite(size[0]) and math.isfinite(size[1]) and min(size) > 0):
        raise InputError(f"{where}: width {width} and height {height} of a picture must both be above 0")
    return size


def as_whole(value: Any, what: str, where: str) -> int:
    """Return a whole number, which may be written as 3, 3.0 or "3".

    Raises:
        InputError: It is none. The message calls it `what`.
    """
    try:
        whole = number(value)
    except ValueError:
        whole = math.nan
    if not math.isfinite(whole) or whole != int(whole):
        raise InputError(f"{where}: {what} {value!r} is no whole number")
    return value if isinstance(value, int) else int(whole)
