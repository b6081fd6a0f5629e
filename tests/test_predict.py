"""Poses in one's own footage: the numbers are the network's, every file format says the same, and nothing
broken stops it.
"""

import csv
import itertools
import json
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from fakes import FakeDrones, saved, tiny
from tqdm import tqdm

from dronekeypp import checkpoint
from dronekeypp.camera import (
    clamp_square,
    crop_image,
    crop_intrinsics,
    from_crop,
    square_around,
    to_crop,
)
from dronekeypp.classes import DroneClass, names_of
from dronekeypp.cli import main
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.files import lock_folder
from dronekeypp.footage import (
    Calibration,
    Tracker,
    open_footage,
    read_boxes,
    read_camera,
)
from dronekeypp.model import DroneKeyPP, ModelConfig
from dronekeypp.predict import (
    JOURNAL,
    POSES,
    SETTINGS,
    Pose,
    batches,
    draw_overlay,
    mirror_doubt,
    predict,
    read_journal,
    run,
)
from dronekeypp.predict.ahead import ahead, side_by_side
from dronekeypp.rotations import geodesic_degrees
from dronekeypp.sequences import gaussian
from dronekeypp.settings import usable

ROOT = Path(__file__).parents[1]
CHECKPOINT = ROOT / "data_samples" / "checkpoint"


@pytest.fixture(scope="module")
def frames():
    """Seven whole frames, one of every drone."""
    return open_dataset(ROOT / "data_samples" / "frames", "test", size=96)


@pytest.fixture(scope="module")
def footage(tmp_path_factory, frames):
    """(folder of seven images, camera file, boxes as CSV, indices into `frames`)."""
    root = tmp_path_factory.mktemp("footage")
    (root / "images").mkdir()
    chosen = list(range(0, 21, 3))
    rows = ["frame,x,y,w,h"]
    for i, index in enumerate(chosen):
        shutil.copy(frames.folders[index] / "rgb" / "000000.jpg", root / "images" / f"shot_{i}.jpg")
        rows.append(f"shot_{i}.jpg,{','.join(str(v) for v in frames.frames[index].box)}")
    (root / "boxes.csv").write_text("\n".join(rows) + "\n")
    write_camera(root / "camera.json", frames.frames[0].K)
    return root / "images", root / "camera.json", root / "boxes.csv", chosen


def write_camera(path, K, **more):
    """A calibration as OpenCV counts: pixel centres from 0."""
    K = np.asarray(K) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    path.write_text(
        json.dumps({"camera_matrix": K.tolist(), "image_width": 1920, "image_height": 1080, **more})
    )


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A tiny network that was never trained."""
    return saved(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def names(small):
    """The names of its drones."""
    return names_of(checkpoint.load(small).drones)


def test_the_poses_are_the_networks(footage, frames, tmp_path):
    images, camera, boxes, chosen = footage
    poses = predict(CHECKPOINT, images, camera, tmp_path / "out", boxes=boxes, progress=False)
    assert [pose.frame for pose in poses] == list(range(7))
    model = DroneKeyPP.from_pretrained(CHECKPOINT)
    for pose, index in zip(poses, chosen, strict=True):
        item = frames[index]
        with torch.inference_mode():
            found = model(item["image"][None], item["K"][None], item["square"][None])
        assert (
            geodesic_degrees(torch.tensor(pose.R), found["R"][0].double()) < 0.5
        )  # the box is stored with two digits
        np.testing.assert_allclose(pose.t, found["t"][0], atol=0.02)
        np.testing.assert_allclose(pose.keypoints, found["keypoints_px"][0], atol=0.5)
    errors = [
        np.linalg.norm(pose.t - frames[index]["t"].numpy()) for pose, index in zip(poses, chosen, strict=True)
    ]
    assert np.median(errors) < 0.5
    lines = (tmp_path / "out" / POSES).read_text().splitlines()
    assert lines[0] == "scene_id,im_id,obj_id,score,R,t,time" and len(lines) == 8
    row = next(csv.DictReader(lines))
    np.testing.assert_allclose(np.array(row["t"].split(), float) / 1000, poses[0].t, atol=1e-6)
    np.testing.assert_allclose(np.array(row["R"].split(), float).reshape(3, 3), poses[0].R, atol=1e-6)
    assert (tmp_path / "out" / "trajectory.png").stat().st_size > 5000
    video = open_footage(tmp_path / "out" / "overlay.mp4")
    assert len(video.names) == 7 and next(video.read())[1].shape == (1080, 1920, 3)


SQUARE = np.array([[0.3, 0.3, 0], [0.3, -0.3, 0], [-0.3, -0.3, 0], [-0.3, 0.3, 0]])  # hubs, metres


def save_with_drones(folder, *drones):
    """A tiny network that knows these drones."""
    torch.manual_seed(0)
    network = DroneKeyPP(ModelConfig.from_dict(tiny(classes=len(drones))))
    network.know(drones)
    network.save_pretrained(folder)
    return folder


def test_the_names_are_those_of_the_networks_drones(footage, tmp_path):
    images, camera, boxes, _ = footage
    net = save_with_drones(tmp_path / "net", DroneClass("Wren"), DroneClass("Kite", SQUARE, "A red kite"))
    poses = predict(net, images, camera, tmp_path / "out", boxes=boxes, progress=False)
    rows = list(csv.DictReader((tmp_path / "out" / POSES).read_text().splitlines()))
    number_of = {"Wren": "1", "Kite": "2"}
    assert [row["obj_id"] for row in rows] == [number_of[pose.drone] for pose in poses]
    settings = json.loads((tmp_path / "out" / SETTINGS).read_text())
    assert settings["drones"] == {"Wren": None, "Kite": DroneClass("Kite", SQUARE).digest}
    other = save_with_drones(tmp_path / "other", DroneClass("Wren"), DroneClass("Kite", 2 * SQUARE))
    with pytest.raises(InputError, match="begun with another drones"):  # the weights are the same
        predict(other, images, camera, tmp_path / "out", boxes=boxes, progress=False)


@pytest.mark.parametrize(
    "drone, text, length",
    [
        (DroneClass("Kite", SQUARE, "A red kite"), "A red kite 50 %, 2.00 m", 0.3 * np.sqrt(2)),
        (DroneClass("Kite"), "Kite 50 %, 2.00 m", 0.1),  # of unknown size
    ],
)
def test_the_overlay_shows_title_and_size_of_the_drone(monkeypatch, drone, text, length):
    texts, tips = [], []
    monkeypatch.setattr(cv2, "putText", lambda image, text, *rest: texts.append(text))
    monkeypatch.setattr(cv2, "arrowedLine", lambda image, start, tip, *rest, **more: tips.append(tip))
    pose = Pose(
        frame=0,
        box=np.array([300.0, 200, 40, 40]),
        drone="Kite",
        score=0.5,
        doubt_px=0.1,
        keypoints=np.full((4, 2), 320.0),
        R=np.eye(3),
        t=np.array([0.0, 0, 2]),
        seconds=0.1,
        turn_sigma_deg=float("nan"),
        shift_sigma_m=float("nan"),
    )
    calibration = Calibration(np.array([[1000.0, 0, 320.5], [0, 1000, 240.5], [0, 0, 1]]))
    image = draw_overlay(np.zeros((480, 640, 3), np.uint8), pose, calibration, drone)
    assert texts == [text] and image.shape == (480, 640, 3) and image.any()
    forward = round(1000 * length / 2)  # pixels: the body's x axis, two metres away
    assert tips == [(320 + forward, 240), (320, 240 + forward), (320, 240)]


def test_a_run_of_an_older_version_goes_on(footage, small, tmp_path, monkeypatch):
    """Its settings.json did not name the network's drones."""
    images, camera, boxes, _ = footage
    out = tmp_path / "out"
    whole = predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
    settings = json.loads((out / SETTINGS).read_text())
    drones = settings.pop("drones")
    (out / SETTINGS).write_text(json.dumps({**settings, "own_drones": {}}))
    monkeypatch.setattr(batches, "fill", None)  # nothing is left to ask
    again = predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
    np.testing.assert_array_equal([pose.t for pose in again], [pose.t for pose in whole])
    assert json.loads((out / SETTINGS).read_text()) == {**settings, "drones": drones}
    (out / SETTINGS).write_text(json.dumps({**settings, "camera": "another"}))
    with pytest.raises(InputError, match="begun with another camera"):
        predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)


