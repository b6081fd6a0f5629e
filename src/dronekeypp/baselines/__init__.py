"""What DroneKey++ is measured against (Sec. V-B). Each is a `PoseNetwork`, so one loop trains and measures
it.

YOLOv8n-pose is no part of this: it is AGPL software and lives in `baselines.yolo`, which calls it only when
it is asked to. Which methods there are says `checkpoint.METHODS`.
"""

from dronekeypp.baselines.dronekey import DroneKey
from dronekeypp.baselines.dronepose import DronePose

__all__ = ["DroneKey", "DronePose"]
