"""A BOP folder as a torch data set, whose items keep the contract of `dronekeypp.data`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from dronekeypp import files
from dronekeypp.augment import degrade, recolour
from dronekeypp.camera import CROP_MARGIN, clamp_square, crop_image, square_around, to_crop
from dronekeypp.classes import DroneClass, names_of
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, folders, scenes

ALWAYS = ("image", "K", "square", "label", "scene", "subsequence", "frame")
# Where the others come from on disk, for the message that one is missing.
ON_DISK = {
    "keypoints": "keypoints_2d in scene_gt.json, or `keypoints` in models_info.json",
    "keypoints_3d": "keypoints_3d in scene_gt.json, or `keypoints` in models_info.json",
    "R": "cam_R_m2c in scene_gt.json",
    "t": "cam_t_m2c in scene_gt.json",
    "visible": "keypoints_visible in scene_gt.json",
}


class FrameDataset(Dataset):
    """This data set hands out the frames of one split, each cut to its drone.

    Items hold KEYS, as far as the folder has them.

    Args:
        root: a BOP folder, such as `python -m dronekeypp generate` makes, with crops or whole frames.
        split: the name of a folder or of a list SPLIT.txt in it. In 6DroneSyn it is "train", "val" or "test"
            (paper Sec. V-A: scenes 1, 2, 4, 5, 8, 10, 11, 12 / 3, 9, 13 / 6, 7).
        size: side S of the crop handed out, pixels.
        augment: draw each crop's margin (1.15 to 1.3), centre and colours anew. Without it the margin is 1.2,
            the box is in the middle, and the colours are as stored. The paper has no augmentation.
        seed: seed of the augmentation, which depends on (seed, epoch, index) alone; see `set_epoch`.
        stride: keep every stride-th stored frame of each flight.
        drones: names of the drones to keep; None for all. The class indices stay as they are.
        degrade: show half of the crops, drawn anew, as a small, compressed video shows them; see
            `augment.degrade`.

    Attributes:
        drones: the classes in the order of their indices, as models_info.json numbers them.
        keys: the keys that every item has.
        manifest: the manifest of 6DroneSyn; {} for any other folder.

    Raises:
        InputError: on opening, there is no such split, or annotations are missing or malformed; on reading an
            image, it is missing or cut off.
    """

    def __init__(
        self,
        root: str | Path,
        split: str,
        size: int = 96,
        augment: bool = False,
        seed: int = 0,
        stride: int = 1,
        drones: Sequence[str] | None = None,
        degrade: bool = False,
    ) -> None:
        self.root, self.split, self.size, self.seed = Path(root), split, size, seed
        self.augment, self.degrade, self.epoch = augment, degrade, 0
        self.manifest = folders.read_manifest(self.root)
        models = bop.read_models(self.root) or folders.unnamed_objects(self.root)
        chosen = folders.find_flights(self.root, split, self.manifest)
        self.frames: list[bop.Frame] = []
        self.folders: list[Path] = []
        self.images: list[Path] = []
        self.digests: list[str | None] = []
        self._places: list[tuple[int, int]] = []  # (scene, subsequence)
        self._sizes: dict[Path, tuple[int, int]] = {}
        for order, (folder, wanted) in enumerate(chosen.items()):
            self._add_flight(folder, wanted, order, models, stride)
        self._numbers = list(models)
        self.drones = tuple(models.values())
        self._keep(drones)
        if not self.frames:
            raise InputError(
                f"{self.root}: no {split} frames; its scenes are not in this data set, "
                "or generate has not finished"
            )
        self.keys = self._common_keys()

    def _add_flight(
        self,
        folder: Path,
        wanted: set[int] | None,
        order: int,
        models: dict[int, DroneClass],
        stride: int,
    ) -> None:
        """Add every stride-th frame of a flight, or of those of its frames whose numbers are `wanted`."""
        stored = folders.stored_images(folder)
        size = self._sizes[folder] = self._frame_size(folder, stored)
        frames, flight = bop.read_flight(folder, models, size)
        if wanted is not None:
            frames = [frame for frame in frames if frame.number in wanted]
        number = int(folder.name) if folder.name.isdigit() else order
        place = (int(flight.get("scene", number)), number)
        digests = flight.get("digests", {})
        for frame in frames[::stride]:
            self.frames.append(frame)
            self.folders.append(folder)
            self.images.append(stored.get(frame.number, bop.image_path(folder, frame.number)))
            self.digests.append(digests.get(str(frame.number), [None])[0])
            self._places.append(place)

    def _frame_size(self, folder: Path, stored: dict[int, Path]) -> tuple[int, int]:
        """Return the width and height of the whole frames of a flight, pixels.

        Raises:
            InputError: nothing says how large they are, and the flight has no image.
        """
        if self.manifest.get("name") == "6DroneSyn":
            return scenes.WIDTH, scenes.HEIGHT
        camera = self.root / "camera.json"
        entry = files.read_json(camera) if camera.is_file() else {}
        if isinstance(entry, dict) and entry.get("width") and entry.get("height"):
            return int(entry["width"]), int(entry["height"])
        if not stored:
            raise InputError(f"{folder / 'rgb'}: no image")
        height, width = folders.read_image(next(iter(stored.values()))).shape[:2]
        return width, height

    def _keep(self, names: Sequence[str] | None) -> None:
        """Leave out the frames of other drones than those named.

        Raises:
            InputError: a name is unknown; the known ones are listed.
        """
        if names is None:
            return
        known = names_of(self.drones)
        for name in names:
            if name not in known:
                raise InputError(f"drone {name!r}: choose from {', '.join(known)}")
        wanted = {self._numbers[known.index(name)] for name in names}
        kept = [i for i, frame in enumerate(self.frames) if frame.obj_id in wanted]
        self.frames = [self.frames[i] for i in kept]
        self.folders = [self.folders[i] for i in kept]
        self.images = [self.images[i] for i in kept]
        self.digests = [self.digests[i] for i in kept]
        self._places = [self._places[i] for i in kept]

    def _common_keys(self) -> tuple[str, ...]:
        """Return the keys that every frame has.

        Raises:
            InputError: some frames have a key and others have not, which is a fault of the data. The message
                names the key and a frame.
        """
        fields = {
            "keypoints": "keypoints_2d",
            "keypoints_3d": "keypoints_3d",
            "R": "R",
            "t": "t",
            "visible": "visible",
        }
        keys = list(ALWAYS)
        for key, field in fields.items():
            absent = [i for i, frame in enumerate(self.frames) if getattr(frame, field) is None]
            if not absent:
                keys.append(key)
            elif len(absent) < len(self.frames):
                i = absent[0]
                where = f"{self.folders[i] / bop.SCENE_FILES[1]} frame {self.frames[i].number}"
                raise InputError(f"{where}: no `{key}` ({ON_DISK[key]}), and other frames have it")
        if "R" not in keys or "t" not in keys:  # hubs relative to the drone's centre need that centre
            keys = [key for key in keys if key != "keypoints_3d"]
        return tuple(keys)

    def __len__(self) -> int:
        return len(self.frames)

    def set_epoch(self, epoch: int) -> None:
        """Choose this epoch's augmentation.

        An epoch always looks the same, so a resumed training sees what an uninterrupted one saw.
        """
        self.epoch = epoch

    def stored_image(self, index: int) -> np.ndarray:
        """Read the image on disk as uint8 RGB.

        Returns:
            (size, size, 3) for a stored crop, or (H, W, 3) for a whole frame.

        Raises:
            InputError: the image is missing or cut off, or a whole frame has another size than its data set
                says.
        """
        image = folders.read_image(self.images[index], self.digests[index])
        width, height = self._sizes[self.folders[index]]
        if self.frames[index].square is None and image.shape[:2] != (height, width):
            raise InputError(
                f"{self.images[index]}: {image.shape[1]}×{image.shape[0]} pixels, "
                f"its data set has {width}×{height}"
            )
        return image

    def _generator(self, index: int, purpose: int) -> np.random.Generator:
        """Return the random numbers of one item in this epoch; each `purpose` has its own."""
        return np.random.default_rng([self.seed, self.epoch, index, purpose])

    def square(self, index: int) -> np.ndarray:
        """Return the (x, y, side) that an item shows in this epoch, in full-frame pixels."""
        box, frame_size = self.frames[index].box, self._sizes[self.folders[index]]
        if not self.augment:
            return clamp_square(square_around(box), *frame_size)
        rng = self._generator(index, 0)
        x, y, side = square_around(box, rng.uniform(*CROP_MARGIN))
        dx, dy = rng.uniform(-0.05, 0.05, 2) * side
        return clamp_square((x + dx, y + dy, side), *frame_size)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        index = range(len(self))[index]  # so that -1 draws the random numbers of the last item
        frame = self.frames[index]
        image, square = self.stored_image(index), self.square(index)
        local = square
        if frame.square is not None:  # a stored crop: from full-frame pixels to its own
            corner = square[:2] - frame.square[:2]
            local = np.concatenate([corner, square[2:]]) * (image.shape[0] / frame.square[2])
        crop = crop_image(image, local, self.size)
        if self.augment:
            crop = recolour(crop, self._generator(index, 1))
        if self.degrade:
            rng = self._generator(index, 2)
            if rng.random() < 0.5:
                crop = degrade(crop, rng)
        pixels = torch.from_numpy(crop).permute(2, 0, 1).float() / 255
        return {"image": pixels, **self.annotation(index, square)}

    @property
    def labels(self) -> list[int]:
        """Return the class index of every frame."""
        return [self._numbers.index(frame.obj_id) for frame in self.frames]

    def annotations(self) -> dict[str, Tensor]:
        """Return everything but the images, stacked.

        It is what an item holds, with the number of frames as the first dimension.
        """
        items = [self.annotation(i, self.square(i)) for i in range(len(self))]
        return {name: torch.stack([item[name] for item in items]) for name in items[0]}

    def annotation(self, index: int, square: np.ndarray) -> dict[str, Tensor]:
        """Return one item without its image, as seen in the crop `square` (x, y, side)."""
        frame = self.frames[index]
        scene, subsequence = self._places[index]
        item = {"K": _floats(frame.K), "square": _floats(square)}
        if "keypoints" in self.keys:
            item["keypoints"] = _floats(to_crop(frame.keypoints_2d, square))
        item["label"] = torch.tensor(self._numbers.index(frame.obj_id))
        if "keypoints_3d" in self.keys:
            item["keypoints_3d"] = _floats(frame.keypoints_3d - frame.t)
        if "R" in self.keys:
            item["R"] = _floats(frame.R)
        if "t" in self.keys:
            item["t"] = _floats(frame.t)
        if "visible" in self.keys:
            item["visible"] = torch.tensor(frame.visible)
        item["scene"], item["subsequence"] = torch.tensor(scene), torch.tensor(subsequence)
        item["frame"] = torch.tensor(frame.number)
        return item


def _floats(values: np.ndarray) -> Tensor:
    return torch.tensor(values, dtype=torch.float32)


class Relabelled(Dataset):
    """This data set hands out only the drones that a network knows, with the network's class indices.

    Args:
        dataset: the data set with all its frames.
        indices: for each class of the data set the index that it gets, or None to leave it out.
        drones: the classes that the new indices mean.
    """

    def __init__(
        self, dataset: FrameDataset, indices: Sequence[int | None], drones: Sequence[DroneClass]
    ) -> None:
        self.dataset, self.drones, self.keys = dataset, tuple(drones), dataset.keys
        labels = dataset.labels
        self._chosen = [i for i, label in enumerate(labels) if indices[label] is not None]
        self._labels = torch.tensor([indices[labels[i]] for i in self._chosen])

    def __len__(self) -> int:
        return len(self._chosen)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return {**self.dataset[self._chosen[index]], "label": self._labels[index]}
