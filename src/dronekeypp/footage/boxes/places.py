"""Compare where a file of boxes says that a picture lies with where the footage lies."""

from __future__ import annotations

import os
import re
import unicodedata
from pathlib import Path, PurePosixPath

from dronekeypp.errors import InputError

# Folders that many data sets have. They do not tell one flight from another.
USUAL = re.compile(
    r"\.+|(?:train|valid|validation|val|test|images?|imgs?|img\d|rgb|color|frames?|data|dataset|datasets"
    r"|jpegimages|voc\d*|obj_\w+_data|upload|default)\d*",
    re.IGNORECASE,
)


def composed(name: str) -> str:
    """Return a name with each letter and its accents in one character, as most programs write it."""
    return unicodedata.normalize("NFC", name)


def as_path(name: str) -> PurePosixPath:
    """Return a name of a file of boxes as a path.

    Programs on Windows write backslashes. Those on a Mac write letters and accents apart. Label Studio writes
    /data/local-files/?d= in front of the path, and keeps what was uploaded in numbered folders of its own.
    """
    path = re.sub(r"^.*\?d=/?", "/", composed(name).strip().replace("\\", "/"))
    return PurePosixPath(re.sub(r"^(.*/)?upload/\d+/", "", path))


class Place:
    """Hold the folder of the footage, as it was given and with its links resolved.

    Args:
        folder: the folder.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(os.path.abspath(folder))
        self.resolved = Path(folder).resolve()

    def may_hold(self, name: str) -> bool:
        """Tell whether a picture with this name and folders may lie here.

        Usual folders such as images/ tell nothing. Of the others, all of a relative path must be those of the
        footage, from the last one on. Of an absolute path only the last must, because it may be that of
        another machine.
        """
        parent = as_path(name).parent
        theirs = _telling(parent)
        absolute = parent.is_absolute() or bool(re.match(r"[A-Za-z]:", str(parent)))
        if absolute or ".." in parent.parts:
            theirs = theirs[-1:]
        for folder in (self.folder, self.resolved):
            ours = _telling(folder)
            if len(theirs) <= len(ours) and ours[len(ours) - len(theirs) :] == theirs:
                return True
        return False

    def is_of(self, name: str) -> bool:
        """Tell whether the path of a picture is the end of the footage's, or all of it."""
        parent = as_path(name).parent.as_posix().lstrip("/")
        return any(f"/{folder.as_posix()}".endswith(f"/{parent}") for folder in (self.folder, self.resolved))


def _telling(folder: PurePosixPath | Path) -> list[str]:
    """Return the parts of a path that tell one flight from another."""
    parts = [part for part in folder.parts if part != folder.anchor and not re.match(r"[A-Za-z]:", part)]
    return [composed(part) for part in parts if not USUAL.fullmatch(part)]


def choose_one(path: Path, candidates: dict[str, list[int]], place: Place, frame: str) -> list[int]:
    """Return the pictures of a file that are a frame, from all that have its name.

    Args:
        path: the file, for messages.
        candidates: the indices of pictures by name.
        place: where the footage lies.
        frame: the name of the frame.

    Raises:
        InputError: Several could be.
    """
    chosen = list(candidates)
    if len(chosen) > 1:
        chosen = [name for name in candidates if place.is_of(name)]
    if len(chosen) != 1:
        listed = ", ".join(list(candidates)[:3])
        raise InputError(
            f"{path}: {len(candidates)} pictures could be {frame} of {place.folder}: {listed}; "
            "give their names with the folders"
        )
    return candidates[chosen[0]]
