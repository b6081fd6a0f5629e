"""Somebody else's BOP folder, made from the whole frames of 6DroneSyn in data_samples."""

import json
import shutil
from pathlib import Path

import cv2

SAMPLES = Path(__file__).parents[1] / "data_samples"
SIZE = (1280, 720)


def make_plain_folder(root):
    """The 21 whole frames without the manifest: 1280×720, PNG, flights of other names, three splits."""
    shutil.copytree(SAMPLES / "frames" / "models", root / "models")
    scale = SIZE[0] / 1920
    for i, flight in enumerate(sorted((SAMPLES / "frames" / "test").iterdir())):
        split = ("train", "val", "test")[i % 3]
        folder = root / split / f"flight_{i}"
        (folder / "rgb").mkdir(parents=True)
        for picture in (flight / "rgb").iterdir():
            image = cv2.resize(cv2.imread(str(picture)), SIZE, interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(folder / "rgb" / f"{picture.stem}.png"), image)
        for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
            table = json.loads((flight / name).read_text())
            for entry in table.values():
                shrink(entry if name == "scene_camera.json" else entry[0], scale)
            (folder / name).write_text(json.dumps(table))
    return root


def shrink(entry, scale):
    """Pixels of a smaller picture. Pixel centres are at +0.5, so every coordinate just shrinks."""
    for key in ("keypoints_2d", "bbox_obj", "bbox_visib"):
        if key in entry:
            entry[key] = [scale * value for value in entry[key]]
    if "cam_K" in entry:
        entry["cam_K"] = [scale * value for value in entry["cam_K"][:6]] + entry["cam_K"][6:]
