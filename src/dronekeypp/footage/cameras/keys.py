"""Keep account of the entries of a camera file: what is not used is looked at once more.

Programs call one thing by many names, and an entry that is passed over in silence makes wrong poses. So a
reader takes the entries that it understands, and `Entries.refuse_rest` refuses, by its name, whatever is left
and looks like distortion, the size of the picture or the model of the lens. It may be nested, and capitals
and underscores do not count.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp.errors import InputError

DISTORTION, SIZE, LENS = "distortion", "image size", "lens model"
MATRIX_KEYS = {"rows", "cols", "dt", "data", "type_id"}  # of a matrix as OpenCV and ROS write it
# Names as `plain` writes them.
_DISTORTION = re.compile(
    r"dist(?!ance|rib|ro)|.*distort|.*coef|d\d?$|[kps]\d$|k[cd]\d?$|kappa|tau[xy]?$|radial|tangential"
)
_SIZE = re.compile(r"[wh]$|.*(width|height|resolution|res[xy]$)|[a-z]*(size|shape|dims?|dimensions?)$")
_OTHER_SIZES = re.compile(
    r"board|square|tag|pattern|grid|target|chess|check|charuco|aruco|marker|cell|pixel|sensor|window"
)
_LENS = re.compile(
    r".*model|.*fisheye|.*omni|xi$|lens(type)?$|cam(era)?type$|projection(type)?$|distortiontype$"
)
# Something was done to the picture behind the lens.
_PART = re.compile(r"crop.*|binning.*|roi")
_SWITCH = re.compile(r"fisheye|omni|xi$")


def plain(name: Any) -> str:
    """Return a name in small letters and digits alone: "Camera_Matrix" is "cameramatrix"."""
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


@dataclass(frozen=True)
class Entry:
    """Hold one entry of a camera file.

    Attributes:
        path: its names from the outside in, as the file writes them: "cam0.resolution".
        name: the last of them, as `plain` writes it.
        value: what it holds.
        kind: DISTORTION, SIZE or LENS where its name looks like that, or None.
    """

    path: str
    name: str
    value: Any
    kind: str | None


class Entries:
    """Hold the entries of a camera file, nested ones too, and know which were taken."""

    def __init__(self, tree: Any, file: Path) -> None:
        self.file = file
        self.of_ros = False  # whether a matrix is written as ROS does, without the type of its numbers
        self.entries: list[Entry] = []
        self._by_name: dict[str, list[Entry]] = {}
        self._taken: set[int] = set()
        self._walk(tree, "", None)
        for entry in self.entries:
            self._by_name.setdefault(entry.name, []).append(entry)

    def _walk(self, tree: Any, path: str, kind: str | None) -> None:
        """List the entries of dictionaries, and of dictionaries in lists. Depth was checked before."""
        if isinstance(tree, list):
            for i, value in enumerate(tree):
                if isinstance(value, (dict, list)):
                    self._walk(value, f"{path}[{i}]", kind)
            return
        if not isinstance(tree, dict):
            return
        for key, value in tree.items():
            inner = f"{path}.{key}" if path else str(key)
            name = plain(key)
            own_kind = _kind(name, value) or kind
            if own_kind == LENS and _kind(name, value) is None and not isinstance(value, str | bool):
                own_kind = LENS if _SWITCH.search(plain(path)) else None  # "model" may hold the whole camera
            if isinstance(value, dict) and "data" in value and value.keys() <= MATRIX_KEYS:
                self.entries.append(Entry(inner, name, self._data(value, inner), own_kind))
                continue
            self.entries.append(Entry(inner, name, value, own_kind))
            self._walk(value, inner, own_kind)

    def _data(self, matrix: dict[str, Any], path: str) -> Any:
        """Return the numbers of a matrix as OpenCV writes it, or as ROS does, row by row."""
        data = matrix["data"]
        if {"rows", "cols"} <= matrix.keys():
            self.of_ros = self.of_ros or "dt" not in matrix
            rows, columns = matrix["rows"], matrix["cols"]
            whole = isinstance(rows, int) and isinstance(columns, int)
            count = len(data) if isinstance(data, list) else 1
            if not whole or rows * columns != count:
                raise InputError(f"{self.file}: {path}: {rows!r}×{columns!r} numbers, but {count} are there")
        return data

    def has(self, *names: str) -> bool:
        """Tell whether there is an entry with one of these names (as `plain` writes them)."""
        return any(name in self._by_name for name in names)

    def take_all(self, *names: str) -> list[Entry]:
        """Return the entries with one of these names that nobody has taken and that hold a value."""
        found = []
        for name in names:
            for entry in self._by_name.get(name, ()):
                empty = entry.value is None or isinstance(entry.value, dict)
                if id(entry) not in self._taken and not empty:
                    found.append(entry)
        self.mark(found)
        return found

    def take(self, *names: str) -> Entry | None:
        """Return the entry with one of these names, or None.

        Raises:
            InputError: There are several, and they differ.
        """
        found = self.take_all(*names)
        for other in found[1:]:
            if not _same(found[0].value, other.value):
                raise InputError(
                    f"{self.file}: {found[0].path} and {other.path} differ; keep those of the camera "
                    "that took the footage"
                )
        return found[0] if found else None

    def take_lens(self) -> list[Entry]:
        """Return the entries that look like the model of the lens."""
        found = []
        for entry in self.entries:
            if entry.kind == LENS and _says_something(entry) and id(entry) not in self._taken:
                found.append(entry)
        self.mark(found)
        return found

    def mark(self, entries: list[Entry]) -> None:
        """Count entries as taken."""
        self._taken.update(id(entry) for entry in entries)

    def below(self, path: str) -> list[Entry]:
        """Return the entries in the one with a path."""
        return [entry for entry in self.entries if entry.path.startswith(f"{path}.")]

    def refuse_parts(self) -> None:
        """Raise InputError where an entry says that the pictures are a part of what the lens saw, or binned.

        A "roi" of four numbers is passed over: programs save the one of cv2.getOptimalNewCameraMatrix, which
        is of the straightened picture.
        """
        for entry in self.entries:
            if not _PART.fullmatch(entry.name) or (entry.name == "roi" and not isinstance(entry.value, dict)):
                continue
            if entry.value not in (None, "", [], {}, 0, 1):
                raise InputError(
                    f"{self.file}: {entry.path}: the pictures are a part of what the lens saw, or smaller; "
                    "give the matrix of these pictures, and remove the entry"
                )

    def refuse_rest(self) -> None:
        """Raise InputError where an entry looks like distortion, size or lens, and was not taken.

        Distortion of zero is none and may stay.
        """
        for entry in self.entries:
            if entry.kind is None or id(entry) in self._taken or not _says_something(entry):
                continue
            if entry.kind == DISTORTION and _is_zero(entry.value):
                continue
            raise InputError(
                f"{self.file}: {entry.path} looks like the {entry.kind}, but is not read under this name or "
                "in this form; name it as OpenCV or ROS does (see README), or remove it"
            )


def _kind(name: str, value: Any) -> str | None:
    """Tell what an entry looks like by its name."""
    # K1, P2 and D1 of a stereo pair are matrices; K1 and P2 with many numbers are no coefficients.
    if isinstance(value, list) and len(value) in (3, 9, 12) and re.fullmatch(r"[kp]\d", name):
        return None
    if _LENS.match(name):
        is_distortion = _DISTORTION.match(name) and "model" not in name and "type" not in name
        return DISTORTION if is_distortion else LENS
    if _DISTORTION.match(name):
        return DISTORTION
    if _SIZE.match(name) and not _OTHER_SIZES.match(name):
        return SIZE
    return None


def _says_something(entry: Entry) -> bool:
    """Tell whether an entry holds a value of its own; those of a dictionary are entries themselves."""
    value = entry.value
    if isinstance(value, list) and any(isinstance(part, dict) for part in value):
        return False
    return value is not None and value != [] and value != "" and not isinstance(value, dict)


def _is_zero(value: Any) -> bool:
    try:
        return not np.any(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        return False


def _same(first: Any, second: Any) -> bool:
    """Tell whether two values are the same numbers, or the same words."""
    try:
        a, b = np.asarray(first, np.float64).ravel(), np.asarray(second, np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        return first == second
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=1e-9, atol=0))
