"""Read a camchain of Kalibr (https://github.com/ethz-asl/kalibr/wiki/yaml-formats).

It holds cam0, cam1 …, each with `camera_model`, `intrinsics` [fu, fv, pu, pv], `distortion_model`,
`distortion_coeffs` and `resolution`. Pinhole cameras with radtan, equidistant or no distortion are read.
Pixel centres are counted from 0.
"""

from __future__ import annotations

import re
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras import lens_models, opencv
from dronekeypp.footage.cameras.keys import Entries, plain
from dronekeypp.footage.cameras.readings import Reading, matrix_of, numbers, take_size

WANTED = ("camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution")


def recognise(tree: Any) -> bool:
    """Tell whether a file holds cam0, cam1 … of Kalibr, and nothing that is no camera of it."""
    return isinstance(tree, dict) and any(re.fullmatch(r"cam\d+", str(key)) for key in tree)


def read(tree: dict[str, Any], entries: Entries) -> Reading:
    """Read the camera of a camchain.

    Raises:
        InputError: There are several, or its model is not read, or an entry is missing or not valid.
    """
    file = entries.file
    cameras = [key for key, value in tree.items() if isinstance(value, dict)]
    if len(cameras) != 1:
        raise InputError(
            f"{file}: holds {len(cameras)} cameras ({', '.join(map(str, cameras))}); "
            "write the one that took the footage into a file of its own"
        )
    [name] = cameras
    for field in WANTED:
        if tree[name].get(field) is None:
            raise InputError(f"{file}: {name} has no {field}; was it written whole?")
    model = tree[name]["camera_model"]
    if lens_models.NAMES.get(plain(model)) != lens_models.PINHOLE:
        raise InputError(f"{file}: {name}.camera_model {model!r:.40} is not read, only pinhole")
    found = entries.take("intrinsics")
    where = f"{file}: {name}.intrinsics"
    focal = numbers(found.value if found else None, where)
    if focal.shape != (4,):
        raise InputError(f"{where} needs 4 numbers, fu, fv, pu and pv")
    keys = {"K": f"{name}.intrinsics"}
    distortion, fisheye = opencv.take_distortion(entries, keys)
    if distortion is not None and len(distortion) != 4:
        raise InputError(f"{file}: {keys['distortion']} needs 4 numbers, not {len(distortion)}")
    size, keys["size"] = take_size(entries)
    return Reading("Kalibr", matrix_of(focal.tolist(), where), 0.0, distortion, fisheye, size, keys)
