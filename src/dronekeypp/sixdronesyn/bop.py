"""The on-disk format: BOP's folders and field names, plus the four keypoints; a COCO-keypoints export beside it.

    ROOT/manifest.json                      settings, versions, environments, a digest a frame
    ROOT/coco_train.json, …                 COCO-keypoints, in pixels of the stored images
    ROOT/models/models_info.json, obj_000001.ply, …
    ROOT/train/000400/rgb/000000.jpg, …     one folder a flight: scene × 100 + drone × 10 + background
                      scene_camera.json     cam_K, cam_R_w2c, cam_t_w2c
                      scene_gt.json         obj_id, cam_R_m2c, cam_t_m2c, keypoints_2d, keypoints_3d, keypoints_visible
                      scene_gt_info.json    bbox_obj, bbox_visib, visib_fract, crop
                      flight.json           scene, drone, take, environment, turn, seed, fps

Millimetres here and only here. All pixels in the three scene files are full-frame pixels, whether whole frames or crops are stored: a crop never
changes an annotation. `crop` is the square (x, y, side) that a stored crop shows, null for whole frames. A mesh in models/ has no propellers, as it
is what stands still; bbox_obj holds the discs they sweep, so it is larger than the mesh's own.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

from dronekeypp import files
from dronekeypp.camera import check_intrinsics
from dronekeypp.errors import InputError
from dronekeypp.rotations import check_rotation
from dronekeypp.sixdronesyn.drones import DRONES, KEYPOINT_NAMES
from dronekeypp.sixdronesyn.scenes import HEIGHT, WIDTH

SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json")
SKELETON = [[1, 2], [2, 3], [3, 4], [4, 1]]
MM = 1000.0


@dataclass(frozen=True)
class Frame:
    """One frame's annotation. Metres and full-frame pixels.

    K (3, 3) · camera_R (3, 3), camera_t (3,): camera←world · R (3, 3), t (3,): camera←body · keypoints_2d (4, 2) · keypoints_3d (4, 3) in camera
    axes · visible (4,) bool, in the frame and not hidden by the drone itself · box (x, y, w, h) · square (x, y, side) or None · obj_id 1 to 7, and on
    for drones of your own.
    """

    number: int
    K: np.ndarray
    camera_R: np.ndarray
    camera_t: np.ndarray
    obj_id: int
    R: np.ndarray
    t: np.ndarray
    keypoints_2d: np.ndarray
    keypoints_3d: np.ndarray
    visible: np.ndarray
    box: np.ndarray
    square: np.ndarray | None

    def to_bop(self):
        """The frame's entries in the three scene files."""
        box = _numbers(self.box, 3)
        camera = {
            "cam_K": _numbers(self.K),
            "cam_R_w2c": _numbers(self.camera_R, 9),
            "cam_t_w2c": _numbers(self.camera_t * MM),
            "depth_scale": 1.0,
        }
        truth = {
            "obj_id": self.obj_id,
            "cam_R_m2c": _numbers(self.R, 9),
            "cam_t_m2c": _numbers(self.t * MM),
            "keypoints_2d": _numbers(self.keypoints_2d),
            "keypoints_3d": _numbers(self.keypoints_3d * MM),
            "keypoints_visible": [bool(v) for v in self.visible],
        }
        info = {
            "bbox_obj": box,
            "bbox_visib": box,
            "visib_fract": 1.0,
            "crop": None if self.square is None else _numbers(self.square),
        }
        return camera, truth, info

    @classmethod
    def from_bop(cls, number, camera, truth, info, where):
        """Read one frame's three entries. `where` names file and frame in an error.

        Raises:
            InputError: a missing field, a wrong shape, NaN, a matrix that is no rotation, a drone behind the camera, a box or crop without
                area, a box whose middle lies outside the crop or the frame.
        """
        gt = f"{where[1]} frame {number}"
        K = _array(camera, "cam_K", 9, f"{where[0]} frame {number}").reshape(3, 3)
        check_intrinsics(K, f"{where[0]} frame {number}: cam_K")
        camera_R = _array(camera, "cam_R_w2c", 9, f"{where[0]} frame {number}").reshape(3, 3)
        check_rotation(camera_R, f"{where[0]} frame {number}: cam_R_w2c")
        R = _array(truth, "cam_R_m2c", 9, gt).reshape(3, 3)
        check_rotation(R, f"{gt}: cam_R_m2c")
        t = _array(truth, "cam_t_m2c", 3, gt) / MM
        if t[2] <= 0:
            raise InputError(f"{gt}: cam_t_m2c puts the drone behind the camera")
        seen = f"{where[2]} frame {number}"
        box = _array(info, "bbox_obj", 4, seen)
        if (box[2:] <= 0).any():
            raise InputError(f"{seen}: bbox_obj has no area ({box[2]:g} × {box[3]:g} px)")
        square = None if info.get("crop") is None else _array(info, "crop", 3, seen)
        left, top, wide, high = (0, 0, WIDTH, HEIGHT) if square is None else square[[0, 1, 2, 2]]
        middle = box[:2] + box[2:] / 2
        if wide <= 0:
            raise InputError(f"{seen}: crop has no area (side {wide:g} px)")
        if not (left <= middle[0] <= left + wide and top <= middle[1] <= top + high):
            raise InputError(
                f"{seen}: the middle of bbox_obj lies outside the {'frame' if square is None else 'stored crop'}"
            )
        obj_id = truth.get("obj_id")
        if type(obj_id) is not int or not 1 <= obj_id <= len(DRONES):
            raise InputError(f"{gt}: obj_id {obj_id!r} is not one of 1 to {len(DRONES)}")
        return cls(
            number=number,
            K=K,
            camera_R=camera_R,
            camera_t=_array(camera, "cam_t_w2c", 3, f"{where[0]} frame {number}") / MM,
            obj_id=obj_id,
            R=R,
            t=t,
            keypoints_2d=_array(truth, "keypoints_2d", 8, gt).reshape(4, 2),
            keypoints_3d=_array(truth, "keypoints_3d", 12, gt).reshape(4, 3) / MM,
            visible=_array(truth, "keypoints_visible", 4, gt).astype(bool),
            box=box,
            square=square,
        )


