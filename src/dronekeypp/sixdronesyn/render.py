"""This module draws one drone alone, as one camera sees it, off-screen with VTK.

`compositing` lays it over a panorama.
"""

import os
import subprocess
import sys
from functools import lru_cache
from typing import TypedDict

import numpy as np
import pyvista as pv
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from dronekeypp.camera import Numbers
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.drones import Drone
from dronekeypp.sixdronesyn.meshes import SPOKES, DroneMesh, drone_mesh

# VTK's view coordinates have y up and z towards the viewer; OpenCV's camera axes have y down and z forward.
_VIEW_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])

# Our own light instead of VTK's, for every fragment: a sun, a sky above and a ground below. It is computed in
# linear light; the power 1/2.2 makes a pixel of it. `disc_colours` does the same for a whole propeller.
_SHADE = """
  vec3 n = normalVCVSOutput;
  vec3 albedo = pow(diffuseColor, vec3(2.2));
  vec3 ambient = mix(groundColour, skyColour, 0.5 + 0.5 * dot(n, upVC));
  float facing = dot(n, sunVC);
  vec3 toEye = normalize(-vertexVC.xyz);
  float shine = pow(max(0.0, dot(n, normalize(sunVC + toEye))), 40.0) * step(0.0, facing);
  float rim = pow(1.0 - max(0.0, dot(n, toEye)), 4.0);
  vec3 sky = mix(groundColour, skyColour, 0.5 + 0.5 * dot(reflect(-toEye, n), upVC));
  vec3 light = albedo * (sunColour * max(0.0, facing) + ambient)
             + gloss * (sunColour * shine + (0.04 + 0.4 * rim) * sky);
  gl_FragData[0] = vec4(pow(clamp(light, 0.0, 1.0), vec3(1.0 / 2.2)), opacity);
"""

BODY_GLOSS = 0.35
PROPELLER_GLOSS = 0.15
NEAREST = 0.05  # metres, where drawing begins at least
# metres: what lies so near to the origin of the drone is drawn in any case
LEAST_RADIUS = 1.0

_CHECKED = "DRONEKEYPP_OPENGL_CHECKED"
_PROBE = """
import dronekeypp.sixdronesyn, pyvista
plotter = pyvista.Plotter(off_screen=True)
plotter.add_mesh(pyvista.Triangle())
plotter.screenshot()
"""


class Light(TypedDict):
    """Describe the light on a drone by unit vectors in camera axes and linear RGB colours, (3,) each."""

    sun: np.ndarray  # towards the sun
    up: np.ndarray
    sun_colour: np.ndarray
    sky_colour: np.ndarray
    ground_colour: np.ndarray


class View(TypedDict):
    """Describe one exposure of one drone.

    It holds the arguments of `DroneRenderer.draw` besides the square.
    """

    R: np.ndarray
    t: np.ndarray
    K: np.ndarray
    light: Light
    phases: np.ndarray
    blur: float


def check_opengl() -> None:
    """Draw one triangle in a process of its own.

    Without an OpenGL library VTK does not raise, it crashes; only another process can find that out.

    Raises:
        InputError: this machine cannot render; the message names the package to install.
    """
    if os.environ.get(_CHECKED):  # by the process that started this one
        return
    result = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True)
    if result.returncode != 0:
        raise InputError(
            "this machine has no OpenGL library to render with; on Debian or Ubuntu: "
            "apt-get install libegl1 libgl1-mesa-dri (training and evaluation need none)"
        )
    os.environ[_CHECKED] = "1"


