"""This module reads the annotations of many frames key by key.

One check of a whole stack is cheaper than one check a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dronekeypp.errors import InputError


class Instances:
    """This class holds the entries of every drone in every frame of one flight.

    An entry is what one of the flight's files says of one drone in one frame. `part` is the file's number: 0
    is the camera's, 1 the truth's and 2 that of the boxes, as in `bop.SCENE_FILES`.

    Args:
        paths: the three files that the entries were read from, for the messages.
        rows: (frame number, camera, truth, info) of each drone in each frame.
    """

    def __init__(self, paths: Sequence[Path], rows: Sequence[tuple[int, dict, dict, dict]]) -> None:
        self.paths = paths
        self.numbers = [row[0] for row in rows]
        self.entries = [[row[part] for row in rows] for part in (1, 2, 3)]

    def where(self, part: int, index: int) -> str:
        """Return the file and the frame of an entry, for a message."""
        return f"{self.paths[part]} frame {self.numbers[index]}"

    def stack(self, part: int, key: str, shape: tuple[int, ...], truth: bool = False) -> np.ndarray:
        """Return the values of a key as float64 (F, *shape).

        Args:
            part: the number of the file.
            key: the key.
            shape: of one value.
            truth: whether the values are true or false (or 1 or 0), and no other numbers.

        Raises:
            InputError: one is missing, has another size, holds NaN, or no numbers. The message names file and
                frame.
        """
        size = int(np.prod(shape))
        entries = self.entries[part]
        kinds = (bool, int) if truth else (int, float)
        try:
            for entry in entries:
                if not holds_only(entry[key], kinds):
                    raise TypeError
            values = np.array([entry[key] for entry in entries], dtype=np.float64)
            values = values.reshape(len(entries), size)
            sound = bool(np.isfinite(values).all())
        except (KeyError, TypeError, ValueError):
            sound = False
        if not sound:  # one by one, to find the frame
            rows = []
            for i, entry in enumerate(entries):
                rows.append(one_value(entry, key, size, self.where(part, i), truth))
            values = np.stack(rows)
        return values.reshape(len(entries), *shape)

    def optional(self, part: int, key: str, shape: tuple[int, ...], truth: bool = False) -> np.ndarray | None:
        """Return what `stack` returns, or None where no entry has the key.

        Raises:
            InputError: as `stack` raises it, and also where one entry has the key and another lacks it.
        """
        for entry in self.entries[part]:
            if entry.get(key) is not None:
                return self.stack(part, key, shape, truth)
        return None

    def check(self, function: Callable, values: np.ndarray | None, part: int, key: str) -> None:
        """Check a whole stack; if that fails, find the frame and name it.

        `function(values, name)` raises InputError, beginning with `name`, if one of the values is bad.
        """
        if values is None:
            return
        try:
            function(values, key)
        except InputError:
            for i, value in enumerate(values):
                function(value, f"{self.where(part, i)}: {key}")
            raise

    def refuse(self, bad: np.ndarray, part: int, message: str, values: np.ndarray | None = None) -> None:
        """Raise InputError for the first frame that the mask `bad` (F,) marks.

        `message` may have places for the numbers that `values` (F, N) hold of that frame: "{:g} px".
        """
        if bad.any():
            index = int(bad.argmax())
            shown = [] if values is None else values[index]
            raise InputError(f"{self.where(part, index)}: {message.format(*shown)}")


def holds_only(value: Any, kinds: tuple[type, ...], depth: int = 4) -> bool:
    """Say whether a value of JSON is of these kinds, or a list of such values, up to a depth."""
    if isinstance(value, list):
        return depth > 0 and all(holds_only(part, kinds, depth - 1) for part in value)
    return type(value) in kinds


def one_value(entry: dict, key: str, size: int, where: str, truth: bool = False) -> np.ndarray:
    """Return the value of a key as `size` finite numbers, float64 (size,).

    With `truth` they are true or false, or 1 or 0.

    Raises:
        InputError: it is missing, no list of numbers, has another size, or holds NaN. The message begins with
            `where`.
    """
    if entry.get(key) is None:
        raise InputError(f"{where}: the field {key} is missing")
    if not holds_only(entry[key], (bool, int) if truth else (int, float)):
        wanted = "list of true and false" if truth else "list of numbers"
        raise InputError(f"{where}: {key} is not a {wanted}")
    try:
        values = np.array(entry[key], dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise InputError(f"{where}: {key} is not a list of numbers") from None
    if values.size != size:
        raise InputError(f"{where}: {key} holds {values.size} numbers instead of {size}")
    if not np.isfinite(values).all():
        raise InputError(f"{where}: {key} holds NaN or infinity")
    return values
