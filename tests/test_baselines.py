"""The baselines: PnP that is told the size, DroneKey, DronePose, and what YOLO is handed."""

import math

import cv2
import numpy as np
import pytest
import torch
from fakes import FakeDrones, tiny
from torch.utils.data import default_collate

from dronekeypp import checkpoint, train
from dronekeypp.baselines import DroneKey, DronePose, yolo
from dronekeypp.baselines.dronepose import DronePoseConfig
from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.camera import from_crop
from dronekeypp.classes import names_of
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.evaluate import evaluate
from dronekeypp.model import DroneKeyPP
from dronekeypp.presets import TrainConfig
from dronekeypp.rotations import geodesic_degrees
from dronekeypp.settings import usable


def settings(**changes):
    return TrainConfig(**{"epochs": 2, "batch": 16, "lr": 1e-3, "device": "cpu", **changes})


def learned(classes=7, **more):
    pnp = PnPPose(classes, **more)
    pnp.learn(FakeDrones(200).data)
    return pnp


def config_of(network):
    """The settings of `tiny` that a method has."""
    return network.Config.from_dict(usable(network.Config, tiny(), {}))


def open_splits(root):
    return {split: open_dataset(root, split, size=64) for split in ("train", "val")}


def test_pnp_learns_the_true_hubs_and_finds_the_true_pose():
    data = FakeDrones(60, seed=4, tilt=35).data
    pnp = learned()
    body = data["keypoints_3d"] @ data["R"]
    torch.testing.assert_close(pnp.hubs[data["label"]], body, atol=1e-5, rtol=0)
    answer = pnp(from_crop(data["keypoints"], data["square"]), data["label"], data["K"])
    assert not answer["failed"].any()
    assert geodesic_degrees(answer["R"], data["R"]).median() < 0.1
    assert (answer["t"] - data["t"]).norm(dim=-1).median() < 0.005


def test_pnp_with_the_wrong_size_is_off_by_the_ratio_of_sizes():
    data = FakeDrones(60, seed=4, tilt=35).data
    pnp = learned()
    pnp.hubs *= 1.5
    answer = pnp(from_crop(data["keypoints"], data["square"]), data["label"], data["K"])
    ratio = answer["t"].norm(dim=-1) / data["t"].norm(dim=-1)
    assert ratio.median() == pytest.approx(1.5, abs=0.02)


def test_upright_chooses_among_the_two_poses_by_the_back():
    data = FakeDrones(200, seed=4, tilt=25).data
    noise = torch.randn(200, 4, 2, generator=torch.Generator().manual_seed(0))
    pixels = from_crop(data["keypoints"], data["square"]) + noise
    wrong = {}
    for hypothesis in ("fit", "upright"):
        answer = learned(hypothesis=hypothesis)(pixels, data["label"], data["K"])
        wrong[hypothesis] = (geodesic_degrees(answer["R"], data["R"]) > 30).float().mean()
    # Flown level, the truth is nearly always the upright one.
    assert wrong["upright"] < 0.5 * wrong["fit"]
    with pytest.raises(InputError, match="hypothesis='best' is not one of: fit, upright"):
        PnPPose(7, "best")


def test_a_failure_is_counted_and_answered_with_the_constant():
    data = FakeDrones(12, seed=1).data
    pnp = learned()
    pixels = from_crop(data["keypoints"], data["square"])
    pixels[3] = torch.nan
    answer = pnp(pixels, data["label"], data["K"])
    assert answer["failed"].nonzero().flatten().tolist() == [3]
    torch.testing.assert_close(answer["R"][3], pnp.fallback_R)
    torch.testing.assert_close(answer["t"][3], FakeDrones(200).data["t"].median(dim=0).values)
    with pytest.raises(InputError, match=r"call learn\(\)"):
        PnPPose(7)(pixels, data["label"], data["K"])
    with pytest.raises(InputError, match="no frame of class 6"):
        PnPPose(7).learn(FakeDrones(50, classes=6).data)


