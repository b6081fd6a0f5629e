"""Read a camera_info of ROS: the file that camera_calibration writes, or what `topic echo` prints.

The fields are those of sensor_msgs/CameraInfo: `K`, `D`, `distortion_model`, `width`, `height`, and in the
file `camera_matrix`, `distortion_coefficients`, `image_width`, `image_height`. ROS 2 prints small letters.
The rectification and the projection of the rectified picture are not used. Pixel centres are counted from 0.
"""

from __future__ import annotations

from dataclasses import replace

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras import opencv
from dronekeypp.footage.cameras.keys import Entries
from dronekeypp.footage.cameras.readings import Reading, number

# What other programs do not write.
SIGNS = ("rectificationmatrix", "projectionmatrix", "p", "binningx", "binningy", "dorectify")
WANTED = (
    ("distortion_model", ("distortionmodel",)),
    ("D or distortion_coefficients", ("d", "distortioncoefficients")),
    ("width", ("width", "imagewidth")),
    ("height", ("height", "imageheight")),
)


def recognise(entries: Entries) -> bool:
    """Tell whether entries are those of a camera_info."""
    return entries.has(*SIGNS)


def read(entries: Entries) -> Reading:
    """Read a camera_info.

    Raises:
        InputError: A field is missing or not valid, or the camera sent a part of the picture, or pixels
            taken together.
    """
    file = entries.file
    for field, names in WANTED:
        if not entries.has(*names):
            raise InputError(f"{file}: a camera_info without {field}; was it written whole?")
    for entry in entries.take_all("binningx", "binningy"):
        if number(entry.value, f"{file}: {entry.path}") not in (0, 1):
            raise InputError(f"{file}: {entry.path} is {entry.value}; give the camera of the binned picture")
    for region in (entry for entry in entries.entries if entry.name == "roi"):
        parts = [part for part in entries.below(region.path) if part.name != "dorectify"]
        entries.mark(parts)
        whole = {e.name: e.value for e in entries.entries if e.path in ("width", "height")}
        for part in parts:
            # Nothing or the whole picture: drivers write either where none is cut off.
            if number(part.value, f"{file}: {part.path}") not in (0, whole.get(part.name, 0)):
                raise InputError(
                    f"{file}: {part.path} is {part.value}: the camera sent a part of the picture; "
                    "give the camera of that part"
                )
    return replace(opencv.read(entries), program="ROS camera_info")
