"""This module proves a data set of 6DroneSyn sound, or names each fault by file and frame."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dronekeypp.classes import DroneClass
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, depth_files, scenes, targets
from dronekeypp.sixdronesyn.coco_check import coco_faults
from dronekeypp.sixdronesyn.flight_file import CHANGED, frame_digest, read_flight_file
from dronekeypp.sixdronesyn.folders import (
    check_flight,
    edition_of,
    read_image,
    read_models,
    require_manifest,
    split_of,
)
from dronekeypp.sixdronesyn.frame_checks import frame_faults, needed_fields
from dronekeypp.sixdronesyn.manifest import totals
from dronekeypp.sixdronesyn.model_check import model_faults
from dronekeypp.sixdronesyn.models import FOLDERS as MODEL_FOLDERS


def validate(root: str | Path, progress: bool = False) -> list[str]:
    """Check a data set: counts, digests, rotations, projections, boxes, splits.

    No drone of one's own need be installed: names and hubs are those of models/models_info.json.

    Args:
        root: folder made by `generate`.
        progress: show a progress bar, where stderr is a terminal.

    Returns:
        list of faults, one line each; empty when the data set is sound.

    Raises:
        InputError: there is no readable manifest at all.
    """
    root = Path(root)
    manifest = require_manifest(root)
    check = _Validation(root, manifest)
    check.plan()
    for split, folder in tqdm(check.flights, unit="flight", disable=None if progress else True):
        check.flight(split, folder)
    check.splits()
    check.totals()
    check.bop_scripts()
    check.coco()
    check.meshes()
    return check.faults


class _Validation:
    """This class collects the faults of a data set, and what the next checks need.

    Each method adds to `faults`. `splits` comes after all flights.
    """

    def __init__(self, root: Path, manifest: dict[str, Any]) -> None:
        self.root, self.manifest = root, manifest
        self.faults: list[str] = []
        self.flights: list[tuple[str, Path]] = []  # (split, folder)
        for split in scenes.SPLITS:
            for folder in bop.flight_folders(root, split):
                self.flights.append((split, folder))
        self.images: dict[str, list[tuple[str, Path]]] = defaultdict(list)  # digest: [(split, file)]
        self.environments: dict[str, set[str]] = defaultdict(set)  # split: names
        self.digests: dict[str, dict] = {}  # flight: what its flight.json says
        self.models = self._read_models()

    def _read_models(self) -> dict[int, DroneClass]:
        """Return the drones by number, or {} if they cannot be read.

        A file that cannot be read is a fault. A missing one is a fault once generate has finished.
        """
        try:
            return read_models(self.root, self.manifest)
        except InputError as error:
            self.faults.append(str(error))
            return {}

    def plan(self) -> None:
        """Check that each planned flight is there once, and no other flight is.

        Each flight must lie in the split that Table 2 gives it. It is a fault, too, if generate has not
        finished.
        """
        places: dict[str, list[str]] = defaultdict(list)
        for split, folder in self.flights:
            places[folder.name].append(split)
        for name in self.manifest["planned"]:
            home, splits = split_of(name, edition_of(self.manifest)), places[name]
            if not splits:
                where = self.root / (home or "?") / name
                self.faults.append(f"{where}: this flight is missing; run generate again, it resumes")
            elif len(splits) > 1:
                self.faults.append(f"{self.root}: flight {name} is in two splits, {' and '.join(splits)}")
            elif splits != [home]:
                self.faults.append(f"{self.root / splits[0] / name}: belongs into {home}")
        for _, folder in self.flights:
            if folder.name not in self.manifest["planned"]:
                self.faults.append(f"{folder}: not in the manifest's plan")
        if "flights" not in self.manifest:
            path = self.root / "manifest.json"
            self.faults.append(f"{path}: generate has not finished; run it again, it resumes")

    def flight(self, split: str, folder: Path) -> None:
        """Check that the frames of a flight are those planned, and that each is sound."""
        try:
            entries = bop.read_entries(folder)
            about = read_flight_file(folder, self._files_of_a_frame)
            check_flight(folder, about, self.manifest)
        except InputError as error:
            self.faults.append(str(error))
            return
        digests = self.digests[folder.name] = about["digests"]
        self.environments[split].add(str(about.get("environment")))
        planned = self.manifest["planned"].get(folder.name)
        stride = self.manifest["settings"]["stride"]
        if planned is not None and list(entries) != list(range(0, planned * stride, stride)):
            path = folder / bop.SCENE_FILES[0]
            self.faults.append(
                f"{path}: its frames are not the {planned} planned ones, every {stride}. from 0"
            )
        recorded = self.manifest.get("flights", {}).get(folder.name, {}).get("digests", digests)
        if recorded != digests:
            self.faults.append(
                f"{folder / 'flight.json'}: its digests are not the manifest's; "
                "run generate again to renew the manifest"
            )
        self._strangers(folder, entries)
        for number, (camera, truths, infos) in entries.items():
            if self._has_annotation(folder, number, camera, truths, infos):
                nothing = [""] * (1 + self._files_of_a_frame)
                image, annotation, *others = digests.get(str(number), nothing)
                self._annotation(folder, number, (camera, truths[0], infos[0]), annotation)
                self._image(bop.image_path(folder, number), image)
                settings = self.manifest["settings"]
                self.faults += depth_files.faults(folder, number, infos[0], others, settings)
                self.images[image].append((split, bop.image_path(folder, number)))

    @property
    def _files_of_a_frame(self) -> int:
        """Return how many image files each frame has: its picture, and what else was asked for."""
        return 1 + len(depth_files.paths(self.root, 0, self.manifest["settings"]))

    def _strangers(self, folder: Path, numbers: Iterable[int]) -> None:
        """Check that no image of a flight belongs to a frame that is not there."""
        expected = set()
        for number in numbers:
            expected.add(bop.image_path(folder, number))
            expected.update(depth_files.paths(folder, number, self.manifest["settings"]))
        for name in ("rgb", *depth_files.FOLDERS):
            for path in sorted((folder / name).glob("*")):
                if path not in expected:
                    self.faults.append(f"{path}: an image without an annotation")

    def _has_annotation(
        self, folder: Path, number: int, camera: dict | None, truths: list[dict], infos: list[dict]
    ) -> bool:
        """Return whether each scene file says something of a frame, and of one drone only."""
        for name, objects in zip(bop.SCENE_FILES, ([camera], truths, infos), strict=True):
            if not objects or objects[0] is None:
                self.faults.append(
                    f"{folder / name} frame {number}: no annotation; generate this flight again"
                )
                return False
            if len(objects) > 1:
                self.faults.append(f"{folder / name} frame {number}: {len(objects)} objects instead of one")
                return False
        return True

    def _annotation(self, folder: Path, number: int, entry: tuple[dict, dict, dict], digest: str) -> None:
        """Check that a frame's annotation has all fields and its digest, and is geometrically sound.

        `entry` is the frame's (camera, truth, info).
        """
        if frame_digest(entry) != digest:
            self.faults.append(f"{folder} frame {number}: {CHANGED}")
        for name, part, keys in zip(bop.SCENE_FILES, entry, needed_fields(self.manifest), strict=True):
            for key in keys:
                if part.get(key) is None:
                    self.faults.append(f"{folder / name} frame {number}: the field {key} is missing")
                    return
        try:
            size = (scenes.WIDTH, scenes.HEIGHT)
            frame = bop.frames_from(folder, [(number, *entry)], self.models or None, size)[0]
        except InputError as error:
            self.faults.append(str(error))
            return
        hubs = self.models[frame.obj_id].hubs if self.models else None
        side, scale = self.manifest["settings"]["size"], entry[0]["cam_K"][0] / frame.K[0, 0]
        if scale != 1 and abs(scale * frame.square[2] - side) > 0.01:
            self.faults.append(
                f"{folder / bop.SCENE_FILES[0]} frame {number}: cam_K is that of a crop of "
                f"{scale * frame.square[2]:.2f} pixels, not {side}"
            )
        for fault in frame_faults(frame, hubs):
            self.faults.append(f"{folder / bop.SCENE_FILES[1]} frame {number}: {fault}")

    def _image(self, path: Path, digest: str) -> None:
        """Check that an image can be read, is the generated one, and has the size of the settings."""
        try:
            image = read_image(path, digest)
        except InputError as error:
            self.faults.append(str(error))
            return
        height, width = image.shape[:2]
        side = self.manifest["settings"]["size"]
        expected = (side, side) if side else (scenes.WIDTH, scenes.HEIGHT)
        if (width, height) != expected:
            self.faults.append(f"{path}: {width}×{height} pixels instead of {expected[0]}×{expected[1]}")

    def splits(self) -> None:
        """Check that no image and, where there are enough of them, no environment is in two splits."""
        for image, places in self.images.items():
            if len({split for split, _ in places}) > 1:
                self.faults.append(
                    f"{places[0][1]}: the same image (digest {image}) is in two splits, also {places[1][1]}"
                )
        if len(self.manifest["settings"]["environment_digests"]) < 6:
            return  # fewer are shared, see `scenes.split_environments`
        for a, b in (("train", "val"), ("train", "test"), ("val", "test")):
            for environment in sorted(self.environments[a] & self.environments[b]):
                self.faults.append(f"{self.root}: environment {environment} is in two splits, {a} and {b}")

    def totals(self) -> None:
        """Check that the manifest's own list, counts and digests are those of the flights on disk."""
        if "flights" not in self.manifest or len(self.digests) < len(self.flights):
            return  # not finished, or a flight is there twice or cannot be read: that is named elsewhere
        flights = {}
        for split, folder in self.flights:
            flights[folder.name] = {"split": split, "digests": self.digests[folder.name]}
        expected = {**totals(self.manifest["planned"], flights), "flights": flights}
        for key, value in expected.items():
            if self.manifest.get(key) != value:
                self.faults.append(
                    f"{self.root / 'manifest.json'}: its {key} is not what is on disk; "
                    "run generate again to renew it"
                )

    def bop_scripts(self) -> None:
        """Check that the second edition has what BOP's own scripts read."""
        if edition_of(self.manifest) == 1 or "flights" not in self.manifest:
            return
        mend = "run generate again, it writes what is missing"
        expected = targets.targets(self.manifest["flights"], edition_of(self.manifest))
        path = self.root / targets.NAME
        if not expected:
            return
        try:
            listed = bop.read_json(path) if path.is_file() else []
        except InputError as error:
            self.faults.append(f"{error}; {mend}")
            return
        if listed != expected:
            self.faults.append(f"{path}: does not list the test pictures; {mend}")

    def meshes(self) -> None:
        """Check that every mesh is there and whole, and that models_info.json has its sizes."""
        if self.models and "flights" in self.manifest:
            folders = MODEL_FOLDERS[:1] if edition_of(self.manifest) == 1 else MODEL_FOLDERS
            self.faults += model_faults(self.root, list(self.models), folders)

    def coco(self) -> None:
        """Check each COCO file against the annotations. Where those are at fault, nothing is compared."""
        if self.faults:
            return
        for split, count in self.manifest.get("frames", {}).items():
            if count:
                self.faults += coco_faults(self.root, split, self.manifest["settings"])
