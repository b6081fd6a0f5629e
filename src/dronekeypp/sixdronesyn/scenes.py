"""The flight plan of 6DroneSyn (paper Sec. IV, Table 2): 13 scenes, their splits, cameras, backgrounds and flights. No rendering here.

Every random draw comes from a generator seeded by (seed, scene, drone, subsequence), so any flight can be remade alone.

What the paper leaves open, and what we take:
- A scene fixes the lens (one camera matrix); each of its 21 subsequences mounts that camera anew (height, tilt, where it looks) and flies its
  own path: 273 flights instead of the paper's 91 flights before three backgrounds each.
- The 22 environments are split like the scenes (14 train, 3 validation, 5 test), so a test frame has a background nobody trained on.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from dronekeypp.camera import intrinsics
from dronekeypp.sixdronesyn.drones import DRONES, SEVEN

FPS = 30
SUBSEQUENCES = 3  # backgrounds a scene and drone
WIDTH, HEIGHT = 1920, 1080
NEAREST, FARTHEST = 1.5, 8.0  # metres, camera to drone
GRAVITY = 9.81
PURPOSES = ("camera", "flight", "exposure", "propellers")  # what is drawn at random; new ones go last
DRAG = 0.35  # 1/s: a drone leans into its own wind, even at constant speed


@dataclass(frozen=True)
class Scene:
    """One row of Table 2. `motion` is "linear" or "non-linear"."""

    number: int
    motion: str
    seconds: int
    split: str

    @property
    def frames(self):
        return self.seconds * FPS


def _table():
    split = {3: "val", 9: "val", 13: "val", 6: "test", 7: "test"}
    for n in range(1, 14):
        motion = "linear" if n <= 3 or 7 <= n <= 9 else "non-linear"
        yield n, Scene(n, motion, 12 if n >= 10 else 4, split.get(n, "train"))


SCENES = dict(_table())
SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class Subsequence:
    """One flight: a scene, a drone, and which of its three backgrounds. `id` is its BOP scene number and folder."""

    scene: int
    drone: str
    take: int

    @property
    def id(self):
        return self.scene * 100 + DRONES[self.drone].index * 10 + self.take

    @property
    def split(self):
        return SCENES[self.scene].split

    @property
    def frames(self):
        return SCENES[self.scene].frames

    def generator(self, seed, purpose, frame=0):
        """A random generator of its own for one purpose (a key of `PURPOSES`), of this flight or of one frame of it."""
        return np.random.default_rng(
            [seed, self.scene, DRONES[self.drone].index, self.take, frame, PURPOSES.index(purpose)]
        )


def subsequences(scenes=None, drones=None):
    """Every flight of the chosen scenes and drones (all by default), in a fixed order."""
    return [
        Subsequence(s, d, k)
        for s in SCENES
        if scenes is None or s in scenes
        for d in DRONES
        if drones is None or d in drones
        for k in range(SUBSEQUENCES)
    ]


def frame_numbers(subsequence, stride=1):
    """The frames of a flight that `--stride` keeps: every `stride`-th, their numbers unchanged."""
    return range(0, subsequence.frames, stride)


def count_frames(scenes=None, drones=None, stride=1):
    """How many frames a selection has, from the table alone. All of it: 52,920."""
    return sum(len(frame_numbers(s, stride)) for s in subsequences(scenes, drones))


# --- backgrounds -----------------------------------------------------------------------------------------------------------------------


def split_environments(n):
    """Environment numbers of each split, for `n` environments: 14 : 3 : 5 of 22. Too few for that (under 6): every split shares all."""
    kind = dict.fromkeys((3, 7, 11, 15, 19), "test") | dict.fromkeys((5, 12, 17), "val")
    groups = {split: [i for i in range(n) if kind.get(i % 22, "train") == split] for split in SPLITS}
    return groups if n >= 6 else {split: list(range(n)) for split in SPLITS}


def background(subsequence, environments, seed=0):
    """(environment number, quarter turns about z) behind a flight. Each split deals its environments × 4 turns out like a pack of cards.

    The seven drones get theirs first, so that a drone of your own changes none of their frames.
    """
    pool = [(e, turn) for e in split_environments(environments)[subsequence.split] for turn in range(4)]
    family = [drone for drone in DRONES if (drone in SEVEN) == (subsequence.drone in SEVEN)]
    order = [s for s in subsequences(drones=family) if s.split == subsequence.split].index(subsequence)
    shuffled = np.random.default_rng(
        [seed, SPLITS.index(subsequence.split), order // len(pool), 88]
    ).permutation(len(pool))
    return pool[shuffled[order % len(pool)]]


# --- cameras ---------------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Camera:
    """A fixed camera. `K` (3, 3) pixels; a world point is `R @ X + t` in camera axes; world z up, ground at z = 0."""

    K: np.ndarray
    R: np.ndarray
    t: np.ndarray

    @property
    def position(self):
        return -self.R.T @ self.t


def camera(subsequence, seed=0):
    """The scene's lens on this flight's mount: 2 to 8 m high, tilted between 25° down and 40° up, at most 2° of roll."""
    lens = np.random.default_rng([seed, subsequence.scene])
    centre = np.array([WIDTH, HEIGHT]) / 2 + lens.normal(0, 8, 2)
    K = intrinsics(lens.uniform(1150, 1850), WIDTH, HEIGHT, centre)
    rng = subsequence.generator(seed, "camera")
    tilt, roll = np.radians([rng.uniform(-25, 40), rng.uniform(-2, 2)])
    height = rng.uniform(2, 3) if tilt > 0 else rng.uniform(4, 8)
    forward = np.array(
        [np.cos(tilt), 0, np.sin(tilt)]
    )  # towards world +x; the background's turn brings the variety
    left = np.array([0, np.cos(roll), np.sin(roll)])
    left -= (left @ forward) * forward
    left /= np.linalg.norm(left)
    R = np.stack([-left, -np.cross(forward, left), forward])  # rows: camera x (right), y (down), z (forward)
    return Camera(K, R, -R @ np.array([0, 0, height]))


# --- flights ---------------------------------------------------------------------------------------------------------------------------


def reach(drone):
    """Metres from the drone's centre to its farthest propeller tip or corner."""
    tips = np.linalg.norm(drone.hubs, axis=1).max() + drone.propeller_radius
    return max(tips, np.linalg.norm(drone.body_mm) / 2000)


