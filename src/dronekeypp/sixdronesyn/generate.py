"""Makes 6DroneSyn on disk: frame by frame from a seed, on any number of workers or shards, resumable at any frame.

A flight is rendered into ROOT/.partial and moved into its split when it is whole. Until then every finished frame stands in
.partial/ID/frames.jsonl; a restart keeps those and goes on. Every random draw comes from (seed, scene, drone, background, frame), so neither the
order nor the number of workers changes a pixel.
"""

import json
import os
import platform
import sys
from functools import lru_cache
from pathlib import Path

import cv2
import joblib
import numpy as np
import pyvista as pv
import vtk
from filelock import FileLock
from scipy.spatial import ConvexHull
from tqdm import tqdm

from dronekeypp import __version__
from dronekeypp.camera import clamp_square, project, square_around
from dronekeypp.environments.cache import environment_files
from dronekeypp.errors import InputError
from dronekeypp.files import digest
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.panorama import load_panorama
from dronekeypp.sixdronesyn.render import (
    DroneRenderer,
    SelfOcclusion,
    check_opengl,
    directions,
    draw_crop,
    draw_frame,
    window_around,
)

STORED_MARGIN = (
    1.5  # a stored crop is 1.5 times the box's longer side: room to jitter a training crop of 1.15 to 1.3
)
KINDS = ("crop", "full")  # of frames
QUALITY = 85  # JPEG


def annotation_digest(entry):
    """The digest of anything JSON can hold, such as the (camera, truth, info) of `bop.Frame.to_bop`."""
    return digest(json.dumps(entry, separators=(",", ":")).encode())


class Flight:
    """Everything that stays the same in one flight, and the way from a frame number to its annotation and its picture."""

    def __init__(self, subsequence, settings, environments):
        self.subsequence, self.settings = subsequence, settings
        self.drone = DRONES[subsequence.drone]
        seed = settings["seed"]
        self.path = scenes.fly(subsequence, seed)
        self.environment, self.turn = scenes.background(subsequence, len(environments), seed)
        self.environment_file = Path(environments[self.environment])
        self.blur = subsequence.generator(seed, "exposure").uniform(
            0.3, 1.6
        )  # radians a blade turns while the shutter is open
        self.outline = _outline(subsequence.drone)
        self.occlusion = _occlusion(subsequence.drone)

    def annotate(self, number):
        """The annotation of frame `number`: a `bop.Frame`."""
        cam, R, t = self.path.camera, self.path.R[number], self.path.t[number]
        hubs = self.drone.hubs @ R.T + t
        keypoints = project(hubs, cam.K)
        outline = project(self.outline @ R.T + t, cam.K)
        low, high = outline.min(0), outline.max(0)
        box = np.concatenate([low, high - low])
        inside = ((keypoints >= 0) & (keypoints <= [scenes.WIDTH, scenes.HEIGHT])).all(1)
        square = clamp_square(square_around(box, STORED_MARGIN), scenes.WIDTH, scenes.HEIGHT)
        return bop.Frame(
            number=number,
            K=cam.K,
            camera_R=cam.R,
            camera_t=cam.t,
            obj_id=self.drone.index + 1,
            R=R,
            t=t,
            keypoints_2d=keypoints,
            keypoints_3d=hubs,
            visible=inside & self.occlusion.visible(self.drone.hubs, R, t),
            box=box,
            square=square if self.settings["frames"] == "crop" else None,
        )

    def open(self, frames):
        """Sample the part of the panorama that `frames` will show, and read the light. The camera stands still, so once is enough."""
        panorama = _panorama(self.environment_file)
        light = panorama.light(self.turn)
        cam_R = self.path.camera.R
        self.light = {
            "sun": cam_R @ light.direction,
            "up": cam_R @ np.array([0.0, 0.0, 1.0]),
            "sun_colour": light.sun_colour,
            "sky_colour": light.sky_colour,
            "ground_colour": light.ground_colour,
        }
        x0, y0, x1, y1 = 0, 0, scenes.WIDTH, scenes.HEIGHT
        if self.settings["frames"] == "crop":
            windows = np.array([window_around(f.square, scenes.WIDTH, scenes.HEIGHT) for f in frames])
            x0, y0 = windows[:, :2].min(0)
            x1, y1 = (windows[:, :2] + windows[:, 2:]).max(0)
        self.origin = (x0, y0)
        self.background = panorama.sample(directions(self.path.camera.K, cam_R, x0, y0, x1, y1), self.turn)

    def picture(self, frame):
        """The stored image of an annotated frame: (size, size, 3) crop or (1080, 1920, 3) whole, uint8 RGB."""
        rng = self.subsequence.generator(self.settings["seed"], "propellers", frame.number)
        view = dict(
            R=frame.R, t=frame.t, K=frame.K, light=self.light, phases=rng.uniform(0, np.pi, 4), blur=self.blur
        )
        if self.settings["frames"] == "crop":
            size, window = self.settings["size"], window_around(frame.square, scenes.WIDTH, scenes.HEIGHT)
            x, y, side = window[0] - self.origin[0], window[1] - self.origin[1], window[2]
            behind = self.background[y : y + side, x : x + side]
            return draw_crop(_renderer(self.drone.name, 2 * size), behind, frame.square, window, size, **view)
        side = int(np.ceil(max(frame.box[2:]))) + 4
        centre = frame.box[:2] + frame.box[2:] / 2
        corner = np.clip(np.round(centre - side / 2), 0, [scenes.WIDTH - side, scenes.HEIGHT - side])
        resolution = 256 * max(1, 2 ** int(np.ceil(np.log2(2 * side / 256))))
        return draw_frame(_renderer(self.drone.name, resolution), self.background, [*corner, side], **view)


