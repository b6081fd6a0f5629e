"""This module keeps the list of the finished frames of a flight that is being rendered: frames.jsonl.

A frame gets its line when all of its files are written. So a killed run loses no finished frame, and no torn
file is taken for one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronekeypp.files import digest
from dronekeypp.sixdronesyn import bop, depth

NAME = "frames.jsonl"


@dataclass(frozen=True)
class Finished:
    """This is what is known of a frame whose files are all written.

    Attributes:
        image: the digest of its picture.
        others: the digests of its depth image and masks, as `depth.paths` lists them.
        pixels: how many pixels of the image show the drone, and how many its whole silhouette has; None
            without masks.
    """

    image: str
    others: tuple[str, ...] = ()
    pixels: tuple[int, int] | None = None


def line(number: int, frame: Finished) -> str:
    """Return what the list says of a finished frame."""
    entry = [number, frame.image]
    if frame.others:
        entry += [frame.others, frame.pixels]
    return json.dumps(entry) + "\n"


def read(folder: Path, settings: dict[str, Any]) -> dict[int, Finished]:
    """Return the frames that a killed run had finished, by number.

    A frame whose line or one of whose files is torn is not among them, so it is rendered again.

    Args:
        folder: of the unfinished flight.
        settings: those of the data set.
    """
    done: dict[int, Finished] = {}
    log = folder / NAME
    if not log.exists():
        return done
    text = log.read_text()
    whole_lines = text[: text.rfind("\n") + 1]
    if whole_lines != text:
        log.write_text(whole_lines)
    for entry in whole_lines.splitlines():
        number, image, *more = json.loads(entry)
        others, pixels = more or ((), None)
        files = [bop.image_path(folder, number), *depth.paths(folder, number, settings)]
        if all(path.exists() for path in files):
            if [digest(path.read_bytes()) for path in files] == [image, *others]:
                done[number] = Finished(image, tuple(others), pixels)
    return done
