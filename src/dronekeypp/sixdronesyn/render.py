"""Draws one drone as one camera sees it, over a panorama, off-screen with VTK.

Full frames and crops go through the same steps: the panorama is sampled at the frame's own pixels, the drone is drawn finer and averaged. So a
crop is the picture that the full frame would give there.
"""

import os
import subprocess
import sys

import cv2
import numpy as np
import pyvista as pv
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from dronekeypp.camera import crop_image
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.meshes import drone_mesh

# VTK's view coordinates have y up and z towards the viewer; OpenCV's camera axes have y down and z forward.
_VIEW_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])

# Our own light instead of VTK's: a sun, a sky above and a ground below, in linear light, then the power 1/2.2 of a pixel. Per fragment.
_SHADE = """
  vec3 n = normalVCVSOutput;
  vec3 albedo = pow(diffuseColor, vec3(2.2));
  vec3 ambient = mix(groundColour, skyColour, 0.5 + 0.5 * dot(n, upVC));
  float facing = dot(n, sunVC);
  vec3 toEye = normalize(-vertexVC.xyz);
  float shine = pow(max(0.0, dot(n, normalize(sunVC + toEye))), 40.0) * step(0.0, facing);
  float rim = pow(1.0 - max(0.0, dot(n, toEye)), 4.0);
  vec3 sky = mix(groundColour, skyColour, 0.5 + 0.5 * dot(reflect(-toEye, n), upVC));
  vec3 light = albedo * (sunColour * max(0.0, facing) + ambient) + gloss * (sunColour * shine + (0.04 + 0.4 * rim) * sky);
  gl_FragData[0] = vec4(pow(clamp(light, 0.0, 1.0), vec3(1.0 / 2.2)), opacity);
"""


_CHECKED = "DRONEKEYPP_OPENGL_CHECKED"


def check_opengl():
    """Draw one triangle in a process of its own: without an OpenGL library VTK does not raise, it crashes.

    Raises:
        InputError: this machine cannot render; the message names the package to install.
    """
    if os.environ.get(_CHECKED):  # by the process that started this one
        return
    probe = "import dronekeypp.sixdronesyn, pyvista as pv; p = pv.Plotter(off_screen=True); p.add_mesh(pv.Triangle()); p.screenshot()"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True)
    if done.returncode != 0:
        raise InputError(
            "this machine has no OpenGL library to render with; on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri "
            "(training and evaluation need none)"
        )
    os.environ[_CHECKED] = "1"


def _actor(mesh, rgba):
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(mesh)
    mapper.SetScalarModeToUsePointFieldData()
    mapper.SelectColorArray(rgba)
    mapper.SetColorModeToDirectScalars()
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetShaderProperty().AddFragmentShaderReplacement("//VTK::Light::Impl", True, _SHADE, False)
    return actor


class DroneRenderer:
    """Draws one drone type. Keep one for many frames: setting up costs a second, a frame a few milliseconds.

    Args:
        name: the drone, a key of `DRONES`.
        resolution: side in pixels of the square it draws (before any averaging).
    """

    def __init__(self, name, resolution):
        check_opengl()
        self.mesh = drone_mesh(name)
        self.resolution = resolution
        self._body = _actor(self.mesh.body, "rgb")
        discs = self.mesh.propellers(np.zeros(4), 1.0)
        self._discs = _actor(discs, "rgba")
        self._discs.ForceTranslucentOn()
        self._plotter = pv.Plotter(off_screen=True, window_size=(resolution, resolution), lighting="none")
        self._window, renderer = self._plotter.render_window, self._plotter.renderer
        renderer.AddLight(vtk.vtkLight())  # unused by our shader, but without one VTK computes no normals
        self._window.SetMultiSamples(
            0
        )  # drawn twice as fine and averaged instead: cheaper, and the same everywhere
        self._window.SetAlphaBitPlanes(1)
        renderer.SetUseOIT(
            False
        )  # plain blending: the four discs never cover each other much, and alpha stays exact
        renderer.SetBackground(0, 0, 0)
        renderer.SetBackgroundAlpha(0.0)
        for actor in (self._body, self._discs):
            renderer.AddActor(actor)
        self._camera = renderer.GetActiveCamera()
        self._camera.SetPosition(0, 0, 0)
        self._camera.SetFocalPoint(0, 0, 1)
        self._camera.SetViewUp(0, -1, 0)
        self._pixels = vtk.vtkUnsignedCharArray()

    def close(self):
        self._plotter.close()

    def draw(self, R, t, K, square, light, phases, blur):
        """Premultiplied RGBA (resolution, resolution, 4) uint8 of the drone alone inside `square`.

        Args:
            R, t: (3, 3) and (3,) metres, pose in the camera frame.
            K: (3, 3) camera matrix of the full frame.
            square: (x, y, side) in full-frame pixels.
            light: dict of `sun`, `up` (unit vectors in camera axes) and `sun_colour`, `sky_colour`, `ground_colour` (linear RGB).
            phases, blur: propeller angles (4,) and the angle each blade sweeps during the exposure, radians.
        """
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, t
        matrix = vtk.vtkMatrix4x4()
        matrix.DeepCopy(pose.ravel())
        self.mesh.propellers(phases, blur)
        for actor, gloss in ((self._body, 0.35), (self._discs, 0.15)):
            actor.SetUserMatrix(matrix)
            uniforms = actor.GetShaderProperty().GetFragmentCustomUniforms()
            for key, vector in (
                ("sunVC", _VIEW_FROM_CAMERA @ light["sun"]),
                ("upVC", _VIEW_FROM_CAMERA @ light["up"]),
            ):
                uniforms.SetUniform3f(key, vector.tolist())
            for key, colour in (
                ("sunColour", "sun_colour"),
                ("skyColour", "sky_colour"),
                ("groundColour", "ground_colour"),
            ):
                uniforms.SetUniform3f(key, np.asarray(light[colour], dtype=float).tolist())
            uniforms.SetUniformf("gloss", gloss)
        x, y, side = (float(v) for v in square)
        half = side / 2
        # One off-centre camera: the window's centre, in half-sides from the principal point.
        self._camera.SetViewAngle(2 * np.degrees(np.arctan(half / K[1, 1])))
        self._camera.SetWindowCenter((x + half - K[0, 2]) / half, -(y + half - K[1, 2]) / half)
        distance = float(t[2])
        self._camera.SetClippingRange(max(0.05, distance - 1), distance + 1)
        self._window.Render()
        last = self.resolution - 1
        self._window.GetRGBACharPixelData(0, 0, last, last, 0, self._pixels)
        return vtk_to_numpy(self._pixels).reshape(self.resolution, self.resolution, 4)[::-1]


