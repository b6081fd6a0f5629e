"""Whole frames for a detector: labels, splits, kills, and those who train on them."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import torchvision
from plain_bop import make_plain_folder

from dronekeypp.classes import names_of
from dronekeypp.cli import main
from dronekeypp.convert import convert, labels, run
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn.coco import coco
from dronekeypp.sixdronesyn.generate import generate
from dronekeypp.stored import StoredFrame

ROOT = Path(__file__).parents[1]
FRAME = np.array([scenes.WIDTH, scenes.HEIGHT])


@pytest.fixture(scope="module")
def whole(tmp_path_factory, environments):
    """18 whole frames of one drone, in one scene of each split. Read only."""
    root = tmp_path_factory.mktemp("whole") / "frames"
    selection = dict(scene_numbers=[1, 3, 6], drone_names=["Tello"], stride=60, progress=False)
    generate(root, environments=environments, frames="full", **selection)
    return root


@pytest.fixture
def plain(tmp_path):
    """Somebody else's BOP folder, 1280×720, which may be changed."""
    return make_plain_folder(tmp_path / "plain")


def lines_of(folder, split, name):
    """The lines of a label file as numbers, (drones, columns)."""
    text = (folder / "labels" / split / f"{name}.txt").read_text()
    return np.array([[float(word) for word in line.split()] for line in text.splitlines()])


def edit(path, change):
    """Change what a JSON file holds."""
    table = json.loads(path.read_text())
    change(table)
    path.write_text(json.dumps(table))


# --- Ultralytics' layout ----------------------------------------------------------------------------------


def test_labels_are_the_annotations_and_names_lead_back(whole, tmp_path):
    out = convert(whole, "yolo", tmp_path / "yolo", progress=False)
    for split in scenes.SPLITS:
        frames = open_dataset(whole, split)
        assert len(list((out / "images" / split).iterdir())) == len(frames) == 6
        for stored in frames.stored:
            name = f"{stored.folder.name}_{stored.annotation.number:06d}"
            picture = out / "images" / split / f"{name}.jpg"
            assert os.path.samefile(picture, whole / split / stored.folder.name / "rgb" / stored.image.name)
            (line,) = lines_of(out, split, name)
            assert line[0] == 0 and len(line) == 5
            box = np.concatenate([(line[1:3] - line[3:5] / 2) * FRAME, line[3:5] * FRAME])
            np.testing.assert_allclose(box, stored.annotation.box, atol=0.002)
    yaml = (out / "data.yaml").read_text()
    assert yaml == 'train: images/train\nval: images/val\ntest: images/test\nnames:\n  0: "drone"\n'


def test_keypoints_and_types(whole, tmp_path):
    out = convert(whole, "yolo", tmp_path / "pose", keypoints=True, types=True, progress=False)
    frames = open_dataset(whole, "test")
    seen = []
    for stored, label in zip(frames.stored, frames.labels, strict=True):
        (line,) = lines_of(out, "test", f"{stored.folder.name}_{stored.annotation.number:06d}")
        assert line[0] == label and len(line) == 5 + 4 * 3
        points = line[5:].reshape(4, 3)
        np.testing.assert_allclose(points[:, :2] * FRAME, stored.annotation.keypoints_2d, atol=0.002)
        seen.append(points[:, 2] == 2)
        assert (seen[-1] == stored.annotation.visible).all()
    assert np.any(seen) and not np.all(seen)
    yaml = (out / "data.yaml").read_text()
    assert "kpt_shape: [4, 3]\nflip_idx: [1, 0, 3, 2]\n" in yaml
    assert f'  {names_of(frames.drones).index("Tello")}: "Tello"\n' in yaml


