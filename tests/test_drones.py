"""The seven drones: numbers and meshes. No rendering."""

import subprocess
import sys

import numpy as np
import pytest
import pyvista as pv

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import airframes, meshes, shapes
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.meshes import drone_mesh

each = pytest.mark.parametrize("name", DRONES)


def _hits(mesh: pv.PolyData, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distances along a ray to every triangle that it meets (Möller and Trumbore)."""
    points = np.asarray(mesh.points, float)
    a, b, c = points[mesh.faces.reshape(-1, 4)[:, 1:]].transpose(1, 0, 2)
    u, v = b - a, c - a
    cross = np.cross(direction, v)
    size = np.einsum("ij,ij->i", u, cross)
    size = np.where(np.abs(size) < 1e-15, np.inf, size)
    first = np.einsum("ij,ij->i", origin - a, cross) / size
    origin_cross = np.cross(origin - a, u)
    second = origin_cross @ direction / size
    distance = np.einsum("ij,ij->i", v, origin_cross) / size
    return distance[(first >= 0) & (second >= 0) & (first + second <= 1) & (distance > 0)]


def test_order_and_labels() -> None:
    assert list(DRONES) == ["Mini3", "Mini2", "Air3", "Air2", "Mav2", "Mav3", "Tello"]
    assert [drone.index for drone in DRONES.values()] == list(range(7))
    assert len({drone.label for drone in DRONES.values()}) == 7


@each
def test_hubs(name: str) -> None:
    drone = DRONES[name]
    hubs = drone.hubs
    # front-left, front-right, rear-right, rear-left, clockwise from above
    assert (np.sign(hubs[:, 0]) == [1, 1, -1, -1]).all() and (np.sign(hubs[:, 1]) == [1, -1, -1, 1]).all()
    np.testing.assert_allclose(hubs[[1, 2]], hubs[[0, 3]] * [1, -1, 1], atol=0)
    assert np.linalg.svd(hubs - hubs.mean(axis=0))[1][2] < 1e-12  # coplanar
    # Mini 2's measured hubs give 215 mm against a published 213
    tolerance = 0.01 if name == "Mini2" else 1e-9
    assert np.linalg.norm(hubs[0] - hubs[2]) == pytest.approx(drone.wheelbase, rel=tolerance)
    distances = np.linalg.norm((hubs[:, None] - hubs)[..., :2], axis=-1)[np.triu_indices(4, 1)]
    assert distances.min() >= drone.propeller_diameter, "two propellers would meet"
    with pytest.raises(ValueError):
        hubs[0, 0] = 0.0


def test_mini2_hubs_are_its_makers() -> None:
    mm = DRONES["Mini2"].hubs * 1000
    np.testing.assert_allclose(mm[[0, 3]], [[64.3, 87.8, 24.7], [-61.1, 85.5, 3.2]])


def test_which_rotors_are_higher() -> None:
    rise = {name: drone.hubs[0, 2] - drone.hubs[3, 2] for name, drone in DRONES.items()}
    assert rise["Mini3"] < 0 and rise["Tello"] == 0
    for name in ("Mini2", "Air3", "Air2", "Mav2", "Mav3"):
        assert rise[name] > 0.005


@each
def test_body_has_the_published_size(name: str) -> None:
    drone, body = DRONES[name], drone_mesh(name).body
    expected = np.array(drone.body_mm, float)
    if drone.box_between_axes:
        expected[:2] += 2000 * drone.motor_radius
    np.testing.assert_allclose(np.ptp(body.points, axis=0) * 1000, expected, rtol=0.065)


@each
def test_body_is_one_clean_coloured_surface(name: str) -> None:
    body = drone_mesh(name).body
    faces = body.faces.reshape(-1, 4)
    assert (faces[:, 0] == 3).all() and 3000 < len(faces) <= 15000
    assert body.point_data["rgb"].dtype == np.uint8 and body.point_data["rgb"].shape == (body.n_points, 3)
    assert len(np.unique(body.point_data["rgb"], axis=0)) >= 6
    np.testing.assert_allclose(np.linalg.norm(body.point_data["Normals"], axis=1), 1, atol=1e-4)
    gloss = body.point_data["specular"]
    assert 0 <= gloss.min() < gloss.max() <= 1
    # stored normals and winding both look outward
    corners = np.asarray(body.points, float)[faces[:, 1:]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agree = np.einsum("ij,ij->i", normal, body.point_data["Normals"][faces[:, 1]]) > 0
    weight = np.linalg.norm(normal, axis=1)
    assert (weight * agree).sum() > 0.995 * weight.sum()


@each
def test_arms_and_motors_are_symmetric(name: str) -> None:
    points = np.asarray(drone_mesh(name).body.points, float)
    outside = points[np.abs(points[:, 1]) > 0.055 * DRONES[name].wheelbase / 0.2]
    left = outside[outside[:, 1] > 0]
    right = outside[outside[:, 1] < 0] * [1, -1, 1]
    left = np.unique(np.round(left * 1e5).astype(int), axis=0)
    right = np.unique(np.round(right * 1e5).astype(int), axis=0)
    assert len(left) > 200
    np.testing.assert_array_equal(left, right)


@each
def test_propellers_clear_the_body(name: str) -> None:
    drone, points = DRONES[name], np.asarray(drone_mesh(name).body.points)
    for hub in drone.hubs:
        distance = np.linalg.norm(points[:, :2] - hub[:2], axis=1)
        assert points[distance < drone.propeller_radius, 2].max() < hub[2]


@each
def test_a_hub_is_seen_from_above_and_hidden_from_below(name: str) -> None:
    mesh = drone_mesh(name)
    for hub in mesh.hubs:
        outward = hub * [1, 1, 0] / np.linalg.norm(hub[:2])
        above = np.array([0.013, 0.007, 1.0])
        for direction in (above, 0.9 * outward + [0, 0, 0.5], 1.0 * outward + [0, 0, 0.1]):
            direction = direction / np.linalg.norm(direction)
            assert not (_hits(mesh.body, hub, direction) > mesh.hub_clearance).any()
        assert (_hits(mesh.body, hub, np.array([0.013, 0.007, -1.0])) > mesh.hub_clearance).any()


@each
def test_propellers(name: str) -> None:
    drone, mesh = DRONES[name], drone_mesh(name)
    discs = mesh.propellers(np.zeros(4), 1.0)
    points = np.asarray(discs.points, float).reshape(4, -1, 3)
    np.testing.assert_allclose(points.mean(axis=1), drone.hubs, atol=1e-6)
    radius = np.linalg.norm(points - drone.hubs[:, None], axis=2).max()
    assert radius == pytest.approx(drone.propeller_diameter / 2, rel=1e-5)
    assert np.ptp(points[..., 2], axis=1).max() < 1e-6
    rgba = discs.point_data["rgba"]
    assert rgba.dtype == np.uint8 and rgba.shape == (discs.n_points, 4)


def test_blur_only_spreads_the_blades() -> None:
    mesh = drone_mesh("Mini2")
    alpha = {}  # of the first propeller, (spokes, rings)
    for blur in (0.0, 1.0, np.pi, 2 * np.pi, 40.0):
        rgba = mesh.propellers(np.full(4, 0.3), blur).point_data["rgba"]
        alpha[blur] = rgba[:, 3].reshape(4, 48, -1)[0].astype(float)
    for blur in (1.0, np.pi, 2 * np.pi, 40.0):
        # the same blade, only smeared
        np.testing.assert_allclose(alpha[blur].mean(axis=0), alpha[0.0].mean(axis=0), atol=1.0)
    assert np.ptp(alpha[2 * np.pi], axis=0).max() <= 1  # whole turns: an even disc
    assert alpha[0.0][:, 3].max() > 240 and alpha[0.0][:, 3].min() == 0
    # a still blade lies at its phase: 0.3 rad is 2.3 spokes
    assert alpha[0.0][:, 4].argmax() in (2, 26)


def test_bad_input_says_so() -> None:
    with pytest.raises(InputError, match="Mini9.*choose one of Mini3"):
        drone_mesh("Mini9")
    with pytest.raises(InputError, match="four angles"):
        drone_mesh("Tello").propellers(np.zeros(3), 1.0)
    with pytest.raises(InputError, match="0 or more"):
        drone_mesh("Tello").propellers(np.zeros(4), -1.0)


@each
def test_meshes_are_deterministic(name: str) -> None:
    body, rebuilt = drone_mesh(name).body, shapes.merge(airframes.parts(DRONES[name]))
    assert drone_mesh(name) is meshes.drone_mesh(name)
    np.testing.assert_array_equal(rebuilt.points, body.points)
    np.testing.assert_array_equal(rebuilt.faces, body.faces)
    np.testing.assert_array_equal(rebuilt["rgb"], body["rgb"])
    np.testing.assert_array_equal(rebuilt["Normals"], body["Normals"])


def _area(part: shapes.Part) -> float:
    corners = part.points[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.linalg.norm(normals, axis=1).sum() / 2


def test_painting_cuts_along_the_border() -> None:
    cube = shapes.block((0, 0, 0), (10, 10, 10), (100, 100, 100))
    painted = shapes.painted(cube, (255, 0, 0), z=(2.0, 50.0), y=(-3.0, 50.0))
    red = painted.points[(painted.rgb == [255, 0, 0]).all(axis=1)]
    assert red[:, 2].min() == pytest.approx(2.0)
    assert red[:, 1].min() == pytest.approx(-3.0)
    assert _area(painted) == pytest.approx(_area(cube))


def test_a_network_can_be_loaded_after_rendering() -> None:
    """Two copies of LLVM in one process, the renderer's and Triton's, once ended it without a word."""
    code = (
        "import dronekeypp.sixdronesyn, pyvista\n"
        "plotter = pyvista.Plotter(off_screen=True)\n"
        "plotter.add_mesh(pyvista.Triangle())\n"
        "plotter.screenshot()\n"
        "from dronekeypp.model import DroneKeyPP\n"
        "print(DroneKeyPP.method)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "DroneKey++\n", (done.returncode, done.stderr)