class _Airspace:
    """Where a drone may be: wholly in the frame, 1.5 to 8 m away, above the ground. An intersection of half-spaces and a ball, hence convex:
    a straight line or a B-spline between points inside stays inside, so no flight ever has to be checked or thrown away."""

    def __init__(self, cam, radius):
        (fx, _, cx), (_, fy, cy) = cam.K[0], cam.K[1]
        r = radius + 0.02
        # half-spaces n·p ≥ r through the camera centre: left, right, top and bottom of the frame
        walls = np.array([[fx, 0, cx], [-fx, 0, WIDTH - cx], [0, fy, cy], [0, -fy, HEIGHT - cy]])
        self.normals = walls / np.linalg.norm(walls, axis=1, keepdims=True)
        self.r, self.cam = r, cam

    def contains(self, p):
        floor = (self.cam.R.T @ (p - self.cam.t))[2]
        inside = (self.normals @ p >= self.r).all() and p[2] >= NEAREST and np.linalg.norm(p) <= FARTHEST
        return inside and floor >= 0.3 + self.r

    def sample(self, rng):
        """A point (3,) in camera axes: uniform in the picture, log-uniform in depth, so that near views are not rare."""
        while True:
            depth = np.exp(rng.uniform(np.log(NEAREST), np.log(FARTHEST)))
            pixel = np.array([rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT), 1.0])
            p = depth * np.linalg.solve(self.cam.K, pixel)
            if self.contains(p):
                return p


