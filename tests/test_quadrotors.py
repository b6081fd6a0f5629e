"""Random quadrotors: their numbers, hubs, propellers and bodies. No rendering."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bodies import floating, is_closed

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import (
    meshes,
    quadrotor_bodies,
    quadrotor_enterprise,
    quadrotor_extras,
    quadrotor_frames,
    quadrotor_hulls,
    quadrotor_small,
    quadrotors,
    shapes,
)
from dronekeypp.sixdronesyn.drones import DRONES, find_drone
from dronekeypp.sixdronesyn.meshes import DroneMesh
from dronekeypp.sixdronesyn.quadrotor_plan import DESIGN, GAP, plan_of, scaled, tube
from dronekeypp.sixdronesyn.quadrotors import FAMILIES, WHEELBASE, quadrotor
from dronekeypp.sixdronesyn.scenes import reach

MANY = [quadrotor(number) for number in range(200)]
# two of each family
BUILT = [number for name in FAMILIES for number in [d.number for d in MANY if d.family == name][:2]]
each = pytest.mark.parametrize("number", BUILT)
# more of each family, and those that once had parts in the air, parts left out, or no front
ONCE_WRONG = [3, 6, 13, 17, 46, 49, 63, 75, 84, 93, 101, 114, 120, 169, 190, 196, 208, 250, 259, 432]
WATCHED = sorted({*BUILT, *range(10), *ONCE_WRONG})


@cache
def parts(number: int) -> list[shapes.Part]:
    return quadrotor_bodies.parts(quadrotor(number))


@cache
def points(number: int) -> np.ndarray:
    """All points of a quadrotor's body in metres."""
    return np.concatenate([part.points[np.unique(part.faces)] for part in parts(number)]) / 1000


def test_names() -> None:
    assert quadrotors.name_of(17) == "Quad17" and quadrotors.number_of("Quad17") == 17
    for name in ("Mini2", "Quad", "Quad017", "Quad-1", "quad1", "Quad1.0", "Quad1x"):
        assert quadrotors.number_of(name) is None
    drone = find_drone("Quad17")
    assert drone.name == "Quad17" and drone.label == "Quadrotor 17" and drone.index == drone.number == 17
    with pytest.raises(InputError, match="count from 0"):
        quadrotor(-1)


def test_eight_of_ten_numbers_train_one_validates_one_tests() -> None:
    splits = [quadrotors.split_of(number) for number in range(100)]
    assert (splits.count("train"), splits.count("val"), splits.count("test")) == (80, 10, 10)


def test_a_quadrotor_follows_from_seed_and_number() -> None:
    drone = MANY[5]
    quadrotor.cache_clear()
    again, other = quadrotor(5), quadrotor(5, seed=1)
    assert again == drone and again is not drone
    np.testing.assert_array_equal(again.hubs, drone.hubs)
    assert (
        again.wheelbase == drone.wheelbase and again.mass == drone.mass and again.hull_rgb == drone.hull_rgb
    )
    assert other != drone and other.wheelbase != drone.wheelbase
    assert replace(drone, body_seed=1) != drone and drone.digest is other.digest is None
    assert len({one.wheelbase for one in MANY}) == len(MANY)


def test_wheelbases_are_log_uniform() -> None:
    logs = np.log([drone.wheelbase for drone in MANY])
    low, high = np.log(WHEELBASE)
    assert low <= logs.min() and logs.max() <= high
    counts = np.histogram(logs, bins=4, range=(low, high))[0]
    assert counts.min() > 30  # of 50 expected


def test_the_first_sixty_cover_all_families_at_their_sizes() -> None:
    assert {drone.family for drone in MANY[:60]} == set(FAMILIES)
    for drone in MANY:
        low, high = FAMILIES[drone.family].size
        assert low <= drone.wheelbase <= high


def test_hubs() -> None:
    for drone in MANY:
        hubs = drone.hubs
        # front-left, front-right, rear-right, rear-left, clockwise from above
        assert (np.sign(hubs[:, 0]) == [1, 1, -1, -1]).all() and (np.sign(hubs[:, 1]) == [1, -1, -1, 1]).all()
        np.testing.assert_array_equal(hubs[[1, 2]], hubs[[0, 3]] * [1, -1, 1])
        assert np.linalg.svd(hubs - hubs.mean(axis=0))[1][2] < 1e-12  # coplanar
        assert np.linalg.norm(hubs[0] - hubs[2]) == pytest.approx(drone.wheelbase, rel=1e-9)
        assert abs(hubs[0, 0] + hubs[3, 0]) < 1e-12  # the origin is midway between front and rear
        assert np.abs(hubs[:, 2]).max() < drone.body_mm[2] / 1000


