"""Build the seven drones as meshes: one opaque body each, and four propellers that spin (Sec. IV).

`drone_mesh("Mini2").body` is one triangle surface in metres, body frame, with the point arrays `rgb` (uint8),
`Normals` and `specular` (0 is matt, 1 is glossy). `.propellers(phases, blur_radians)` is one translucent
surface: the opacity of a spot is the share of the exposure in which a blade covered it.
"""

import warnings
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pyvista as pv

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import airframes, quadrotor_bodies
from dronekeypp.sixdronesyn.drones import Drone, find_drone
from dronekeypp.sixdronesyn.mesh_files import check_mesh
from dronekeypp.sixdronesyn.shapes import as_polydata, merge

SPOKES = 48  # points around a propeller disc
# Radius and chord as shares of the propeller's radius: narrow at the nut, widest at a third, a slim tip.
BLADE = np.array(
    [[0.03, 0.01], [0.10, 0.07], [0.34, 0.20], [0.62, 0.165], [0.86, 0.12], [0.97, 0.085], [1.0, 0.02]]
)
BLADE_HALF_ANGLE = BLADE[:, 1] / BLADE[:, 0] / 2  # radians, as seen from the hub


def _coverage(angle: np.ndarray, half_width: np.ndarray, blur: float, blades: int = 2) -> np.ndarray:
    """Return the share (0 to 1) of the exposure in which one of the blades covers a direction.

    A blade is a box function of the angle. The exposure slides it through `blur` radians, and a cell of the
    mesh averages over its own width. That makes three boxes convolved; the closed form of the convolution is
    a signed sum of squared ramps.

    Args:
        angle: radians ahead of the first blade's middle position, (4, SPOKES, 1).
        half_width: half the angle that a blade fills, radians, (len(BLADE),).
        blur: the angle that a blade sweeps during the exposure, radians.
        blades: how many blades a propeller has.
    """
    blur = np.clip(blur, 0.02, 2 * np.pi)
    cell = 2 * np.pi / SPOKES
    turn = 2 * np.pi / blades
    # the angle to the nearest blade and to those that may reach this direction within one whole turn
    x = np.remainder(angle, turn)[..., None] - turn * np.arange(-(blades // 2), blades // 2 + 2)
    total = np.zeros(np.broadcast_shapes(angle.shape, half_width.shape))
    for a in (-1, 1):
        for b in (-1, 1):
            for c in (-1, 1):
                ramp = np.maximum(x + a * half_width[..., None] + 0.5 * (b * blur + c * cell), 0.0)
                total = total + a * b * c * np.einsum("...k,...k->...", ramp, ramp)
    return np.clip(total / (2 * blur * cell), 0.0, 1.0)


@dataclass(eq=False)
class DroneMesh:
    """A drone mesh holds the shapes of one drone.

    `hubs` is (4, 3), metres, body frame. `hub_clearance`, metres, is for occlusion: cast a ray from a hub to
    the camera and ignore what it meets of `body` nearer than this, because that is only the top of the hub's
    own motor. Everything farther, the rest of the motor and its arm included, hides the hub.
    """

    drone: Drone
    body: pv.PolyData
    hubs: np.ndarray
    hub_clearance: float
    _discs: pv.PolyData = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rings = len(BLADE)
        # two triangles between every two neighbouring spokes and rings of each disc
        corner = np.arange(4 * SPOKES * rings).reshape(4, SPOKES, rings)
        next_corner = np.roll(corner, -1, axis=1)
        a = corner[:, :, :-1].ravel()
        b = corner[:, :, 1:].ravel()
        c = next_corner[:, :, 1:].ravel()
        d = next_corner[:, :, :-1].ravel()
        faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])

        angle = np.arange(SPOKES) * (2 * np.pi / SPOKES)
        spokes = np.stack([np.cos(angle), np.sin(angle)], -1)
        radius = BLADE[:, 0] * self.drone.propeller_radius
        level = np.zeros((SPOKES, rings, 1))
        disc = np.concatenate([radius[:, None] * spokes[:, None], level], -1)  # (SPOKES, rings, 3)
        points = (self.hubs[:, None, None] + disc).reshape(-1, 3).astype(np.float32)

        colour = np.tile(np.asarray(self.drone.propeller_rgb, np.uint8), (4, SPOKES, rings, 1))
        if self.drone.rear_propeller_rgb is not None:
            colour[2:] = self.drone.rear_propeller_rgb
        if self.drone.rear_propeller_rgb is None or self.drone.tip_rgb != self.drone.propeller_rgb:
            colour[:, :, -2:] = self.drone.tip_rgb
        opacity = np.zeros((4, SPOKES, rings, 1), np.uint8)  # `propellers` fills it in

        self._discs = as_polydata(points, faces)
        self._discs.point_data["rgba"] = np.concatenate([colour, opacity], -1).reshape(-1, 4)
        self._discs.point_data["Normals"] = np.tile(np.array([0, 0, 1], np.float32), (len(points), 1))
        self._discs.point_data.active_normals_name = "Normals"

    def propellers(self, phases: np.ndarray, blur_radians: float) -> pv.PolyData:
        """Return the four propellers during one exposure.

        Their opacity is in `point_data['rgba']` (uint8). Each call refills the same PolyData: copy it to keep
        it. The arguments and the errors are those of `opacity`.
        """
        self._discs.point_data["rgba"][:, 3] = self.opacity(phases, blur_radians).ravel()
        self._discs.Modified()
        return self._discs

    def opacity(self, phases: np.ndarray, blur_radians: float) -> np.ndarray:
        """Return the opacity of the four propellers during one exposure, (4, spokes, rings) uint8.

        Args:
            phases: (4,) radians from body x to a blade in the middle of the exposure, in keypoint order,
                counter-clockwise as seen from above.
            blur_radians: how far each propeller turns during the exposure. 0 gives still blades; from pi on
                the disc is nearly even.

        Raises:
            InputError: the shape is wrong, an angle is not finite, or the blur is negative.
        """
        phases = np.asarray(phases, float)
        usable_phases = phases.shape == (4,) and np.isfinite(phases).all()
        usable_blur = np.isfinite(blur_radians) and blur_radians >= 0
        if not usable_phases or not usable_blur:
            raise InputError(
                f"propellers: phases {phases.shape}, blur {blur_radians}: "
                "give four angles and a blur of 0 or more, radians"
            )
        angle = np.arange(SPOKES) * (2 * np.pi / SPOKES) - phases[:, None]
        half_width = self.drone.blade_width * BLADE_HALF_ANGLE
        alpha = _coverage(angle[:, :, None], half_width, float(blur_radians), self.drone.blades)
        return np.rint(255 * alpha).astype(np.uint8)