# One renderer is a window and its buffers: a worker keeps the two it used last and frees the rest.
_RENDERERS = {}


def _renderer(name, resolution):
    key = (name, resolution)
    if key not in _RENDERERS:
        while len(_RENDERERS) >= 2:
            _RENDERERS.pop(next(iter(_RENDERERS))).close()
        _RENDERERS[key] = DroneRenderer(name, resolution)
    return _RENDERERS[key]


@lru_cache(maxsize=2)
def _panorama(path):
    return load_panorama(path)


@lru_cache
def _occlusion(name):
    return SelfOcclusion(name)


@lru_cache
def _outline(name):
    """The drone's extreme points (P, 3), body axes, propeller discs included: their projections bound the drone's box exactly."""
    mesh = drone_mesh(name)
    points = np.concatenate([mesh.body.points, mesh.propellers(np.zeros(4), 1.0).points]).astype(np.float64)
    return points[ConvexHull(points).vertices]


def render_flight(root, subsequence, settings, environments, stride):
    """Render one flight, or what is missing of it. Returns the number of frames rendered now."""
    final = Path(root) / subsequence.split / f"{subsequence.id:06d}"
    if final.exists():
        return 0
    flight = Flight(subsequence, settings, environments)
    partial = Path(root) / ".partial" / final.name
    (partial / "rgb").mkdir(parents=True, exist_ok=True)
    log = partial / "frames.jsonl"
    done = _read_log(log, partial)
    annotated = {n: flight.annotate(n) for n in scenes.frame_numbers(subsequence, stride)}
    missing = [f for n, f in annotated.items() if n not in done]
    if missing:
        flight.open(missing)
        with log.open("a") as lines:
            for f in missing:
                picture = cv2.cvtColor(flight.picture(f), cv2.COLOR_RGB2BGR)
                data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
                bop.image_path(partial, f.number).write_bytes(data)
                done[f.number] = digest(data)
                lines.write(json.dumps([f.number, done[f.number]]) + "\n")
                lines.flush()
    entries = {n: f.to_bop() for n, f in annotated.items()}
    about = {
        "scene": subsequence.scene,
        "motion": scenes.SCENES[subsequence.scene].motion,
        "drone": subsequence.drone,
        "take": subsequence.take,
        "environment": flight.environment_file.stem,
        "turn_degrees": 90 * flight.turn,
        "seed": settings["seed"],
        "fps": scenes.FPS,
        "digests": {str(n): [done[n], annotation_digest(entries[n])] for n in entries},
    }
    bop.write_flight(partial, entries, about)
    log.unlink(missing_ok=True)
    final.parent.mkdir(parents=True, exist_ok=True)
    partial.rename(final)
    return len(missing)