def test_dronekey_is_told_the_drone_and_trained_on_keypoints_alone():
    data, val = FakeDrones(64), FakeDrones(20, seed=1)
    torch.manual_seed(0)
    model = DroneKey(config_of(DroneKey).replace(pool="mean"))
    history = train.fit(model, data, val, settings())
    assert set(history[0]) >= {"train_L_2D", "val_L_2D", "score"} and "train_L_cls" not in history[0]
    assert history[-1]["score"] == pytest.approx(history[-1]["val_keypoint_crop_px"] / 32, rel=1e-5)
    assert math.isnan(history[-1]["val_class_accuracy"])
    items = default_collate([val[i] for i in range(6)])
    assert set(model.train()(items["image"], items["K"], items["square"])) == {"keypoints", "gate"}
    with pytest.raises(InputError, match="DroneKey needs the drone's label"):
        model.eval()(items["image"], items["K"], items["square"])
    out = model.eval()(items["image"], items["K"], items["square"], items["label"])
    torch.testing.assert_close(
        out["R"] @ out["R"].transpose(1, 2), torch.eye(3).expand(6, 3, 3), atol=1e-5, rtol=0
    )


def test_dronepose_sees_the_crop_alone_unless_it_is_told_where_that_was_cut():
    items = default_collate([FakeDrones(6)[i] for i in range(6)])
    elsewhere = items["square"] + torch.tensor([200.0, -100.0, 50.0])
    for use_rays in (False, True):
        torch.manual_seed(0)
        model = DronePose(DronePoseConfig(image_size=32, backbone_stride=8, use_rays=use_rays)).eval()
        a = model(items["image"], items["K"], items["square"])
        b = model(items["image"], items["K"], elsewhere)
        assert torch.equal(a["t"], b["t"]) is not use_rays
        assert torch.equal(a["R"], b["R"]) is not use_rays
        identity = torch.eye(3).expand(6, 3, 3)
        torch.testing.assert_close(a["R"] @ a["R"].transpose(1, 2), identity, atol=1e-5, rtol=0)
    frames = evaluate(model, FakeDrones(6))
    assert np.isnan(frames["keypoint_px"]).all() and (frames["predicted"] == -1).all()
    assert np.isfinite(frames["R_deg"]).all()


@pytest.mark.parametrize("network", [DroneKeyPP, DroneKey, DronePose])
def test_every_method_trains_resumes_and_comes_back_from_disk(network, tmp_path):
    data, val, config = FakeDrones(48), FakeDrones(16, seed=1), config_of(network)

    def kill(state):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train.train_on(data, val, tmp_path / "a", config, settings(), on_epoch=kill, network=network)
    best = train.train_on(data, val, tmp_path / "a", config, settings(), resume=True, network=network)
    train.train_on(data, val, tmp_path / "b", config, settings(), network=network)
    model, same = checkpoint.load(best), checkpoint.load(tmp_path / "b")
    assert type(model) is network
    resumed, at_once = evaluate(model, val), evaluate(same, val)
    assert np.array_equal(resumed["R_deg"], at_once["R_deg"])
    assert np.array_equal(resumed["t_m"], at_once["t_m"])
    model.save_pretrained(tmp_path / "half", half=True)
    rounded = evaluate(network.from_pretrained(tmp_path / "half"), val)
    np.testing.assert_allclose(rounded["t_m"], resumed["t_m"], rtol=0.05, atol=0.02)
    size = (best / "model.safetensors").stat().st_size
    assert (tmp_path / "half" / "model.safetensors").stat().st_size < 0.6 * size
    other = DronePose if network is not DronePose else DroneKey
    with pytest.raises(InputError, match=f"holds a network of {network.method.replace('+', '.')}, not of"):
        other.from_pretrained(best)
    with pytest.raises(InputError, match="model.method was"):
        train.train_on(data, val, tmp_path / "a", config_of(other), settings(), resume=True, network=other)


def test_an_unknown_method_is_named():
    with pytest.raises(InputError, match="unknown method 'PoseCNN'; known: DroneKey.., DroneKey, DronePose"):
        checkpoint.network_class("PoseCNN")


