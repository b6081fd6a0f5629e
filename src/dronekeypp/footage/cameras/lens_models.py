"""Know the names that programs give to lens models.

Two kinds are read. One is Brown's and Conrady's, in OpenCV's order k1, k2, p1, p2, k3 …; ROS calls it
plumb_bob, Kalibr radtan. The other is Kannala's and Brandt's for fisheye lenses, with k1 … k4; ROS and Kalibr
call it equidistant (cv2.fisheye, J. Kannala and S. Brandt, "A generic camera model and calibration method for
conventional, wide-angle, and fish-eye lenses", 2006). Omnidirectional models (Mei's xi, double sphere, field
of view) need OpenCV's contrib modules, and are refused.
"""

from __future__ import annotations

from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras.keys import LENS, Entries, Entry, plain

PINHOLE, NONE, BROWN, FISHEYE = "pinhole", "none", "brown", "fisheye"
NO_FISHEYE = "no fisheye"  # what a switch says that is off
NAMES = {
    "pinhole": PINHOLE,  # says nothing of the distortion
    "perspective": PINHOLE,
    "simplepinhole": NONE,
    "none": NONE,
    "nodistortion": NONE,
    "brown": BROWN,
    "brownconrady": BROWN,
    "plumbbob": BROWN,
    "radtan": BROWN,
    "radial": BROWN,
    "radialtangential": BROWN,
    "simpleradial": BROWN,
    "rational": BROWN,
    "rationalpolynomial": BROWN,
    "opencv": BROWN,
    "fullopencv": BROWN,
    "fisheye": FISHEYE,
    "opencvfisheye": FISHEYE,
    "equidistant": FISHEYE,
    "equi": FISHEYE,
    "kannalabrandt": FISHEYE,
    "kannalabrandt4": FISHEYE,
    "kb4": FISHEYE,
}
RATIONAL = ("rational", "rationalpolynomial", "fullopencv")  # whose k4, k5, k6 are of the denominator
SWITCHES = ("fisheyemodel", "fisheye", "isfisheye", "usefisheye")  # true or false, 1 or 0
OFFSETS = ("xi",)  # of the mirror of an omnidirectional camera


def lens_of(entry: Entry, file: object) -> str | None:
    """Return the lens model that an entry names, or None where it says nothing.

    Raises:
        InputError: It names another one.
    """
    value = entry.value
    if entry.name in OFFSETS:
        if value == 0 and not isinstance(value, bool):
            return None
        raise InputError(
            f"{file}: {entry.path}: an omnidirectional camera; undistort the footage with the program that "
            "calibrated it, and give the matrix of the result"
        )
    if entry.name in SWITCHES and not isinstance(value, str):
        if value in (0, 1) and isinstance(value, (bool, int, float)):
            return FISHEYE if value else NO_FISHEYE
        raise InputError(f"{file}: {entry.path} must be true or false, 1 or 0, not {value!r:.40}")
    lens = NAMES.get(plain(value)) if isinstance(value, str) else None
    if lens is None:
        raise InputError(
            f"{file}: {entry.path} {value!r:.40} is no lens model that is read here (pinhole, plumb_bob, "
            "radtan, rational_polynomial, equidistant …); undistort the footage first, or remove the entry "
            "if it is not of the lens"
        )
    return lens


def take_lens(entries: Entries) -> tuple[str, list[Entry]]:
    """Return the lens model that a file names, PINHOLE where it names none, and the entries that say so.

    Raises:
        InputError: An entry names a model that is not read, or two entries contradict each other.
    """
    found: dict[str, Entry] = {}
    taken = entries.take_lens()
    for entry in taken:
        lens = lens_of(entry, entries.file)
        if lens is not None:
            found[lens] = entry
    named = [lens for lens in found if lens not in (PINHOLE, NO_FISHEYE)]
    against = [*named[1:], *([NO_FISHEYE] if FISHEYE in named and NO_FISHEYE in found else [])]
    if against:
        first, second = found[named[0]], found[against[0]]
        raise InputError(
            f"{entries.file}: {first.path} {first.value!r:.40} contradicts "
            f"{second.path} {second.value!r:.40}; keep the right one"
        )
    return (named[0] if named else PINHOLE), taken


def check_not_empty(entries: Entries) -> None:
    """Raise InputError where a lens model has an entry but no value.

    Which one is meant, nobody knows, and coefficients mean nothing without it.
    """
    for entry in entries.entries:
        if entry.kind == LENS and entry.value in (None, "", []):
            raise InputError(f"{entries.file}: {entry.path} is empty; name the lens model, or remove it")


def is_rational(entries: list[Entry]) -> bool:
    """Tell whether a lens model is named whose k4, k5 and k6 stand in OpenCV's denominator."""
    values: list[Any] = [entry.value for entry in entries]
    return any(isinstance(value, str) and plain(value) in RATIONAL for value in values)