def _read_log(log, partial):
    """{frame: image digest} of the frames that a killed run had finished; a torn last line or a torn image is simply rendered again."""
    done = {}
    if log.exists():
        text = log.read_text()
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            log.write_text(whole)
        for line in whole.splitlines():
            number, image = json.loads(line)
            path = bop.image_path(partial, number)
            if path.exists() and digest(path.read_bytes()) == image:
                done[number] = image
    return done


def _work(root, subsequence, settings, environments, stride, threads):
    os.environ.setdefault(
        "LP_NUM_THREADS", str(threads)
    )  # Mesa's software rasteriser would take every core in every worker
    cv2.setNumThreads(threads)
    return subsequence, render_flight(root, subsequence, settings, environments, stride)


def generate(root, scene_numbers=None, drone_names=None, frames="crop", size=128, stride=1, seed=0, environments=None, workers=1,
             shard=(0, 1), progress=True):  # fmt: skip
    """Generate 6DroneSyn, or a part of it, into `root`; what is already there is kept (paper Sec. IV).

    Args:
        root: output folder.
        scene_numbers, drone_names: which scenes (1 to 13) and drones (keys of `DRONES`); None for all.
        frames: "crop", the square around the drone at `size` pixels, or "full", 1920×1080.
        stride: keep every stride-th frame of each flight.
        environments: folder of equirectangular images; None for the 22 procedural ones.
        workers: processes. The result does not depend on it.
        shard: (I, N) renders flights I, I + N, I + 2N, …; run every I from 0 to N − 1, at the same time if you like.

    Returns:
        the manifest, a dictionary (also written as manifest.json).

    Raises:
        InputError: bad arguments, no OpenGL library, a bad environment image, or a folder that holds a data set with other settings.
    """
    root = Path(root)
    _check_arguments(scene_numbers, drone_names, frames, size, stride, seed, workers, shard)
    check_opengl()
    files = environment_files(environments, workers=workers, progress=progress)
    settings = {
        "version": __version__,
        "seed": seed,
        "frames": frames,
        "size": size if frames == "crop" else None,
        "stride": stride,
        "environments": "procedural" if environments is None else Path(environments).resolve().name,
        "environment_digests": {Path(f).name: digest(Path(f).read_bytes()) for f in files},
    }
    plan = scenes.subsequences(scene_numbers, drone_names)
    own = {name: DRONES[name].digest for name in dict.fromkeys(s.drone for s in plan) if DRONES[name].digest}
    settings |= {"own_drones": own} if own else {}
    root.mkdir(parents=True, exist_ok=True)
    with _lock(root):
        _start_manifest(root, settings, plan)
    mine = [s for i, s in enumerate(plan) if i % shard[1] == shard[0]]
    threads = 1 if workers > 1 else 2
    jobs = (joblib.delayed(_work)(root, s, settings, files, stride, threads) for s in mine)
    total = sum(len(scenes.frame_numbers(s, stride)) for s in mine)
    with tqdm(total=total, unit="frame", disable=None if progress else True, smoothing=0.05) as bar:
        for subsequence, _ in joblib.Parallel(n_jobs=workers, return_as="generator_unordered")(jobs):
            bar.update(len(scenes.frame_numbers(subsequence, stride)))
    return finish(root)


def _check_arguments(scene_numbers, drone_names, frames, size, stride, seed, workers, shard):
    if scene_numbers == [] or drone_names == []:
        raise InputError("the list of scenes or drones is empty; leave it out for all of them")
    for n in scene_numbers or ():
        if n not in scenes.SCENES:
            raise InputError(f"scene {n}: there are scenes 1 to {max(scenes.SCENES)}")
    for name in drone_names or ():
        if name not in DRONES:
            raise InputError(f"drone {name!r}: choose from {', '.join(DRONES)}")
    if frames not in KINDS:
        raise InputError(f"frames {frames!r}: choose crop or full")
    if not 32 <= size <= 1024:
        raise InputError(f"size {size}: a crop is 32 to 1024 pixels wide")
    if stride < 1 or workers < 1 or seed < 0:
        raise InputError("stride and workers must be at least 1, seed at least 0")
    if not 0 <= shard[0] < shard[1]:
        raise InputError(f"shard {shard[0]}/{shard[1]}: I counts from 0 to N − 1")


