"""Tell from what a file of boxes counts the frames: from 0 or from 1."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.places import as_path, composed
from dronekeypp.footage.pictures import IMAGES

NOBODYS = ("", "frame", "frames", "image", "img", "im")  # names in front of a number that are no video's own


def first_number(
    path: Path, numbers: Collection[int], frames: int, format_says: int | None, user_says: int | None
) -> int:
    """Return the number of the first frame.

    Args:
        path: the file, for messages.
        numbers: all that it has.
        frames: how many frames the footage has.
        format_says: 0 or 1 where the format fixes it.
        user_says: 0 or 1 where the user does.

    Raises:
        InputError: It is not clear, or the numbers contradict what format or user say.
    """
    low, high = min(numbers), max(numbers)
    says = format_says if user_says is None else user_says
    run = f"its frame numbers run from {low} to {high}, the footage has {frames} frames"
    if low < (says or 0):
        raise InputError(f"{path}: frame {low}; the first is number {says or 0} (--count-from)")
    if user_says is not None:
        return user_says
    if format_says == 0 and low == 1 and high == frames:
        raise InputError(f"{path}: {run}; counting from 0 is usual here, so say --count-from 0 or 1")
    if format_says is not None:
        return format_says
    if low == 0:
        return 0
    if high == frames:
        return 1
    raise InputError(f"{path}: {run}, which may count from 0 or from 1; say --count-from 0 or 1")


class VideoName(NamedTuple):
    """Hold the name of a picture that was taken out of a video: walk_000012.png."""

    prefix: str  # in small letters: walk
    digits: str  # 000012


def video_name(name: str, video: str) -> VideoName | None:
    """Split the name of a picture of a video, or return None where it ends in no number.

    `video` is the name of the footage's video, without its suffix. It may hold digits itself.
    """
    base = as_path(name).name
    if PurePosixPath(base).suffix.lower() in IMAGES:
        base = PurePosixPath(base).stem
    base, video = base.lower(), composed(video).lower()
    own = re.fullmatch(r"[-_. ](?:frames?|images?|img)?[-_. ]?(\d+)", base.removeprefix(video))
    if base.startswith(video) and own:
        return VideoName(video, own[1])
    split = re.fullmatch(r"(.*?)[-_. ]*(\d+)", base)
    return VideoName(split[1], split[2]) if split else None


def own_numbers(names: Sequence[VideoName | None], video: str) -> list[int | None] | None:
    """Return the number of each picture that is of the footage's video, and None for the others.

    Pictures with the video's name are. Where none has it, those are that have no video's name, such as
    frame_000012. Return None where the names have no number or are another video's.
    """
    prefixes = {name.prefix for name in names if name}
    own = composed(video).lower()
    if own in prefixes:
        return [int(name.digits) if name and name.prefix == own else None for name in names]
    if None in names or len(prefixes) != 1 or not prefixes <= set(NOBODYS):
        return None
    return [int(name.digits) for name in names if name]


def is_ultralytics(names: Sequence[VideoName | None], video: str) -> bool:
    """Tell whether labels are called as Ultralytics calls those of a video: NAME_1, NAME_2 …, from 1."""
    prefix = composed(video).lower()
    own = [name.digits for name in names if name and name.prefix == prefix]
    return bool(own) and not any(digits.startswith("0") for digits in own)
