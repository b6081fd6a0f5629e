"""Proves a generated data set sound, or names each fault by file and frame."""

from collections import defaultdict
from pathlib import Path

import numpy as np
from tqdm import tqdm

from dronekeypp.camera import project
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn.dataset import read_image
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.generate import annotation_digest, totals


def validate(root, progress=False):
    """Check a data set: counts, digests, rotations, projections, boxes, splits.

    Args:
        root: folder made by `generate`.

    Returns:
        list of faults, one line each; empty when the data set is sound.

    Raises:
        InputError: there is no readable manifest at all.
    """
    root = Path(root)
    manifest = bop.read_json(root / "manifest.json")
    faults = []
    if not isinstance(manifest, dict) or not {"settings", "planned"} <= manifest.keys():
        raise InputError(
            f"{root / 'manifest.json'}: holds no settings and plan; generate this data set again"
        )
    found = {split: {p.name: p for p in bop.flight_folders(root, split)} for split in scenes.SPLITS}
    faults += _check_splits(root, found, manifest)
    images, environments = defaultdict(list), defaultdict(set)
    flights = [(split, name, folder) for split, group in found.items() for name, folder in group.items()]
    for split, name, folder in tqdm(flights, unit="flight", disable=None if progress else True):
        faults += _check_flight(folder, manifest, manifest["planned"].get(name), split, images, environments)
    for image, places in images.items():
        if len({split for split, _ in places}) > 1:
            faults.append(
                f"{places[0][1]}: the same image (digest {image}) is in two splits, also {places[1][1]}"
            )
    if len(manifest["settings"]["environment_digests"]) >= 6:
        for a, b in (("train", "val"), ("train", "test"), ("val", "test")):
            for environment in sorted(environments[a] & environments[b]):
                faults.append(f"{root}: environment {environment} is in two splits, {a} and {b}")
    faults += _check_totals(root, flights, manifest)
    for split, count in manifest.get("frames", {}).items():
        if count:
            try:
                listed = len(bop.read_json(root / f"coco_{split}.json")["images"])
                if listed != count:
                    faults.append(
                        f"{root / f'coco_{split}.json'}: lists {listed} images, the manifest {count}"
                    )
            except InputError as error:
                faults.append(str(error))
    return faults


def _check_totals(root, folders, manifest):
    """The manifest's own list, counts and digests are those of the flights on disk."""
    if "flights" not in manifest:
        return []  # not finished; said elsewhere
    flights = {}
    for split, name, folder in folders:
        try:
            flights[name] = {
                "split": split,
                "digests": dict(bop.read_json(folder / "flight.json")["digests"]),
            }
        except (InputError, KeyError, TypeError, ValueError):
            return []  # named with the flight
    wrong = [key for key, value in totals(manifest["planned"], flights).items() if manifest.get(key) != value]
    wrong += ["flights"] * (manifest["flights"] != flights)
    return [
        f"{root / 'manifest.json'}: its {key} is not what is on disk; run generate again to renew it"
        for key in wrong
    ]


def _check_splits(root, found, manifest):
    """Every planned flight is there once, in the split Table 2 gives it, and nothing else is."""
    faults, home = [], {f"{s.id:06d}": s.split for s in scenes.subsequences()}
    for name in manifest["planned"]:
        places = [split for split in scenes.SPLITS if name in found[split]]
        if not places:
            faults.append(
                f"{root / home.get(name, '?') / name}: this flight is missing; run generate again, it resumes"
            )
        elif len(places) > 1:
            faults.append(f"{root}: flight {name} is in two splits, {' and '.join(places)}")
        elif places != [home.get(name)]:
            faults.append(f"{root / places[0] / name}: belongs into {home.get(name)}")
    for group in found.values():
        faults += [
            f"{folder}: not in the manifest's plan"
            for name, folder in group.items()
            if name not in manifest["planned"]
        ]
    if (root / "manifest.json").exists() and "flights" not in manifest:
        faults.append(f"{root / 'manifest.json'}: generate has not finished; run it again, it resumes")
    return faults


