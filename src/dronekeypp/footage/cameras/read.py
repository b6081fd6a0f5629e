"""Find out whose format a camera file is, and make the camera of the frames from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras import bop, colmap, kalibr, nerf, opencv, ros
from dronekeypp.footage.cameras.calibration import Calibration
from dronekeypp.footage.cameras.documents import read_documents, read_text
from dronekeypp.footage.cameras.keys import Entries
from dronekeypp.footage.cameras.plausible import check_plausible
from dronekeypp.footage.cameras.readings import Reading
from dronekeypp.footage.pictures import CAMERA_FILE, Footage


def read_camera(path: str | Path) -> Calibration:
    """Read a calibration, whichever program wrote it.

    The modules of this package say what is read of OpenCV, ROS, Kalibr, COLMAP, BOP and transforms.json. The
    format follows from the content, not from the name of the file. The principal point is moved by half a
    pixel where the file counts pixel centres from 0.

    Raises:
        InputError: The file is not found, damaged, or in no format that is read. It holds no camera matrix,
            one that is not valid or of no lens, or several cameras. Or it holds distortion, a size or a lens
            model that is not understood.
    """
    path = Path(path)
    text = read_text(path)
    if colmap.recognise(text):
        return _calibration(colmap.read(text, path), path)
    documents = read_documents(text, path)
    if not documents:
        raise InputError(f"{path}: holds no camera, but is empty")
    readings = [_read_document(document, path) for document in documents]
    for number, reading in enumerate(readings[1:], 2):
        if not reading.same(readings[0]):
            raise InputError(f"{path}: document {number} holds another camera than the first; keep one")
    return _calibration(readings[0], path)


def _read_document(tree: Any, path: Path) -> Reading:
    """Read one document of a file by the format that it has."""
    if isinstance(tree, str):
        raise InputError(f"{path}: not a calibration in YAML, XML, JSON or the text of COLMAP")
    if bop.recognise_scene(tree, path):
        return bop.read_scene(tree, path)
    tree = bop.as_object(tree, path)
    entries = Entries(tree, path)
    of_ros = not kalibr.recognise(tree) and not nerf.recognise(entries) and ros.recognise(entries)
    if not of_ros:
        entries.refuse_parts()
    if kalibr.recognise(tree):
        reading = kalibr.read(tree, entries)
    elif nerf.recognise(entries):
        reading = nerf.read(entries)
    elif of_ros:
        reading = ros.read(entries)
    elif bop.recognise_camera(tree) and not entries.has(*opencv.MATRIX):
        reading = bop.read_camera_file(tree, entries)
    else:
        reading = opencv.read(entries)
    entries.refuse_rest()
    return reading


def _calibration(reading: Reading, path: Path, of_the_frames: bool = False) -> Calibration:
    """Return the camera of a reading, with pixel centres at +0.5.

    Raises:
        InputError: No lens has such numbers.
    """
    K = reading.K.copy()
    K[:2, 2] += 0.5 - reading.first_centre
    distortion = reading.distortion
    # Of a fisheye lens, four zeros are no pinhole camera.
    if distortion is not None and not reading.fisheye and not distortion.any():
        distortion = None
    if reading.size is not None:
        check_plausible(K, distortion, reading.fisheye, reading.size, str(path))
    return Calibration(
        K,
        distortion,
        reading.size,
        reading.fisheye,
        of_the_frames,
        str(path),
        f"{path.name}: {reading.describe()}",
    )


def read_cameras(path: str | Path, footage: Footage) -> list[Calibration]:
    """Read the calibration of every frame of some footage, in order.

    Where the frames are those of a BOP scene, and the file is its scene_camera.json and does not say the same
    of all frames, every frame has its own. Otherwise all have that of `read_camera`.

    Raises:
        InputError: As `read_camera` raises it. Or the file lacks a frame of the scene, or the frames are
            crops and the file does not hold their camera matrices.
    """
    path, scene = Path(path), footage.bop_scene
    if scene is None:
        return [read_camera(path)] * len(footage.names)
    own_file = scene.folder / CAMERA_FILE
    own = path.resolve() == own_file
    table: dict[str, Any] = {}
    if own or (scene.folder / bop.INFO_FILE).is_file():
        [tree] = read_documents(read_text(own_file), own_file) or [None]
        table = bop.as_object(tree, own_file)
        bop.check_crops(scene, table, own)
    if not own:
        return [read_camera(path)] * len(footage.names)
    bop.check_entries(table, path)
    if len({str(bop.matrix_of(entry)) for entry in table.values()}) < 2:
        shared = _calibration(bop.read_scene(table, path), path, of_the_frames=True)
        return [shared] * len(footage.names)
    entries = bop.by_number(table)
    calibrations = []
    for number in scene.images:
        if bop.matrix_of(entries.get(number)) is None:
            raise InputError(f"{path}: no cam_K of frame {number}")
        reading = bop.read_image(entries[number], f"{path} frame {number}")
        calibrations.append(_calibration(reading, path, of_the_frames=True))
    return calibrations


def fit_to_frames(calibrations: list[Calibration], width: int, height: int) -> list[Calibration]:
    """Return the calibrations of all frames, made fit for frames of this size.

    Frames that share a calibration go on sharing it, so that its maps are computed once.
    """
    fitting = {id(calibration): calibration for calibration in calibrations}
    for key, calibration in fitting.items():
        fitting[key] = calibration.for_frames(width, height)
    return [fitting[id(calibration)] for calibration in calibrations]