def _linear(rng, air, seconds, times):
    """A straight line, either at constant speed or from rest to rest (a quintic: no jump in acceleration)."""
    start = air.sample(rng)
    while True:
        end = air.sample(rng)
        if 0.8 <= np.linalg.norm(end - start) <= 1.6 * seconds:
            break
    u = times[:, None] / seconds
    if rng.random() < 0.5:
        s, ds, dds = u, np.ones_like(u), np.zeros_like(u)
    else:
        s = u**3 * (10 - 15 * u + 6 * u**2)
        ds, dds = 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)
    d = end - start
    return start + s * d, ds * d / seconds, dds * d / seconds**2


def _spline(control, seconds, times):
    """Uniform cubic B-spline over `seconds`: value, first and second derivative at `times`."""
    spacing = seconds / (len(control) - 3)
    knots = spacing * np.arange(-3, len(control) + 1)
    curve = BSpline(knots, control, 3)
    return curve(times), curve(times, 1), curve(times, 2)


def _wandering(rng, air, seconds, times):
    """A B-spline through a walk towards ever new goals, up to 1.6 m every 0.8 s: speeds to 2 m/s, accelerations to half of gravity."""
    points = [air.sample(rng)]
    goal = air.sample(rng)
    for _ in range(int(round(seconds / 0.8)) + 2):
        step, way = rng.uniform(0.5, 1.6), goal - points[-1]
        distance = np.linalg.norm(way)
        points.append(points[-1] + way * min(1.0, step / max(distance, 1e-9)))
        if distance <= step or rng.random() < 0.25:
            goal = air.sample(rng)
    return _spline(np.array(points), seconds, times)


def _yaw(rng, seconds, times):
    """Heading in radians, free of the direction of travel: a B-spline that turns up to 80° every 0.8 s."""
    turns = rng.uniform(-80, 80, int(round(seconds / 0.8)) + 2)
    start = rng.uniform(0, 360)
    control = np.radians(start + np.concatenate([[0], np.cumsum(turns)]))
    return _spline(control, seconds, times)[0]


@dataclass(frozen=True)
class Flight:
    """Poses of every frame. `R` (F, 3, 3) camera←body and `t` (F, 3) metres in the camera frame; `world_*` the same in world axes."""

    camera: Camera
    R: np.ndarray
    t: np.ndarray
    world_R: np.ndarray
    world_t: np.ndarray


def attitude(acceleration, velocity, yaw):
    """World←body rotations (F, 3, 3) of a quadrotor that follows a path.

    Its thrust points along body z and must carry the weight, the acceleration and the drag, so the drone tilts into both. Yaw is free.

    Args:
        acceleration, velocity: (F, 3) in world axes, m/s² and m/s.
        yaw: (F,) radians, the heading of the nose about world z.
    """
    up = acceleration + DRAG * velocity + [0, 0, GRAVITY]
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    nose = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1)
    left = np.cross(up, nose)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    return np.stack([np.cross(left, up), left, up], axis=2)


def fly(subsequence, seed=0):
    """The whole flight of a subsequence: its camera and the drone's pose in every frame (30 a second)."""
    scene, drone = SCENES[subsequence.scene], DRONES[subsequence.drone]
    cam = camera(subsequence, seed)
    rng = subsequence.generator(seed, "flight")
    times = np.arange(scene.frames) / FPS
    path = _linear if scene.motion == "linear" else _wandering
    p, v, a = path(rng, _Airspace(cam, reach(drone)), scene.seconds, times)
    to_world = cam.R.T
    v, a = v @ to_world.T, a @ to_world.T
    # gusts: a degree or two of wobble, three slow sines an axis
    phase, rate = rng.uniform(0, 2 * np.pi, (3, 2)), rng.uniform(0.4, 1.8, (3, 2))
    gust = 0.12 * np.sin(2 * np.pi * rate * times[:, None, None] + phase).sum(1)
    a = a + np.concatenate([gust, np.zeros((len(times), 1))], axis=1)
    world_R = attitude(a, v, _yaw(rng, scene.seconds, times))
    return Flight(cam, cam.R @ world_R, p, world_R, (p - cam.t) @ cam.R)
