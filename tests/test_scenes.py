import numpy as np
import pytest

from dronekeypp.sixdronesyn import scenes
from dronekeypp.sixdronesyn.drones import DRONES

ALL = scenes.subsequences()


def test_table_2():
    assert scenes.count_frames() == 52_920
    assert len(ALL) == 13 * 21
    groups = [range(1, 4), range(4, 7), range(7, 10), range(10, 14)]
    assert [scenes.count_frames(list(g)) for g in groups] == [7560, 7560, 7560, 30_240]
    assert [{scenes.SCENES[n].motion for n in g} for g in groups] == [
        {"linear"},
        {"non-linear"},
        {"linear"},
        {"non-linear"},
    ]


def test_splits():
    by_split = {split: {s.scene for s in ALL if s.split == split} for split in scenes.SPLITS}
    assert by_split == {"train": {1, 2, 4, 5, 8, 10, 11, 12}, "val": {3, 9, 13}, "test": {6, 7}}
    assert sum(s.frames for s in ALL if s.split == "train") == 35_280


def test_stride_keeps_frame_numbers():
    assert list(scenes.frame_numbers(ALL[0], 40)) == [0, 40, 80]


def test_every_flight_has_its_own_folder_number():
    assert len({s.id for s in ALL}) == len(ALL)


def test_all_88_backgrounds_are_used_and_no_environment_crosses_a_split():
    used = {split: {scenes.background(s, 22) for s in ALL if s.split == split} for split in scenes.SPLITS}
    assert [len(used[s]) for s in scenes.SPLITS] == [56, 12, 20]
    assert len(set.union(*used.values())) == 88
    rooms = [{e for e, _ in used[split]} for split in scenes.SPLITS]
    assert not rooms[0] & rooms[1] and not rooms[0] & rooms[2] and not rooms[1] & rooms[2]


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_few_environments_are_shared(n):
    assert all(len(v) == n for v in scenes.split_environments(n).values())


@pytest.mark.parametrize("n", [6, 10, 22, 40])
def test_enough_environments_are_split_and_none_is_lost(n):
    groups = scenes.split_environments(n)
    assert sorted(sum(groups.values(), [])) == list(range(n)) and all(groups.values())


def test_flights_are_reproducible_and_their_seeds_matter():
    a, b, c = scenes.fly(ALL[5]), scenes.fly(ALL[5]), scenes.fly(ALL[5], seed=1)
    assert np.array_equal(a.R, b.R) and np.array_equal(a.t, b.t)
    assert not np.allclose(a.t, c.t)


@pytest.mark.parametrize("subsequence", ALL[::17])
def test_the_drone_stays_in_the_frame_and_in_reach(subsequence):
    flight, r = scenes.fly(subsequence), scenes.reach(DRONES[subsequence.drone])
    K = flight.camera.K
    for sign in np.array(np.meshgrid([-r, r], [-r, r], [-r, r])).reshape(3, -1).T:
        corner = flight.t + sign / np.sqrt(3)
        pixel = corner @ K.T
        pixel = pixel[:, :2] / pixel[:, 2:]
        assert (pixel >= 0).all() and (pixel <= [scenes.WIDTH, scenes.HEIGHT]).all()
    distance = np.linalg.norm(flight.t, axis=1)
    assert distance.min() >= scenes.NEAREST and distance.max() <= scenes.FARTHEST
    assert (flight.world_t[:, 2] > 0.3).all()


@pytest.mark.parametrize("subsequence", ALL[::29])
def test_poses_in_camera_and_world_agree(subsequence):
    f = scenes.fly(subsequence)
    np.testing.assert_allclose(f.R.swapaxes(1, 2) @ f.R, np.broadcast_to(np.eye(3), f.R.shape), atol=1e-9)
    assert np.allclose(np.linalg.det(f.R), 1)
    np.testing.assert_allclose(f.world_t @ f.camera.R.T + f.camera.t, f.t, atol=1e-9)
    np.testing.assert_allclose(f.camera.R @ f.world_R, f.R, atol=1e-9)


def test_attitude_by_hand():
    """At rest: level. Accelerating along x at g: nose (heading x) 45° down, thrust 45° forward."""
    g = scenes.GRAVITY
    R = scenes.attitude(np.array([[0, 0, 0], [g, 0, 0]], float), np.zeros((2, 3)), np.zeros(2))
    np.testing.assert_allclose(R[0], np.eye(3), atol=1e-12)
    h = np.sqrt(0.5)
    np.testing.assert_allclose(R[1], [[h, 0, h], [0, 1, 0], [-h, 0, h]], atol=1e-12)


def test_thrust_points_along_what_it_must_carry():
    """Differentiate the finished path twice: body z must lean with the acceleration (the gusts add a degree or two)."""
    for s in ALL[100:110]:
        f = scenes.fly(s)
        dt = 1 / scenes.FPS
        v, a = np.gradient(f.world_t, dt, axis=0), np.gradient(np.gradient(f.world_t, dt, axis=0), dt, axis=0)
        thrust = a + scenes.DRAG * v + [0, 0, scenes.GRAVITY]
        thrust /= np.linalg.norm(thrust, axis=1, keepdims=True)
        angle = np.degrees(np.arccos((thrust * f.world_R[:, :, 2]).sum(1).clip(-1, 1)))[4:-4]
        assert angle.max() < 6


def test_headings_are_free_of_the_direction_of_travel():
    off = []
    for s in ALL:
        f = scenes.fly(s)
        way = np.gradient(f.world_t, axis=0)[:, :2]
        nose = f.world_R[:, :2, 0]
        off.append(
            np.degrees(np.arctan2(way[:, 0] * nose[:, 1] - way[:, 1] * nose[:, 0], (way * nose).sum(1))) % 360
        )
    share = np.histogram(np.concatenate(off), bins=8, range=(0, 360))[0] / sum(map(len, off))
    assert share.min() > 0.06 and share.max() < 0.2
