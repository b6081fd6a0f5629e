"""Turn entries into numbers: what a camera file says, before it is made a camera.

Every reader of a format answers with a `Reading`, in the numbers of the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dronekeypp.camera import check_intrinsics
from dronekeypp.errors import InputError
from dronekeypp.footage.cameras.keys import Entries, Entry

FOCAL = ("fx", "fy", "cx", "cy")
RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
OPENCV_COUNTS = (4, 5, 8, 12, 14)  # as many coefficients does OpenCV's model have
FISHEYE_COUNT = 4
PIXELS = ("imagesize", "imgsize", "resolution", "imageresolution", "framesize", "size")
WIDTHS, HEIGHTS = ("imagewidth", "imgwidth", "width", "w"), ("imageheight", "imgheight", "height", "h")
MOST_PIXELS = 100_000  # of a side


@dataclass(frozen=True)
class Reading:
    """Hold what one camera file says.

    Attributes:
        program: whose format it is, for people.
        K: (3, 3) camera matrix, pixels, as the file counts them.
        first_centre: where the file counts the centre of the first pixel: 0 as OpenCV does, 0.5 as we do.
        distortion: coefficients in OpenCV's order, or None.
        fisheye: whether they are those of cv2.fisheye.
        size: (width, height), pixels, or None.
        keys: what each part was read from.
    """

    program: str
    K: np.ndarray
    first_centre: float
    distortion: np.ndarray | None = None
    fisheye: bool = False
    size: tuple[int, int] | None = None
    keys: dict[str, str] = field(default_factory=dict)

    def describe(self) -> str:
        """Return one line for people: every number that is used, and the entries it is from."""
        (fx, skew, cx), (_, fy, cy) = self.K[0], self.K[1]
        parts = [f"fx {fx:.6g}, fy {fy:.6g}, cx {cx:.6g}, cy {cy:.6g} from {self.keys['K']}"]
        if skew:
            parts[0] = f"skew {skew:.6g}, {parts[0]}"
        if self.size:
            parts.append(f"size {self.size[0]}x{self.size[1]} from {self.keys['size']}")
        else:
            parts.append("no size, so that of the frames")
        if self.distortion is None:
            parts.append("no distortion")
        else:
            numbers = ", ".join(f"{value:.6g}" for value in self.distortion)
            kind = "fisheye distortion" if self.fisheye else "distortion"
            parts.append(f"{kind} {numbers} from {self.keys['distortion']}")
        if "lens" in self.keys:
            parts.append(f"lens model from {self.keys['lens']}")
        return f"{self.program}: {'; '.join(parts)}"

    def same(self, other: Reading) -> bool:
        """Tell whether another reading says the same camera."""
        mine, theirs = self.distortion, other.distortion
        if (mine is None) != (theirs is None) or self.fisheye != other.fisheye or self.size != other.size:
            return False
        return np.array_equal(self.K, other.K) and (mine is None or np.array_equal(mine, theirs))


def numbers(value: Any, where: str) -> np.ndarray:
    """Return a list, or a list of lists, of numbers as an array; true, words and NaN are none.

    Raises:
        InputError: It is something else. The message begins with `where`.
    """
    flat = [value]
    while any(isinstance(part, list) for part in flat):
        opened: list[Any] = []
        for part in flat:
            opened.extend(part if isinstance(part, list) else [part])
        flat = opened
    for part in flat:
        if not isinstance(part, (int, float)) or isinstance(part, bool):
            raise InputError(f"{where} needs numbers, not {part!r:.40}")
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where} needs numbers in rows of one length ({error})") from None
    if not np.isfinite(array).all():
        raise InputError(f"{where} needs finite numbers")
    return array


def number(value: Any, where: str) -> float:
    """Return one number, or raise InputError with a message that begins with `where`."""
    array = numbers(value, where)
    if array.ndim:
        raise InputError(f"{where} needs one number")
    return float(array)


def intrinsics_matrix(value: Any, where: str) -> np.ndarray:
    """Return a camera matrix (3, 3), or raise InputError with a message that begins with `where`."""
    K = numbers(value, where)
    if K.shape not in ((3, 3), (9,), (1, 9), (9, 1)):
        raise InputError(f"{where} needs 3×3 numbers, not {'×'.join(map(str, K.shape)) or 'one'}")
    return check_intrinsics(K.reshape(3, 3), where)


def matrix_of(focal: Sequence[float], where: str) -> np.ndarray:
    """Return the camera matrix (3, 3) of fx, fy, cx and cy."""
    fx, fy, cx, cy = focal
    return check_intrinsics(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), where)


def side(entry: Entry, file: object) -> int:
    """Return a width or a height, or raise InputError unless it is a whole number of pixels."""
    value = number(entry.value, f"{file}: {entry.path}")
    if not value.is_integer() or not 1 <= value <= MOST_PIXELS:
        raise InputError(f"{file}: {entry.path} must be positive whole pixels, got {value:g}")
    return int(value)


def take_size(entries: Entries) -> tuple[tuple[int, int] | None, str]:
    """Return the (width, height) that a file names, or None, and the entries it is from.

    Raises:
        InputError: One side alone is there, one is no whole number, or two entries contradict each other.
    """
    file = entries.file
    sizes = []
    for entry in entries.take_all(*PIXELS):
        pair = numbers(entry.value, f"{file}: {entry.path}")
        if pair.shape not in ((2,), (1, 2), (2, 1)):
            raise InputError(f"{file}: {entry.path} must be [width, height], not {entry.value!r:.40}")
        width, height = pair.ravel().tolist()
        parts = Entry(entry.path, "", width, None), Entry(entry.path, "", height, None)
        sizes.append(((side(parts[0], file), side(parts[1], file)), entry.path))
    width, height = entries.take(*WIDTHS), entries.take(*HEIGHTS)
    if (width is None) != (height is None):
        present = width or height
        raise InputError(f"{file}: {present.path} is one side of the picture only; give both or none")
    if width is not None and height is not None:
        sizes.append(((side(width, file), side(height, file)), f"{width.path}, {height.path}"))
    for size, path in sizes[1:]:
        if size != sizes[0][0]:
            raise InputError(f"{file}: {sizes[0][1]} and {path} are different sizes; keep the right one")
    return sizes[0] if sizes else (None, "")


def take_named_coefficients(
    entries: Entries, fisheye: bool, denominator: bool
) -> tuple[np.ndarray | None, str]:
    """Return the distortion that is written as k1, k2, p1 …, in OpenCV's order, and the names.

    Args:
        entries: of the file.
        fisheye: whether they are those of cv2.fisheye.
        denominator: whether k4, k5 and k6 are known to stand in OpenCV's denominator. Other programs mean
            powers of the radius that OpenCV does not have.

    Raises:
        InputError: One is missing between others, or k4, k5 or k6 cannot be used.
    """
    file, given = entries.file, {}
    for name in (*RADIAL, "p1", "p2"):
        entry = entries.take(name)
        if entry is not None:
            given[name] = number(entry.value, f"{file}: {entry.path}")
    if not given:
        return None, ""
    if not fisheye and not any(given.values()):
        return np.zeros(OPENCV_COUNTS[0]), ", ".join(given)
    if fisheye:
        wanted = RADIAL[:FISHEYE_COUNT]
    else:
        wanted = ("k1", "k2", "p1", "p2") if "p1" in given or "p2" in given else ("k1", "k2")
        later = [name for name in RADIAL[3:] if given.get(name)]
        if later and not denominator:
            raise InputError(
                f"{file}: {later[0]} means one thing in OpenCV and another in other programs; "
                "name the model (rational_polynomial), or undistort the footage first"
            )
        if later:
            wanted = (*RADIAL, "p1", "p2")
    for name in wanted:
        if name not in given:
            raise InputError(f"{file}: {', '.join(given)} without {name}; give it, 0 if it is none")
    unused = [name for name, value in given.items() if fisheye and name not in wanted and value]
    if unused:
        raise InputError(f"{file}: {unused[0]} is no coefficient of a fisheye lens (k1 to k4)")
    order = wanted if fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    values = np.array([given.get(name, 0.0) for name in order])
    if not fisheye and not values[5:].any():
        values = values[: 5 if "k3" in given else 4]
    return values, ", ".join(given)


def check_coefficients(values: np.ndarray, fisheye: bool, where: str) -> None:
    """Raise InputError unless OpenCV has a model with as many coefficients."""
    if fisheye and len(values) != FISHEYE_COUNT:
        raise InputError(f"{where}: a fisheye lens has 4 coefficients, not {len(values)}")
    if not fisheye and len(values) not in OPENCV_COUNTS:
        raise InputError(f"{where}: distortion has {len(values)} numbers; OpenCV knows 4, 5, 8, 12 or 14")
