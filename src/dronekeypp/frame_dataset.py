"""A BOP folder as a torch data set, whose items keep the contract of `dronekeypp.data`."""

from __future__ import annotations

import json
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
from dronekeypp.sixdronesyn.flight_file import read_own_flight
from dronekeypp.stored import StoredFrame

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
        objects: the same classes by their object numbers.
        keys: the keys that every item has.
        stored: what is known of each frame (`StoredFrame`).
        outside: the drones that were left out, because their box has its middle outside the picture.
        empty: the pictures that are known to hold no drone.
        unannotated: how many pictures scene_gt.json says nothing of.
        manifest: the manifest of 6DroneSyn; {} for any other folder.

    Raises:
        InputError: on opening, an argument is out of its range, there is no such split, or annotations are
            missing or malformed; on reading an image, it is missing or cut off.
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
        for name, value, least in (("size", size, 1), ("stride", stride, 1), ("seed", seed, 0)):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
                raise InputError(f"{name}={value!r}: a whole number, at least {least}")
        self.root, self.split, self.size, self.seed = Path(root), split, size, seed
        self.augment, self.degrade, self.epoch = augment, degrade, 0
        self.manifest = folders.read_manifest(self.root)
        flights = folders.find_flights(self.root, split, self.manifest)
        models = folders.read_models(self.root, self.manifest) or folders.unnamed_objects(self.root)
        self.objects, self.drones = models, tuple(models.values())
        self._numbers = list(models)
        self.stored: list[StoredFrame] = []
        self.outside: list[StoredFrame] = []
        self.empty: list[StoredFrame] = []
        self.unannotated = 0
        for order, (folder, wanted) in enumerate(flights.items()):
            frames = self._read_flight(folder, order, models, wanted)
            if wanted is not None:
                folders.check_listed(folder, wanted, {frame.number for frame in frames})
                frames = [frame for frame in frames if frame.number in wanted]
            self._sort_in(frames, stride)
        self._keep(drones)
        if not self.stored:
            raise InputError(f"{self.root}: no {split} frames")
        self.keys = self._common_keys()

    def _read_flight(
        self, folder: Path, order: int, models: dict[int, DroneClass], wanted: set[int] | None
    ) -> list[StoredFrame]:
        """Read the frames of a flight, which is number `order` of its split.

        Where the split has a list, `wanted` are the frames of the flight that it names.

        Raises:
            InputError: also where crops are stored, and only their own size is known.
        """
        images = folders.stored_images(folder)
        if self.manifest:
            annotations, about = read_own_flight(folder, models)
            folders.check_flight(folder, about, self.manifest)
            digests = {int(number): values[0] for number, values in about["digests"].items()}
            place = (about["scene"], int(folder.name), scenes.WIDTH, scenes.HEIGHT)
        else:
            annotations = bop.frames_of(folder, bop.read_entries(folder), models, strict=False)
            width, height = folders.frame_size(self.root, folder, images)
            digests = {}
            place = (order, order, width, height)
            crops = any(annotation.square is not None for annotation in annotations)
            if crops and not (self.root / folders.CAMERA).is_file():
                raise InputError(
                    f"{folder}: crops are stored, so {self.root / folders.CAMERA} must say "
                    "the width and height of the whole frames"
                )
        frames = []
        for annotation in annotations:
            image = images.get(annotation.number)
            if image is None and not self.manifest:
                raise InputError(f"{folder / 'rgb'}: no picture of frame {annotation.number}")
            image = image or bop.image_path(folder, annotation.number)
            frames.append(StoredFrame(annotation, folder, image, digests.get(annotation.number), *place))
        if not self.manifest:
            annotated = {annotation.number for annotation in annotations}
            for image in self._pictures_without_a_drone(folder, images, annotated, wanted):
                frames.append(StoredFrame(None, folder, image, None, *place))
        return frames

    def _sort_in(self, frames: Sequence[StoredFrame], stride: int) -> None:
        """Put the frames of a flight where they belong: `stored`, `outside` or `empty`."""
        inside = []
        for frame in frames:
            if frame.annotation is None:
                self.empty.append(frame)
            elif self.manifest or frame.middle_inside:
                inside.append(frame)
            else:
                self.outside.append(frame)
        self.stored += inside[::stride]

    def _pictures_without_a_drone(
        self, folder: Path, images: dict[int, Path], annotated: set[int], wanted: set[int] | None
    ) -> list[Path]:
        """Return the pictures of a flight of which scene_gt.json says that there is no drone.

        Those of which it says nothing are counted, unless the split has a list that does not name them.
        """
        rest = {number: path for number, path in images.items() if number not in annotated}
        if not rest:
            return []
        truths = {int(key): value for key, value in bop.read_json(folder / bop.SCENE_FILES[1]).items()}
        empty = []
        for number, path in rest.items():
            if isinstance(truths.get(number), list):
                empty.append(path)
            elif wanted is None or number in wanted:
                self.unannotated += 1
        return empty

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
        self.stored = [frame for frame in self.stored if frame.annotation.obj_id in wanted]

    def _common_keys(self) -> tuple[str, ...]:
        """Return the keys that every frame has.

        Raises:
            InputError: some frames have a key and others have not, which is a fault of the data. The message
                names the key and a frame.
        """
        keys = list(ALWAYS)
        for key in ON_DISK:
            field = "keypoints_2d" if key == "keypoints" else key
            lacking = [frame for frame in self.stored if getattr(frame.annotation, field) is None]
            if not lacking:
                keys.append(key)
            elif len(lacking) < len(self.stored):
                where = f"{lacking[0].folder / bop.SCENE_FILES[1]} frame {lacking[0].annotation.number}"
                raise InputError(f"{where}: no `{key}` ({ON_DISK[key]}), and other frames have it")
        if "R" not in keys or "t" not in keys:  # hubs relative to the drone's centre need that centre
            keys = [key for key in keys if key != "keypoints_3d"]
        return tuple(keys)

    @property
    def frames(self) -> list[bop.Frame]:
        """Return the annotation of every frame."""
        return [frame.annotation for frame in self.stored]

    @property
    def folders(self) -> list[Path]:
        """Return the flight folder of every frame."""
        return [frame.folder for frame in self.stored]

    @property
    def labels(self) -> list[int]:
        """Return the class index of every frame."""
        return [self._numbers.index(frame.annotation.obj_id) for frame in self.stored]

    @property
    def left_out(self) -> int:
        """Return how many drones were left out, because their box has its middle outside the picture."""
        return len(self.outside)

    @property
    def digest(self) -> str | None:
        """Return what tells these data from others: of the drones and the annotations, or 6DroneSyn's own."""
        if self.manifest:
            return self.manifest.get("digest")
        facts = [json.dumps([drone.to_dict() for drone in self.drones])]
        for frame in self.stored:
            facts.append(f"{frame.folder.name} {frame.annotation}")
        return files.digest("\n".join(facts).encode())

    def __len__(self) -> int:
        return len(self.stored)

    def set_epoch(self, epoch: int) -> None:
        """Choose this epoch's augmentation.

        An epoch always looks the same, so a resumed training sees what an uninterrupted one saw.
        """
        self.epoch = epoch

    def stored_image(self, index: int) -> np.ndarray:
        """Read the image on disk as uint8 RGB, see `StoredFrame.read`."""
        return self.stored[index].read()

    def _generator(self, index: int, purpose: int) -> np.random.Generator:
        """Return the random numbers of one item in this epoch; each `purpose` has its own."""
        return np.random.default_rng([self.seed, self.epoch, index, purpose])

    def square(self, index: int) -> np.ndarray:
        """Return the (x, y, side) that an item shows in this epoch, in full-frame pixels."""
        frame = self.stored[index]
        box, frame_size = frame.annotation.box, (frame.width, frame.height)
        if not self.augment:
            return clamp_square(square_around(box), *frame_size)
        rng = self._generator(index, 0)
        x, y, side = square_around(box, rng.uniform(*CROP_MARGIN))
        dx, dy = rng.uniform(-0.05, 0.05, 2) * side
        return clamp_square((x + dx, y + dy, side), *frame_size)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        index = range(len(self))[index]  # so that -1 draws the random numbers of the last item
        frame = self.stored[index].annotation
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

    def annotations(self) -> dict[str, Tensor]:
        """Return everything but the images, stacked.

        It is what an item holds, with the number of frames as the first dimension.
        """
        items = [self.annotation(i, self.square(i)) for i in range(len(self))]
        return {name: torch.stack([item[name] for item in items]) for name in items[0]}

    def annotation(self, index: int, square: np.ndarray) -> dict[str, Tensor]:
        """Return one item without its image, as seen in the crop `square` (x, y, side)."""
        place, frame = self.stored[index], self.stored[index].annotation
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
        item["scene"] = torch.tensor(place.scene)
        item["subsequence"] = torch.tensor(place.subsequence)
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

    @property
    def stored(self) -> list[StoredFrame]:
        """Return what is known of each frame that is handed out."""
        return [self.dataset.stored[i] for i in self._chosen]

    def annotations(self) -> dict[str, Tensor]:
        """Return everything but the images of the frames that are handed out, stacked."""
        chosen = torch.tensor(self._chosen)
        whole = self.dataset.annotations()
        return {**{name: value[chosen] for name, value in whole.items()}, "label": self._labels}

    def __len__(self) -> int:
        return len(self._chosen)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return {**self.dataset[self._chosen[index]], "label": self._labels[index]}