def _check_flight(folder, manifest, planned, split, images, environments):
    files = [folder / name for name in bop.SCENE_FILES]
    try:
        entries = bop.read_entries(folder)
        flight = bop.read_json(folder / "flight.json")
        digests = dict(flight["digests"])
    except InputError as error:
        return [str(error)]
    except (KeyError, TypeError, ValueError):
        return [f"{folder / 'flight.json'}: no digests; generate this flight again"]
    faults = []
    stride = manifest["settings"]["stride"]
    if planned is not None and list(entries) != list(range(0, planned * stride, stride)):
        faults.append(f"{files[0]}: its frames are not the {planned} planned ones, every {stride}. from 0")
    recorded = manifest.get("flights", {}).get(folder.name, {}).get("digests", digests)
    if recorded != digests:
        faults.append(
            f"{folder / 'flight.json'}: its digests are not the manifest's; run generate again to renew the manifest"
        )
    environments[split].add(flight.get("environment"))
    for extra in sorted({p.name for p in (folder / "rgb").glob("*")} - {f"{n:06d}.jpg" for n in entries}):
        faults.append(f"{folder / 'rgb' / extra}: an image without an annotation")
    for n, entry in entries.items():
        if None in entry:
            faults.append(f"{files[entry.index(None)]} frame {n}: no annotation; generate this flight again")
            continue
        pair = digests.get(str(n), ["", ""])
        if annotation_digest(entry) != pair[1]:
            faults.append(
                f"{folder} frame {n}: the annotation is not the one that was generated (its digest differs)"
            )
        faults += _check_image(bop.image_path(folder, n), pair[0], manifest["settings"])
        images[pair[0]].append((split, bop.image_path(folder, n)))
        try:
            frame = bop.Frame.from_bop(n, *entry, files)
        except InputError as error:
            faults.append(str(error))
        else:
            faults += [f"{files[1]} frame {n}: {what}" for what in frame_faults(frame)]
    return faults


def _check_image(path, expected, settings):
    try:
        image = read_image(path, expected)
    except InputError as error:
        return [str(error)]
    size = settings["size"]
    shape = (size, size, 3) if size else (scenes.HEIGHT, scenes.WIDTH, 3)
    if image.shape != shape:
        return [f"{path}: {image.shape[1]}×{image.shape[0]} pixels instead of {shape[1]}×{shape[0]}"]
    return []


def frame_faults(frame):
    """What is geometrically wrong with one `bop.Frame`: a list of short sentences."""
    faults = []
    hubs = list(DRONES.values())[frame.obj_id - 1].hubs
    off = np.abs(frame.keypoints_3d - (hubs @ frame.R.T + frame.t)).max()
    if off > 1e-5:
        faults.append(f"keypoints_3d are {off:.2g} m from R · hubs + t")
    if (frame.keypoints_3d[:, 2] <= 0).any():
        faults.append("a keypoint lies behind the camera")
    else:
        off = np.abs(project(frame.keypoints_3d, frame.K) - frame.keypoints_2d).max()
        if off > 0.01:
            faults.append(f"keypoints_2d are {off:.2g} px from the projection of keypoints_3d")
    low, high = frame.box[:2], frame.box[:2] + frame.box[2:]
    if (low < 0).any() or (high > [scenes.WIDTH, scenes.HEIGHT]).any():
        faults.append("bbox_obj reaches outside the frame")
    if ((frame.keypoints_2d < low - 0.01) | (frame.keypoints_2d > high + 0.01)).any():
        faults.append("a keypoint lies outside bbox_obj")
    if frame.square is not None:
        corner = frame.square[:2]
        if (corner < -0.01).any() or (
            corner + frame.square[2] > np.array([scenes.WIDTH, scenes.HEIGHT]) + 0.01
        ).any():
            faults.append("the crop reaches outside the frame")
    return faults
