"""Read text of other programs safely: only whole, ordinary files of a sensible size."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import NamedTuple

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import number

LARGEST = 256 * 2**20  # bytes of one file: a million boxes have less
SHOWN = 60  # characters of a line that a message quotes


class NumberLine(NamedTuple):
    """Hold the numbers of a line, and where they stand."""

    where: str
    values: list[float]


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 with its byte order mark.

    Raises:
        InputError: It is no ordinary file, too large, or not text.
    """
    if not path.is_file():
        there = path.exists() or path.is_symlink()
        raise InputError(f"{path}: not an ordinary file" if there else f"{path}: boxes not found")
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: larger than {LARGEST // 2**20} MB; these are not boxes, or split the file")
    content = path.read_bytes()
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not text in UTF-8; save it so") from None
    if "\0" in text:
        raise InputError(f"{path}: not text, it holds zero bytes; is the file whole?")
    return text


def number_lines(path: Path, text: str, separator: str | None) -> list[NumberLine]:
    """Return the numbers of every line that is not empty.

    Args:
        path: the file, for messages.
        text: its text.
        separator: what stands between two numbers; None for any white space.

    Raises:
        InputError: A line holds anything but numbers.
    """
    lines = []
    for count, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        where = f"{path} line {count}"
        try:
            lines.append(NumberLine(where, [number(part) for part in line.split(separator)]))
        except ValueError:
            raise InputError(f"{where}: not numbers: {line.strip()[:SHOWN]!r}") from None
    return lines


def refuse_cut(path: Path, text: str, ends: bool = False) -> None:
    """Refuse a file whose end was cut off.

    A line break ends what is whole. A file without one at its end is refused where its program `ends` every
    file with one, or where its last number has fewer decimals than those of all other lines.

    Raises:
        InputError: The file seems cut.
    """
    lines = text.splitlines()
    if text.endswith(("\n", "\r")) or not lines:
        return
    # A header does not end in a number.
    compared = [_decimals(line) for line in lines[:-1] if line.strip()[-1:].isdigit()]
    if ends or (compared and _decimals(lines[-1]) < min(compared)):
        raise InputError(
            f"{path}: its last line {lines[-1][-SHOWN:]!r} has no end and looks cut off; "
            "if it is whole, add a line break"
        )


def _decimals(line: str) -> int:
    """Return the number of digits behind the last point of a line's last number."""
    last = line.replace(",", " ").split()[-1:] or [""]
    return len(last[0].partition(".")[2])
