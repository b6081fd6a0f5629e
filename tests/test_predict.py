"""Poses in one's own footage: the numbers are the network's, every file format says the same, and nothing broken stops it."""

import csv
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from fakes import FakeDrones, saved

from dronekeypp import predict as predict_module
from dronekeypp.camera import from_crop, to_crop
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.files import lock_folder
from dronekeypp.footage import Calibration, Footage, Tracker, open_footage, read_boxes, read_camera
from dronekeypp.model import DroneKeyPP
from dronekeypp.predict import JOURNAL, POSES, mirror_doubt, predict, read_journal
from dronekeypp.rotations import geodesic_degrees
from dronekeypp.sequences import gaussian
from dronekeypp.sixdronesyn.dataset import SixDroneSyn

ROOT = Path(__file__).parents[1]
CHECKPOINT = ROOT / "data_samples" / "checkpoint"


@pytest.fixture(scope="module")
def frames():
    """Seven whole frames, one of every drone."""
    return SixDroneSyn(ROOT / "data_samples" / "frames", "test", size=96, stride=1)


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
        """The truth, whichever way round the picture is: left of the principal point becomes right, and the hubs swap names."""
        flipped = not torch.equal(image, items["image"])
        pixels = from_crop(items["keypoints"], items["square"])
        if flipped:
            pixels = torch.stack([2 * K[:, None, 0, 2] - pixels[..., 0], pixels[..., 1]], dim=-1)[
                :, [1, 0, 3, 2]
            ]
        return {"keypoints": to_crop(pixels, square) + (torch.tensor([0.03, 0.04]) if flipped else 0)}

    doubt = mirror_doubt(sees, items["image"], items["K"], items["square"], items["keypoints"])
    torch.testing.assert_close(doubt, torch.full((6,), 0.05), atol=1e-5, rtol=0)


def test_a_killed_run_goes_on(footage, small, tmp_path, monkeypatch):
    images, camera, boxes, _ = footage
    monkeypatch.setattr(predict_module, "BATCH", 2)
    whole = predict(small, images, camera, tmp_path / "whole", boxes=boxes, overlay=False, progress=False)
    calls = []
    real = predict_module.fill

    def dies(*arguments):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(predict_module, "fill", dies)
    with pytest.raises(KeyboardInterrupt):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    journal = tmp_path / "out" / JOURNAL
    assert len(read_journal(journal)) == 4
    journal.write_text(journal.read_text() + "4,shot_4.jpg,ok,12.")  # half a row
    seen = []
    monkeypatch.setattr(
        predict_module, "fill", lambda *arguments: (seen.append(len(arguments[2])), real(*arguments))[1]
    )
    poses = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    assert sum(seen) == 3  # only what was missing
    for a, b in zip(whole, poses, strict=True):
        np.testing.assert_allclose(a.t, b.t, atol=1e-5)
    with pytest.raises(InputError, match="was begun with another checkpoint"):
        predict(CHECKPOINT, images, camera, tmp_path / "out", boxes=boxes, progress=False)


def test_a_run_killed_before_its_first_row_goes_on(footage, small, tmp_path, monkeypatch):
    images, camera, boxes, _ = footage
    real = predict_module.fill
    monkeypatch.setattr(predict_module, "fill", lambda *arguments: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    monkeypatch.setattr(predict_module, "fill", real)
    assert (
        len(predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)) == 7
    )


