"""Read the camera that took some footage, as calibration programs and data sets write it: one file a format.

    opencv      OpenCV's calibration in YAML, XML and JSON, and plain JSON with a camera_matrix
    ros         camera_info, the file and what `topic echo` prints
    kalibr      camchain
    colmap      cameras.txt
    bop         scene_camera.json and camera.json
    nerf        transforms.json
`documents` turns text into values, `keys` watches that no entry is passed over, `plausible` knows what a lens
may be.
"""

from dronekeypp.footage.cameras.calibration import Calibration
from dronekeypp.footage.cameras.read import fit_to_frames, read_camera, read_cameras

__all__ = ["Calibration", "fit_to_frames", "read_camera", "read_cameras"]
