"""Define the frame contract: what a data set hands out.

A data set is a folder of frames; an item is one frame: one drone's crop, its camera and its truth.
`open_dataset` opens any BOP folder that keeps the contract. 6DroneSyn is one such folder, with more in its
manifest. Any other BOP folder will do:

    ROOT/SPLIT/FLIGHT/rgb/000000.jpg …       any names of splits and flights, any size, JPEG or PNG
                      scene_camera.json      cam_K
                      scene_gt.json          obj_id, cam_R_m2c, cam_t_m2c, and if you have them keypoints_2d,
                                             keypoints_3d, keypoints_visible
                      scene_gt_info.json     bbox_obj
    ROOT/models/models_info.json             for each object: name, and keypoints (its four hubs, body axes)
    ROOT/SPLIT.txt                           instead of a folder SPLIT: one flight folder of ROOT a line, or
                                             FLIGHT/NUMBER for a single frame

On disk, cam_t_m2c, keypoints_3d (both in camera axes) and the hubs of models_info.json are in millimetres, as
everywhere in BOP; keypoints_2d and bbox_obj (x, y, width, height) are in pixels of the whole frame. Keypoints
come in the order front-left, front-right, rear-right, rear-left, seen from above. Body axes are x forward,
y left, z up. A file ROOT/camera.json with width and height says how large the frames are where the pictures
do not. Stored crops need it; their square (x, y, side) is `crop` in scene_gt_info.json. Where
scene_camera.json has `cam_K_frame`, the camera matrix of the full frame, `cam_K` is that of the crop, and
keypoints_2d and bbox_obj are in pixels of the crop. They are handed out in pixels of the full frame all the
same.

A picture without a drone has an empty list in scene_gt.json. It is no item, and neither is a drone whose box
has its middle outside the picture; `convert` writes both for a detector.

Keypoints that are not annotated follow from the pose and the hubs; those may also stand in each annotation,
as keypoints_body. All frames of a flight lie in one folder, and what is measured over flights takes each
folder for one flight.

An item is a dictionary of tensors; KEYS says what each is. A data set of your own that is not a folder is a
torch `Dataset` whose items hold these keys. If it has an attribute `drones`, a network trained on it knows
their names.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor
from torch.utils.data import Dataset, Subset

from dronekeypp.classes import SYMMETRY, DroneClass
from dronekeypp.errors import InputError
from dronekeypp.frame_dataset import ON_DISK, FrameDataset

KEYS = {
    "image": "(3, S, S) float32 RGB in [0, 1]: the crop",
    "K": "(3, 3) camera matrix of the full frame, pixels",
    "square": "(3,) the crop's x, y, side in full-frame pixels",
    "keypoints": "(4, 2) crop units: 0 to 1 across the crop; front-left, front-right, rear-right, rear-left",
    "label": "() class index, in the order of `drones`",
    "keypoints_3d": "(4, 3) hubs minus the drone's centre, camera axes, metres",
    "R": "(3, 3) camera←body",
    "t": "(3,) the drone's centre in camera axes, metres",
    "visible": "(4,) bool: a hub is in the frame and the drone itself does not hide it",
    "scene": "() where the frame comes from: its scene",
    "subsequence": "() its flight",
    "frame": "() its number",
}
# What each purpose needs, beyond what a network's own losses read (`PoseNetwork.learns_from`).
EVALUATED = ("K", "square", "label", "R", "t", "scene", "subsequence", "frame")
MIRRORED = ("square", "keypoints", "keypoints_3d", "R", "t", "visible")


def open_dataset(
    path: str | Path,
    split: str,
    size: int = 96,
    augment: bool = False,
    seed: int = 0,
    stride: int = 1,
    drones: Sequence[str] | None = None,
    degrade: bool = False,
) -> FrameDataset:
    """Open one split of a data set on disk.

    The arguments are those of `FrameDataset`.

    Raises:
        InputError: there is no such folder or split, annotations are missing or malformed, or a drone is
            unknown.
    """
    return FrameDataset(path, split, size, augment, seed, stride, drones, degrade)


# --- what any data set can be asked -----------------------------------------------------------------------


def underlying(dataset: Dataset) -> Dataset:
    """Return the data set behind a `Subset`, or behind a `Subset` of one."""
    while isinstance(dataset, Subset):
        dataset = dataset.dataset
    return dataset


def drones_of(dataset: Dataset) -> tuple[DroneClass, ...] | None:
    """Return the classes of a data set, or None where it does not say what they are."""
    return getattr(underlying(dataset), "drones", None)


def keys_of(dataset: Dataset) -> tuple[str, ...]:
    """Return the keys that the items of a data set have."""
    whole = underlying(dataset)
    return tuple(whole.keys) if hasattr(whole, "keys") else tuple(dataset[0])


def require(dataset: Dataset, keys: Sequence[str], purpose: str) -> None:
    """Check that the items of a data set have the keys that a purpose needs.

    Raises:
        InputError: a key is missing. The message names it, the data set and the purpose.
    """
    present = keys_of(dataset)
    for key in keys:
        if key not in present:
            place = getattr(underlying(dataset), "root", "the data set")
            source = f" ({ON_DISK[key]})" if key in ON_DISK else ""
            raise InputError(f"{place}: no `{key}`{source}: {purpose} needs it")


def hubs_of(annotations: dict[str, Tensor], label: int) -> Tensor | None:
    """Return the hubs (4, 3) of a class in body axes, or None where it has no frame.

    They are the median over its frames.
    """
    chosen = annotations["label"] == label
    if not chosen.any():
        return None
    body = annotations["keypoints_3d"][chosen] @ annotations["R"][chosen]  # (F, 4, 3): rows are points
    return body.median(dim=0).values


def check_mirror(annotations: dict[str, Tensor], drones: Sequence[DroneClass] | None) -> None:
    """Check that every drone is its own mirror image: that its hubs are left–right symmetric.

    Args:
        annotations: label, R and keypoints_3d of training frames, stacked.
        drones: the classes, for the message; None: they are called by their number.

    Raises:
        InputError: the hubs of one drone miss it by more than a hundredth of the wheelbase.
    """
    for label in annotations["label"].unique().tolist():
        hubs = hubs_of(annotations, label)
        drone = DroneClass(drones[label].name if drones else f"class {label}", hubs.double().numpy())
        if drone.asymmetry > SYMMETRY * drone.wheelbase:
            raise InputError(
                f"mirror needs hubs that are left–right symmetric; those of {drone.name} are off by "
                f"{1000 * drone.asymmetry:.1f} mm"
            )


def read_annotations(dataset: Dataset) -> dict[str, Tensor]:
    """Return the annotations of a whole data set without its images, stacked.

    They are keypoints, K, square, label, R, t, scene and so on, with the number of frames as the first
    dimension. A data set with a method `annotations()` gives them at once; of any other, every item is read.
    """
    if isinstance(dataset, Subset) and hasattr(dataset.dataset, "annotations"):
        chosen = torch.as_tensor(dataset.indices)
        return {name: value[chosen] for name, value in dataset.dataset.annotations().items()}
    if hasattr(dataset, "annotations"):
        return dataset.annotations()
    items = []
    for i in range(len(dataset)):
        item = dict(dataset[i])
        item.pop("image", None)
        items.append(item)
    return {name: torch.stack([torch.as_tensor(item[name]) for item in items]) for name in items[0]}