def drone_mesh(drone: str | Drone) -> DroneMesh:
    """Return the mesh of a drone or of its name (see `find_drone`). It is built once.

    Raises:
        InputError: the name is unknown, or the mesh of your own cannot be used.
    """
    return _drone_mesh(find_drone(drone) if isinstance(drone, str) else drone)


@lru_cache(maxsize=16)
def _drone_mesh(drone: Drone) -> DroneMesh:
    if drone.mesh is not None:
        body = read_body(drone)
    elif drone.number is not None:
        body = merge(quadrotor_bodies.parts(drone))
    else:
        body = merge(airframes.parts(drone))
    return DroneMesh(drone, body, drone.hubs, hub_clearance=1.15 * drone.motor_radius)


def _point_colours(mesh: pv.PolyData) -> np.ndarray | None:
    """Return the colours (P, 3) uint8 that a mesh file gives its points, or None where it gives none."""
    for name in ("RGB", "rgb", "RGBA"):
        if name in mesh.point_data:
            colours = np.asarray(mesh.point_data[name])[:, :3]
            if np.issubdtype(colours.dtype, np.floating) and colours.max() <= 1:
                colours = 255 * colours
            return np.asarray(np.clip(colours, 0, 255), np.uint8)
    return None


def read_body(drone: Drone) -> pv.PolyData:
    """Read the mesh of a drone of your own.

    It gets the same point arrays as `merge` gives the meshes of the seven.

    Raises:
        InputError: the file holds no mesh, or the mesh does not fit the drone's hubs in size or position.
    """
    check_mesh(drone.mesh)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "The VTK reader")
            mesh = pv.read(drone.mesh)
        mesh = mesh.extract_surface(algorithm="dataset_surface").triangulate()
        colours = _point_colours(mesh)
        mesh.clear_data()
        if colours is not None:
            mesh.point_data["rgb"] = colours
        mesh = mesh.compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=38.0, auto_orient_normals=True
        )
    except Exception as error:  # PyVista's readers and filters have no common one
        reason = str(error).splitlines()[0]
        raise InputError(f"{drone.mesh}: not a mesh that PyVista reads ({reason})") from None
    if not mesh.n_points or not np.isfinite(mesh.points).all():
        raise InputError(f"{drone.mesh}: holds no point, or one that is not finite; export it again")
    mesh.points = (np.asarray(mesh.points, float) * drone.mesh_scale).astype(np.float32)
    size = np.ptp(np.asarray(mesh.points), axis=0).max()
    if not 0.5 < size / drone.wheelbase < 4:
        raise InputError(
            f"{drone.mesh}: {size:.3g} m large, but its hubs are {drone.wheelbase:.3g} m apart; "
            "is mesh_unit right?"
        )
    offset = np.linalg.norm(np.asarray(mesh.points).mean(axis=0) - drone.hubs.mean(axis=0))
    if offset > drone.wheelbase:
        raise InputError(
            f"{drone.mesh}: its middle is {offset:.3g} m away from that of its hubs; "
            "do both have the same origin and axes?"
        )
    if "rgb" not in mesh.point_data:
        mesh.point_data["rgb"] = np.tile(np.array(drone.hull_rgb, np.uint8), (mesh.n_points, 1))
    mesh.point_data["specular"] = np.full(mesh.n_points, 0.25, np.float32)
    return mesh