def test_hubs_vary() -> None:
    hubs = np.array([drone.hubs / drone.wheelbase for drone in MANY])
    aspect = (hubs[:, 0, 1] + hubs[:, 3, 1]) / (hubs[:, 0, 0] - hubs[:, 3, 0])
    taper = hubs[:, 0, 1] / hubs[:, 3, 1]
    rise = hubs[:, 0, 2] - hubs[:, 3, 2]
    assert (
        (aspect > 1.15).mean() > 0.1 and (aspect < 0.9).mean() > 0.1 and (abs(aspect - 1) < 1e-9).mean() > 0.1
    )
    assert (taper > 1.1).mean() > 0.1 and (taper < 0.97).mean() > 0.1
    assert (rise > 0.02).mean() > 0.05 and (rise < -0.02).mean() > 0.05 and (rise == 0).mean() > 0.1


def test_propellers_never_meet() -> None:
    shares = []
    for drone in MANY:
        distances = np.linalg.norm((drone.hubs[:, None] - drone.hubs)[..., :2], axis=-1)
        nearest = distances[np.triu_indices(4, 1)].min()
        assert nearest >= drone.propeller_diameter
        shares.append(drone.propeller_diameter / nearest)
        assert drone.motor_radius < 0.25 * drone.propeller_diameter
    assert min(shares) < 0.75 and max(shares) > 0.95


def test_masses_are_those_of_real_drones() -> None:
    for drone in MANY:
        usual = 0.03 * (drone.wheelbase / 0.08) ** 2.3
        assert 0.7 < drone.mass / usual < 1.45
    assert min(drone.mass for drone in MANY) < 0.05 and max(drone.mass for drone in MANY) > 4


def test_colours() -> None:
    hull = np.array([drone.hull_rgb for drone in MANY])
    grey = (np.ptp(hull, axis=1) < 12).mean()
    assert 0.4 < grey < 0.75
    assert {drone.blades for drone in MANY} == {2, 3, 4}
    rear = [drone for drone in MANY if drone.rear_propeller_rgb is not None]
    assert 0.05 < len(rear) / len(MANY) < 0.4
    assert len({drone.propeller_rgb for drone in MANY}) > 100