@pytest.mark.parametrize(
    "method, changes, kind",
    [
        ("DroneKey", {}, "DroneKey"),  # it is told which drone it sees
        ("DronePose", {}, "DronePose"),  # it does not say which drone it sees
        ("DroneKey++", {"encoder": "truth"}, r"DroneKey\+\+ without an encoder"),
    ],
)
def test_networks_that_do_not_name_the_drone_are_refused(footage, tmp_path, method, changes, kind):
    images, camera, boxes, _ = footage
    network_class = checkpoint.network_class(method)
    settings = usable(network_class.Config, tiny(), changes)
    network = network_class(network_class.Config.from_dict({**settings, **changes}))
    network.save_pretrained(tmp_path / "net")
    with pytest.raises(InputError, match=f"net holds a network of {kind}; this takes DroneKey"):
        predict(tmp_path / "net", images, camera, tmp_path / "out", boxes=boxes, progress=False)
    assert not (tmp_path / "out").exists()


def test_a_geometric_network_says_how_sure_it_is_and_is_smoothed_by_it(footage, tmp_path):
    images, camera, boxes, _ = footage
    net = saved(tmp_path / "net", rays="split", pose="geometric", classifier="features")
    poses = predict(net, images, camera, tmp_path / "out", boxes=boxes, progress=False)
    claims = np.array([(pose.turn_sigma_deg, pose.shift_sigma_m) for pose in poses])
    assert np.isfinite(claims).all() and (claims > 0).all() and len(np.unique(claims, axis=0)) == 7
    again = predict(
        net, images, camera, tmp_path / "out", boxes=boxes, smooth=0.1, progress=False
    )  # from the journal
    time = np.arange(7) / 30
    R, t = gaussian(
        np.stack([p.R for p in poses]), np.stack([p.t for p in poses]), time, 0.1, 1 / np.square(claims)
    )
    np.testing.assert_allclose([p.t for p in again], t)
    np.testing.assert_allclose([p.R for p in again], R)


def test_doubt_is_what_a_mirror_changes():
    data = FakeDrones(6)
    items = next(iter(torch.utils.data.DataLoader(data, 6)))

    def sees(image, K, square):
        """The truth, whichever way round the picture is.

        Left of the principal point becomes right, and the hubs swap names.
        """
        pixels = from_crop(items["keypoints"], items["square"])
        if torch.equal(image, items["image"]):
            return {"keypoints": to_crop(pixels, square)}
        mirrored = torch.stack([2 * K[:, None, 0, 2] - pixels[..., 0], pixels[..., 1]], dim=-1)
        moved = torch.tensor([0.03, 0.04])
        return {"keypoints": to_crop(mirrored[:, [1, 0, 3, 2]], square) + moved}

    doubt = mirror_doubt(sees, items["image"], items["K"], items["square"], items["keypoints"])
    torch.testing.assert_close(doubt, torch.full((6,), 0.05), atol=1e-5, rtol=0)


