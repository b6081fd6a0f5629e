"""Read your own pictures: a video, a folder or one image, and the camera's calibration.

The drone's boxes come from any detector, or from one box and a tracker.
"""

from dronekeypp.footage.boxes import Boxes, BoxReport, check_box, read_boxes
from dronekeypp.footage.cameras import Calibration, fit_to_frames, read_camera, read_cameras
from dronekeypp.footage.decoding import read_picture
from dronekeypp.footage.pictures import DEFAULT_RATE, IMAGES, VIDEOS, BopScene, Footage, open_footage
from dronekeypp.footage.tracker import Tracker
from dronekeypp.footage.videos import open_video, writable_rate

__all__ = [
    "DEFAULT_RATE",
    "IMAGES",
    "VIDEOS",
    "BopScene",
    "BoxReport",
    "Boxes",
    "Calibration",
    "Footage",
    "Tracker",
    "check_box",
    "fit_to_frames",
    "open_footage",
    "open_video",
    "read_boxes",
    "read_camera",
    "read_cameras",
    "read_picture",
    "writable_rate",
]