def disc_colours(rgb: np.ndarray, hubs: np.ndarray, R: np.ndarray, t: np.ndarray, light: Light) -> np.ndarray:
    """Return the colours of four propeller discs in the light of `_SHADE`, uint8.

    A disc is flat and small, so one calculation for its middle stands for all of it. That is much cheaper
    than one for every fragment.

    Args:
        rgb: (4, …, 3) uint8, the paint of each disc.
        hubs: (4, 3) metres, body frame.
        R, t: (3, 3) and (3,) metres, the pose in the camera frame.
        light: the light, in camera axes.
    """
    to_eye = -(hubs @ R.T + t)
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    normals = (
        np.where(to_eye @ R[:, 2:] > 0, 1.0, -1.0) * R[:, 2]
    )  # (4, 3), of the sides that the camera sees
    half = light["sun"] + to_eye
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    facing = normals @ light["sun"]
    cosine = (normals * to_eye).sum(axis=1)
    reflected = 2 * cosine[:, None] * normals - to_eye
    shine = np.where(facing >= 0, np.maximum((normals * half).sum(axis=1), 0) ** 40, 0)
    rim = (1 - cosine) ** 4

    def sky(direction: np.ndarray) -> np.ndarray:
        share = 0.5 + 0.5 * direction @ light["up"]
        return (1 - share)[:, None] * light["ground_colour"] + share[:, None] * light["sky_colour"]

    diffuse = light["sun_colour"] * np.maximum(facing, 0)[:, None] + sky(normals)
    mirror = light["sun_colour"] * shine[:, None] + (0.04 + 0.4 * rim)[:, None] * sky(reflected)
    shape = (4, *[1] * (rgb.ndim - 2), 3)
    albedo = (rgb / 255.0) ** 2.2
    linear = albedo * diffuse.reshape(shape) + PROPELLER_GLOSS * mirror.reshape(shape)
    return np.rint(255 * np.clip(linear, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def _actor(colours: str) -> vtk.vtkActor:
    """Return an actor without a mesh, which is drawn with the point array `colours`."""
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetScalarModeToUsePointFieldData()
    mapper.SelectColorArray(colours)
    mapper.SetColorModeToDirectScalars()
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    return actor


def _set_light(actor: vtk.vtkActor, light: Light) -> None:
    """Give the light to the shader of a body, in VTK's view coordinates."""
    uniforms = actor.GetShaderProperty().GetFragmentCustomUniforms()
    uniforms.SetUniform3f("sunVC", (_VIEW_FROM_CAMERA @ light["sun"]).tolist())
    uniforms.SetUniform3f("upVC", (_VIEW_FROM_CAMERA @ light["up"]).tolist())
    uniforms.SetUniform3f("sunColour", np.asarray(light["sun_colour"], float).tolist())
    uniforms.SetUniform3f("skyColour", np.asarray(light["sky_colour"], float).tolist())
    uniforms.SetUniform3f("groundColour", np.asarray(light["ground_colour"], float).tolist())
    uniforms.SetUniformf("gloss", BODY_GLOSS)


def pose_matrix(R: np.ndarray, t: np.ndarray) -> vtk.vtkMatrix4x4:
    """Return a pose, (3, 3) and (3,) metres, as VTK takes it."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, t
    matrix = vtk.vtkMatrix4x4()
    matrix.DeepCopy(pose.ravel())
    return matrix


def aim(camera: vtk.vtkCamera, K: np.ndarray, square: Numbers, near: float, far: float) -> None:
    """Let VTK's camera see what a camera `K` (3, 3) sees in a square (x, y, side) of its image.

    It stands in the origin of the camera frame. `near` and `far` are the depths in metres between which
    anything is drawn.
    """
    camera.SetPosition(0, 0, 0)
    camera.SetFocalPoint(0, 0, 1)
    camera.SetViewUp(0, -1, 0)
    # One off-centre camera: its window centre counts half sides from the principal point.
    x, y, half = float(square[0]), float(square[1]), float(square[2]) / 2
    camera.SetViewAngle(2 * np.degrees(np.arctan(half / K[1, 1])))
    camera.SetWindowCenter((x + half - K[0, 2]) / half, -(y + half - K[1, 2]) / half)
    camera.SetClippingRange(near, far)


@lru_cache(maxsize=16)
def farthest_point(drone: Drone) -> float:
    """Return the distance in metres from a drone's origin to its farthest point, propeller discs included."""
    body = np.linalg.norm(np.asarray(drone_mesh(drone).body.points, dtype=np.float64), axis=1).max()
    tips = np.linalg.norm(drone.hubs, axis=1).max() + drone.propeller_radius
    return float(max(body, tips))


def depth_range(distance: float, radius: float) -> tuple[float, float]:
    """Return the depths, near and far, between which a ball is drawn whose middle is at depth `distance`."""
    return max(NEAREST, distance - radius), distance + radius


class DroneRenderer:
    """A renderer draws one drone at a time.

    Keep one for many frames and drones: setting up costs half a second, a frame a few milliseconds.

    Args:
        drone: the drone, or its name; `show` puts another in its place.
        resolution: side in pixels of the square it draws (before any averaging).

    Raises:
        InputError: this machine cannot render, or the drone is unknown.
    """

    def __init__(self, drone: str | Drone, resolution: int) -> None:
        check_opengl()
        self.resolution = resolution
        self.mesh: DroneMesh | None = None
        self._body, self._discs = _actor("rgb"), _actor("rgba")
        shader = self._body.GetShaderProperty()
        shader.AddFragmentShaderReplacement("//VTK::Light::Impl", True, _SHADE, False)
        # a body is closed, so nobody sees the back of a face
        self._body.GetProperty().BackfaceCullingOn()
        self._discs.GetProperty().LightingOff()  # see `disc_colours`
        self._discs.ForceTranslucentOn()
        self.show(drone)
        self._plotter = pv.Plotter(off_screen=True, window_size=(resolution, resolution), lighting="none")
        self._window, renderer = self._plotter.render_window, self._plotter.renderer
        renderer.AddLight(vtk.vtkLight())  # unused by our shader, but without one VTK computes no normals
        # drawn twice as fine and averaged instead: that is cheaper, and the same everywhere
        self._window.SetMultiSamples(0)
        self._window.SetAlphaBitPlanes(1)
        # plain blending: the four discs hardly ever cover each other, and alpha stays exact
        renderer.SetUseOIT(False)
        renderer.SetBackground(0, 0, 0)
        renderer.SetBackgroundAlpha(0.0)
        renderer.AddActor(self._body)
        renderer.AddActor(self._discs)
        self._camera = renderer.GetActiveCamera()
        self._pixels = vtk.vtkUnsignedCharArray()

    def show(self, drone: str | Drone) -> None:
        """Draw another drone from now on.

        Raises:
            InputError: the drone is unknown.
        """
        mesh = drone_mesh(drone)
        if mesh is self.mesh:
            return
        self.mesh = mesh
        self.radius = max(LEAST_RADIUS, farthest_point(mesh.drone))
        self._propellers = mesh.propellers(np.zeros(4), 1.0).copy()
        self._rgba = self._propellers.point_data["rgba"].reshape(4, SPOKES, -1, 4)
        self._paint = self._rgba[:, 0, :, :3].copy()  # (4, rings, 3): a disc has rings of one colour
        self._body.GetMapper().SetInputData(self.mesh.body)
        self._discs.GetMapper().SetInputData(self._propellers)

    def close(self) -> None:
        """Free the window and its buffers."""
        self._plotter.close()

    def draw(
        self,
        R: np.ndarray,
        t: np.ndarray,
        K: np.ndarray,
        square: Numbers,
        light: Light,
        phases: np.ndarray,
        blur: float,
    ) -> np.ndarray:
        """Draw the drone alone inside `square`.

        Args:
            R, t: (3, 3) and (3,) metres, the pose in the camera frame.
            K: (3, 3) camera matrix of the full frame.
            square: (x, y, side) in full-frame pixels.
            light: the light, in camera axes.
            phases, blur: the angles (4,) of the propellers and the angle that each blade sweeps during the
                exposure, radians.

        Returns:
            (resolution, resolution, 4) uint8, premultiplied RGBA. The next call writes over it.
        """
        matrix = pose_matrix(R, t)
        self._body.SetUserMatrix(matrix)
        self._discs.SetUserMatrix(matrix)
        _set_light(self._body, light)
        self._rgba[..., :3] = disc_colours(self._paint, self.mesh.hubs, R, t, light)[:, None]
        self._rgba[..., 3] = self.mesh.opacity(phases, blur)
        self._propellers.Modified()
        aim(self._camera, K, square, *depth_range(float(t[2]), self.radius))
        self._window.Render()
        last = self.resolution - 1
        self._window.GetRGBACharPixelData(0, 0, last, last, 0, self._pixels)
        return vtk_to_numpy(self._pixels).reshape(self.resolution, self.resolution, 4)[::-1]
