"""Check what a data set's manifest.json holds, before anything relies on it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.plan import MOST_DRONES, SPLITS

KINDS = ("crop", "full")  # of frames
# What the settings of older manifests lack.
OLDER: dict[str, Any] = {
    "edition": 1,
    "quadrotors": None,
    "depth": False,
    "masks": False,
    "own_drones": {},
}


def check_manifest(path: Path, manifest: dict[str, Any]) -> None:
    """Check the settings, the plan, and what is listed of the flights.

    Args:
        path: of manifest.json, for the messages.
        manifest: what it holds.

    Raises:
        InputError: the edition is unknown, or a field is missing or of another kind.
    """
    settings = manifest.get("settings")
    if not isinstance(settings, dict):
        raise _broken(path, "no settings")
    settings = {**OLDER, **settings}
    edition = settings["edition"]
    if type(edition) is not int or edition not in MOST_DRONES:
        known = " and ".join(str(number) for number in MOST_DRONES)
        raise InputError(f"{path}: edition {edition!r} is unknown; this version of dronekeypp knows {known}")
    for key, is_right in _SETTINGS.items():
        if not is_right(settings.get(key)):
            raise _broken(path, f"no {key}" if key not in settings else f"{key} {settings[key]!r}")
    if (settings["size"] is None) != (settings["frames"] == "full"):
        raise _broken(path, f"size {settings['size']!r} of {settings['frames']} frames")
    if not _is_table(manifest.get("planned"), _is_count):
        raise _broken(path, "no plan of flights and their numbers of frames")
    if not isinstance(manifest.get("versions", []), list):
        raise _broken(path, "versions that are no list")
    if not _is_table(manifest.get("frames", {}), _is_count):
        raise _broken(path, "frames that are no numbers")
    if not _is_table(manifest.get("flights", {}), _is_flight):
        raise _broken(path, "a flight without split and digests")


def _broken(path: Path, what: str) -> InputError:
    return InputError(
        f"{path}: not a data set's manifest: {what}; mend it, or generate the data set in another folder"
    )


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is_length(value: Any) -> bool:
    return type(value) is int and value >= 1


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_flag(value: Any) -> bool:
    return isinstance(value, bool)


def _is_table(value: Any, is_right: Callable[[Any], bool]) -> bool:
    return isinstance(value, dict) and all(is_right(entry) for entry in value.values())


def _is_table_of_texts(value: Any) -> bool:
    return _is_table(value, _is_text)


def _is_flight(value: Any) -> bool:
    """Tell whether this is what `manifest.totals` says of a flight."""
    if not isinstance(value, dict) or value.get("split") not in SPLITS:
        return False
    digests = value.get("digests")
    return isinstance(digests, dict) and all(number.isdecimal() for number in digests)


def _is_range(value: Any) -> bool:
    """Tell whether this is a range of random quadrotors, or None."""
    if value is None:
        return True
    return isinstance(value, list) and len(value) == 2 and all(map(_is_count, value)) and value[0] < value[1]


_SETTINGS: dict[str, Callable[[Any], bool]] = {
    "version": _is_text,
    "quadrotors": _is_range,
    "seed": _is_count,
    "frames": lambda value: value in KINDS,
    "size": lambda value: value is None or _is_length(value),
    "stride": _is_length,
    "depth": _is_flag,
    "masks": _is_flag,
    "environments": _is_text,
    "environment_digests": _is_table_of_texts,
    "own_drones": _is_table_of_texts,
}
