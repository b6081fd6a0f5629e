"""Find the frame of the footage that each picture of a file of boxes is. A frame is never guessed.

Names go before numbers. Whether numbers count from 0 or from 1 follows from the format, from the names, or
from the numbers together: a 0 among them, or the number of frames. Anything else is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes import yolo
from dronekeypp.footage.boxes.content import BoxFile, as_whole
from dronekeypp.footage.boxes.doubts import remark_on_first, remark_on_sampling
from dronekeypp.footage.boxes.numbering import first_number, is_ultralytics, own_numbers, video_name
from dronekeypp.footage.boxes.pictures_by_name import PicturesByName
from dronekeypp.footage.boxes.places import Place, as_path, choose_one

NUMBER = re.compile(r"[+-]?(?:0|[1-9]\d*)(?:\.\d*)?")  # 000012 is a name


@dataclass(frozen=True)
class Match:
    """Hold which frames the pictures of a file are.

    Attributes:
        frames: of each picture its frame, or None.
        first_number: from what the file counts, where its numbers were taken.
        remarks: what may be wrong with them.
    """

    frames: list[int | None]
    first_number: int | None = None
    remarks: list[str] = field(default_factory=list)


def match_pictures(
    file: BoxFile, names: Sequence[str], folder: str | Path, count_from: int | None = None
) -> Match:
    """Find the frame of each picture of a file.

    Args:
        file: its pictures.
        names: the frames of the footage, see `Footage.names`.
        folder: where they lie, see `Footage.folder`.
        count_from: 0 or 1, where the user says from what the numbers of the file count.

    Raises:
        InputError: It is not clear which frame a picture is, or the pictures lie elsewhere.
    """
    if not file.pictures:
        return Match([])
    place = Place(folder)
    numbers = _numbers(file)
    if not any(Path(name).suffix for name in names):  # the frames of a video are called by their numbers only
        if numbers is None:
            return _match_video_names(file, len(names), place, count_from)
        return _match_numbers(file, numbers, len(names), count_from)
    if numbers is not None and count_from is not None:
        return _match_numbers(file, numbers, len(names), count_from)
    pictures = PicturesByName(names)
    found = [pictures.find(picture.name, picture.where) for picture in file.pictures]
    if numbers is not None and None in found:
        wheres = [picture.where for picture in file.pictures]
        found = [pictures.find(number, where) for number, where in zip(numbers, wheres, strict=True)]
    if numbers is None:
        return Match(_in_their_place(file, found, names, place))
    if None in found:
        match = _match_numbers(file, numbers, len(names), None)
        clear = not pictures.by_number or None not in match.frames
    else:
        match = Match(found)
        # Numbers of MOT and of our table are positions, and may be the numbers of names as well.
        positions = [number - (file.first_number or 0) for number in numbers]
        possible = file.first_number is not None and 0 <= min(positions) and max(positions) < len(names)
        clear = not possible or positions == found
    if not clear:
        raise InputError(
            f"{file.path}: its numbers, from {min(numbers)} to {max(numbers)}, may be names or positions of "
            f"the {len(names)} frames, the first of which is {names[0]}; "
            "give file names, or say --count-from 0 or 1"
        )
    return match


def _numbers(file: BoxFile) -> list[int] | None:
    """Return the pictures' names as numbers, or None where they are names.

    Raises:
        InputError: A number is not whole.
    """
    if file.named:
        return None
    numbers = []
    for picture in file.pictures:
        if isinstance(picture.name, str) and not NUMBER.fullmatch(picture.name):
            return None
        numbers.append(as_whole(picture.name, "frame", picture.where))
    return numbers


def _match_numbers(file: BoxFile, numbers: Sequence[int], frames: int, count_from: int | None) -> Match:
    """Match numbers that are positions in the footage."""
    first = first_number(file.path, numbers, frames, file.first_number, count_from)
    positions = [number - first for number in numbers]
    remarks = remark_on_first(numbers, first, file.first_number) if count_from is None else []
    return Match([position if position < frames else None for position in positions], first, remarks)


def _match_video_names(file: BoxFile, frames: int, place: Place, count_from: int | None) -> Match:
    """Match names of pictures that were taken out of a video."""
    names = [str(picture.name) for picture in file.pictures]
    video = place.folder.name
    here = [place.may_hold(name) for name in names]
    if not any(here):
        raise _elsewhere(file, names[0], place)
    split = [video_name(name, video) for name, is_here in zip(names, here, strict=True) if is_here]
    found = own_numbers(split, video)
    if found is None:
        raise InputError(
            f"{file.path}: its first name is {names[0]}, the footage's 000000 of the video {video}; "
            f"{video}_000000, frame_000000 and 000000 are read"
        )
    own = [number for number in found if number is not None]
    format_says = None
    if file.format == yolo.FORMAT and 0 not in own and is_ultralytics(split, video):
        format_says = 1
    first = first_number(file.path, own, frames, format_says, count_from)
    queue = iter(found)
    matched: list[int | None] = []
    for is_here in here:
        number = next(queue) if is_here else None
        matched.append(None if number is None or number - first >= frames else number - first)
    frame_names = [f"{frame:06d}" for frame in range(frames)]
    remarks = remark_on_sampling(own, first, frames) if count_from is None else []
    return Match(_in_their_place(file, matched, frame_names, place), first, remarks)


def _in_their_place(
    file: BoxFile, found: Sequence[int | None], names: Sequence[str], place: Place
) -> list[int | None]:
    """Keep those matches whose pictures may lie where the footage lies, one name a frame.

    Raises:
        InputError: None may, or two names could be the same frame.
    """
    candidates: dict[int, dict[str, list[int]]] = {}  # of each frame: its pictures by name
    for index, frame in enumerate(found):
        name = str(file.pictures[index].name)
        if frame is not None and place.may_hold(name):
            same = as_path(name).as_posix()
            candidates.setdefault(frame, {}).setdefault(same, []).append(index)
    matched = [index for index, frame in enumerate(found) if frame is not None]
    if matched and not candidates:
        raise _elsewhere(file, str(file.pictures[matched[0]].name), place)
    frames: list[int | None] = [None] * len(found)
    for frame, pictures in candidates.items():
        for index in choose_one(file.path, pictures, place, names[frame]):
            frames[index] = frame
    return frames


def _elsewhere(file: BoxFile, name: str, place: Place) -> InputError:
    return InputError(
        f"{file.path}: its first name is {as_path(name)}, the footage lies in {place.folder}; "
        "if the pictures are the same, give their names without folders"
    )
