"""Find pictures of a folder by the names that annotation programs make of theirs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.places import as_path, composed

# Label Studio puts eight hexadecimal digits in front of a name. Roboflow puts a suffix of its own behind it.
LABEL_STUDIO = re.compile(r"[0-9a-f]{8}-(?P<name>.+)")
ROBOFLOW = re.compile(r"(?P<name>.+)_(?:jpe?g|png|bmp|tiff?|webp)\.rf\.[0-9A-Za-z]+(?:\.\w+)?", re.IGNORECASE)


class PicturesByName:
    """Look up the pictures of a folder.

    Args:
        names: the file names of the pictures, in order.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.by_name: dict[str, list[int]] = {}
        self.by_stem: dict[str, list[int]] = {}
        self.by_number: dict[int, list[int]] = {}
        for index, name in enumerate(names):
            name = composed(name)
            stem = Path(name).stem
            self.by_name.setdefault(name, []).append(index)
            self.by_stem.setdefault(stem, []).append(index)
            if stem.isdecimal():
                self.by_number.setdefault(int(stem), []).append(index)

    def find(self, name: str | int, where: str) -> int | None:
        """Return the index of the picture that a file of boxes calls `name`, or None.

        A number is that of a name: 12 is 000012.jpg, because programs drop the zeros of such names. Folders
        are passed over.

        Raises:
            InputError: Several pictures have that name but for their suffix, or that number.
        """
        found = self.by_number.get(name, []) if isinstance(name, int) else self._by_text(name)
        if len(found) > 1:
            raise InputError(f"{where}: {len(found)} pictures of the footage could be {name}; rename one")
        return found[0] if found else None

    def _by_text(self, name: str) -> list[int]:
        base = as_path(name).name
        for candidate in (base, unquote(base), _original(base), _original(unquote(base))):
            if candidate in self.by_name:
                return self.by_name[candidate]
            for stem in (candidate, PurePosixPath(candidate).stem):
                if stem in self.by_stem:
                    return self.by_stem[stem]
        return []


def _original(base: str) -> str:
    """Return the name that a picture had before Label Studio or Roboflow renamed it."""
    renamed = LABEL_STUDIO.fullmatch(base) or ROBOFLOW.fullmatch(base)
    return renamed["name"] if renamed else base