class SelfOcclusion:
    """Which propeller hubs the drone's own body hides. Ray casting in double precision: the same on every machine, unlike a depth buffer."""

    def __init__(self, name):
        self.mesh = drone_mesh(name)
        self._locator = vtk.vtkStaticCellLocator()
        self._locator.SetDataSet(self.mesh.body)
        self._locator.BuildLocator()

    def visible(self, hubs, R, t):
        """(4,) bool: nothing of the body lies between the camera and each hub (4, 3) (body axes, metres)."""
        eye = -R.T @ t
        seen = []
        for hub in hubs:
            way = eye - hub
            start = hub + way / np.linalg.norm(way) * self.mesh.hub_clearance  # leaves its own motor cap out
            seen.append(
                not self._locator.IntersectWithLine(
                    start, eye, 1e-9, vtk.reference(0.0), [0.0] * 3, [0.0] * 3, vtk.reference(0)
                )
            )
        return np.array(seen)


def composite(drone, background):
    """Lay a premultiplied RGBA drone over an RGB background of the same size; both uint8."""
    alpha = drone[..., 3:].astype(np.uint16)
    return (drone[..., :3] + ((255 - alpha) * background + 127) // 255).clip(0, 255).astype(np.uint8)


def directions(K, camera_R, x0, y0, x1, y1):
    """World directions (y1 − y0, x1 − x0, 3) of the full frame's pixel centres in the window; `camera_R` is camera←world."""
    x, y = np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5)
    v = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], -1)
    return (v @ camera_R).astype(np.float32)


def window_around(square, width, height):
    """The whole pixels (x, y, side) of a `width` × `height` frame that hold `square` and the pixels next to it."""
    side = int(
        min(np.ceil(square[2]) + 3, width, height)
    )  # and a pixel on each side, which interpolation at the edge reads
    corner = np.floor(square[:2]).astype(int) - 1
    return int(np.clip(corner[0], 0, width - side)), int(np.clip(corner[1], 0, height - side)), side


def draw_crop(renderer, background, square, window, size, **view):
    """The crop `square`, `size` pixels wide.

    Args:
        renderer: a `DroneRenderer`.
        background: (side, side, 3) uint8, the panorama at the frame's own pixels in `window`.
        square: (x, y, side) in full-frame pixels.
        window: the whole pixels around it, from `window_around`.
        view: the other arguments of `DroneRenderer.draw`.

    Returns:
        (size, size, 3) uint8 RGB.
    """
    local = np.array([square[0] - window[0], square[1] - window[1], square[2]])
    if square[2] >= size:  # the camera has more pixels than we keep: average
        drone = cv2.resize(renderer.draw(square=square, **view), (size, size), interpolation=cv2.INTER_AREA)
        return composite(drone, crop_image(background, local, size))
    # The camera has fewer pixels than `size`: draw at the camera's own pixels, then enlarge, as cutting the full frame would.
    side = window[2]
    drone = cv2.resize(renderer.draw(square=window, **view), (side, side), interpolation=cv2.INTER_AREA)
    return crop_image(composite(drone, background), local, size)


def draw_frame(renderer, background, square, **view):
    """The full frame: `background` (H, W, 3) with the drone drawn inside `square` (whole pixels) at twice the frame's resolution, averaged."""
    x, y, side = (int(v) for v in square)
    drone = cv2.resize(renderer.draw(square=square, **view), (side, side), interpolation=cv2.INTER_AREA)
    picture = background.copy()
    picture[y : y + side, x : x + side] = composite(drone, picture[y : y + side, x : x + side])
    return picture
