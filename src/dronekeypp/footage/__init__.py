"""Read your own pictures: a video, a folder or one image, and the camera's calibration.

The drone's boxes come from any detector, or from one box and a tracker.
"""

from dronekeypp.footage.boxes import Boxes, BoxReport, check_box, read_boxes
from dronekeypp.footage.camera import Calibration, read_camera, read_cameras
from dronekeypp.footage.pictures import IMAGES, VIDEOS, BopScene, Footage, open_footage, read_picture
from dronekeypp.footage.tracker import Tracker

__all__ = [
    "IMAGES",
    "VIDEOS",
    "BopScene",
    "BoxReport",
    "Boxes",
    "Calibration",
    "Footage",
    "Tracker",
    "check_box",
    "open_footage",
    "read_boxes",
    "read_camera",
    "read_cameras",
    "read_picture",
]
