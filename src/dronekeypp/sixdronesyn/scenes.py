"""This module gives each flight of the plan its camera and its path (paper Sec. IV).

Nothing is rendered here. The plan itself, which is in `plan`, can be used from here too.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from dronekeypp.camera import intrinsics
from dronekeypp.sixdronesyn.drones import SEVEN, Drone
from dronekeypp.sixdronesyn.plan import (
    FPS,
    MOST_DRONES,
    SCENES,
    SPLITS,
    SUBSEQUENCES,
    Scene,
    Subsequence,
    background,
    count_frames,
    frame_numbers,
    quadrotor_flights,
    split_environments,
    subsequences,
)

__all__ = [
    "FPS",
    "HEIGHT",
    "MOST_DRONES",
    "SCENES",
    "SEVEN",
    "SPLITS",
    "SUBSEQUENCES",
    "WIDTH",
    "Camera",
    "Flight",
    "Scene",
    "Subsequence",
    "attitude",
    "background",
    "camera",
    "count_frames",
    "fly",
    "frame_numbers",
    "quadrotor_flights",
    "reach",
    "split_environments",
    "subsequences",
]

WIDTH, HEIGHT = 1920, 1080
NEAREST, FARTHEST = 1.5, 8.0  # metres, camera to drone
GRAVITY = 9.81
DRAG = 0.35  # 1/s: a drone leans into its own wind, even at constant speed

# a curve at the times of F frames, (F, ...), with its first and second derivative by time
Trajectory = tuple[np.ndarray, np.ndarray, np.ndarray]


# --- cameras ---


@dataclass(frozen=True)
class Camera:
    """A camera has a fixed place, a fixed direction and one lens.

    `K` (3, 3) is its camera matrix in pixels. A world point X (metres) is `R @ X + t` in camera axes, with
    `R` (3, 3) and `t` (3,). World z points up and the ground is at z = 0.
    """

    K: np.ndarray
    R: np.ndarray
    t: np.ndarray

    @property
    def position(self) -> np.ndarray:
        """Return the camera's centre (3,) in the world, metres."""
        return -self.R.T @ self.t


def camera(subsequence: Subsequence, seed: int = 0) -> Camera:
    """Return the lens and the mount of this flight.

    The first edition draws one lens for a scene, the second one for every flight. The mount is 2 to 8 m high,
    tilted between 25° down and 40° up, with at most 2° of roll.
    """
    lens = subsequence.generator(seed, "lens")
    if subsequence.edition == 1:
        lens = np.random.default_rng([seed, subsequence.scene])
    centre = np.array([WIDTH, HEIGHT]) / 2 + lens.normal(0, 8, 2)
    K = intrinsics(lens.uniform(1150, 1850), WIDTH, HEIGHT, centre)
    rng = subsequence.generator(seed, "camera")
    tilt, roll = np.radians([rng.uniform(-25, 40), rng.uniform(-2, 2)])
    height = rng.uniform(2, 3) if tilt > 0 else rng.uniform(4, 8)
    # It looks towards world +x; the turn of the background brings the variety.
    forward = np.array([np.cos(tilt), 0, np.sin(tilt)])
    left = np.array([0, np.cos(roll), np.sin(roll)])
    left -= (left @ forward) * forward
    left /= np.linalg.norm(left)
    R = np.stack([-left, -np.cross(forward, left), forward])  # rows: camera x (right), y (down), z (forward)
    return Camera(K, R, -R @ np.array([0, 0, height]))


# --- flights ---


def reach(drone: Drone) -> float:
    """Return the distance in metres from the drone's centre to its farthest propeller tip or corner."""
    tips = np.linalg.norm(drone.hubs, axis=1).max() + drone.propeller_radius
    return max(tips, np.linalg.norm(drone.body_mm) / 2000)


class _Airspace:
    """An airspace holds where a drone may be: wholly in the frame, near enough and above the ground.

    This is an intersection of half-spaces and a ball, hence convex: a straight line or a B-spline between
    points inside stays inside, so no flight ever has to be checked or thrown away.

    Args:
        camera: the camera that watches the drone.
        radius: metres from the drone's centre to its farthest point.
        nearest, farthest: metres from the camera to the drone's centre.
    """

    def __init__(
        self, camera: Camera, radius: float, nearest: float = NEAREST, farthest: float = FARTHEST
    ) -> None:
        fx, cx = camera.K[0, 0], camera.K[0, 2]
        fy, cy = camera.K[1, 1], camera.K[1, 2]
        # half-spaces n·p ≥ margin through the camera centre: left, right, top and bottom of the frame
        walls = np.array([[fx, 0, cx], [-fx, 0, WIDTH - cx], [0, fy, cy], [0, -fy, HEIGHT - cy]])
        self.normals = walls / np.linalg.norm(walls, axis=1, keepdims=True)
        self.margin = radius + 0.02
        self.camera = camera
        self.nearest, self.farthest = nearest, farthest

    def contains(self, p: np.ndarray) -> bool:
        """Return whether a drone centred at `p` (3,), camera axes, is inside."""
        height = (self.camera.R.T @ (p - self.camera.t))[2]
        in_frame = (self.normals @ p >= self.margin).all()
        in_range = p[2] >= self.nearest and np.linalg.norm(p) <= self.farthest
        return bool(in_frame and in_range and height >= 0.3 + self.margin)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """Return a point (3,) in camera axes, drawn uniformly in the picture and log-uniformly in depth.

        A depth drawn this way makes near views no rarer than far ones.
        """
        while True:
            depth = np.exp(rng.uniform(np.log(self.nearest), np.log(self.farthest)))
            pixel = np.array([rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT), 1.0])
            p = depth * np.linalg.solve(self.camera.K, pixel)
            if self.contains(p):
                return p