def test_what_lies_outside_the_picture_is_cut_off(plain, tmp_path):
    flight = next((plain / "train").iterdir())
    number = min(int(path.stem) for path in (flight / "rgb").iterdir())
    points = [-20.0, 10.0, 30.0, 12.0, 32.0, 40.0, 700.0, 721.0]

    def move_keypoints(table):
        table[str(number)][0]["keypoints_2d"] = points
        table[str(number)][0]["keypoints_visible"] = [True, True, False, True]

    edit(flight / "scene_gt.json", move_keypoints)
    edit(
        flight / "scene_gt_info.json",
        lambda table: table[str(number)][0].update(bbox_obj=[-40.0, -10.0, 100.0, 60.0]),
    )
    out = convert(plain, "yolo", tmp_path / "out", keypoints=True, progress=False)
    (line,) = lines_of(out, "train", f"{flight.name}_{number:06d}")
    np.testing.assert_allclose(line[1:5], [30 / 1280, 25 / 720, 60 / 1280, 50 / 720], atol=1e-6)
    assert line[5:].reshape(4, 3)[:, 2].tolist() == [0, 2, 1, 0]
    assert line[5:8].tolist() == [0, 0, 0]
    for path in (out / "labels").rglob("*.txt"):
        values = lines_of(out, path.parent.name, path.stem)
        assert values[:, 1:5].min() >= 0 and values[:, 1:5].max() <= 1
        assert values[:, 5:].reshape(-1, 3)[:, :2].min() >= 0
        assert values[:, 5:].reshape(-1, 3)[:, :2].max() <= 1


def test_two_drones_in_a_picture_are_two_lines(plain, tmp_path):
    flight = next((plain / "val").iterdir())
    for name in ("scene_gt.json", "scene_gt_info.json"):
        edit(flight / name, lambda table: [entry.append(dict(entry[0])) for entry in table.values()])
    edit(
        flight / "scene_gt_info.json",
        lambda table: [entry[1].update(bbox_obj=[64.0, 72.0, 128.0, 144.0]) for entry in table.values()],
    )
    out = convert(plain, "yolo", tmp_path / "out", progress=False)
    for picture in (flight / "rgb").iterdir():
        lines = lines_of(out, "val", f"{flight.name}_{picture.stem}")
        assert lines[1].tolist() == [0, 0.1, 0.2, 0.1, 0.2] and lines[0].tolist() != lines[1].tolist()


def test_pictures_without_a_drone_and_drones_at_the_border_count(plain, tmp_path, capsys):
    """A detector needs both: the former have an empty label, the latter what is seen of their box."""
    flight = sorted((plain / "train").iterdir())[0]
    picture = next((flight / "rgb").iterdir())
    for number in (1, 2, 3, 4):
        shutil.copy(picture, picture.with_name(f"{number:06d}.png"))
    boxes = {1: [-90, 10, 120, 40], 2: [1400, 10, 60, 40], 3: [-1, -1, -1, -1]}

    def add(table):
        for number, box in boxes.items():
            table[str(number)] = json.loads(json.dumps(table["0"]))
            if "bbox_obj" in table["0"][0]:
                table[str(number)][0]["bbox_obj"] = box

    edit(flight / "scene_camera.json", lambda table: [table.update({str(n): table["0"]}) for n in boxes])
    for name in ("scene_gt.json", "scene_gt_info.json"):
        edit(flight / name, add)
    out = convert(plain, "yolo", tmp_path / "out")
    texts = []
    for number in range(4):
        texts.append((out / "labels" / "train" / f"{flight.name}_{number:06d}.txt").read_text())
        assert (out / "images" / "train" / f"{flight.name}_{number:06d}.png").is_file()
    assert texts[1] == f"0 {15 / 1280:.6f} {30 / 720:.6f} {30 / 1280:.6f} {40 / 720:.6f}\n"
    assert texts[0].count("\n") == 1 and texts[2:] == ["", ""]
    assert not (out / "images" / "train" / f"{flight.name}_000004.png").exists()
    printed = capsys.readouterr().out
    assert f"{plain} train: 1 drones left out, whose box is not in the picture" in printed
    assert f"{plain} train: 1 pictures left out, which scene_gt.json does not mention" in printed
    edit(flight / "scene_gt_info.json", lambda table: table["1"][0].update(bbox_obj=[-90, 10, 121, 40]))
    with pytest.raises(InputError, match="made with other digests"):
        convert(plain, "yolo", tmp_path / "out")


