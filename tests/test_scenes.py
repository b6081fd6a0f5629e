"""The flight plan: Table 2, splits, backgrounds, and flights that a drone can fly and a camera can see."""

from dataclasses import replace

import numpy as np
import pytest

from dronekeypp.sixdronesyn import scenes
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.scenes import SCENES, SPLITS, Subsequence

ALL = scenes.subsequences()


def flights_of(split: str) -> list[Subsequence]:
    return [flight for flight in ALL if flight.split == split]


def test_table_2() -> None:
    assert scenes.count_frames() == 52_920
    assert len(ALL) == 13 * 21
    for first, last, motion, frames in (
        (1, 3, "linear", 7560),
        (4, 6, "non-linear", 7560),
        (7, 9, "linear", 7560),
        (10, 13, "non-linear", 30_240),
    ):
        numbers = range(first, last + 1)
        assert scenes.count_frames(numbers) == frames
        for number in numbers:
            assert SCENES[number].number == number
            assert SCENES[number].motion == motion


def test_splits() -> None:
    expected = {"train": {1, 2, 4, 5, 8, 10, 11, 12}, "val": {3, 9, 13}, "test": {6, 7}}
    for split in SPLITS:
        assert {flight.scene for flight in flights_of(split)} == expected[split]
    assert sum(flight.frames for flight in flights_of("train")) == 35_280


def test_stride_keeps_frame_numbers() -> None:
    assert list(scenes.frame_numbers(ALL[0], 40)) == [0, 40, 80]


def test_every_flight_has_its_own_folder_number() -> None:
    assert len({flight.id for flight in ALL}) == len(ALL)


def test_all_88_backgrounds_are_used_and_no_environment_crosses_a_split() -> None:
    backgrounds = set()
    split_of = {}  # environment number to split
    for split, count in (("train", 56), ("val", 12), ("test", 20)):
        used = {scenes.background(flight, 22) for flight in flights_of(split)}
        assert len(used) == count
        backgrounds |= used
        for environment, _ in used:
            assert split_of.setdefault(environment, split) == split
    assert len(backgrounds) == 88


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_few_environments_are_shared(n: int) -> None:
    for numbers in scenes.split_environments(n).values():
        assert len(numbers) == n


@pytest.mark.parametrize("n", [6, 10, 22, 40])
def test_enough_environments_are_split_and_none_is_lost(n: int) -> None:
    groups = scenes.split_environments(n)
    assert sorted(groups["train"] + groups["val"] + groups["test"]) == list(range(n))
    assert all(groups.values())


def test_flights_are_reproducible_and_their_seeds_matter() -> None:
    a, b, c = scenes.fly(ALL[5]), scenes.fly(ALL[5]), scenes.fly(ALL[5], seed=1)
    assert np.array_equal(a.R, b.R) and np.array_equal(a.t, b.t)
    assert not np.allclose(a.t, c.t)


@pytest.mark.parametrize("subsequence", ALL[::17])
def test_the_drone_stays_in_the_frame_and_in_reach(subsequence: Subsequence) -> None:
    flight, r = scenes.fly(subsequence), scenes.reach(DRONES[subsequence.drone])
    K = flight.camera.K
    for corner in np.array(np.meshgrid([-r, r], [-r, r], [-r, r])).reshape(3, -1).T:
        point = flight.t + corner / np.sqrt(3)
        pixel = point @ K.T
        pixel = pixel[:, :2] / pixel[:, 2:]
        assert (pixel >= 0).all() and (pixel <= [scenes.WIDTH, scenes.HEIGHT]).all()
    distance = np.linalg.norm(flight.t, axis=1)
    assert distance.min() >= scenes.NEAREST and distance.max() <= scenes.FARTHEST
    assert (flight.world_t[:, 2] > 0.3).all()


@pytest.mark.parametrize("subsequence", ALL[::29])
def test_poses_in_camera_and_world_agree(subsequence: Subsequence) -> None:
    flight = scenes.fly(subsequence)
    R, camera = flight.R, flight.camera
    np.testing.assert_allclose(R.swapaxes(1, 2) @ R, np.broadcast_to(np.eye(3), R.shape), atol=1e-9)
    assert np.allclose(np.linalg.det(R), 1)
    np.testing.assert_allclose(flight.world_t @ camera.R.T + camera.t, flight.t, atol=1e-9)
    np.testing.assert_allclose(camera.R @ flight.world_R, R, atol=1e-9)


