"""6DroneSyn as a torch data set: one drone crop, its camera and its truth per item."""

from pathlib import Path

import cv2
import numpy as np
import torch

from dronekeypp import files
from dronekeypp.camera import CROP_MARGIN, clamp_square, crop_image, square_around, to_crop
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.own import VARIABLE
from dronekeypp.sixdronesyn.scenes import HEIGHT, SPLITS, WIDTH, subsequences

SMALLEST_SIDE = 20  # pixels, of `degrade`


def read_image(path, digest=None):
    """A JPEG as (H, W, 3) uint8 RGB.

    Raises:
        InputError: missing, truncated or not a JPEG, or another one than `digest` (of flight.json) tells; the message names the file.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: image missing; generate this flight again") from None
    # OpenCV fills what a truncated JPEG lacks with grey and says nothing; the end marker tells.
    whole = data[:2] == b"\xff\xd8" and data[-2:] == b"\xff\xd9"
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if whole else None
    if image is None:
        raise InputError(f"{path}: truncated or not a JPEG; delete its flight folder and run generate again")
    if digest and files.digest(data) != digest:
        raise InputError(
            f"{path}: not the image that was generated; delete its flight folder and run generate again"
        )
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def recolour(image, rng):
    """Another camera's picture of the same scene: exposure, gamma, white balance and saturation drawn from `rng`. (H, W, 3) uint8 to the same.

    There are only 14 training environments; without this a network learns their light along with the drones.
    """
    level = np.arange(256) / 255
    curves = np.exp(rng.uniform(-0.3, 0.3) + rng.uniform(-0.1, 0.1, 3))[:, None] * level ** np.exp(
        rng.uniform(-0.35, 0.35)
    )
    curves = (curves * 255).clip(0, 255).astype(np.uint8)
    image = cv2.LUT(image, np.ascontiguousarray(curves.T[None]))
    saturation = rng.uniform(0.5, 1.2)
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return cv2.addWeighted(image, saturation, grey, 1 - saturation, 0)


def degrade(image, rng):
    """The same crop as a small, compressed video shows it. (S, S, 3) uint8 to the same; every strength is drawn from `rng`.

    Rendered crops are sharp and free of noise. A real drone is often 20 to 80 pixels wide, and its camera sharpens the picture, adds noise and
    compresses it: all of that happens here at the small size, before the crop is enlarged again.
    """
    S = image.shape[0]
    side = int(round(np.exp(rng.uniform(np.log(min(SMALLEST_SIDE, S)), np.log(S)))))
    small = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA).astype(np.float32)
    small += rng.uniform(0, 1) * (small - cv2.GaussianBlur(small, (0, 0), 1))
    small += rng.normal(0, rng.uniform(0, 8), small.shape)
    quality = int(rng.integers(30, 91))
    data = cv2.imencode(
        ".jpg", small.clip(0, 255).round().astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality]
    )[1]
    return cv2.resize(cv2.imdecode(data, cv2.IMREAD_COLOR), (S, S), interpolation=cv2.INTER_LINEAR)


class SixDroneSyn(torch.utils.data.Dataset):
    """Frames of one split, cut to the drone.

    Args:
        root: folder made by `python -m dronekeypp generate`, crops or whole frames.
        split: "train", "val" or "test" (paper Sec. V-A: scenes 1, 2, 4, 5, 8, 10, 11, 12 / 3, 9, 13 / 6, 7).
        size: side S of the crop handed out, pixels.
        augment: draw each crop's margin (1.15 to 1.3), centre and colours anew; False: margin 1.2, centred, as stored. The paper has none.
        degrade: show half of the crops, drawn anew, as a small, compressed video shows them; see `degrade`.
        seed: of the augmentation, which depends on (seed, epoch, index) alone; see `set_epoch`.
        stride: keep every stride-th stored frame of each flight.
        drones: names of the drones to keep; None for all.

    An item is a dictionary of tensors:
        image (3, S, S) float32 RGB in [0, 1] · K (3, 3) of the full frame · square (3,): crop (x, y, side) in full-frame pixels ·
        keypoints (4, 2) in crop units, 0 to 1 across the crop · label (): drone index · keypoints_3d (4, 3) hubs minus the drone's centre, camera
        axes, metres · R (3, 3), t (3,) metres: camera←body · visible (4,) bool · scene, subsequence, frame (): where it comes from.

    Raises:
        InputError: no such split, missing or malformed annotations (on opening); missing or truncated image (on reading it).
    """

    def __init__(self, root, split, size=96, augment=False, seed=0, stride=1, drones=None, degrade=False):
        if split not in SPLITS:
            raise InputError(f"split {split!r}: choose {', '.join(SPLITS)}")
        self.root, self.split, self.size, self.augment, self.seed, self.epoch = (
            Path(root),
            split,
            size,
            augment,
            seed,
            0,
        )
        self.degrade = degrade
        self.manifest = bop.read_json(self.root / "manifest.json")
        if not isinstance(self.manifest, dict) or not isinstance(self.manifest.get("planned", {}), dict):
            raise InputError(f"{self.root / 'manifest.json'}: not a data set's manifest; run generate again")
        for name, digest in self.manifest.get("settings", {}).get("own_drones", {}).items():
            if name not in DRONES or DRONES[name].digest != digest:
                raise InputError(
                    f"{self.root} was made with another drone {name}: set {VARIABLE} to the folder it was made with"
                )
        for name in drones or ():
            if name not in DRONES:
                raise InputError(f"drone {name!r}: choose from {', '.join(DRONES)}")
        wanted = {DRONES[name].index + 1 for name in (drones or DRONES)}
        folders = bop.flight_folders(root, split)
        planned = [
            s
            for s in subsequences()
            if s.split == split and f"{s.id:06d}" in self.manifest.get("planned", {})
        ]
        if len(folders) < len(planned):
            raise InputError(
                f"{self.root}: {len(folders)} of {len(planned)} {split} flights are there; run generate again, it resumes"
            )
        self.frames, self.folders, self.digests = [], [], []
        for folder in folders:
            frames, flight = bop.read_flight(folder)
            kept = [f for f in frames[::stride] if f.obj_id in wanted]
            self.frames += kept
            self.folders += [folder] * len(kept)
            self.digests += [flight.get("digests", {}).get(str(f.number), [None])[0] for f in kept]
        if not self.frames:
            raise InputError(
                f"{self.root}: no {split} frames; its scenes are not in this data set, or generate has not finished"
            )

    def __len__(self):
        return len(self.frames)

    def set_epoch(self, epoch):
        """Choose this epoch's augmentation; an epoch always looks the same, so a resumed training sees what an uninterrupted one saw."""
        self.epoch = epoch

    def stored_image(self, index):
        """The image on disk: (size, size, 3) or (1080, 1920, 3) uint8 RGB."""
        return read_image(bop.image_path(self.folders[index], self.frames[index].number), self.digests[index])

    def _generator(self, index, purpose):
        return np.random.default_rng([self.seed, self.epoch, index, purpose])

    def square(self, index):
        """The (x, y, side) that item `index` shows in this epoch, full-frame pixels."""
        f = self.frames[index]
        if not self.augment:
            return clamp_square(square_around(f.box), WIDTH, HEIGHT)
        rng = self._generator(index, 0)
        x, y, side = square_around(f.box, rng.uniform(*CROP_MARGIN))
        dx, dy = rng.uniform(-0.05, 0.05, 2) * side
        return clamp_square((x + dx, y + dy, side), WIDTH, HEIGHT)

    def __getitem__(self, index):
        index = range(len(self))[index]  # -1 is the last, and draws what the last draws
        f = self.frames[index]
        image, square = self.stored_image(index), self.square(index)
        local = square
        if f.square is not None:  # a stored crop: from full-frame pixels to its own
            local = np.concatenate([square[:2] - f.square[:2], square[2:]]) * (image.shape[0] / f.square[2])
        crop = crop_image(image, local, self.size)
        if self.augment:
            crop = recolour(crop, self._generator(index, 1))
        if self.degrade and (rng := self._generator(index, 2)).random() < 0.5:
            crop = degrade(crop, rng)
        return {
            "image": torch.from_numpy(crop).permute(2, 0, 1).float() / 255,
            **self.annotation(index, square),
        }

    def annotations(self):
        """Everything but the images, stacked: what `__getitem__` gives, with the number of frames in front."""
        items = [self.annotation(i, self.square(i)) for i in range(len(self))]
        return {name: torch.stack([item[name] for item in items]) for name in items[0]}

    def annotation(self, index, square):
        """One item without its image, as seen in the crop `square` (x, y, side)."""
        f, number = self.frames[index], dict(dtype=torch.float32)
        return {
            "K": torch.tensor(f.K, **number),
            "square": torch.tensor(square, **number),
            "keypoints": torch.tensor(to_crop(f.keypoints_2d, square), **number),
            "label": torch.tensor(f.obj_id - 1),
            "keypoints_3d": torch.tensor(f.keypoints_3d - f.t, **number),
            "R": torch.tensor(f.R, **number),
            "t": torch.tensor(f.t, **number),
            "visible": torch.tensor(f.visible),
            "scene": torch.tensor(int(self.folders[index].name) // 100),
            "subsequence": torch.tensor(int(self.folders[index].name)),
            "frame": torch.tensor(f.number),
        }