@each
def test_every_part_looks_outward(number: int) -> None:
    for part in parts(number):
        corners = part.points[part.faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middle = corners - part.points.mean(axis=0)
        assert np.einsum("ij,ij->", middle[:, 0], np.cross(middle[:, 1], middle[:, 2])) > 0
        facing = np.einsum("ij,ij->i", area, part.normals[part.faces[:, 0]]) > 0
        assert (np.linalg.norm(area, axis=1) * facing).sum() > 0.98 * np.linalg.norm(area, axis=1).sum()


@each
def test_two_faces_share_every_edge(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Painting cuts triangles, so that neighbours no longer share whole edges: this is before it."""
    for module in (
        quadrotor_enterprise,
        quadrotor_extras,
        quadrotor_frames,
        quadrotor_hulls,
        quadrotor_small,
    ):
        monkeypatch.setattr(module, "painted", lambda part, *arguments, **bounds: part)
    assert all(is_closed(part) for part in quadrotor_bodies.parts(quadrotor(number)))


def test_an_open_tube_is_not_closed() -> None:
    closed = tube((0, 0, 0), (9, 0, 0), 2.0, (1, 2, 3))
    assert is_closed(closed)
    ends = (closed.points[closed.faces][:, :, 0] < 0).all(axis=1)
    ends |= (closed.points[closed.faces][:, :, 0] > 9).all(axis=1)
    assert not is_closed(replace(closed, faces=closed.faces[~ends]))


@pytest.mark.parametrize("number", WATCHED)
def test_no_part_floats(number: int) -> None:
    design = quadrotor(number).wheelbase * 1000 / DESIGN  # what a design millimetre is in millimetres
    assert floating(parts(number), gap=0.5 * design) == []


@pytest.mark.parametrize("number", WATCHED)
def test_every_part_clears_the_discs(number: int) -> None:
    plan = plan_of(quadrotor(number))
    assert all(plan.clears(scaled(part, 1 / plan.scale)) for part in parts(number))


def test_hardly_anything_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rod finds a free direction, and few receivers find no room beside the discs."""
    asked, built = 0, 0

    def counted(builder):
        def build(plan, *arguments):
            nonlocal asked, built
            result = builder(plan, *arguments)
            asked += 1
            built += len(plan.whole(result)) > 0
            return result

        return build

    for module in (quadrotor_enterprise, quadrotor_frames, quadrotor_hulls, quadrotor_small):
        for name in ("rod", "dome"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, counted(getattr(module, name)))
    for number in range(120):
        quadrotor_bodies.parts(quadrotor(number))
    assert asked > 50 and asked - built <= 2


@each
def test_bodies_are_right_in_size(number: int) -> None:
    drone, body = quadrotor(number), points(number)
    assert 3000 <= sum(len(part.faces) for part in parts(number)) <= 15000
    assert np.linalg.norm(body, axis=1).max() <= 1.03 * reach(drone)
    # it stands on the ground, which is half its height below the origin
    assert body[:, 2].min() * 1000 == pytest.approx(-0.5 * drone.body_mm[2], abs=0.08 * drone.body_mm[2])
    assert body[:, 1].min() == pytest.approx(-body[:, 1].max(), abs=1e-9)


@each
def test_propellers_clear_the_body(number: int) -> None:
    drone, body = quadrotor(number), points(number)
    for hub in drone.hubs:
        distance = np.linalg.norm(body[:, :2] - hub[:2], axis=1)
        assert body[distance < drone.propeller_radius, 2].max() < hub[2]
        # the motor ends right below its propeller
        assert body[distance < drone.motor_radius, 2].max() == pytest.approx(
            hub[2], abs=0.01 * drone.wheelbase
        )


@each
def test_a_hub_is_seen_from_above_and_hidden_from_below(number: int) -> None:
    mesh = meshes.drone_mesh(quadrotor(number))
    for hub in mesh.hubs:
        for direction, hidden in (([0.013, 0.007, 1.0], False), ([0.013, 0.007, -1.0], True)):
            start = hub + mesh.hub_clearance * np.array(direction)
            end = hub + np.array(direction)
            assert (len(mesh.body.ray_trace(start, end)[0]) > 0) == hidden


@pytest.mark.parametrize("number", WATCHED)
def test_front_and_rear_differ(number: int) -> None:
    """Turned by half a turn about the vertical axis, a body does not look the same."""
    merged = shapes.merge(parts(number))
    body, colour = np.asarray(merged.points, float), np.asarray(merged["rgb"], float)
    front, rear = body[:, 0] > 0, body[:, 0] < 0
    turned = merged.copy()
    turned.points *= np.array([-1, -1, 1], np.float32)
    beyond = merged.compute_implicit_distance(turned)[
        "implicit_distance"
    ].max()  # what only one of them fills
    colours = np.abs(colour[front].mean(axis=0) - colour[rear].mean(axis=0)).max()
    assert beyond > 0.015 * quadrotor(number).wheelbase or colours > 4


def test_a_body_is_the_same_when_it_is_built_again() -> None:
    first = shapes.merge(parts(BUILT[0]))
    again = shapes.merge(quadrotor_bodies.parts(quadrotor(BUILT[0])))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first["rgb"], again["rgb"])
    assert len(meshes.drone_mesh(f"Quad{BUILT[0]}").body.points) == len(again.points)


def test_a_plan_knows_the_room_beside_the_discs() -> None:
    plan = plan_of(quadrotor(BUILT[0]))
    x = (-40.0, 40.0)
    half = plan.free_half(x)
    assert plan.roof(x, half - 0.1) == np.inf
    assert plan.roof(x, half + 1.0) == pytest.approx(plan.low - GAP, abs=abs(plan.front[2] - plan.rear[2]))


@pytest.mark.parametrize("blades", [2, 3, 4])
@pytest.mark.parametrize("blur", [0.0, 1.0, 7.0])
def test_more_and_wider_blades_cover_more(blades: int, blur: float) -> None:
    def opacity(drone):
        mesh = DroneMesh(drone, None, drone.hubs, 0.01)
        return (
            mesh.propellers(np.full(4, 0.3), blur).point_data["rgba"][:, 3].reshape(4, 48, -1).astype(float)
        )

    drone = DRONES["Mini2"]
    two = opacity(drone).mean(axis=1)
    more = opacity(replace(drone, blades=blades))
    np.testing.assert_allclose(more.mean(axis=1)[:, 1:], two[:, 1:] * blades / 2, atol=1.5)
    np.testing.assert_allclose(
        more, np.roll(more, 48 // blades, axis=1), atol=1.0
    )  # it looks the same turned
    wide = opacity(replace(drone, blades=blades, blade_width=1.3))
    np.testing.assert_allclose(wide.mean(axis=1)[:, 1:], 1.3 * more.mean(axis=1)[:, 1:], atol=1.5)


def test_rear_propellers_may_have_a_colour_of_their_own() -> None:
    drone = replace(DRONES["Tello"], propeller_rgb=(1, 2, 3), tip_rgb=(1, 2, 3), rear_propeller_rgb=(9, 8, 7))
    rgba = DroneMesh(drone, None, drone.hubs, 0.01).propellers(np.zeros(4), 1.0).point_data["rgba"]
    rgb = rgba.reshape(4, -1, 4)[..., :3]
    assert (rgb[:2] == [1, 2, 3]).all() and (rgb[2:] == [9, 8, 7]).all()
    tipped = replace(drone, tip_rgb=(200, 0, 0))
    rgba = DroneMesh(tipped, None, drone.hubs, 0.01).propellers(np.zeros(4), 1.0).point_data["rgba"]
    rgb = rgba.reshape(4, 48, -1, 4)[..., :3]
    assert (rgb[:, :, -1] == [200, 0, 0]).all() and (rgb[2:, :, 0] == [9, 8, 7]).all()
