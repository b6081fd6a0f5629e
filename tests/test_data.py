"""The frame contract, and any BOP folder that keeps it. What is missing is named."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from fakes import FakeDrones, tiny_config
from plain_bop import SIZE, make_plain_folder
from torch.utils.data import Subset

from dronekeypp import camera, data, train
from dronekeypp.cli import main
from dronekeypp.data import KEYS, open_dataset
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP
from dronekeypp.presets import TrainConfig
from dronekeypp.train import run

SAMPLES = Path(__file__).parents[1] / "data_samples"


def edit(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def objects(folder, change):
    """Apply a change to the entry of every object in the scene_gt.json of every flight."""
    for path in folder.rglob("scene_gt.json"):
        edit(path, lambda table: [change(entry) for entries in table.values() for entry in entries])


@pytest.fixture(scope="session")
def plain_folder(tmp_path_factory):
    """Read only: `folder` is a copy to break."""
    return make_plain_folder(tmp_path_factory.mktemp("plain") / "mine")


@pytest.fixture
def folder(plain_folder, tmp_path):
    """A copy to break."""
    return Path(shutil.copytree(plain_folder, tmp_path / "mine"))


def test_items_hold_what_the_contract_says(plain_folder):
    dataset = open_dataset(plain_folder, "test", size=64)
    assert set(dataset.keys) == set(KEYS) == set(dataset[0])
    assert [drone.name for drone in dataset.drones][:2] == ["Mini3", "Mini2"] and len(dataset) == 7
    item = dataset[3]
    assert item["image"].shape == (3, 64, 64) and item["K"][0, 2] < SIZE[0]
    pixels = camera.from_crop(item["keypoints"], item["square"])
    projected = camera.project(item["keypoints_3d"] + item["t"], item["K"])
    np.testing.assert_allclose(pixels, projected, atol=0.05)


def test_the_same_crop_as_of_6dronesyn(plain_folder):
    """The picture of a smaller frame, at a third fewer pixels: nearly the crop of the original."""
    theirs = open_dataset(plain_folder, "test", size=64)[0]
    whole = open_dataset(SAMPLES / "frames", "test", size=64)
    ours = next(item for item in whole if torch.allclose(item["t"], theirs["t"]))
    assert (ours["image"] - theirs["image"]).abs().mean() < 0.02
    torch.testing.assert_close(ours["keypoints"], theirs["keypoints"], atol=1e-3, rtol=0)


def test_it_trains_evaluates_and_predicts(plain_folder, tmp_path, capsys):
    run = tmp_path / "run"
    settings = ["epochs=1", "batch=7", "width=16", "heads=2", "ffn=16", "layers=1", "warmup=1", "device=cpu"]
    options = [word for setting in settings for word in ("--set", setting)]
    assert main(["train", str(plain_folder), "--out", str(run), *options]) == 0
    assert main(["evaluate", str(run), str(plain_folder)]) == 0
    assert "Mini3" in capsys.readouterr().out
    flight = next((plain_folder / "test").iterdir())
    box = json.loads((flight / "scene_gt_info.json").read_text())["0"][0]["bbox_obj"]
    box = ",".join(str(value) for value in box)
    where = ["--camera", str(flight / "scene_camera.json"), "--box", box, "--out", str(tmp_path / "out")]
    assert main(["predict", str(run), str(flight / "rgb"), *where]) == 0
    assert (tmp_path / "out" / "poses.csv").read_text().count("\n") == 2
    pytest.importorskip("onnxscript")
    assert main(["export", str(run), str(tmp_path / "net.onnx"), "--check", str(plain_folder)]) == 0


def test_splits_by_a_list(folder):
    everything = {}
    for split in ("train", "val", "test"):
        for flight in (folder / split).iterdir():
            everything[flight.name] = flight.rename(folder / flight.name)
        (folder / split).rmdir()
    (folder / "train.txt").write_text("# mine\nflight_0\nflight_3/\n\nflight_4/0\nflight_6/rgb/000000.png\n")
    dataset = open_dataset(folder, "train")
    assert [path.name for path in dataset.folders] == ["flight_0", "flight_3", "flight_4", "flight_6"]
    (folder / "val.txt").write_text("flight_0/7\n")
    with pytest.raises(InputError, match="flight_0: a list names frame 7, and there is no drone in it"):
        open_dataset(folder, "val")
    (folder / "val.txt").write_text("flight_99\n")
    with pytest.raises(
        InputError, match="val.txt line 1: 'flight_99' is neither a flight folder nor FLIGHT/NUMBER"
    ):
        open_dataset(folder, "val")
    with pytest.raises(InputError, match="no split 'test': neither a folder nor test.txt"):
        open_dataset(folder, "test")


def test_folders_and_frames_may_have_any_number(folder):
    flight = folder / "test" / "flight_2"
    for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
        edit(flight / name, lambda table: table.update({"1234567": table.pop("0")}))
    (flight / "rgb" / "000000.png").rename(flight / "rgb" / "1234567.png")
    flight.rename(folder / "test" / "90210")
    dataset = open_dataset(folder, "test")
    item = dataset[0]  # numbers come before names
    assert (int(item["frame"]), int(item["subsequence"])) == (1234567, 0)


def test_keypoints_follow_from_pose_and_hubs(folder, plain_folder):
    objects(folder, lambda entry: [entry.pop(key) for key in ("keypoints_2d", "keypoints_3d")])
    there, gone = open_dataset(plain_folder, "test"), open_dataset(folder, "test")
    torch.testing.assert_close(there[2]["keypoints"], gone[2]["keypoints"], atol=1e-3, rtol=0)
    torch.testing.assert_close(there[2]["keypoints_3d"], gone[2]["keypoints_3d"], atol=1e-5, rtol=0)


def test_the_class_is_that_of_models_info(folder):
    """Object numbers may be any: the class index is the place in the data set's own list."""
    edit(folder / "models" / "models_info.json", lambda info: info.update({"42": info.pop("3")}))
    objects(folder, lambda entry: entry.update(obj_id=42 if entry["obj_id"] == 3 else entry["obj_id"]))
    dataset = open_dataset(folder, "test")
    names = [drone.name for drone in dataset.drones]
    assert names == ["Mini3", "Mini2", "Air2", "Mav2", "Mav3", "Tello", "Air3"]
    air3 = [i for i, frame in enumerate(dataset.frames) if frame.obj_id == 42]
    assert air3 and all(int(dataset[i]["label"]) == 6 for i in air3)


