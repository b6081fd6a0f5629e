"""Read and write the on-disk format: BOP's folders and field names, plus the four keypoints.

    ROOT/manifest.json                      6DroneSyn only: settings, versions, a digest a frame
    ROOT/coco_train.json, …                 COCO-keypoints, in pixels of the stored images (see `coco`)
    ROOT/test_targets_bop19.json            what BOP's own scripts are to score
    ROOT/models/models_info.json, obj_000001.ply, …
    ROOT/models_eval/                       the same, with fewer triangles
    ROOT/train/000400/rgb/000000.jpg, …     one folder a flight; its name is the BOP scene's number
                      depth/, mask/, mask_visib/      on demand (see `depth`)
                      scene_camera.json     cam_K, cam_K_frame, cam_R_w2c, cam_t_w2c, depth_scale
                      scene_gt.json         obj_id, cam_R_m2c, cam_t_m2c, keypoints_2d, keypoints_3d,
                                            keypoints_body, keypoints_visible
                      scene_gt_info.json    bbox_obj, bbox_visib, visib_fract, crop
                      flight.json           scene, drone, take, environment, turn, seed, fps

Millimetres here and only here. All pixels in the three scene files are those of the stored image, and cam_K
is its camera matrix. Of a stored crop, cam_K_frame is the camera matrix of the full frame, and `crop` the
square (x, y, side) that it shows, in full-frame pixels; `crop` of a whole frame is null. keypoints_body are
the hubs in body axes. A mesh in models/ has no propellers, as it is what stands still; bbox_obj holds the
discs they sweep, so it is larger than the mesh's own. bbox_visib is the part of bbox_obj in the image.

A stored crop without cam_K_frame is one of the first edition: there cam_K and all pixels are those of the
full frame, and keypoints_body is missing.

Any BOP folder can be read, see `dronekeypp.data`: only cam_K, obj_id and bbox_obj must be there. What else is
not there is None in the frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from dronekeypp import files
from dronekeypp.classes import DroneClass, check_hubs
from dronekeypp.errors import InputError
from dronekeypp.schema import Open, check
from dronekeypp.sixdronesyn.annotation import MM, Frame
from dronekeypp.sixdronesyn.frame_reader import SCENE_FILES, frames_from
from dronekeypp.sixdronesyn.instances import one_value

MODELS = "models"
Above0 = Annotated[float, Field(gt=0)]
MEND = "mend it, or generate it again"
INVISIBLE = [-1, -1, -1, -1]  # BOP's bbox_obj of an object that is not in the picture


class ModelInfo(Open):
    """This is what models_info.json says of an object of any data set. `keypoints` are its hubs."""

    name: str | None = None
    label: str | None = None
    diameter: Above0 | None = None
    propeller_diameter: Above0 | None = None
    keypoints: list[Any] | None = None


def read_json(path: str | Path) -> Any:
    """Read a JSON file of a data set.

    Raises:
        InputError: it is missing or not JSON. The message names the file.
    """
    missing = "missing; is this a data set, and did `python -m dronekeypp generate` finish it?"
    if Path(path).name in SCENE_FILES:
        missing = f"missing; a flight has {', '.join(SCENE_FILES)}"
    return files.read_json(path, missing, MEND)


def write_flight(folder: Path, frames: Mapping[int, tuple[dict, dict, dict]], flight: dict) -> None:
    """Write the three scene files and flight.json of one flight.

    Args:
        folder: of the flight.
        frames: (camera, truth, info) by frame number, as `Frame.to_bop` returns them.
        flight: what flight.json is to hold.
    """
    cameras, truths, infos = {}, {}, {}
    for number, (camera, truth, info) in sorted(frames.items()):
        cameras[str(number)] = camera
        truths[str(number)] = [truth]  # BOP lists the objects of a frame
        infos[str(number)] = [info]
    for name, table in zip(SCENE_FILES, (cameras, truths, infos), strict=True):
        files.write_json(folder / name, table)
    files.write_json(folder / "flight.json", flight)


def read_flight(
    folder: str | Path,
    models: Mapping[int, DroneClass] | None = None,
    size: tuple[int, int] | None = None,
    strict: bool = True,
) -> tuple[list[Frame], dict[str, Any]]:
    """Read all frames of one flight folder of any data set, in order, and its flight.json ({} without one).

    The arguments and errors are those of `frames_of`. Digests are not checked, see `flight_file`.
    """
    folder = Path(folder)
    flight = read_json(folder / "flight.json") if (folder / "flight.json").is_file() else {}
    return frames_of(folder, read_entries(folder), models, size, strict), flight


def frames_of(
    folder: Path,
    entries: Mapping[int, tuple[dict | None, list[dict], list[dict]]],
    models: Mapping[int, DroneClass] | None = None,
    size: tuple[int, int] | None = None,
    strict: bool = True,
) -> list[Frame]:
    """Make frames of what `read_entries` returns of a flight.

    A drone that BOP marks as not in the picture is left out.

    Args:
        folder: of the flight, for messages.
        entries: what the three files say of each frame.
        models, size: as in `frames_from`.
        strict: whether every frame must hold a drone. Elsewhere a frame without one is left out.

    Raises:
        InputError: naming the file and the frame, see `frames_from`.
    """
    rows = []
    for number, (camera, truths, infos) in entries.items():
        if not strict and not truths and not infos:
            continue
        for name, part in zip(SCENE_FILES, (camera, truths, infos), strict=True):
            if not part:
                raise InputError(f"{folder / name} frame {number}: no annotation")
        if len(truths) != len(infos):
            raise InputError(
                f"{folder / SCENE_FILES[2]} frame {number}: {len(infos)} objects, "
                f"{SCENE_FILES[1]} has {len(truths)}"
            )
        for truth, info in zip(truths, infos, strict=True):
            if info.get("bbox_obj") != INVISIBLE:
                rows.append((number, camera, truth, info))
    return frames_from(folder, rows, models, size) if rows else []


def read_entries(folder: Path) -> dict[int, tuple[dict | None, list[dict], list[dict]]]:
    """Return {frame number: (camera, truths, infos)} of one flight folder, in order.

    `truths` and `infos` hold an entry for each drone. Where a file lacks the frame, or holds something else
    there, `camera` is None and the lists are empty.

    Raises:
        InputError: a file is missing, not JSON, or not a table of frames.
    """
    cameras = _read_table(folder / SCENE_FILES[0], "frames")
    truths = _read_table(folder / SCENE_FILES[1], "frames")
    infos = _read_table(folder / SCENE_FILES[2], "frames")
    entries = {}
    for number in sorted({*cameras, *truths, *infos}):
        camera = cameras.get(number)
        if not isinstance(camera, dict):
            camera = None
        entries[number] = (camera, _objects(truths.get(number)), _objects(infos.get(number)))
    return entries


def _read_table(path: Path, kind: str) -> dict[int, Any]:
    """Return what a JSON file says of each frame or object (`kind`, in the plural), by number."""
    table = read_json(path)
    if not isinstance(table, dict) or not all(key.isdecimal() and len(key) < 19 for key in table):
        raise InputError(f"{path}: not a table of {kind}")
    return {int(key): entry for key, entry in table.items()}


def _objects(entries: Any) -> list[dict]:
    """Return the objects of a frame, or [] unless they are a list of dicts."""
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        return []
    return entries


def image_path(folder: str | Path, number: int) -> Path:
    """Return the path of the picture of a frame of 6DroneSyn."""
    return Path(folder) / "rgb" / f"{number:06d}.jpg"


def flight_folders(root: str | Path, split: str) -> list[Path]:
    """Return the finished flights of a split of 6DroneSyn, in order."""
    return sorted(path for path in (Path(root) / split).glob("[0-9]" * 6) if path.is_dir())


def read_models(root: str | Path) -> dict[int, DroneClass]:
    """Return the drones of a data set by object number, from models_info.json; {} where there is none.

    Raises:
        InputError: the file is not a table of objects, two of them have one name, or the keypoints of one are
            not the four hubs of a drone in millimetres.
    """
    path = Path(root) / MODELS / "models_info.json"
    if not path.is_file():
        return {}
    models = {}
    for number, entry in sorted(_read_table(path, "objects").items()):
        where = f"{path} object {number}"
        check(ModelInfo, entry, where, MEND)
        hubs = None
        if entry.get("keypoints") is not None:
            hubs = one_value(entry, "keypoints", 12, where).reshape(4, 3) / MM
            check_hubs(hubs, f"{where}: keypoints")
        name = entry.get("name") or f"object {number}"
        for other, drone in models.items():
            if drone.name == name:
                raise InputError(f"{path}: objects {other} and {number} are both called {name}")
        models[number] = DroneClass(name, hubs, entry.get("label") or name)
    return models
