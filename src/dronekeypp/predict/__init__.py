"""Find the poses of a drone in your own footage: `python -m dronekeypp predict`.

OUT holds
    frames.csv      the journal, a row a frame, written as it goes; a killed run goes on after its last row
    poses.csv       the poses in BOP's results format (scene_id, im_id, obj_id, score, R, t, time; millimetres
                    there and only there). Of a scene of a BOP data set (pictures with numbers for names, in a
                    folder beside scene_camera.json) they have its own numbers of scene and images, and of the
                    drones that its models_info.json names. Of other footage scene_id is 0, im_id counts the
                    frames from 0, whatever their files are called, and obj_id is the network's class index
                    plus 1. Drones that models_info.json does not name have numbers behind its last
    overlay.mp4     box, propellers, body axes, the drone's name and its distance, drawn on the footage (of
                    one image: overlay.png)
    trajectory.png  the path in space
    settings.json   what the run was begun with; it goes on only with the same
With `smooth`, poses.csv, overlay and trajectory hold the smoothed poses. The journal always holds the poses
of the single frames. At the end a line says how many frames have a pose, and what became of every box that
was given (`footage.BoxReport`).
"""

from dronekeypp.predict.batches import mirror_doubt
from dronekeypp.predict.journal import (
    COLUMNS,
    GOOD,
    JOURNAL,
    PICTURE,
    POSES,
    SETTINGS,
    TRAJECTORY,
    VIDEO,
    Pose,
    bop_results,
    read_journal,
    to_pose,
)
from dronekeypp.predict.overlay import draw_overlay, draw_trajectory, write_overlay
from dronekeypp.predict.run import predict, smoothed

__all__ = [
    "COLUMNS",
    "GOOD",
    "JOURNAL",
    "PICTURE",
    "POSES",
    "SETTINGS",
    "TRAJECTORY",
    "VIDEO",
    "Pose",
    "bop_results",
    "draw_overlay",
    "draw_trajectory",
    "mirror_doubt",
    "predict",
    "read_journal",
    "smoothed",
    "to_pose",
    "write_overlay",
]