def test_without_models_info_objects_are_numbered(folder):
    shutil.rmtree(folder / "models")
    drones = open_dataset(folder, "test").drones
    assert [drone.name for drone in drones] == [f"object {n}" for n in range(1, 8)]
    assert drones[0].hubs is None


def test_several_drones_in_a_frame_are_several_items(folder):
    flight = folder / "test" / "flight_2"
    for name in ("scene_gt.json", "scene_gt_info.json"):
        edit(flight / name, lambda table: table["0"].append(dict(table["0"][0])))
    edit(flight / "scene_gt.json", lambda table: table["0"][1].update(obj_id=5))
    assert len(open_dataset(folder, "test")) == 8
    edit(flight / "scene_gt_info.json", lambda table: table["0"][1].update(bbox_obj=[-1, -1, -1, -1]))
    assert len(open_dataset(folder, "test")) == 7  # BOP's mark of an object that is not in the picture


def test_a_picture_of_another_size_is_named(folder):
    picture = folder / "test" / "flight_2" / "rgb" / "000000.png"
    (folder / "camera.json").write_text('{"width": 1280, "height": 720}')
    cv2.imwrite(str(picture), np.zeros((100, 100, 3), np.uint8))
    dataset = open_dataset(folder, "test")
    with pytest.raises(InputError, match="000000.png: 100×100 pixels, its data set has 1280×720"):
        dataset[0]