def test_what_is_made_ahead_comes_in_order_and_not_too_early():
    made = []

    def items():
        for number in range(6):
            made.append(number)
            yield number

    seen = []
    for number in ahead(items(), 2):
        seen.append(number)
        assert len(made) <= number + 3  # this one and two more
    assert seen == list(range(6))
    assert list(ahead(iter([]), 2)) == []


def test_what_fails_ahead_is_raised_in_its_place_and_no_thread_is_left():
    def items():
        yield from (0, 1)
        raise InputError("the third is broken")

    seen = []
    with pytest.raises(InputError, match="the third is broken"):
        for number in ahead(items(), 1):
            seen.append(number)
    assert seen == [0, 1]
    stopped = ahead(itertools.count(), 2)
    assert next(stopped) == 0
    stopped.close()  # as Ctrl-C does it
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ahead")]


def test_what_is_computed_side_by_side_comes_in_order_and_not_too_early():
    taken, threads = [], set()
    both = threading.Barrier(2, timeout=10)

    def items():
        for number in range(6):
            taken.append(number)
            yield number

    def square(number):
        threads.add((threading.get_ident(), torch.get_num_threads()))
        both.wait()  # two are computed at once
        time.sleep(0.01 * (number % 2 == 0))  # the first of two ends last
        return number**2

    before = torch.get_num_threads()
    seen = []
    for result in side_by_side(square, items(), 2):
        seen.append(result)
        assert len(taken) <= len(seen) + 2
    assert seen == [0, 1, 4, 9, 16, 25]
    assert len(threads) == 2 and {number for _, number in threads} == {max(1, before // 2)}
    assert torch.get_num_threads() == before
    with ThreadPoolExecutor(1) as later:
        assert later.submit(torch.get_num_threads).result() == before
    assert list(side_by_side(square, [], 2)) == []


def test_what_fails_side_by_side_is_raised_in_its_place_and_no_thread_is_left():
    def inverse(number):
        return 1 / (2 - number)

    seen = []
    with pytest.raises(ZeroDivisionError):
        for result in side_by_side(inverse, itertools.count(), 2):
            seen.append(result)
    assert seen == [0.5, 1]
    stopped = side_by_side(inverse, itertools.count(3), 2)
    assert next(stopped) == -1
    stopped.close()  # as Ctrl-C does it
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("side_by_side")]


def test_the_command_keeps_torch_out_of_the_garbage_collector_and_ends_without_a_word():
    code = """
import gc
from dronekeypp import cli
cli._import_torch()
assert gc.isenabled() and gc.get_freeze_count() > 100_000
import dronekeypp.predict
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_killed_run_goes_on(footage, small, names, tmp_path, monkeypatch):
    images, camera, boxes, _ = footage
    monkeypatch.setattr(batches, "BATCH", 2)
    whole = predict(small, images, camera, tmp_path / "whole", boxes=boxes, overlay=False, progress=False)
    real = batches.fill

    def dies(network, crops):
        if crops[0].row["frame"] == "4":  # in the third batch
            raise KeyboardInterrupt
        real(network, crops)

    monkeypatch.setattr(batches, "fill", dies)
    with pytest.raises(KeyboardInterrupt):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    journal = tmp_path / "out" / JOURNAL
    assert len(read_journal(journal, names)) == 4
    journal.write_text(journal.read_text() + "4,shot_4.jpg,ok,12.")  # half a row
    seen = []

    def counts(network, crops):
        seen.append(len(crops))
        real(network, crops)

    monkeypatch.setattr(batches, "fill", counts)
    poses = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    assert sum(seen) == 3  # only what was missing
    for a, b in zip(whole, poses, strict=True):
        np.testing.assert_allclose(a.t, b.t, atol=1e-5)
    with pytest.raises(InputError, match="was begun with another checkpoint"):
        predict(CHECKPOINT, images, camera, tmp_path / "out", boxes=boxes, progress=False)


def test_a_run_killed_before_its_first_row_goes_on(footage, small, tmp_path, monkeypatch):
    images, camera, boxes, _ = footage

    def dies(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as killed, pytest.raises(KeyboardInterrupt):
        killed.setattr(batches, "fill", dies)
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    poses = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    assert len(poses) == 7


def test_a_mended_input_is_taken(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    mine = tmp_path / "boxes.csv"
    mine.write_text(boxes.read_text().replace("frame,x", "frame,left"))
    with pytest.raises(InputError, match="the header needs frame, x, y, w, h"):
        predict(small, images, camera, tmp_path / "out", boxes=mine, overlay=False, progress=False)
    mine.write_text(boxes.read_text())
    poses = predict(small, images, camera, tmp_path / "out", boxes=mine, overlay=False, progress=False)
    assert len(poses) == 7


@pytest.mark.parametrize(
    "box",
    [(5000, 5000, 10, 10), (10, 10, 0, 0), (10, 10, -5, 5), (float("nan"), 1, 2, 3), (1919.6, 10, 60, 60)],
)
def test_a_bad_first_box(footage, small, tmp_path, box):
    images, camera, _, _ = footage
    with pytest.raises(InputError, match="box"):
        predict(small, images, camera, tmp_path / "out", box=box, overlay=False, progress=False)


def test_a_drone_that_straightening_cuts_off_has_no_pose(small, tmp_path):
    cv2.imwrite(str(tmp_path / "shot.png"), np.zeros((240, 320, 3), np.uint8))
    (tmp_path / "camera.json").write_text(
        '{"cameraMatrix": [[300, 0, 160], [0, 300, 120], [0, 0, 1]], "distCoeffs": [-0.3, 0.1, 0, 0]}'
    )
    with pytest.raises(InputError, match="outside the undistorted frame"):
        predict(
            small,
            tmp_path / "shot.png",
            tmp_path / "camera.json",
            tmp_path / "out",
            box=(300, 2, 18, 12),
            progress=False,
        )


def test_a_broken_frame_is_told_and_passed_over(footage, small, names, tmp_path):
    images, camera, boxes, _ = footage
    folder = shutil.copytree(images, tmp_path / "images")
    (folder / "shot_2.jpg").unlink()
    (folder / "shot_2.jpg").symlink_to("nowhere.jpg")
    cv2.imwrite(str(folder / "shot_4.jpg"), np.zeros((100, 200, 3), np.uint8))
    few = tmp_path / "few.csv"
    few.write_text("\n".join(line for line in boxes.read_text().splitlines() if "shot_5" not in line) + "\n")
    poses = predict(small, folder, camera, tmp_path / "out", boxes=few, smooth=0.05, progress=False)
    assert [pose.frame for pose in poses] == [0, 1, 3, 6]
    status = [row["status"] for row in read_journal(tmp_path / "out" / JOURNAL, names)]
    assert status == [
        "ok",
        "ok",
        "cannot be read",
        "ok",
        "is 200x100, the first frame 1920x1080",
        "no box",
        "ok",
    ]
    assert len(open_footage(tmp_path / "out" / "overlay.mp4").names) == 5


def test_a_folder_is_told_how_fast_it_was_taken(footage, small, tmp_path):
    images, camera, boxes, _ = footage

    def positions(smooth, rate):
        out = tmp_path / "out"
        poses = predict(
            small, images, camera, out, boxes=boxes, smooth=smooth, rate=rate, overlay=False, progress=False
        )
        return np.array([pose.t for pose in poses])

    raw, slow, fast = positions(0.0, 30), positions(0.05, 1), positions(0.05, 900)
    np.testing.assert_allclose(slow, raw)  # a second apart: no neighbour near
    assert np.ptp(fast, axis=0).max() < np.ptp(raw, axis=0).max()
    with pytest.raises(InputError, match="--rate 0: frames a second, above 0"):
        positions(0.05, 0)


def test_one_frame_a_second_is_smoothed_too(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    usual = dict(boxes=boxes, rate=1, overlay=False, progress=False)
    raw = predict(small, images, camera, tmp_path / "out", **usual)
    poses = predict(small, images, camera, tmp_path / "out", smooth=3, **usual)
    before, after = np.array([pose.t for pose in raw]), np.array([pose.t for pose in poses])
    assert np.ptp(after, axis=0).max() < 0.7 * np.ptp(before, axis=0).max()
    row = next(csv.DictReader((tmp_path / "out" / POSES).read_text().splitlines()))
    np.testing.assert_allclose(np.array(row["t"].split(), float) / 1000, after[0], atol=1e-6)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """(a video of 12 frames, a patch that moves by 4 pixels each, and its camera file)."""
    root, rng = tmp_path_factory.mktemp("video"), np.random.default_rng(0)
    writer = cv2.VideoWriter(str(root / "video.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (320, 240))
    ground = rng.integers(60, 100, (240, 320, 3), dtype=np.uint8)
    target = rng.integers(0, 255, (40, 60, 3), dtype=np.uint8)
    for i in range(12):
        image = ground.copy()
        image[100:140, 80 + 4 * i : 140 + 4 * i] = target
        writer.write(image)
    writer.release()
    write_camera(
        root / "camera.json", [[300.0, 0, 160], [0, 300, 120], [0, 0, 1]], image_width=320, image_height=240
    )
    return root / "video.avi", root / "camera.json"


def test_a_video_and_a_box_in_its_first_frame(video, small, tmp_path, monkeypatch):
    path, camera = video
    source = open_footage(path)
    assert source.rate == 25 and len(source.names) == 12
    tracker, found = Tracker(np.array([80.0, 100, 60, 40])), []
    for _, image in source.read():
        found.append(tracker.follow(image))
    assert abs(found[-1][0] - 124) < 15 and found[0].tolist() == [80, 100, 60, 40]
    poses = predict(small, path, camera, tmp_path / "out", box=(80, 100, 60, 40), progress=False)
    assert len(poses) == 12 and np.array_equal(poses[0].box, [80, 100, 60, 40])
    journal = tmp_path / "out" / JOURNAL  # killed after five frames, the tracker goes on where it was
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:6]))
    again = predict(
        small, path, camera, tmp_path / "out", box=(80, 100, 60, 40), overlay=False, progress=False
    )
    np.testing.assert_array_equal([pose.box for pose in again], [pose.box for pose in poses])
    monkeypatch.setattr(run, "tracker_after", None)  # nothing is left to track
    poses = predict(
        small,
        path,
        camera,
        tmp_path / "out",
        box=(80, 100, 60, 40),
        smooth=0.1,
        overlay=False,
        progress=False,
    )
    assert len(poses) == 12


def test_a_rate_overrides_that_of_a_video(video, small, tmp_path):
    path, camera = video

    def positions(smooth, rate):
        usual = dict(box=(80, 100, 60, 40), overlay=False, progress=False)
        poses = predict(small, path, camera, tmp_path / "out", smooth=smooth, rate=rate, **usual)
        return np.array([pose.t for pose in poses])

    raw = positions(0.0, None)
    np.testing.assert_allclose(positions(0.05, 1), raw)  # a second apart: no neighbour near
    own = positions(0.05, None)
    assert not np.allclose(own, raw) and np.array_equal(own, positions(0.05, 25))


def test_unevenly_timed_frames_are_smoothed_by_their_times(video, small, tmp_path, monkeypatch, capsys):
    path, camera = video
    even = open_footage(path)
    times = np.arange(12) / 25
    times[6:] += 10  # a gap: frames before it say nothing of frames after it
    monkeypatch.setattr(run, "open_footage", lambda path: replace(even, rate=1.1, times=tuple(times)))
    usual = dict(box=(80, 100, 60, 40), overlay=False)
    raw = predict(small, path, camera, tmp_path / "out", progress=False, **usual)
    poses = predict(small, path, camera, tmp_path / "out", smooth=0.5, **usual)
    assert "unevenly timed, 1.1 frames a second on the average" in capsys.readouterr().out
    before, after = (np.array([pose.t for pose in each]) for each in (raw, poses))
    first, second = before[:6], before[6:]
    for part, smoothed in ((first, after[:6]), (second, after[6:])):
        assert (smoothed >= part.min(axis=0) - 1e-9).all() and (smoothed <= part.max(axis=0) + 1e-9).all()
        assert np.ptp(smoothed, axis=0).max() < np.ptp(part, axis=0).max()


def test_names_with_colons_on_both_sides(video, small, tmp_path, monkeypatch):
    path, camera = video
    monkeypatch.chdir(tmp_path)
    shutil.copy(path, "12:30:15.avi")
    box = (80, 100, 60, 40)
    predict(small, Path("12:30:15.avi"), camera, Path("out:12:30"), box=box, progress=False)
    assert len(open_footage(Path("out:12:30/overlay.mp4")).names) == 12


def test_a_folder_called_like_a_video_is_a_folder(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    folder = shutil.copytree(images, tmp_path / "flight.mp4")
    source = open_footage(folder)
    assert not source.is_video and source.folder == folder and source.rate is None
    before = source.digest()
    (folder / "shot_0.jpg").write_bytes((folder / "shot_1.jpg").read_bytes())
    assert source.digest() != before  # of its files, not of the folder
    poses = predict(small, folder, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    assert len(poses) == 7


def test_a_bar_is_shown_in_a_terminal_only(footage, small, tmp_path, capsys, monkeypatch):
    images, camera, boxes, _ = footage
    given = []

    def bar(frames, *arguments, disable, **more):
        given.append(disable)
        return tqdm(frames, *arguments, disable=disable, **more)

    monkeypatch.setattr(run, "tqdm", bar)
    for progress in (True, False):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=progress)
    assert given == [None, True]
    shown = capsys.readouterr()
    line = "7 poses of 7 frames; boxes.csv (CSV): 7 of 7 boxes used, 0 left out, 0 on no frame"
    names = "its first name shot_0.jpg, the footage's shot_0.jpg"
    camera_line = (
        "camera.json: OpenCV: fx 1660.13, fy 1660.13, cx 955.919, cy 541.397 from camera_matrix; "
        "size 1920x1080 from image_width, image_height; no distortion"
    )
    assert shown.err == ""
    assert shown.out.splitlines() == [camera_line, f"{tmp_path / 'out'}: {line}; {names}"]


def test_json_has_the_numbers_of_the_closing_line(footage, small, tmp_path, capsys):
    """Of two classes one is chosen; a frame cannot be read; a box is of no frame."""
    images, camera, boxes, _ = footage
    folder = shutil.copytree(images, tmp_path / "images")
    (folder / "shot_2.jpg").write_bytes(b"no picture")
    rows = [f"{line},drone" for line in boxes.read_text().splitlines()[1:]]
    rows += ["shot_9.jpg,1,2,30,40,drone", "shot_1.jpg,1,2,30,40,bird"]
    (tmp_path / "b.csv").write_text("\n".join(["frame,x,y,w,h,class", *rows]) + "\n")
    where = ["--camera", str(camera), "--boxes", str(tmp_path / "b.csv"), "--out", str(tmp_path / "out")]
    command = ["predict", str(small), str(folder), *where, "--no-overlay"]
    assert main(command) == 2 and "drone in 7, bird in 1; choose with --class" in capsys.readouterr().err
    assert main([*command, "--class", "drone", "--json", str(tmp_path / "no" / "a.json")]) == 2
    assert not (tmp_path / "out").exists()
    assert main([*command, "--class", "drone", "--json", str(tmp_path / "a.json")]) == 0
    report = json.loads((tmp_path / "a.json").read_text())
    boxes_report = report.pop("boxes")
    assert report == {"frames": 7, "poses": 6, "without_pose": {"cannot be read": 1}}
    assert boxes_report == {
        "file": "b.csv",
        "format": "CSV",
        "boxes": 9,
        "used": 6,
        "left_out": {"of another class": 1, "on a frame that cannot be used": 1},
        "on_no_frame": 1,
        "no_drone": 0,
        "first_name": "shot_0.jpg",
        "footage_first_name": "shot_0.jpg",
        "first_number": None,
        "scaled": 0,
        "remarks": [],
    }
    line = capsys.readouterr().out.splitlines()[-1]
    assert (
        "6 poses of 7 frames, 1 without one (1 cannot be read), see frames.csv; b.csv (CSV): 6 of 9" in line
    )
    assert main([*command, "--class", "bird"]) == 2 and "begun with another boxes" in capsys.readouterr().err


def test_json_replaces_nothing_but_its_own(footage, small, tmp_path, capsys):
    """One word in the wrong place, and the numbers would be written over the camera or the boxes."""
    images, camera, boxes, _ = footage
    before = camera.read_bytes(), boxes.read_bytes()
    command = ["predict", str(small), str(images), "--camera", str(camera), "--boxes", str(boxes)]
    command += ["--out", str(tmp_path / "out"), "--no-overlay", "--json"]
    for path in (camera, boxes):
        assert main([*command, str(path)]) == 2
        assert "for --json, or remove it" in capsys.readouterr().err
    (tmp_path / "out").mkdir()
    assert main([*command, str(tmp_path / "out" / "settings.json")]) == 2
    assert "the run itself writes this file" in capsys.readouterr().err
    assert (camera.read_bytes(), boxes.read_bytes()) == before and not list((tmp_path / "out").iterdir())
    for _ in range(2):
        assert main([*command, str(tmp_path / "a.json")]) == 0


def test_the_closing_line_of_a_tracked_box(video, small, tmp_path, capsys):
    path, camera = video
    predict(small, path, camera, tmp_path / "out", box=(80, 100, 60, 40), overlay=False)
    assert "12 poses of 12 frames; --box (tracker): 12 of 12 boxes used" in capsys.readouterr().out
    with pytest.raises(InputError, match="choose among the boxes of --boxes FILE"):
        predict(small, path, camera, tmp_path / "out", box=(80, 100, 60, 40), tracks=["1"], progress=False)


def test_a_video_whose_header_counts_wrong(video, tmp_path):
    data = bytearray(video[0].read_bytes())
    place = data.index(b"avih") + 8 + 16
    assert int.from_bytes(data[place : place + 4], "little") == 12
    for count in (5, 2**31 - 1):
        data[place : place + 4] = count.to_bytes(4, "little")
        (tmp_path / "video.avi").write_bytes(data)
        assert len(open_footage(tmp_path / "video.avi").names) == 12


def test_a_film_that_could_not_be_written_whole_is_told(video, small, tmp_path, monkeypatch):
    real = cv2.VideoWriter

    class FullDisk:
        def __init__(self, *arguments):
            self.writer, self.room = real(*arguments), 5
            self.isOpened, self.release = self.writer.isOpened, self.writer.release

        def write(self, image):
            self.room -= 1
            if self.room > 0:
                self.writer.write(image)

    predict(small, *video, tmp_path / "out", box=(80, 100, 60, 40), overlay=False, progress=False)
    (tmp_path / "out" / "overlay.mp4").write_text("of an earlier run")
    monkeypatch.setattr(cv2, "VideoWriter", FullDisk)
    with pytest.raises(InputError, match="could not be written whole; is the disk full"):
        predict(small, *video, tmp_path / "out", box=(80, 100, 60, 40), progress=False)
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == ["frames.csv", "overlay.mp4", "poses.csv", "settings.json", "trajectory.png"]
    assert (tmp_path / "out" / "overlay.mp4").read_text() == "of an earlier run"


@pytest.mark.parametrize(
    "name, content",
    [(SETTINGS, '{"theme": "dark"}'), (SETTINGS, "{"), (SETTINGS, "[]"), ("mine.tmp", "keep me")],
)
def test_what_is_not_ours_is_left_alone(footage, small, tmp_path, name, content):
    images, camera, boxes, _ = footage
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text(content)
    with pytest.raises(InputError, match="choose another folder"):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [name]
    assert (tmp_path / "out" / name).read_text() == content


def test_a_table_in_place_of_the_journal_is_left_alone(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    out = tmp_path / "out"
    predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
    (out / JOURNAL).write_text("frame,x,y,w,h\n0,1,2,3,4\n")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(InputError, match="choose another folder"):
        predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_what_a_kill_while_writing_left_behind_is_removed(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    out = tmp_path / "out"
    out.mkdir()
    for name in ("overlay.mp4", "frames.csv", "settings.json"):
        (out / f".{name}.0123456789abcdef.tmp{Path(name).suffix}").write_text("half")
    predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
    written = sorted(path.name for path in out.iterdir())
    assert written == ["frames.csv", "poses.csv", "settings.json", "trajectory.png"]


def test_other_pictures_under_the_same_folder_are_another_footage(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    folder = shutil.copytree(images, tmp_path / "images")
    predict(small, folder, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    shutil.copy(folder / "shot_1.jpg", folder / "shot_0.jpg")
    with pytest.raises(InputError, match="begun with another footage"):
        predict(small, folder, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)


def test_rows_that_cannot_be_read_are_made_again(footage, small, names, tmp_path):
    images, camera, boxes, _ = footage
    whole = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    journal = tmp_path / "out" / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    cells = lines[3].split(b",")
    for column, value in ((3, b"\xff"), (7, b"\xff"), (7, b"Concorde")):  # a number, the drone's name
        row = b",".join([*cells[:column], value, *cells[column + 1 :]])
        journal.write_bytes(b"".join([*lines[:3], row, *lines[4:]]))
        assert len(read_journal(journal, names)) == 2
        again = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
        np.testing.assert_allclose([pose.t for pose in again], [pose.t for pose in whole], atol=1e-5)


def test_two_processes_may_not_write_one_run(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    (tmp_path / "out").mkdir()
    with lock_folder(tmp_path / "out"), pytest.raises(InputError, match="another process is at work"):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)


def test_a_flight_of_the_data_set_is_footage(small, frames, tmp_path):
    """With its own camera file, and the COCO file of the whole data set.

    In that, every flight has a 000000.jpg.
    """
    flight = frames.folders[4]
    poses = predict(
        small,
        flight / "rgb",
        flight / "scene_camera.json",
        tmp_path / "out",
        boxes=frames.root / "coco_test.json",
        progress=False,
    )
    np.testing.assert_allclose(poses[0].box, frames.frames[4].box, atol=0.01)
    np.testing.assert_array_equal(read_camera(flight / "scene_camera.json").K, frames.frames[4].K)
    with pytest.raises(InputError, match="its first name is test/000600/rgb/000000.jpg, the footage lies in"):
        read_boxes(frames.root / "coco_test.json", ("000000.jpg",), 1920, 1080, tmp_path)
    (tmp_path / "link").symlink_to(flight / "rgb")
    linked = read_boxes(frames.root / "coco_test.json", ("000000.jpg",), 1920, 1080, tmp_path / "link")
    np.testing.assert_allclose(linked[0], frames.frames[4].box, atol=0.01)


@pytest.fixture
def scene(frames, tmp_path):
    """Scene 651 of a BOP data set with pictures 0, 40 and 80, its camera file, and the box in each."""
    folder = tmp_path / "set" / "test" / "000651"
    (folder / "rgb").mkdir(parents=True)
    flight = frames.folders[4]
    camera = json.loads((flight / "scene_camera.json").read_text())["0"]
    for number in (0, 40, 80):
        shutil.copy(flight / "rgb" / "000000.jpg", folder / "rgb" / f"{number:06d}.jpg")
    cameras = {str(number): camera for number in (0, 40, 80)}
    (folder / "scene_camera.json").write_text(json.dumps(cameras))
    return folder, folder / "scene_camera.json", tuple(frames.frames[4].box)


def numbers_of_poses(out):
    """(scene_id, im_id) of each row of poses.csv."""
    rows = csv.DictReader((out / POSES).read_text().splitlines())
    return [(int(row["scene_id"]), int(row["im_id"])) for row in rows]


@pytest.mark.parametrize("given", ["", "rgb", "rgb/000040.jpg"])
def test_the_poses_of_a_bop_scene_have_its_numbers(scene, small, tmp_path, given):
    folder, camera, box = scene
    predict(small, folder / given, camera, tmp_path / "out", box=box, overlay=False, progress=False)
    wanted = [(651, 40)] if given.endswith(".jpg") else [(651, 0), (651, 40), (651, 80)]
    assert numbers_of_poses(tmp_path / "out") == wanted


def test_other_footage_is_counted_from_0(scene, small, tmp_path):
    """Names that are no numbers, a folder that is no number, no scene_camera.json beside the folder."""
    folder, camera, box = scene
    shutil.copy(camera, tmp_path)
    for name in ("named", "unnumbered", "alone"):
        shutil.copytree(folder, tmp_path / name / "000651")
    images = [tmp_path / name / "000651" / "rgb" for name in ("named", "unnumbered", "alone")]
    (images[0] / "000080.jpg").rename(images[0] / "last.jpg")
    (images[1].parent).rename(images[1].parent.with_name("flight"))
    images[1] = images[1].parent.with_name("flight") / "rgb"
    (images[2].parent / "scene_camera.json").unlink()
    for i, place in enumerate(images):
        out = tmp_path / f"out{i}"
        predict(small, place, tmp_path / camera.name, out, box=box, overlay=False, progress=False)
        assert numbers_of_poses(out) == [(0, 0), (0, 1), (0, 2)]


def test_a_bop_scene_names_the_drones_by_its_own_numbers(scene, tmp_path):
    folder, camera, box = scene
    save_with_drones(tmp_path / "net", DroneClass("OnlyOne", SQUARE))
    models = folder.parents[1] / "models"
    models.mkdir()
    (models / "models_info.json").write_text(json.dumps({"3": {"name": "Other"}, "5": {"name": "OnlyOne"}}))
    predict(tmp_path / "net", folder, camera, tmp_path / "out", box=box, overlay=False, progress=False)
    rows = csv.DictReader((tmp_path / "out" / POSES).read_text().splitlines())
    assert [row["obj_id"] for row in rows] == ["5", "5", "5"]


@pytest.fixture
def crops(frames, tmp_path):
    """Scene 7 of a BOP data set: crops of three whole frames, as the second edition stores them.

    Its folder, the indices into `frames`, and a file with the boxes.
    """
    folder = tmp_path / "crops" / "test" / "000007"
    (folder / "rgb").mkdir(parents=True)
    chosen, cameras, infos, boxes = [0, 7, 13], {}, {}, ["frame,x,y,w,h"]
    for number, index in enumerate(chosen):
        frame = frames.frames[index]
        square = clamp_square(square_around(frame.box, 1.3), 1920, 1080)
        crop = crop_image(frames.stored_image(index), square, 256)
        cv2.imwrite(str(folder / "rgb" / f"{number:06d}.png"), crop[..., ::-1])
        K = crop_intrinsics(frame.K, square, 256)
        cameras[str(number)] = {"cam_K": K.ravel().tolist(), "cam_K_frame": frame.K.ravel().tolist()}
        infos[str(number)] = [{"crop": square.tolist()}]
        corner, extent = frame.box[:2] - square[:2], frame.box[2:]
        box = np.concatenate([corner, extent]) * 256 / square[2]
        boxes.append(f"{number},{','.join(str(value) for value in box)}")
    (folder / "scene_camera.json").write_text(json.dumps(cameras))
    (folder / "scene_gt_info.json").write_text(json.dumps(infos))
    (tmp_path / "crops.csv").write_text("\n".join(boxes))
    return folder, chosen, tmp_path / "crops.csv"


def test_every_image_of_a_bop_scene_has_its_own_camera(crops, frames, tmp_path):
    """The pose in a crop is the pose in the whole frame."""
    folder, chosen, boxes = crops
    camera = folder / "scene_camera.json"
    poses = predict(CHECKPOINT, folder, camera, tmp_path / "out", boxes=boxes, progress=False)
    model = DroneKeyPP.from_pretrained(CHECKPOINT)
    for pose, index in zip(poses, chosen, strict=True):
        item = frames[index]
        with torch.inference_mode():
            whole = model(item["image"][None], item["K"][None], item["square"][None])
        assert geodesic_degrees(torch.tensor(pose.R), whole["R"][0].double()) < 3
        np.testing.assert_allclose(pose.t, whole["t"][0], rtol=0.03, atol=0.05)
    assert numbers_of_poses(tmp_path / "out") == [(7, 0), (7, 1), (7, 2)]
    one = tmp_path / "one"
    box = tuple(float(value) for value in boxes.read_text().splitlines()[2].split(",")[1:])
    [pose] = predict(CHECKPOINT, folder / "rgb" / "000001.png", camera, one, box=box, progress=False)
    np.testing.assert_allclose(pose.t, poses[1].t, atol=1e-3)


def test_cameras_that_are_not_those_of_the_images_are_refused(crops, small, tmp_path):
    folder, _, boxes = crops
    camera = folder / "scene_camera.json"
    content = camera.read_text()

    def refused(match, camera, footage=folder):
        with pytest.raises(InputError, match=match):
            predict(small, footage, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)

    shutil.copy(camera, tmp_path)
    refused("frame 0: crops, and each has a camera of its own; give .*000007", tmp_path / camera.name)
    shutil.copytree(folder / "rgb", tmp_path / "alone")
    refused("not one camera for all of them; each frame gets", tmp_path / camera.name, tmp_path / "alone")
    table = json.loads(content)
    camera.write_text(json.dumps({number: table[number] for number in "01"}))
    refused("frame 2: crops of the first edition", camera)
    (folder / "scene_gt_info.json").rename(tmp_path / "infos.json")
    refused("scene_camera.json: no cam_K of frame 2", camera)
    camera.write_text(json.dumps({**table, "1": {"cam_K": [1, 2]}}))
    refused("scene_camera.json frame 1: cam_K needs 3×3 numbers", camera)
    (tmp_path / "infos.json").rename(folder / "scene_gt_info.json")
    for entry in table.values():
        entry["cam_K"] = entry.pop("cam_K_frame")
    camera.write_text(json.dumps(table))
    refused("scene_gt_info.json frame 0: crops of the first edition, whose cam_K is not theirs", camera)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("smooth", [-1, float("nan"), 1e-200])
def test_a_bad_smoothing(footage, small, tmp_path, smooth):
    images, camera, boxes, _ = footage
    with pytest.raises(InputError, match="--smooth .* seconds, at least 0.001"):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, smooth=smooth, progress=False)


def test_one_image_from_the_command_line(footage, small, tmp_path, capsys, monkeypatch):
    images, camera, _, _ = footage
    (tmp_path / "shot_0.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    command = [
        "predict",
        str(small),
        str(images / "shot_0.jpg"),
        "--camera",
        str(camera),
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*command, "--boxes", str(tmp_path / "shot_0.txt")]) == 0
    assert "1 poses of 1 frames" in capsys.readouterr().out
    assert cv2.imread(str(tmp_path / "out" / "overlay.png")).shape == (1080, 1920, 3)
    assert main(command) == 2 and "either --boxes FILE or --box" in capsys.readouterr().err
    assert main([*command, "--box", "1,2,3"]) == 2 and "write x,y,w,h" in capsys.readouterr().err

    def stopped(*args, **settings):
        raise KeyboardInterrupt

    monkeypatch.setattr("dronekeypp.predict.predict", stopped)
    assert main([*command, "--box", "1,2,3,4"]) == 130 and capsys.readouterr().err == "stopped\n"


def test_bad_footage(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.md").write_text("hello")
    (tmp_path / "broken.mp4").write_bytes(b"no video")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("keep me")
    bad = {
        "empty": "no image in this folder",
        "text.md": "neither an image",
        "broken.mp4": "cannot be opened",
        "no.mp4": "not found",
    }
    for path, match in bad.items():
        with pytest.raises(InputError, match=match):
            open_footage(tmp_path / path)
    (tmp_path / "full" / ".lock").write_text("theirs")
    with pytest.raises(InputError, match="not empty and not a run of predict"):
        predict(small, images, camera, tmp_path / "full", boxes=boxes, progress=False)
    assert (tmp_path / "full" / ".lock").read_text() == "theirs"
    with pytest.raises(InputError, match="boxes not found"):
        predict(small, images, camera, tmp_path / "out", boxes=tmp_path / "no.csv", progress=False)
    with pytest.raises(InputError, match="camera file not found"):
        predict(small, images, tmp_path / "no.json", tmp_path / "out", boxes=boxes, progress=False)