def _numbers(array, digits=4):
    return [round(float(v), digits) for v in np.asarray(array).ravel()]


def _array(entry, key, size, where):
    if key not in entry:
        raise InputError(f"{where}: the field {key} is missing; generate this flight again")
    try:
        values = np.array(entry[key], dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise InputError(f"{where}: {key} is not a list of numbers") from None
    if values.size != size:
        raise InputError(f"{where}: {key} holds {values.size} numbers instead of {size}")
    if not np.isfinite(values).all():
        raise InputError(f"{where}: {key} holds NaN or infinity")
    return values


def write_json(path, data, indent=None):
    """Write beside, then rename: a kill leaves the old file or the new one, never half of one."""
    path = Path(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(json.dumps(data, indent=indent, separators=None if indent else (",", ":")) + "\n")
    beside.replace(path)


def read_json(path):
    """Read a JSON file.

    Raises:
        InputError: missing, or not JSON; the message names the file.
    """
    return files.read_json(
        path,
        "missing; is this a data set made by `python -m dronekeypp generate`, and did it finish?",
        "generate it again",
    )


def write_flight(folder, frames, flight):
    """Write the three scene files and flight.json of one flight into its folder. `frames`: list of (camera, truth, info) by number."""
    for name, part in zip(SCENE_FILES, range(3), strict=True):
        rows = {str(n): entry[part] if part == 0 else [entry[part]] for n, entry in sorted(frames.items())}
        write_json(folder / name, rows)
    write_json(folder / "flight.json", flight)


def read_flight(folder):
    """All frames of one flight folder, ordered, and its flight.json.

    Raises:
        InputError: naming the file and the frame, see `Frame.from_bop`.
    """
    folder = Path(folder)
    where = [folder / name for name in SCENE_FILES]
    entries = read_entries(folder)
    for number, entry in entries.items():
        for file, part in zip(where, entry, strict=True):
            if part is None:
                raise InputError(f"{file} frame {number}: no annotation; generate this flight again")
    return [Frame.from_bop(number, *entry, where) for number, entry in entries.items()], read_json(
        folder / "flight.json"
    )


def read_entries(folder):
    """{frame number: (camera, truth, info)} of one flight folder, in order; None where a file lacks a frame or holds no object there.

    Raises:
        InputError: a file is missing, not JSON, or not a table of frames.
    """
    tables = []
    for name in SCENE_FILES:
        table = read_json(folder / name)
        if not isinstance(table, dict) or not all(key.isdigit() for key in table):
            raise InputError(f"{folder / name}: not a table of frames; generate this flight again")
        if name != SCENE_FILES[0]:  # BOP lists the objects of a frame; here there is one
            table = {key: one[0] if isinstance(one, list) and one else None for key, one in table.items()}
        tables.append({int(key): one if isinstance(one, dict) else None for key, one in table.items()})
    return {n: tuple(table.get(n) for table in tables) for n in sorted(set().union(*tables))}


def image_path(folder, number):
    return Path(folder) / "rgb" / f"{number:06d}.jpg"


def flight_folders(root, split):
    """The finished flights of a split, in order."""
    return sorted(p for p in (Path(root) / split).glob("[0-9]" * 6) if p.is_dir())


def models_info():
    """BOP's models_info.json: sizes in millimetres, plus each drone's hubs in body axes."""
    from dronekeypp.sixdronesyn.meshes import drone_mesh

    info = {}
    for drone in DRONES.values():
        points = np.asarray(drone_mesh(drone.name).body.points, dtype=np.float64) * MM
        low, size = points.min(0), np.ptp(points, axis=0)
        info[str(drone.index + 1)] = {
            "name": drone.name,
            "diameter": round(float(pdist(points[ConvexHull(points).vertices]).max()), 2),
            **{f"min_{axis}": round(float(v), 2) for axis, v in zip("xyz", low, strict=True)},
            **{f"size_{axis}": round(float(v), 2) for axis, v in zip("xyz", size, strict=True)},
            "keypoints": [_numbers(hub * MM) for hub in drone.hubs],
        }
    return info


def coco(root, split, size=None):
    """A COCO-keypoints dictionary of one split, in pixels of the stored images (`size`: the side of stored crops, None for whole frames)."""
    from dronekeypp.camera import to_crop
    from dronekeypp.sixdronesyn.scenes import HEIGHT, WIDTH

    images, annotations = [], []
    for folder in flight_folders(root, split):
        for f in read_flight(folder)[0]:
            identity = int(folder.name) * 1000 + f.number
            points, corners = f.keypoints_2d, np.array([f.box[:2], f.box[:2] + f.box[2:]])
            if f.square is not None:
                points, corners = (to_crop(p, f.square) * size for p in (points, corners))
            (x, y), (w, h) = corners[0], corners[1] - corners[0]
            flat = [
                v
                for (px, py), seen in zip(points, f.visible, strict=True)
                for v in (round(px, 2), round(py, 2), 2 if seen else 1)
            ]
            name = image_path(folder, f.number).relative_to(root).as_posix()
            images.append(
                {"id": identity, "file_name": name, "width": size or WIDTH, "height": size or HEIGHT}
            )
            annotations.append(
                {"id": identity, "image_id": identity, "category_id": f.obj_id, "iscrowd": 0, "bbox": _numbers([x, y, w, h], 2),
                 "area": round(w * h, 2), "num_keypoints": 4, "keypoints": flat}
            )  # fmt: skip
    categories = [
        {
            "id": d.index + 1,
            "name": d.name,
            "supercategory": "drone",
            "keypoints": list(KEYPOINT_NAMES),
            "skeleton": SKELETON,
        }
        for d in DRONES.values()
    ]
    return {"images": images, "annotations": annotations, "categories": categories}
