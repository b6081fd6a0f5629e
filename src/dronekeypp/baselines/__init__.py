"""What DroneKey++ is measured against (Sec. V-B). Each is a `PoseNetwork`, so one loop trains it and one function measures it.

YOLOv8n-pose is no part of this: it is AGPL software and lives in `baselines.yolo`, which calls it only when asked to.
"""

from pathlib import Path

from dronekeypp.baselines.dronekey import DroneKey
from dronekeypp.baselines.dronepose import DronePose
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP, PoseNetwork
from dronekeypp.model.base import read_config

NETWORKS: dict[str, type[PoseNetwork]] = {
    network.method: network for network in (DroneKeyPP, DroneKey, DronePose)
}


def network_class(method: str) -> type[PoseNetwork]:
    """The class of a method's name. Raises InputError listing the known ones."""
    if method not in NETWORKS:
        raise InputError(f"unknown method {method!r}; known: {', '.join(NETWORKS)}")
    return NETWORKS[method]


def load_network(folder: str | Path) -> PoseNetwork:
    """A checkpoint of any of `NETWORKS`, in evaluation mode. Raises InputError as `PoseNetwork.from_pretrained` does."""
    return network_class(read_config(folder)[0]).from_pretrained(folder)


__all__ = ["NETWORKS", "DroneKey", "DronePose", "load_network", "network_class"]