def test_a_list_may_name_pictures_without_a_drone(plain, tmp_path):
    flight = sorted((plain / "train").iterdir())[0]
    shutil.copy(flight / "rgb" / "000000.png", flight / "rgb" / "000001.png")
    for name in ("scene_gt.json", "scene_gt_info.json"):
        edit(flight / name, lambda table: table.update({"1": []}))
    place = flight.relative_to(plain).as_posix()
    (plain / "train.txt").write_text(f"{place}/000000\n{place}/000001\n")
    out = convert(plain, "yolo", tmp_path / "out", progress=False)
    assert len(list((out / "images" / "train").iterdir())) == 2
    assert (out / "labels" / "train" / f"{flight.name}_000001.txt").read_text() == ""


def test_class_names_in_any_script(plain, tmp_path):
    path = plain / "models" / "models_info.json"
    edit(path, lambda table: table["1"].update(name="Gerät \U0001f681"))
    out = convert(plain, "yolo", tmp_path / "out", types=True, progress=False)
    assert '  0: "Gerät \U0001f681"\n' in (out / "data.yaml").read_text(encoding="utf-8")


# --- splits -----------------------------------------------------------------------------------------------


def test_no_flight_is_in_two_splits(whole, tmp_path):
    out = convert(whole, "yolo", tmp_path / "yolo", progress=False)
    flights = []
    for split in scenes.SPLITS:
        flights.append({path.name.split("_")[0] for path in (out / "images" / split).iterdir()})
    assert [len(names) for names in flights] == [3, 3, 3]
    assert not (flights[0] & flights[1] or flights[0] & flights[2] or flights[1] & flights[2])