def test_a_mended_input_is_taken(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    mine = tmp_path / "boxes.csv"
    mine.write_text(boxes.read_text().replace("shot_0", "shot_x"))
    with pytest.raises(InputError, match="line 2: not a frame"):
        predict(small, images, camera, tmp_path / "out", boxes=mine, overlay=False, progress=False)
    mine.write_text(boxes.read_text())
    assert (
        len(predict(small, images, camera, tmp_path / "out", boxes=mine, overlay=False, progress=False)) == 7
    )


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


def test_a_broken_frame_is_told_and_passed_over(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    folder = shutil.copytree(images, tmp_path / "images")
    (folder / "shot_2.jpg").unlink()
    (folder / "shot_2.jpg").symlink_to("nowhere.jpg")
    cv2.imwrite(str(folder / "shot_4.jpg"), np.zeros((100, 200, 3), np.uint8))
    few = tmp_path / "few.csv"
    few.write_text("\n".join(line for line in boxes.read_text().splitlines() if "shot_5" not in line) + "\n")
    poses = predict(small, folder, camera, tmp_path / "out", boxes=few, smooth=0.05, progress=False)
    assert [pose.frame for pose in poses] == [0, 1, 3, 6]
    status = [row["status"] for row in read_journal(tmp_path / "out" / JOURNAL)]
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
    given = dict(boxes=boxes, overlay=False, progress=False)
    raw, slow, fast = (
        predict(small, images, camera, tmp_path / "out", smooth=smooth, rate=rate, **given)
        for smooth, rate in ((0.0, 30), (0.05, 1), (0.05, 900))
    )
    spread = [np.ptp([pose.t for pose in poses], axis=0).max() for poses in (raw, slow, fast)]
    np.testing.assert_allclose(
        [pose.t for pose in slow], [pose.t for pose in raw]
    )  # a second apart: no neighbour near
    assert spread[2] < spread[0]
    with pytest.raises(InputError, match="--rate 0: frames a second, above 0"):
        predict(small, images, camera, tmp_path / "out", rate=0, **given)


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
    monkeypatch.setattr(predict_module, "carry", None)  # nothing is left to track
    assert (
        len(
            predict(
                small,
                path,
                camera,
                tmp_path / "out",
                box=(80, 100, 60, 40),
                smooth=0.1,
                overlay=False,
                progress=False,
            )
        )
        == 12
    )


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

    monkeypatch.setattr(cv2, "VideoWriter", FullDisk)
    with pytest.raises(InputError, match="could not be written whole; is the disk full"):
        predict(small, *video, tmp_path / "out", box=(80, 100, 60, 40), progress=False)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "frames.csv",
        "poses.csv",
        "settings.json",
        "trajectory.png",
    ]


def test_what_is_not_ours_is_left_alone(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    for name, settings, journal in (
        ("theirs", '{"theme": "dark"}', None), ("broken", "{", None), ("list", "[]", None), ("csv", None, "frame,x,y,w,h\n0,1,2,3,4\n"),
    ):  # fmt: skip
        out = tmp_path / name
        if settings is None:
            predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
        out.mkdir(exist_ok=True)
        if settings:
            (out / "settings.json").write_text(settings)
        if journal:
            (out / JOURNAL).write_text(journal)
        before = {path.name: path.read_bytes() for path in out.iterdir()}
        with pytest.raises(InputError, match="choose another folder"):
            predict(small, images, camera, out, boxes=boxes, overlay=False, progress=False)
        assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_other_pictures_under_the_same_folder_are_another_footage(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    folder = shutil.copytree(images, tmp_path / "images")
    predict(small, folder, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    shutil.copy(folder / "shot_1.jpg", folder / "shot_0.jpg")
    with pytest.raises(InputError, match="begun with another footage"):
        predict(small, folder, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)


def test_rows_that_cannot_be_read_are_made_again(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    whole = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
    journal = tmp_path / "out" / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    cells = lines[3].split(b",")
    for damaged in (3, 7):  # a number, the drone's name
        row = b",".join([*cells[:damaged], b"\xff", *cells[damaged + 1 :]])
        journal.write_bytes(b"".join([*lines[:3], row, *lines[4:]]))
        assert len(read_journal(journal)) == 2
        again = predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)
        np.testing.assert_allclose([pose.t for pose in again], [pose.t for pose in whole], atol=1e-5)


def test_two_processes_may_not_write_one_run(footage, small, tmp_path):
    images, camera, boxes, _ = footage
    (tmp_path / "out").mkdir()
    with lock_folder(tmp_path / "out"), pytest.raises(InputError, match="another process is at work"):
        predict(small, images, camera, tmp_path / "out", boxes=boxes, overlay=False, progress=False)


def test_a_flight_of_the_data_set_is_footage(small, frames, tmp_path):
    """Its own camera file, and the COCO file of the whole data set, in which every flight has a 000000.jpg."""
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
    with pytest.raises(InputError, match="21 images could be"):
        read_boxes(frames.root / "coco_test.json", ("000000.jpg",), 1920, 1080, tmp_path)
    (tmp_path / "link").symlink_to(flight / "rgb")
    linked = read_boxes(frames.root / "coco_test.json", ("000000.jpg",), 1920, 1080, tmp_path / "link")
    np.testing.assert_allclose(linked[0], frames.frames[4].box, atol=0.01)


def test_coco_sets_of_several_videos(tmp_path):
    """Frames of a video lie as in a folder of its name; ids may be long; an absolute name counts; a sliver of a box does not."""
    ids = (-9223372036854775801, 18446744073709551611, 5.0, 7)
    names = ("v1/000000.jpg", "v2/000000.jpg", f"{tmp_path}/v2/000001.jpg", "v1/000001.jpg")
    entries = [{"image_id": i, "bbox": [10 * n, 20, 30, 40]} for n, i in enumerate(ids, 1)] + [
        {"image_id": ids[1], "bbox": [99.5, 20, 0.5, 40]}
    ]
    coco = {
        "images": [{"id": i, "file_name": name} for i, name in zip(ids, names, strict=True)],
        "annotations": entries,
    }
    (tmp_path / "coco.json").write_text(json.dumps(coco))
    found = read_boxes(
        tmp_path / "coco.json", ("000000", "000001"), 200, 100, Footage(tmp_path / "v2.mp4", (), None).folder
    )
    assert {frame: box[0] for frame, box in found.items()} == {0: 20, 1: 30}


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
    monkeypatch.setattr("dronekeypp.cli._predict", lambda args: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main([*command, "--box", "1,2,3,4"]) == 130 and capsys.readouterr().err == "stopped\n"


def test_numbered_names(tmp_path):
    for name in ("1.jpg", "2.jpg", "10.jpg"):
        cv2.imwrite(str(tmp_path / name), np.zeros((8, 8, 3), np.uint8))
    names = open_footage(tmp_path).names
    assert names == ("1.jpg", "2.jpg", "10.jpg")  # as people count
    (tmp_path / "numbers.csv").write_text(
        "\ufeffframe,x,y,w,h\n0,1,1,2,2\n1,2,1,2,2\n2,3,1,2,2\n", encoding="utf-8"
    )
    (tmp_path / "names.csv").write_text("frame,x,y,w,h\n1,1,1,2,2\n2,2,1,2,2\n10,3,1,2,2\n")
    for name in ("numbers.csv", "names.csv"):
        assert [box[0] for box in read_boxes(tmp_path / name, names, 8, 8).values()] == [1, 2, 3], name


def test_a_detectors_labels_of_a_video(tmp_path):
    (tmp_path / "flight_1.txt").write_text(
        "0 0.5 0.5 0.2 0.2 0.9 1\n0 0.1 0.1 0.2 0.2 0.3 9\n"
    )  # class, box, confidence, track
    (tmp_path / "flight_3.txt").write_text(
        "0 0.5 0.5 0.2 0.2 0.1 0.2 0.9 0.3 0.4 0.1\n"
    )  # class, box, keypoints
    found = read_boxes(tmp_path, ("000000", "000001", "000002"), 100, 100)
    assert sorted(found) == [0, 2] and found[0].tolist() == pytest.approx([40, 40, 20, 20])


def test_every_format_of_boxes_says_the_same(tmp_path):
    names = ("a.jpg", "b.jpg", "c.jpg")
    (tmp_path / "boxes.csv").write_text(
        "frame,x,y,w,h,score\na.jpg,10,20,30,40,0.5\na.jpg,1,2,3,4,0.4\nc.jpg,50,60,20,10,0.9\n"
    )
    (tmp_path / "mot.txt").write_text("1,7,10,20,30,40,0.9,-1,-1,-1\n3,7,50,60,20,10,0.9,-1,-1,-1\n")
    (tmp_path / "yolo").mkdir()
    (tmp_path / "yolo" / "a.txt").write_text("0 0.125 0.4 0.15 0.4 0.9\n0 0.5 0.5 0.1 0.1 0.2\n")
    (tmp_path / "yolo" / "c.txt").write_text("0 0.3 0.65 0.1 0.1\n")
    (tmp_path / "yolo" / "classes.txt").write_text("drone\n")  # labelImg writes one
    entries = [{"image_id": 5, "bbox": [10, 20, 30, 40]}, {"image_id": 9, "bbox": [50, 60, 20, 10]}]
    coco = {
        "images": [{"id": 5, "file_name": "x/a.jpg"}, {"id": 9, "file_name": "c.jpg"}],
        "annotations": entries,
    }
    (tmp_path / "coco.json").write_text(json.dumps(coco))
    by_number = [
        {**entry, "image_id": frame, "score": 0.7} for entry, frame in zip(entries, ("a", 2), strict=True)
    ]
    (tmp_path / "detections.json").write_text(json.dumps(by_number))
    for name in ("boxes.csv", "mot.txt", "yolo", "coco.json", "detections.json"):
        found = read_boxes(tmp_path / name, names, 200, 100)
        assert sorted(found) == [0, 2], name
        np.testing.assert_allclose(found[0], [10, 20, 30, 40], err_msg=name)
        np.testing.assert_allclose(found[2], [50, 60, 20, 10], err_msg=name)


@pytest.mark.parametrize(
    "name, text, match",
    [
        ("b.csv", "frame,x,y\n0,1,2\n", "the header needs frame, x, y, w, h"), ("b.csv", "frame,x,y,w,h\nz.jpg,1,2,3,4\n", "line 2: not a frame"),
        ("b.csv", "frame,x,y,w,h\n0,1,2,0,4\n", "line 2: a box needs .* above 0"),
        ("b.csv", "frame,x,y,w,h\n0,300,2,5,4\n", "outside the 200×100 frame"),
        ("b.csv", "frame,x,y,w,h\n0,nan,2,5,4\n", "finite"), ("b.csv", "frame,x,y,w,h\n9,1,2,5,4\n", "no box for any of the 3 frames"),
        ("b.txt", "1,2,three\n", "line 1: not numbers"), ("b.txt", "1,2,3\n", "a MOT line is"), ("b.txt", "0 0.5 0.5\n", "a YOLO line is"),
        ("b.json", "{", "not valid JSON"), ("b.json", "{}", "neither a COCO list"),
        ("b.txt", "0,7,10,20,30,40,0.9\n", "MOT counts from 1"), ("b.csv", "frame,x,y,w,h,score\n0,1,2,5,4,nan\n", "the score is nan"),
        ("b.csv", "frame,x,y,w,h\n0,0.5,0.5,0.1,0.1\n", "shares of the frame"), ("b.csv", "frame,x,y,w,h\n-1,1,2,5,4\n", "frame -1; the first is"),
        ("b.json", '[{"image_id": 1e999, "bbox": [1, 2, 3, 4]}]', "entry 0: needs image_id"), ("b.json", "[" * 100000, "not valid JSON"),
        ("b.txt", "nan,1,2,3,4,5\n", "line 1: not finite"), ("b.json", '{"images": [1]}', "an image without id"),
        ("b.json", '{"images": null, "annotations": null}', "neither a COCO list"), ("b.json", '[{"bbox": [1, 2, 3, 4]}]', "entry 0: needs image_id"),
    ],
)  # fmt: skip
def test_bad_boxes(name, text, match, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=match):
        read_boxes(tmp_path / name, ("a.jpg", "b.jpg", "c.jpg"), 200, 100)


def test_opencvs_own_calibration_files(tmp_path):
    K = np.array([[1000.0, 0, 639.5], [0, 1001.0, 359.5], [0, 0, 1]])
    for suffix in ("yml", "xml", "json"):
        file = cv2.FileStorage(str(tmp_path / f"camera.{suffix}"), cv2.FILE_STORAGE_WRITE)
        file.write("calibration_time", "today")
        file.write("image_width", 1280)
        file.write("image_height", 720)
        file.write("camera_matrix", K)
        file.write("distortion_coefficients", np.array([[-0.2, 0.05, 0.001, 0, 0]]))
        file.release()
        found = read_camera(tmp_path / f"camera.{suffix}")
        np.testing.assert_allclose(found.K[:2, 2], [640, 360])  # our pixel centres lie at +0.5
        np.testing.assert_allclose(found.opencv_K, K)
        assert found.size == (1280, 720) and len(found.distortion) == 5
    half = found.for_frames(640, 360)
    np.testing.assert_allclose(half.K[:2], found.K[:2] / 2)
    np.testing.assert_allclose(
        found.for_frames(854, 480).K[0, 0], 1000 * 854 / 1280
    )  # 480p: a third of a pixel off
    with pytest.raises(InputError, match="not the same shape"):
        found.for_frames(640, 480)
    with pytest.raises(InputError, match="a focal length of 0.9 pixels"):
        Calibration(np.array([[0.9, 0, 0.5], [0, 0.9, 0.5], [0, 0, 1]])).for_frames(640, 480)


def test_a_distorted_frame_is_straightened():
    K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    bent = Calibration(K, np.array([-0.3, 0.1, 0.0, 0.0]))
    corners = np.array([[250.0, 60.0], [290.0, 90.0]])  # of a box in the distorted picture
    box = bent.undistort_box(np.array([*corners[0], *(corners[1] - corners[0])]))
    assert box[0] + box[2] > 290 and box[1] < 60  # barrel distortion drew it towards the middle
    image = np.zeros((240, 320, 3), np.uint8)
    image[60:90, 250:290] = 255
    bright = np.argwhere(bent.undistort(image)[..., 0] > 127)
    assert box[0] - 1 <= bright[:, 1].min() and bright[:, 1].max() <= box[0] + box[2] + 1
    straight = Calibration(K)
    assert straight.undistort(image) is image


@pytest.mark.parametrize(
    "name, text, match",
    [
        ("c.json", "{", "not valid JSON"), ("c.json", "[]", "holds no settings"), ("c.json", "{}", "holds no camera_matrix"),
        ("c.json", '{"K": [[1, 0], [0, 1]]}', "3×3 numbers"), ("c.yml", "hello", "not a calibration"),
        ("c.json", '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "fisheye_model": 1}', "a fisheye camera"),
        ("c.json", '{"K": [[-5, 0, 1], [0, 5, 1], [0, 0, 1]]}', "focal lengths must be positive"),
        ("c.json", '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "dist_coeffs": [1, 2]}', "distortion has 2 numbers"),
        ("c.json", '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "image_width": -32, "image_height": -24}', "must be positive"),
        ("c.json", '{"K": [[5, 0, 1], [0, 5, 1], [0, 0, 1]], "image_width": 1e999, "image_height": 24}', "numbers"),
        ("scene_camera.json", "{}", "not one camera for all"), ("scene_camera.json", '{"0": 1}', "3×3 numbers|no camera_matrix"),
    ],
)  # fmt: skip
def test_bad_cameras(name, text, match, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=match):
        read_camera(tmp_path / name)


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