LOPSIDED = [[80, 99, 0], [70, -90, 0], [-80, -90, 0], [-80, 90, 0]]
FAULTS = {
    "no keypoints at all": (
        lambda root: (
            objects(root, lambda entry: [entry.pop(key) for key in ("keypoints_2d", "keypoints_3d")]),
            edit(
                root / "models/models_info.json",
                lambda info: [entry.pop("keypoints") for entry in info.values()],
            ),
        ),
        "no `keypoints` (keypoints_2d in scene_gt.json, or `keypoints` in models_info.json): training",
    ),
    "no visibility": (
        lambda root: objects(root, lambda entry: entry.pop("keypoints_visible")),
        "no `visible` (keypoints_visible in scene_gt.json): mirror needs it",
    ),
    "no rotation": (
        lambda root: objects(root, lambda entry: entry.pop("cam_R_m2c")),
        "no `R` (cam_R_m2c in scene_gt.json): training DroneKey++ needs it",
    ),
    "one rotation is missing": (
        lambda root: edit(
            root / "train/flight_3/scene_gt.json", lambda table: table["0"][0].pop("cam_R_m2c")
        ),
        "scene_gt.json frame 0: no `R` (cam_R_m2c in scene_gt.json), and other frames have it",
    ),
    "no box": (
        lambda root: edit(root / "train/flight_3/scene_gt_info.json", lambda t: t["0"][0].pop("bbox_obj")),
        "flight_3/scene_gt_info.json frame 0: the field bbox_obj is missing",
    ),
    "an unknown object": (
        lambda root: edit(root / "train/flight_3/scene_gt.json", lambda t: t["0"][0].update(obj_id=9)),
        "flight_3/scene_gt.json frame 0: obj_id 9 is not in models_info.json (1 to 7)",
    ),
    "no picture": (
        lambda root: (root / "train/flight_3/rgb/000000.png").unlink(),
        "flight_3/rgb: no image",
    ),
    "a lopsided drone": (
        lambda root: (
            objects(root, lambda entry: [entry.pop(key) for key in ("keypoints_2d", "keypoints_3d")]),
            edit(root / "models/models_info.json", lambda info: info["2"].update(keypoints=LOPSIDED)),
        ),
        "mirror needs hubs that are left–right symmetric; those of Mini2 are off by 10.0 mm",
    ),
    "two of one name": (
        lambda root: edit(root / "models/models_info.json", lambda info: info["2"].update(name="Mini3")),
        "models_info.json: objects 1 and 2 are both called Mini3",
    ),
    "no validation": (
        lambda root: shutil.rmtree(root / "val"),
        "no split 'val': neither a folder nor val.txt",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_missing_is_one_line_that_names_it(name, folder, tmp_path, capsys):
    damage, message = FAULTS[name]
    damage(folder)
    quick = ["--set", "epochs=1", "--set", "batch=7", "--set", "device=cpu"]
    assert main(["train", str(folder), "--out", str(tmp_path / "run"), *quick]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error, error


def test_without_visibility_it_trains_without_the_mirror(folder, tmp_path):
    objects(folder, lambda entry: entry.pop("keypoints_visible"))
    sets = [open_dataset(folder, split, size=32) for split in ("train", "val")]
    config = TrainConfig(epochs=1, batch=7, device="cpu")
    assert "visible" not in sets[0].keys
    assert len(train.fit(DroneKeyPP(tiny_config()), *sets, config)) == 1


def test_a_data_set_in_memory_keeps_the_contract_by_its_items():
    fakes = FakeDrones(6)
    assert data.drones_of(fakes) is None and set(data.keys_of(Subset(fakes, [0]))) == set(KEYS)
    with pytest.raises(InputError, match="the data set: no `depth`: a test needs it"):
        data.require(fakes, ("R", "depth"), "a test")


def test_stored_crops_need_the_size_of_the_whole_frames(tmp_path):
    """Without it every crop was clamped to its own 128 pixels, and measured wrongly without a word."""
    crops = tmp_path / "crops"
    shutil.copytree(SAMPLES / "crops", crops, ignore=shutil.ignore_patterns("train", "val", "manifest.json"))
    with pytest.raises(InputError, match="crops are stored, so .*camera.json must say the width and height"):
        open_dataset(crops, "test")
    (crops / "camera.json").write_text('{"width": 1920, "height": 1080}')
    ours, theirs = open_dataset(crops, "test"), open_dataset(SAMPLES / "crops", "test")
    for name in ("image", "square", "keypoints"):
        assert torch.equal(ours[7][name], theirs[7][name])
    (crops / "camera.json").write_text('{"width": "wide", "height": 1080}')
    with pytest.raises(InputError, match="camera.json: width and height must be whole numbers"):
        open_dataset(crops, "test")


def test_a_run_does_not_go_on_with_other_annotations(folder, tmp_path, capsys):
    command = [
        "train",
        str(folder),
        "--out",
        str(tmp_path / "run"),
        "--set",
        "batch=7",
        "--set",
        "device=cpu",
    ]
    assert main([*command, "--set", "epochs=2", "--set", "max_minutes=0.0001"]) == 0

    def swap(info):
        info["1"]["name"], info["2"]["name"] = info["2"]["name"], info["1"]["name"]

    edit(folder / "models" / "models_info.json", swap)
    assert main([*command, "--set", "epochs=2", "--resume"]) == 2
    assert "data.digest was" in capsys.readouterr().err


def test_what_cannot_be_learned_from_leaves_no_folder_behind(folder, tmp_path, capsys):
    objects(folder, lambda entry: entry.pop("keypoints_visible"))
    command = [
        "train",
        str(folder),
        "--out",
        str(tmp_path / "run"),
        "--set",
        "batch=7",
        "--set",
        "device=cpu",
    ]
    assert main([*command, "--set", "epochs=1"]) == 2
    assert not (tmp_path / "run").exists() and "mirror needs it" in capsys.readouterr().err
    assert main([*command, "--set", "epochs=1", "--set", "mirror=false"]) == 0


def test_resume_touches_nothing_in_a_folder_that_is_no_run(folder, tmp_path, capsys):
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / ".letter.tmp").write_text("mine")
    assert main(["train", str(folder), "--out", str(victim), "--resume"]) == 2
    assert "not a run" in capsys.readouterr().err and (victim / ".letter.tmp").read_text() == "mine"


def test_frames_without_a_drone_are_left_out(folder):
    flight = folder / "test" / "flight_2"
    whole = len(open_dataset(folder, "test"))
    edit(flight / "scene_camera.json", lambda table: table.update({"9": table["0"]}))
    for name in ("scene_gt.json", "scene_gt_info.json"):
        edit(flight / name, lambda table: table.update({"10": []}))
    assert len(open_dataset(folder, "test")) == whole
    edit(flight / "scene_gt_info.json", lambda table: table["0"][0].update(bbox_obj=[-90, 10, 40, 40]))
    dataset = open_dataset(folder, "test")
    assert (len(dataset), dataset.left_out) == (whole - 1, 1)


@pytest.mark.parametrize("text", ["flight_0\r\nflight_3\r\n", "\ufeffflight_0\nflight_3\n"])
def test_lists_as_other_programs_write_them(text, folder):
    for flight in sorted((folder / "train").iterdir()):
        flight.rename(folder / flight.name)
    (folder / "train").rmdir()
    (folder / "train.txt").write_bytes(text.encode())
    assert len(open_dataset(folder, "train")) == 2
    (folder / "train.txt").write_bytes("flight_0".encode("utf-16"))
    with pytest.raises(InputError, match="train.txt: not text in UTF-8"):
        open_dataset(folder, "train")


def test_one_drone_is_enough(folder, tmp_path):
    """Real footage is mostly of one drone."""
    edit(folder / "models" / "models_info.json", lambda info: [info.pop(str(n)) for n in range(2, 8)])
    objects(folder, lambda entry: entry.update(obj_id=1))
    quick = ["--set", "epochs=1", "--set", "batch=7", "--set", "device=cpu"]
    assert main(["train", str(folder), "--out", str(tmp_path / "run"), *quick]) == 0
    assert main(["evaluate", str(tmp_path / "run"), str(folder)]) == 0


@pytest.mark.parametrize("apart", [False, True])
def test_a_class_that_validation_cannot_know_is_told(folder, tmp_path, capsys, monkeypatch, apart):
    """Random quadrotors: each is a class of its own, and none flies in two splits."""
    monkeypatch.setattr(run, "train_on", lambda *given, **settings: None)
    train_set, val_set = open_dataset(folder, "train"), open_dataset(folder, "val")
    flights = {"train": [], "val": []}
    for dataset, split in ((train_set, "train"), (val_set, "val")):
        for place, label in zip(dataset.folders, dataset.labels, strict=True):
            if not apart or (label < 4) == (split == "train"):
                flights[split].append(place.relative_to(folder).as_posix())
    for split, places in flights.items():
        (folder / f"{split}.txt").write_text("\n".join(places))
    assert main(["train", str(folder), "--out", str(tmp_path / "run")]) == 0
    printed = capsys.readouterr().out
    assert ("no drone of val is in train" in printed) == ("meant for `pretrain`" in printed) == apart


def test_without_keypoints_the_pose_is_still_measured(folder, plain_folder, tmp_path):
    quick = ["--set", "epochs=1", "--set", "batch=7", "--set", "device=cpu"]
    assert main(["train", str(plain_folder), "--out", str(tmp_path / "run"), *quick]) == 0
    objects(folder, lambda entry: [entry.pop(key) for key in ("keypoints_2d", "keypoints_3d")])
    edit(
        folder / "models" / "models_info.json",
        lambda info: [entry.pop("keypoints") for entry in info.values()],
    )
    assert main(["evaluate", str(tmp_path / "run"), str(folder)]) == 0


def test_hubs_in_metres_are_not_taken_for_millimetres(folder):
    def in_metres(info):
        for entry in info.values():
            entry["keypoints"] = [[value / 1000 for value in hub] for hub in entry["keypoints"]]

    edit(folder / "models" / "models_info.json", in_metres)
    with pytest.raises(InputError, match="models_info.json object 1: keypoints: a hub .* is the unit right?"):
        open_dataset(folder, "test")