def test_yolo_is_handed_the_crops_that_all_methods_see(small_dataset, tmp_path):
    sets = open_splits(small_dataset)
    text = yolo.export(sets, tmp_path / "yolo").read_text()
    assert "kpt_shape: [4, 3]" in text and "flip_idx: [1, 0, 3, 2]" in text
    assert text.endswith(f'  {names_of(sets["train"].drones).index("Tello")}: "Tello"\n')
    pictures = sorted((tmp_path / "yolo" / "images" / "train").iterdir())
    labels = sorted((tmp_path / "yolo" / "labels" / "train").iterdir())
    assert [p.stem for p in pictures] == [p.stem for p in labels] and len(pictures) == len(sets["train"])
    frame, folder, item = sets["train"].frames[0], sets["train"].folders[0], sets["train"][0]
    name = f"{folder.name}_{frame.number:06d}"
    picture = cv2.imread(str(tmp_path / "yolo" / "images" / "train" / f"{name}.jpg"))
    assert np.abs(picture.astype(int) - yolo.pixels(item["image"][None])[0]).mean() < 3
    numbers = [float(v) for v in (tmp_path / "yolo" / "labels" / "train" / f"{name}.txt").read_text().split()]
    assert numbers[0] == sets["train"].labels[0] and len(numbers) == 5 + 4 * 3
    square = item["square"].numpy()
    x, y, w, h = np.array(numbers[1:5]) * square[2]
    np.testing.assert_allclose([x - w / 2 + square[0], y - h / 2 + square[1], w, h], frame.box, atol=0.01)
    points = np.array(numbers[5:]).reshape(4, 3)
    np.testing.assert_allclose(points[:, :2] * square[2] + square[:2], frame.keypoints_2d, atol=0.01)
    assert (points[:, 2] == np.where(frame.visible, 2, 1)).all()


def test_yolo_is_an_extra_and_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(yolo.importlib.util, "find_spec", lambda name: None)
    assert not yolo.installed()
    message = r'optional extra \(ultralytics, AGPL-3.0\): pip install -e "\.\[yolo\]"'
    with pytest.raises(InputError, match=message):
        yolo.detect(tmp_path / "a.pt", [torch.zeros(1, 3, 32, 32)], 7)
    with pytest.raises(InputError, match=message):
        yolo.train({}, tmp_path, {"epochs": 1})


def test_a_detection_is_answered_in_crop_units():
    points = [[16.0, 8.0]] * 4
    output = yolo._as_output([(points, 2), None], 32, 7)
    assert output["keypoints"][0].tolist() == [[0.5, 0.25]] * 4
    assert output["class_probs"].tolist() == [[0, 0, 1, 0, 0, 0, 0], [0] * 7]
    assert output["detected"].tolist() == [True, False] and output["keypoints"][1].eq(0.5).all()


def test_yolo_trains_goes_on_and_answers(small_dataset, tmp_path):
    pytest.importorskip("ultralytics", reason="the optional extra yolo")
    sets = open_splits(small_dataset)
    settings = {"size": 64, "epochs": 2, "batch": 8, "seed": 0, "digest": "a"}
    weights = yolo.train(sets, tmp_path / "run", settings)
    assert yolo.training_record(tmp_path / "run")["epochs"] == 2
    made = weights.stat().st_mtime_ns
    assert yolo.train(sets, tmp_path / "run", settings).stat().st_mtime_ns == made
    with pytest.raises(InputError, match="digest was 'a' and is now 'b'"):
        yolo.train(sets, tmp_path / "run", settings | {"digest": "b"})
    # As a kill between the checkpoint and its number leaves it.
    (tmp_path / "run" / "kept" / "epoch").write_text("1")
    yolo.train(sets, tmp_path / "run", settings)
    assert yolo.epochs_done(tmp_path / "run") == 2 and weights.stat().st_mtime_ns == made
    images = torch.stack([sets["val"][i]["image"] for i in range(3)])
    output = yolo.detect(weights, images.split(2), len(sets["val"].drones))
    assert output["keypoints"].shape == (3, 4, 2) and output["detected"].dtype == torch.bool
    assert output["class_probs"].shape == (3, len(sets["val"].drones))