def test_a_flight_that_two_lists_share_is_refused(plain, tmp_path):
    flights = [path.relative_to(plain).as_posix() for path in sorted((plain / "train").iterdir())]
    (plain / "train.txt").write_text("\n".join(flights))
    (plain / "val.txt").write_text(f"{flights[-1]}\n")
    with pytest.raises(InputError, match=rf"{flights[-1]}: in train and in val; a flight belongs to one"):
        convert(plain, "yolo", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_flights_of_one_name_keep_apart_by_their_folders(plain, tmp_path):
    """Flights of lists lie anywhere: two days may each have a flight_0."""
    flights = sorted((plain / "train").iterdir())[:2]
    for day, flight in zip(("monday", "tuesday"), flights, strict=True):
        (plain / day).mkdir()
        flight.rename(plain / day / "flight")
    (plain / "train.txt").write_text("monday/flight\ntuesday/flight\n")
    out = convert(plain, "yolo", tmp_path / "out", progress=False)
    names = {path.name.split("_")[0] for path in (out / "images" / "train").iterdir()}
    assert names == {"monday-flight", "tuesday-flight"}


# --- what is refused --------------------------------------------------------------------------------------


def test_crops_are_refused_with_the_command_that_makes_frames(small_dataset, tmp_path):
    for to in ("yolo", "coco"):
        with pytest.raises(InputError, match=r"holds crops.*generate DIR --frames full"):
            convert(small_dataset, to, tmp_path / "out")


def test_what_cannot_be_converted_says_why(plain, whole, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        convert(tmp_path / "nowhere", "yolo")
    with pytest.raises(InputError, match="no train flights; yolo needs train and val"):
        convert(ROOT / "data_samples" / "frames", "yolo", tmp_path / "out")
    with pytest.raises(InputError, match="COCO files are made of 6DroneSyn only"):
        convert(plain, "coco", tmp_path / "out")
    with pytest.raises(InputError, match="--to voc: choose yolo or coco"):
        convert(whole, "voc", tmp_path / "out")
    with pytest.raises(InputError, match="--keypoints is for --to yolo"):
        convert(whole, "coco", tmp_path / "out", keypoints=True)
    for path in plain.glob("*/*/scene_gt.json"):
        edit(path, lambda table: [entry[0].pop("keypoints_2d") for entry in table.values()])
        edit(path, lambda table: [entry[0].pop("keypoints_3d") for entry in table.values()])
    (plain / "models" / "models_info.json").unlink()
    with pytest.raises(InputError, match="no `keypoints`.*--keypoints needs it"):
        convert(plain, "yolo", tmp_path / "out", keypoints=True)
    convert(plain, "yolo", tmp_path / "out", progress=False)  # boxes are enough for a detector


def test_a_broken_picture_is_named_and_leaves_no_folder(plain, tmp_path):
    picture = next((plain / "val").rglob("*.png"))
    picture.write_bytes(picture.read_bytes()[:500])
    with pytest.raises(InputError, match=f"{picture.name}: truncated"):
        convert(plain, "yolo", tmp_path / "out", progress=False)
    assert not (tmp_path / "out").exists()


# --- the folder -------------------------------------------------------------------------------------------


def content(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def read_pictures(monkeypatch, call, kill_at=None):
    """How many pictures a call reads, until it is killed."""
    count, read_one = 0, StoredFrame.read

    def counted(self):
        nonlocal count
        if count == kill_at:
            raise KeyboardInterrupt
        count += 1
        return read_one(self)

    with monkeypatch.context() as patch:
        patch.setattr(StoredFrame, "read", counted)
        with contextlib.suppress(KeyboardInterrupt):
            call()
    return count


def test_a_killed_run_leaves_nothing_under_its_name_and_goes_on(whole, tmp_path, monkeypatch):
    at_once = convert(whole, "yolo", tmp_path / "at_once", progress=False)
    assert read_pictures(monkeypatch, lambda: convert(whole, "yolo", tmp_path / "out"), kill_at=8) == 8
    assert not (tmp_path / "out").exists()
    assert read_pictures(monkeypatch, lambda: convert(whole, "yolo", tmp_path / "out")) == 18 - 8
    out = tmp_path / "out"
    assert content(out) == content(at_once)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["at_once", "out"]


def test_what_a_run_with_other_options_left_is_not_taken(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(labels, "write_data_yaml", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        convert(whole, "yolo", tmp_path / "out", keypoints=True, progress=False)
    monkeypatch.undo()
    out = convert(whole, "coco", tmp_path / "out", progress=False)
    assert not (out / "labels").exists()


def test_a_second_run_says_that_it_is_there(whole, tmp_path, capsys):
    command = ["convert", str(whole), "--to", "yolo", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'out'}: 6 train, 6 val, 6 test frames\n"
    before = content(tmp_path / "out")
    assert main(command) == 0
    assert "out: already there, 6 train, 6 val, 6 test frames" in capsys.readouterr().out
    assert main([*command, "--keypoints"]) == 2
    assert "made with other keypoints (False, now True)" in capsys.readouterr().err
    assert content(tmp_path / "out") == before


def test_a_folder_with_other_things_is_left_alone(whole, tmp_path):
    (tmp_path / "thesis.tex").write_text("do not lose me")
    with pytest.raises(InputError, match="holds no convert.json; choose another"):
        convert(whole, "yolo", tmp_path)
    with pytest.raises(InputError, match="is a file"):
        convert(whole, "yolo", tmp_path / "thesis.tex")


def test_the_folder_lies_beside_the_data_set_and_can_be_a_copy(plain, tmp_path, monkeypatch):
    def no_links(*_):
        raise OSError("another file system")

    monkeypatch.setattr(run.os, "link", no_links)
    monkeypatch.chdir(plain)
    out = convert(".", "yolo", progress=False)
    assert out == tmp_path / "plain-yolo"
    flight = next((plain / "train").iterdir())
    for picture in (flight / "rgb").iterdir():
        copy = out / "images" / "train" / f"{flight.name}_{picture.name}"
        assert copy.read_bytes() == picture.read_bytes() and not copy.samefile(picture)


# --- COCO, and those who train ----------------------------------------------------------------------------


def test_coco_is_the_data_sets_own_with_names_from_the_folder(whole, tmp_path):
    out = convert(whole, "coco", tmp_path / "coco", types=True, progress=False)
    one_class = convert(whole, "coco", tmp_path / "one_class", progress=False)
    for split in scenes.SPLITS:
        table = bop.read_json(out / f"{split}.json")
        settings = bop.read_json(whole / "manifest.json")["settings"]
        own = json.loads(json.dumps(coco(whole, split, settings)))
        for image, original in zip(table["images"], own["images"], strict=True):
            assert (out / image["file_name"]).samefile(whole / original["file_name"])
            assert image | {"file_name": original["file_name"]} == original
        assert table | {"images": own["images"]} == own
        [category] = bop.read_json(one_class / f"{split}.json")["categories"]
        assert category == {**own["categories"][0], "id": 1, "name": "drone"}
        drones = bop.read_json(one_class / f"{split}.json")["annotations"]
        assert {drone["category_id"] for drone in drones} == {1}
        assert [drone["bbox"] for drone in drones] == [drone["bbox"] for drone in own["annotations"]]


def test_torchvision_takes_a_training_step(whole, tmp_path):
    out = convert(whole, "coco", tmp_path / "coco", progress=False)
    table = bop.read_json(out / "train.json")
    images, targets = [], []
    for image, annotation in zip(table["images"][:2], table["annotations"][:2], strict=True):
        assert annotation["image_id"] == image["id"]
        pixels = cv2.imread(str(out / image["file_name"]))[..., ::-1].copy()
        assert pixels.shape[:2] == (image["height"], image["width"])
        images.append(torch.tensor(pixels).permute(2, 0, 1) / 255)
        x, y, w, h = annotation["bbox"]
        targets.append({"boxes": torch.tensor([[x, y, x + w, y + h]]), "labels": torch.tensor([1])})
    detector = torchvision.models.detection.fasterrcnn_mobilenet_v3_large_320_fpn(
        weights=None, weights_backbone=None, num_classes=2
    )
    loss = sum(detector(images, targets).values())
    loss.backward()
    assert torch.isfinite(loss) and loss > 0


TRAIN_AND_PREDICT = """
import sys
from pathlib import Path
from dronekeypp.baselines.yolo import library

data, frames, out = sys.argv[1:]
model = library(Path(out) / "library")("yolov8n.yaml")
common = dict(imgsz=320, device="cpu", project=out, exist_ok=True)
model.train(data=data, epochs=2, batch=6, workers=0, plots=False, amp=False, name="run", **common)
common |= dict(conf=0.0001, max_det=1, save=False, save_txt=True, save_conf=True)
model.predict(frames, name="found", **common)
"""


def test_ultralytics_trains_on_it_and_predict_takes_what_it_finds(whole, tmp_path):
    pytest.importorskip("ultralytics", reason="the optional extra yolo")
    data = convert(whole, "yolo", tmp_path / "yolo", progress=False) / "data.yaml"
    flight = next((whole / "test").iterdir())
    command = [sys.executable, "-c", TRAIN_AND_PREDICT, str(data), str(flight / "rgb"), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = sorted((tmp_path / "out" / "found" / "labels").iterdir())
    assert [path.stem for path in found] == ["000000", "000060"]
    assert all(len(path.read_text().split()) == 6 for path in found)  # with their confidence
    command = ["predict", str(ROOT / "data_samples" / "checkpoint"), str(flight / "rgb"), "--no-overlay"]
    command += ["--camera", str(flight / "scene_camera.json"), "--boxes", str(found[0].parent)]
    assert main([*command, "--out", str(tmp_path / "poses")]) == 0
    rows = (tmp_path / "poses" / "frames.csv").read_text().splitlines()[1:]
    assert [row.split(",")[2] for row in rows] == ["ok", "ok"]
