"""This module keeps the list of the finished frames of a flight that is being rendered: frames.jsonl.

A frame gets its line when all of its files are written. So a killed run loses no finished frame, and no torn
file is taken for one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronekeypp.files import digest, write_beside
from dronekeypp.sixdronesyn import bop, depth_files

NAME = "frames.jsonl"
MOST_FRAMES = 1_000_000  # of a flight: a file's name has six digits for the number


@dataclass(frozen=True)
class Finished:
    """This is what is known of a frame whose files are all written.

    Attributes:
        image: the digest of its picture.
        others: the digests of its depth image and masks, as `depth_files.paths` lists them.
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
    content = log.read_bytes()
    whole_lines = content[: content.rfind(b"\n") + 1]
    if whole_lines != content:
        write_beside(log, whole_lines)
    for text in whole_lines.splitlines():
        entry = _entry(text, bool(settings.get("masks")))
        if entry is None:
            continue
        number, frame = entry
        files = [bop.image_path(folder, number), *depth_files.paths(folder, number, settings)]
        if all(path.exists() for path in files):
            if [digest(path.read_bytes()) for path in files] == [frame.image, *frame.others]:
                done[number] = frame
    return done


def _entry(line_read: bytes, masks: bool) -> tuple[int, Finished] | None:
    """Return the frame's number and what a line says of it, or None if the line is torn.

    `masks` says whether the data set has masks, whose pixels are counted.
    """
    try:
        number, image, *more = json.loads(line_read)
        others, pixels = more or ((), None)
        others = tuple(others)
        counts = None if pixels is None else tuple(pixels)
    except (ValueError, TypeError, RecursionError):
        return None
    if type(number) is not int or not 0 <= number < MOST_FRAMES:
        return None
    if (counts is not None) != masks or not all(isinstance(text, str) for text in (image, *others)):
        return None
    if counts is not None and [type(count) for count in counts] != [int, int]:
        return None
    return number, Finished(image, others, counts)