def _lock(root):
    """One process at a time reads, changes and writes what describes the whole data set; shards may run side by side."""
    return FileLock(root / ".lock")


def _start_manifest(root, settings, plan):
    """Write the plan before the first frame; refuse a folder that was started with other settings."""
    path, old = root / "manifest.json", None
    planned = {f"{s.id:06d}": len(scenes.frame_numbers(s, settings["stride"])) for s in plan}
    if path.exists():
        old = bop.read_json(path)
        if not isinstance(old, dict) or not {"settings", "versions", "planned"} <= old.keys():
            raise InputError(f"{path}: not the manifest of a data set; choose another folder")
        for key, value in settings.items():
            if old["settings"].get(key) != value:
                raise InputError(
                    f"{path}: this folder holds a data set with another {key} ({_short(old['settings'].get(key))}, now {_short(value)}); "
                    "choose another folder or repeat its settings"
                )
        planned = old["planned"] | planned
    elif any(not p.name.startswith(".") for p in root.iterdir()):
        raise InputError(
            f"{root}: the folder is not empty and holds no manifest.json; choose an empty or new folder"
        )
    now = {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "pyvista": pv.__version__,
        "vtk": vtk.vtkVersion.GetVTKVersion(),
        "platform": sys.platform,
    }
    versions = old["versions"] if old else []  # a resumed data set may have been rendered by several
    versions += [now] * (now not in versions)
    bop.write_json(
        path,
        {
            "name": "6DroneSyn",
            "settings": settings,
            "versions": versions,
            "planned": dict(sorted(planned.items())),
        },
        indent=1,
    )


def _short(value):
    text = json.dumps(value)
    return text if len(text) < 60 else f"digest {digest(text.encode())}"


def finish(root):
    """Bring manifest.json, models/ and the COCO files up to what is on disk. The last shard to finish leaves them complete."""
    root = Path(root)
    with _lock(root):
        return _finish(root)


def totals(planned, flights):
    """What the manifest says of the whole data set, from the plan {flight: frames} and {flight: {"split", "digests"}}."""
    counts = {
        split: sum(len(f["digests"]) for f in flights.values() if f["split"] == split)
        for split in scenes.SPLITS
    }
    result = {"planned_frames": sum(planned.values()), "frames": counts}
    for key, part in (
        ("digest", 0),
        ("annotation_digest", 1),
    ):  # pixels may differ between renderers; annotations never do
        rows = [
            [name, number, pair[part]]
            for name, f in sorted(flights.items())
            for number, pair in f["digests"].items()
        ]
        result[key] = annotation_digest(rows)
    return result


def _finish(root):
    manifest = bop.read_json(root / "manifest.json")
    flights = {}
    for split in scenes.SPLITS:
        for folder in bop.flight_folders(root, split):
            flights[folder.name] = {
                "split": split,
                "digests": bop.read_json(folder / "flight.json")["digests"],
            }
    manifest |= totals(manifest["planned"], flights)
    manifest["flights"] = dict(sorted(flights.items()))
    models = root / "models"
    if not (models / "models_info.json").exists():
        models.mkdir(exist_ok=True)
        for drone in DRONES.values():  # models_info.json comes last: it says that they are all there
            mesh = drone_mesh(drone.name).body
            body = pv.PolyData(mesh.points * np.float32(bop.MM), mesh.faces)
            body.point_data["rgb"] = mesh.point_data["rgb"]
            body.save(models / f"obj_{drone.index + 1:06d}.ply", texture="rgb", recompute_normals=False)
        bop.write_json(models / "models_info.json", bop.models_info(), indent=1)
    for split in scenes.SPLITS:
        if manifest["frames"][split]:
            bop.write_json(root / f"coco_{split}.json", bop.coco(root, split, manifest["settings"]["size"]))
    bop.write_json(root / "manifest.json", manifest)
    partial = root / ".partial"
    if partial.exists() and not any(partial.iterdir()):
        partial.rmdir()
    return manifest
