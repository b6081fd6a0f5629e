"""Compare what a JSON file of ours holds with what its kind of file must hold.

Each kind of file is described once, beside the code that reads it, as a class derived from `Schema`. A
damaged or hand-edited file is then one line that names the file, the key and the mend.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dronekeypp.errors import InputError
from dronekeypp.files import digest, read_json

CHECKSUM = "checksum"  # the key under which a file has that of all its other keys
LONGEST = 60  # characters of a value in a message

Count = Annotated[int, Field(ge=0)]
Length = Annotated[int, Field(ge=1)]
Name = Annotated[str, Field(min_length=1)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]  # of `files.digest`
FlightName = Annotated[str, Field(pattern=r"^[0-9]{6}$")]  # a flight's folder
FrameNumber = Annotated[str, Field(pattern=r"^[0-9]{1,6}$")]  # JSON's keys are text
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Words = dict[str, str]


class Schema(BaseModel):
    """This is the base of what files and their parts must hold.

    Nothing is converted: text that looks like a number is no number, true is not 1, and NaN is none either.
    A key that the class does not name is refused, because a renamed key would otherwise be a missing one.
    """

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, protected_namespaces=())


class Open(Schema):
    """This is the base of those that may hold further keys, of which nothing is read unchecked."""

    model_config = ConfigDict(extra="allow")


def read(
    kind: type[BaseModel], path: str | Path, mend: str = "", missing: str = "not found"
) -> dict[str, Any]:
    """Return the content of a JSON file of this kind.

    Args:
        kind: the description of the file.
        path: the file.
        mend: what the message tells the reader to do.
        missing: what the message says of a file that is missing.

    Raises:
        InputError: the file is missing, not JSON, or of another kind.
    """
    content = read_json(path, missing, mend)
    check(kind, content, path, mend)
    return content


def check(kind: type[BaseModel], content: Any, where: str | Path, mend: str = "") -> None:
    """Check what a file, or a part of it, holds.

    Args:
        kind: its description.
        content: what it holds, as JSON gives it.
        where: the beginning of a message: the file.
        mend: the end of a message.

    Raises:
        InputError: a key is missing, unknown, or its value of another kind. The message names the first.
    """
    try:
        kind.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{where}: {first_fault(error)}" + (f"; {mend}" if mend else "")) from None


def first_fault(error: ValidationError) -> str:
    """Return what is wrong at the first key that does not fit, in words."""
    fault = error.errors(include_url=False, include_context=False)[0]
    key = ".".join(str(part) for part in fault["loc"] if part != "[key]")
    if fault["type"] == "missing":
        return f"the field {key} is missing"
    if fault["type"] == "extra_forbidden":
        return f"the field {key} is unknown"
    value = repr(fault["input"])
    shown = value if len(value) <= LONGEST else f"{value[:LONGEST]}…"
    if fault["type"] == "model_type":
        return f"{key + ' ' if key else ''}is {shown}: an object of named fields is needed"
    message = fault["msg"].removeprefix("Input ").removeprefix("Value error, ")
    return f"{key} is {shown}: it {message}" if message.startswith("should") else f"{key}: {message}"


def checksum(content: Mapping[str, Any]) -> str:
    """Return the digest of what a file holds, apart from its checksum."""
    rest = {key: value for key, value in content.items() if key != CHECKSUM}
    return digest(json.dumps(rest, sort_keys=True).encode())


def with_checksum(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a JSON file with its checksum.

    It is for files of which a missing or changed value would be another value, not a fault.
    """
    return {**content, CHECKSUM: checksum(content)}


def check_checksum(content: Mapping[str, Any], where: str | Path, mend: str) -> None:
    """Check that nobody has changed a file. Files of earlier versions have no checksum.

    Raises:
        InputError: somebody has. The message begins with `where` and ends with `mend`.
    """
    if CHECKSUM in content and content[CHECKSUM] != checksum(content):
        raise InputError(f"{where}: was changed after it was written (its {CHECKSUM} differs); {mend}")