def test_attitude_by_hand() -> None:
    """At rest the drone is level.

    With an acceleration of g along x, the nose (heading x) points 45° down and the thrust 45° forward.
    """
    g = scenes.GRAVITY
    R = scenes.attitude(np.array([[0, 0, 0], [g, 0, 0]], float), np.zeros((2, 3)), np.zeros(2))
    np.testing.assert_allclose(R[0], np.eye(3), atol=1e-12)
    h = np.sqrt(0.5)
    np.testing.assert_allclose(R[1], [[h, 0, h], [0, 1, 0], [-h, 0, h]], atol=1e-12)


def test_thrust_points_along_what_it_must_carry() -> None:
    """Body z leans with the acceleration, which is the finished path differentiated twice.

    The gusts add a degree or two.
    """
    for subsequence in ALL[100:110]:
        flight = scenes.fly(subsequence)
        dt = 1 / scenes.FPS
        v = np.gradient(flight.world_t, dt, axis=0)
        a = np.gradient(v, dt, axis=0)
        thrust = a + scenes.DRAG * v + [0, 0, scenes.GRAVITY]
        thrust /= np.linalg.norm(thrust, axis=1, keepdims=True)
        cosine = (thrust * flight.world_R[:, :, 2]).sum(1).clip(-1, 1)
        angle = np.degrees(np.arccos(cosine))[4:-4]
        assert angle.max() < 6


def test_headings_are_free_of_the_direction_of_travel() -> None:
    angles = []
    for subsequence in ALL:
        flight = scenes.fly(subsequence)
        travel = np.gradient(flight.world_t, axis=0)[:, :2]
        nose = flight.world_R[:, :2, 0]
        cross = travel[:, 0] * nose[:, 1] - travel[:, 1] * nose[:, 0]
        angles.append(np.degrees(np.arctan2(cross, (travel * nose).sum(1))) % 360)
    angles = np.concatenate(angles)
    share = np.histogram(angles, bins=8, range=(0, 360))[0] / len(angles)
    assert share.min() > 0.06 and share.max() < 0.2


def test_a_lens_a_scene_then_a_lens_a_flight() -> None:
    """The two test scenes have 42 flights: two lenses in the first edition, 42 in the second."""
    for edition, lenses in ((1, 2), (2, 42)):
        flights = scenes.subsequences([6, 7], drones=scenes.SEVEN, edition=edition)
        assert len({scenes.camera(flight).K.tobytes() for flight in flights}) == lenses


def test_the_second_edition_keeps_the_backgrounds() -> None:
    for flight in flights_of("test"):
        second = replace(flight, edition=2)
        assert scenes.background(second, 22) == scenes.background(flight, 22)


def test_no_quadrotor_crosses_a_split() -> None:
    flights = scenes.quadrotor_flights(range(40, 60))
    split_of = {}
    for flight in flights:
        assert split_of.setdefault(flight.drone, flight.split) == flight.split
    assert sorted(split_of.values()) == ["test"] * 2 + ["train"] * 16 + ["val"] * 2
    assert len({flight.id for flight in flights}) == len(flights)
    assert {flight.drone_number for flight in flights} == set(range(20))


def test_a_quadrotor_flies_the_same_in_any_range() -> None:
    alone = scenes.quadrotor_flights(range(48, 49), [3])
    among = [flight for flight in scenes.quadrotor_flights(range(40, 60), [3]) if flight.drone == "Quad48"]
    assert len(alone) == 3
    for first, second in zip(alone, among, strict=True):
        assert scenes.background(first, 22) == scenes.background(second, 22)
        np.testing.assert_array_equal(scenes.fly(first).t, scenes.fly(second).t)


def test_a_large_quadrotor_stays_away_by_its_own_size() -> None:
    """The distance is 4 to 25 times the drone's radius, and never outside 1.5 m to 8 m without need."""
    for flight in scenes.quadrotor_flights(range(20), [1, 3, 6]):
        radius = scenes.reach(flight.airframe)
        distance = np.linalg.norm(scenes.fly(flight).t, axis=1)
        assert distance.min() >= max(1.5, 4 * radius)
        assert distance.max() <= max(8.0, 25 * radius)
