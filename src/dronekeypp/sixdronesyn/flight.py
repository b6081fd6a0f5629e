"""This module makes one flight of 6DroneSyn: it annotates the frames, draws them and writes them to disk.

A flight is rendered into ROOT/.partial and moved into its split when it is whole. Until then every finished
frame is listed in .partial/ID/frames.jsonl with the digests of its files; a restart keeps those frames and
goes on.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import ConvexHull

from dronekeypp.camera import clamp_square, project, square_around
from dronekeypp.files import append_to, digest, make_folder, remove_unfinished, write_beside
from dronekeypp.sixdronesyn import bop, depth, depth_files, frame_log, scenes
from dronekeypp.sixdronesyn.compositing import directions, draw_crop, draw_frame, window_around
from dronekeypp.sixdronesyn.drones import Drone
from dronekeypp.sixdronesyn.flight_file import NAME as FLIGHT_FILE
from dronekeypp.sixdronesyn.flight_file import frame_digest
from dronekeypp.sixdronesyn.frame_log import Finished
from dronekeypp.sixdronesyn.frame_reader import SCENE_FILES
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.occlusion import SelfOcclusion
from dronekeypp.sixdronesyn.panorama import Panorama, load_panorama
from dronekeypp.sixdronesyn.render import DroneRenderer, Light, View

# A stored crop is 1.5 times the box's longer side: room to jitter a training crop of 1.15 to 1.3.
STORED_MARGIN = 1.5
QUALITY = 85  # JPEG


class Flight:
    """A flight holds everything that stays the same in all of its frames.

    It leads from a frame number to the frame's annotation and its picture.

    Args:
        subsequence: the flight in the plan.
        settings: those of the data set, as its manifest holds them; `seed`, `frames` and `size` are read.
        environments: the image files of all environments.
    """

    light: Light
    origin: tuple[int, int]  # full-frame pixel of the background's upper left corner
    background: np.ndarray  # (H, W, 3) uint8: what `open` sampled

    def __init__(
        self,
        subsequence: scenes.Subsequence,
        settings: dict[str, Any],
        environments: Sequence[str | Path],
    ) -> None:
        self.subsequence, self.settings = subsequence, settings
        self.drone = subsequence.airframe
        seed = settings["seed"]
        self.path = scenes.fly(subsequence, seed)
        self.environment, self.turn = scenes.background(subsequence, len(environments), seed)
        self.environment_file = Path(environments[self.environment])
        # radians that a blade turns while the shutter is open
        self.blur = subsequence.generator(seed, "exposure").uniform(0.3, 1.6)
        self.outline = _outline(self.drone)
        self.occlusion = _occlusion(self.drone)

    def annotate(self, number: int) -> bop.Frame:
        """Return the annotation of frame `number`."""
        cam, R, t = self.path.camera, self.path.R[number], self.path.t[number]
        hubs = self.drone.hubs @ R.T + t
        keypoints = project(hubs, cam.K)
        outline = project(self.outline @ R.T + t, cam.K)
        low, high = outline.min(0), outline.max(0)
        box = np.concatenate([low, high - low])
        inside = ((keypoints >= 0) & (keypoints <= [scenes.WIDTH, scenes.HEIGHT])).all(1)
        square = None
        if self.settings["frames"] == "crop":
            square = clamp_square(square_around(box, STORED_MARGIN), scenes.WIDTH, scenes.HEIGHT)
        return bop.Frame(
            number=number,
            K=cam.K,
            camera_R=cam.R,
            camera_t=cam.t,
            obj_id=self.subsequence.drone_number + 1,
            R=R,
            t=t,
            keypoints_2d=keypoints,
            keypoints_3d=hubs,
            visible=inside & self.occlusion.visible(self.drone.hubs, R, t),
            box=box,
            square=square,
            hubs=self.drone.hubs,
        )

    def entry(self, frame: bop.Frame) -> tuple[dict, dict, dict]:
        """Return what the three scene files say of a frame: (camera, truth, info)."""
        if self.subsequence.edition == 1:
            return frame.to_first_edition()
        camera, truth, info = frame.to_bop(*self.image_size)
        if self.settings.get("depth"):
            camera["depth_scale"] = depth.depth_scale(self.drone, frame)
        return camera, truth, info

    @property
    def image_size(self) -> tuple[int, int]:
        """Return width and height of the stored images in pixels."""
        size = self.settings["size"]
        return (size, size) if self.settings["frames"] == "crop" else (scenes.WIDTH, scenes.HEIGHT)

    def open(self, frames: Sequence[bop.Frame]) -> None:
        """Sample the part of the panorama that `frames` will show, and read the light.

        The camera stands still, so once is enough for all of them.
        """
        digests = self.settings.get("environment_digests", {})
        panorama = _panorama(self.environment_file, digests.get(self.environment_file.name))
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

    def picture(self, frame: bop.Frame) -> np.ndarray:
        """Return the stored image of an annotated frame, uint8 RGB.

        It is a crop (size, size, 3) or a whole frame (1080, 1920, 3). `open` must have been called with this
        frame.
        """
        rng = self.subsequence.generator(self.settings["seed"], "propellers", frame.number)
        view: View = {
            "R": frame.R,
            "t": frame.t,
            "K": frame.K,
            "light": self.light,
            "phases": rng.uniform(0, np.pi, 4),
            "blur": self.blur,
        }
        if self.settings["frames"] == "crop":
            size = self.settings["size"]
            window = window_around(frame.square, scenes.WIDTH, scenes.HEIGHT)
            x, y, side = window[0] - self.origin[0], window[1] - self.origin[1], window[2]
            behind = self.background[y : y + side, x : x + side]
            renderer = _renderer(self.drone, 2 * size)
            return draw_crop(renderer, behind, frame.square, window, size, **view)
        side = int(np.ceil(max(frame.box[2:]))) + 4
        centre = frame.box[:2] + frame.box[2:] / 2
        corner = np.clip(np.round(centre - side / 2), 0, [scenes.WIDTH - side, scenes.HEIGHT - side])
        resolution = 256 * max(1, 2 ** int(np.ceil(np.log2(2 * side / 256))))
        renderer = _renderer(self.drone, resolution)
        return draw_frame(renderer, self.background, [*corner, side], **view)


# --- what many flights share ------------------------------------------------------------------------------

# One renderer is a window and its buffers: a worker keeps the two it made last and frees the rest.
_RENDERERS: dict[int, DroneRenderer] = {}


def _renderer(drone: Drone, resolution: int) -> DroneRenderer:
    """Return a renderer that shows a drone at a resolution in pixels.

    It is made anew if there is none among the two made last.
    """
    if resolution not in _RENDERERS:
        while len(_RENDERERS) >= 2:
            oldest = next(iter(_RENDERERS))
            _RENDERERS.pop(oldest).close()
        _RENDERERS[resolution] = DroneRenderer(drone, resolution)
    renderer = _RENDERERS[resolution]
    renderer.show(drone)
    return renderer


@lru_cache(maxsize=2)
def _panorama(path: Path, content: str | None) -> Panorama:
    """Return a panorama; `content` is its digest, since the file may be replaced while this process runs."""
    return load_panorama(path)


@lru_cache(maxsize=16)
def _occlusion(drone: Drone) -> SelfOcclusion:
    return SelfOcclusion(drone)


@lru_cache(maxsize=16)
def _outline(drone: Drone) -> np.ndarray:
    """Return the drone's extreme points (P, 3) in body axes, propeller discs included.

    Their projections bound the drone's box exactly.
    """
    mesh = drone_mesh(drone)
    discs = mesh.propellers(np.zeros(4), 1.0)
    points = np.concatenate([mesh.body.points, discs.points]).astype(np.float64)
    return points[ConvexHull(points).vertices]


# --- to disk ----------------------------------------------------------------------------------------------


def render_flight(
    root: str | Path,
    subsequence: scenes.Subsequence,
    settings: dict[str, Any],
    environments: Sequence[str | Path],
    stride: int,
) -> int:
    """Render one flight, or what is missing of it, and return the number of frames rendered now.

    The arguments are those of `Flight`, the folder of the data set and its stride.
    """
    final = Path(root) / subsequence.split / f"{subsequence.id:06d}"
    if final.exists():
        return 0
    flight = Flight(subsequence, settings, environments)
    partial = Path(root) / ".partial" / final.name
    annotated = {n: flight.annotate(n) for n in scenes.frame_numbers(subsequence, stride)}
    make_folder(partial.parent)
    make_folder(partial)
    for path in (bop.image_path(partial, 0), *depth_files.paths(partial, 0, settings)):
        make_folder(path.parent)
    log = partial / frame_log.NAME
    _remove_unfinished(partial, settings, annotated)
    done = frame_log.read(partial, settings)
    missing = [frame for number, frame in annotated.items() if number not in done]
    if missing:
        flight.open(missing)
        with append_to(log) as lines:
            for frame in missing:
                done[frame.number] = _write_frame(flight, frame, partial)
                lines.write(frame_log.line(frame.number, done[frame.number]))
                lines.flush()
    entries, digests = {}, {}
    for number, frame in annotated.items():
        entries[number] = flight.entry(frame)
        if done[number].pixels is not None:
            entries[number][2].update(depth_files.counts(*done[number].pixels))
        digests[str(number)] = [done[number].image, frame_digest(entries[number]), *done[number].others]
    about = {
        "scene": subsequence.scene,
        "motion": scenes.SCENES[subsequence.scene].motion,
        "drone": subsequence.drone,
        "take": subsequence.take,
        "environment": flight.environment_file.stem,
        "turn_degrees": 90 * flight.turn,
        "seed": settings["seed"],
        "fps": scenes.FPS,
        "digests": digests,
    }
    bop.write_flight(partial, entries, about)
    log.unlink(missing_ok=True)
    final.parent.mkdir(parents=True, exist_ok=True)
    partial.rename(final)
    return len(missing)


def _remove_unfinished(partial: Path, settings: dict[str, Any], numbers: Iterable[int]) -> None:
    """Remove what a kill has left of the files of an unfinished flight."""
    remove_unfinished(partial, (frame_log.NAME, *SCENE_FILES, FLIGHT_FILE))
    names: dict[Path, set[str]] = {}
    for number in numbers:
        for path in (bop.image_path(partial, number), *depth_files.paths(partial, number, settings)):
            names.setdefault(path.parent, set()).add(path.name)
    for folder, known in names.items():
        remove_unfinished(folder, known)


def _write_frame(flight: Flight, frame: bop.Frame, folder: Path) -> Finished:
    """Draw a frame, and write all of its files."""
    picture = cv2.cvtColor(flight.picture(frame), cv2.COLOR_RGB2BGR)
    image = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    write_beside(bop.image_path(folder, frame.number), image)
    others = depth_files.paths(folder, frame.number, flight.settings)
    if not others:
        return Finished(digest(image))
    distances, whole = depth.draw_depth(flight.drone, frame, *flight.image_size)
    scale = depth.depth_scale(flight.drone, frame)
    contents = depth_files.encode(distances, scale, flight.settings)
    for path, content in zip(others, contents, strict=True):
        write_beside(path, content)
    pixels = (int((distances > 0).sum()), whole) if flight.settings.get("masks") else None
    return Finished(digest(image), tuple(digest(content) for content in contents), pixels)
