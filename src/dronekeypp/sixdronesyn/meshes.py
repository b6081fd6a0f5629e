"""The seven drones as meshes: one opaque body each, and four propellers that spin (Sec. IV).

`drone_mesh("Mini2").body` is one triangle surface in metres, body frame, with point arrays `rgb` (uint8), `Normals` and `specular`
(0 matt .. 1 glossy). `.propellers(phases, blur_radians)` is one translucent surface: the share of the exposure in which a blade covered
a spot is that spot's opacity.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pyvista as pv

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.airframes import parts
from dronekeypp.sixdronesyn.drones import DRONES, Drone
from dronekeypp.sixdronesyn.shapes import as_polydata, merge

SPOKES = 48
# radius and chord as shares of the propeller's radius: narrow at the nut, widest at a third, a slim tip
BLADE = np.array(
    [[0.03, 0.01], [0.10, 0.07], [0.34, 0.20], [0.62, 0.165], [0.86, 0.12], [0.97, 0.085], [1.0, 0.02]]
)
BLADES = 2


def _coverage(angle: np.ndarray, half_width: np.ndarray, blur: float) -> np.ndarray:
    """Share (0..1) of the exposure in which one of two blades covers `angle` (radians ahead of the first blade's middle position).

    A blade is a box of angle, the exposure slides it through `blur` radians, and a cell of the mesh averages over its own width: three
    boxes convolved, whose closed form is a signed sum of squared ramps.
    """
    blur, cell = np.clip(blur, 0.02, 2 * np.pi), 2 * np.pi / SPOKES
    total = np.zeros(np.broadcast_shapes(angle.shape, half_width.shape))
    turn = 2 * np.pi / BLADES
    x = np.remainder(angle, turn)[..., None] - turn * np.arange(
        -1, 3
    )  # this blade and those it may meet within one whole turn
    for a in (-1, 1):
        for b in (-1, 1):
            for c in (-1, 1):
                ramp = np.maximum(x + a * half_width[..., None] + 0.5 * (b * blur + c * cell), 0.0)
                total = total + a * b * c * np.einsum("...k,...k->...", ramp, ramp)
    return np.clip(total / (2 * blur * cell), 0.0, 1.0)


@dataclass(eq=False)
class DroneMesh:
    """One drone's shapes.

    `hubs` is (4, 3), metres. `hub_clearance`, metres, is for occlusion: cast a ray from a hub to the camera and ignore what it meets of
    `body` nearer than this, which is only the top of its own motor. Anything farther, the rest of the motor and its arm included, hides
    the hub.
    """

    drone: Drone
    body: pv.PolyData
    hubs: np.ndarray
    hub_clearance: float
    _discs: pv.PolyData = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rings = len(BLADE)
        first = (np.arange(4)[:, None, None] * SPOKES + np.arange(SPOKES)[:, None]) * rings + np.arange(
            rings - 1
        )
        after = (
            np.arange(4)[:, None, None] * SPOKES + (np.arange(SPOKES)[:, None] + 1) % SPOKES
        ) * rings + np.arange(rings - 1)
        a, b, c, d = (block.ravel() for block in (first, first + 1, after + 1, after))
        faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
        self._radius = BLADE[:, 0] * self.drone.propeller_radius
        self._half = BLADE[:, 1] / BLADE[:, 0] / 2
        angle = np.arange(SPOKES) * (2 * np.pi / SPOKES)
        self._spokes = np.stack([np.cos(angle), np.sin(angle)], -1)
        colour = np.tile(np.asarray(self.drone.propeller_rgb, np.uint8), (4, SPOKES, rings, 1))
        colour[:, :, -2:] = self.drone.tip_rgb
        rgba = np.concatenate([colour, np.zeros((4, SPOKES, rings, 1), np.uint8)], -1).reshape(-1, 4)
        self._discs = as_polydata(np.zeros((4 * SPOKES * rings, 3), np.float32), faces)
        self._discs.point_data["rgba"] = rgba
        self._discs.point_data["Normals"] = np.tile(np.float32([0, 0, 1]), (len(rgba), 1))
        self._discs.point_data.active_normals_name = "Normals"
        level = np.zeros((SPOKES, rings, 1))
        where = self.hubs[:, None, None] + np.concatenate(
            [self._radius[:, None] * self._spokes[:, None], level], -1
        )
        self._discs.points = where.reshape(-1, 3).astype(np.float32)

    def propellers(self, phases: np.ndarray, blur_radians: float) -> pv.PolyData:
        """The four propellers during one exposure, opacity in `point_data['rgba']` (uint8).

        `phases` (4,): radians from body x to a blade at mid-exposure, keypoint order, counter-clockwise from above. `blur_radians`: how far
        each propeller turns during the exposure; 0 gives still blades, from pi on a nearly even disc. Each call refills the same PolyData:
        copy it to keep it. Raises InputError on the wrong shape or a negative blur.
        """
        phases = np.asarray(phases, float)
        if (
            phases.shape != (4,)
            or not np.isfinite(phases).all()
            or not np.isfinite(blur_radians)
            or blur_radians < 0
        ):
            raise InputError(
                f"propellers: phases {phases.shape}, blur {blur_radians}: give four angles and a blur of 0 or more, radians"
            )
        angle = np.arange(SPOKES) * (2 * np.pi / SPOKES) - phases[:, None]
        alpha = _coverage(angle[:, :, None], self._half, float(blur_radians))
        self._discs.point_data["rgba"][:, 3] = np.rint(255 * alpha).astype(np.uint8).ravel()
        self._discs.Modified()
        return self._discs


@cache
def drone_mesh(name: str) -> DroneMesh:
    """The mesh of drone `name` (a key of `DRONES`), built once. Raises InputError on an unknown name."""
    if name not in DRONES:
        raise InputError(f"drone {name!r} is unknown; choose one of {', '.join(DRONES)}")
    drone = DRONES[name]
    body = merge(parts(name)) if drone.mesh is None else read_body(drone)
    return DroneMesh(drone, body, drone.hubs, hub_clearance=1.15 * drone.motor_radius)


def read_body(drone: Drone) -> pv.PolyData:
    """The mesh of a drone of your own, as `merge` makes those of the seven. Raises InputError if it is none, or not of a drone's size."""
    try:
        mesh = pv.read(drone.mesh).extract_surface(algorithm="dataset_surface").triangulate()
        colours = next(
            (
                np.asarray(mesh.point_data[name])[:, :3]
                for name in ("RGB", "rgb", "RGBA")
                if name in mesh.point_data
            ),
            None,
        )
        mesh.clear_data()
        if colours is not None:
            whole = (
                255 * colours if np.issubdtype(colours.dtype, np.floating) and colours.max() <= 1 else colours
            )
            mesh.point_data["rgb"] = np.asarray(np.clip(whole, 0, 255), np.uint8)
        mesh = mesh.compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=38.0, auto_orient_normals=True
        )
    except Exception as error:  # PyVista's readers and filters have no common one
        raise InputError(
            f"{drone.mesh}: not a mesh that PyVista reads ({str(error).splitlines()[0]})"
        ) from None
    mesh.points = (np.asarray(mesh.points, float) * drone.mesh_scale).astype(np.float32)
    size = np.ptp(np.asarray(mesh.points), axis=0).max()
    if not 0.5 < size / drone.wheelbase < 4:
        raise InputError(
            f"{drone.mesh}: {size:.3g} m large, but its hubs are {drone.wheelbase:.3g} m apart; is mesh_unit right?"
        )
    away = np.linalg.norm(np.asarray(mesh.points).mean(axis=0) - drone.hubs.mean(axis=0))
    if away > drone.wheelbase:
        raise InputError(
            f"{drone.mesh}: its middle is {away:.3g} m away from that of its hubs; do both have the same origin and axes?"
        )
    if "rgb" not in mesh.point_data:
        mesh.point_data["rgb"] = np.tile(np.uint8(drone.hull_rgb), (mesh.n_points, 1))
    mesh.point_data["specular"] = np.full(mesh.n_points, 0.25, np.float32)
    return mesh