def _linear(rng: np.random.Generator, airspace: _Airspace, seconds: float, times: np.ndarray) -> Trajectory:
    """Return a straight line, either at constant speed or from rest to rest.

    From rest to rest it follows a quintic, so that the acceleration does not jump.
    """
    start = airspace.sample(rng)
    while True:
        end = airspace.sample(rng)
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


def _spline(control: np.ndarray, seconds: float, times: np.ndarray) -> Trajectory:
    """Return a uniform cubic B-spline over `seconds`, with its derivatives, at `times`."""
    spacing = seconds / (len(control) - 3)
    knots = spacing * np.arange(-3, len(control) + 1)
    curve = BSpline(knots, control, 3)
    return curve(times), curve(times, 1), curve(times, 2)


def _wandering(
    rng: np.random.Generator, airspace: _Airspace, seconds: float, times: np.ndarray
) -> Trajectory:
    """Return a B-spline through a walk towards ever new goals, up to 1.6 m every 0.8 s.

    Speeds reach 2 m/s and accelerations half of gravity.
    """
    points = [airspace.sample(rng)]
    goal = airspace.sample(rng)
    for _ in range(int(round(seconds / 0.8)) + 2):
        step = rng.uniform(0.5, 1.6)
        to_goal = goal - points[-1]
        distance = np.linalg.norm(to_goal)
        points.append(points[-1] + to_goal * min(1.0, step / max(distance, 1e-9)))
        if distance <= step or rng.random() < 0.25:
            goal = airspace.sample(rng)
    return _spline(np.array(points), seconds, times)


def _yaw(rng: np.random.Generator, seconds: float, times: np.ndarray) -> np.ndarray:
    """Return headings (F,) in radians that are free of the direction of travel.

    They follow a B-spline that turns up to 80° every 0.8 s.
    """
    turns = rng.uniform(-80, 80, int(round(seconds / 0.8)) + 2)
    start = rng.uniform(0, 360)
    control = np.radians(start + np.concatenate([[0], np.cumsum(turns)]))
    return _spline(control, seconds, times)[0]


@dataclass(frozen=True)
class Flight:
    """A flight has a camera and the drone's pose in every frame.

    `R` (F, 3, 3) is camera←body and `t` (F, 3) the drone's position in the camera frame, metres. `world_R`
    and `world_t` are the same in world axes.
    """

    camera: Camera
    R: np.ndarray
    t: np.ndarray
    world_R: np.ndarray
    world_t: np.ndarray


def attitude(acceleration: np.ndarray, velocity: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Return world←body rotations (F, 3, 3) of a quadrotor that follows a path.

    Its thrust points along body z and must carry the weight, the acceleration and the drag, so the drone
    tilts into both. Yaw is free.

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


def fly(subsequence: Subsequence, seed: int = 0) -> Flight:
    """Return the whole flight of a subsequence.

    It holds the camera and the drone's pose in every frame (30 a second).
    """
    scene, drone = SCENES[subsequence.scene], subsequence.airframe
    cam = camera(subsequence, seed)
    airspace = _Airspace(cam, reach(drone))
    if subsequence.edition == 2:
        # The seven fit into 1.5 to 8 m; a larger quadrotor stays as many times its own size away.
        airspace = _Airspace(
            cam, reach(drone), max(NEAREST, 4 * reach(drone)), max(FARTHEST, 25 * reach(drone))
        )
    rng = subsequence.generator(seed, "flight")
    times = np.arange(scene.frames) / FPS
    path = _linear if scene.motion == "linear" else _wandering
    p, v, a = path(rng, airspace, scene.seconds, times)  # (F, 3) each, in camera axes
    to_world = cam.R.T
    v, a = v @ to_world.T, a @ to_world.T
    # gusts: a degree or two of wobble, three slow sines an axis
    phase, rate = rng.uniform(0, 2 * np.pi, (3, 2)), rng.uniform(0.4, 1.8, (3, 2))
    gust = 0.12 * np.sin(2 * np.pi * rate * times[:, None, None] + phase).sum(1)
    a = a + np.concatenate([gust, np.zeros((len(times), 1))], axis=1)
    world_R = attitude(a, v, _yaw(rng, scene.seconds, times))
    return Flight(cam, cam.R @ world_R, p, world_R, (p - cam.t) @ cam.R)
