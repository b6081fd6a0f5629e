"""Values that no training, file or command can mean are refused in one line, and nothing is written over."""

import json
import shutil

import numpy as np
import pytest
import torch
from fakes import FakeDrones, saved, tiny_config
from plain_bop import make_plain_folder
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from dronekeypp import bench, checkpoint, pretrain, train
from dronekeypp.baselines import yolo
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.export import export
from dronekeypp.exported import OnnxNetwork
from dronekeypp.files import digest
from dronekeypp.model import Backbone, BackboneConfig, DroneKeyPP
from dronekeypp.model.backbone import save_backbone
from dronekeypp.presets import TrainConfig
from dronekeypp.sixdronesyn import own, scenes
from dronekeypp.sixdronesyn.flight_file import read_flight_file
from dronekeypp.sixdronesyn.manifest import drawing

SETS = FakeDrones(16), FakeDrones(8, seed=1)


def settings(**changes):
    return TrainConfig(**{"epochs": 2, "batch": 8, "lr": 1e-3, "device": "cpu", **changes})


# --- weights ----------------------------------------------------------------------------------------------

KINDS = {
    "int": (lambda x: (100 * x).to(torch.int32), "holds torch.int32, the network torch.float32"),
    "bool": (lambda x: x > 0, "holds torch.bool"),
    "complex": (lambda x: x.to(torch.complex64), "holds torch.complex64"),
    "NaN": (lambda x: x * torch.nan, "holds NaN or infinity"),
    "one infinity": (lambda x: torch.where(x == x.max(), torch.inf, x), "holds NaN or infinity"),
    "too large for float32": (lambda x: x.double() * 1e300, "holds NaN or infinity"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_weights_that_are_none(kind, tmp_path):
    change, message = KINDS[kind]
    path = saved(tmp_path / "net") / "model.safetensors"
    weights = load_file(path)
    key = "encoder.to_class.weight"
    save_file({**weights, key: change(weights[key])}, path)
    with pytest.raises(InputError, match=f"model.safetensors: '{key}' {message}"):
        checkpoint.load(tmp_path / "net")
    backbone = save_backbone(Backbone(BackboneConfig(image_size=32)))
    key = "net.1.0.conv1.weight"
    save_file({**backbone, key: change(backbone[key].float())}, tmp_path / "backbone.safetensors")
    with pytest.raises(InputError, match=f"backbone.safetensors: '{key}' {message}"):
        DroneKeyPP(tiny_config(backbone_weights=tmp_path / "backbone.safetensors"))


def test_weights_of_another_precision_are_weights(tmp_path):
    path = saved(tmp_path / "net") / "model.safetensors"
    weights = load_file(path)
    double = {key: value.double() if value.is_floating_point() else value for key, value in weights.items()}
    save_file(double, path)
    assert checkpoint.load(tmp_path / "net").encoder.to_class.weight.dtype == torch.float32


def test_weights_that_are_none_are_not_exported(tmp_path):
    if not OnnxNetwork.installed():
        pytest.skip("the optional extra onnx")
    import onnx

    path = saved(tmp_path / "net") / "model.safetensors"
    whole = export(tmp_path / "net", tmp_path / "whole.onnx")
    weights = load_file(path)
    save_file({**weights, "encoder.cls": weights["encoder.cls"] * torch.nan}, path)
    with pytest.raises(InputError, match="'encoder.cls' holds NaN"):
        export(tmp_path / "net", tmp_path / "broken.onnx")
    assert not (tmp_path / "broken.onnx").exists()
    graph = onnx.load(whole)
    tensor = max(graph.graph.initializer, key=lambda entry: len(entry.raw_data))
    tensor.raw_data = np.full(len(tensor.raw_data) // 4, np.nan, np.float32).tobytes()
    onnx.save(graph, whole)
    with pytest.raises(InputError, match="whole.onnx: its answer to a grey picture is not finite"):
        checkpoint.load(whole)


# --- training ---------------------------------------------------------------------------------------------


def rewritten(path, header=None, tensors=None):
    """Change a training state: `header` and `tensors` are functions of what it holds."""
    with safe_open(path, "pt") as file:
        old = json.loads(file.metadata()["state"])
    held = load_file(path)
    new = header(old) if header else old
    save_file(tensors(held) if tensors else held, path, {"state": json.dumps(new)})


def without(part):
    return lambda tensors: {key: value for key, value in tensors.items() if part not in key}


def changed(part, change):
    return lambda tensors: {key: change(value) if part in key else value for key, value in tensors.items()}


STATES = {
    "beyond the end": (
        dict(header=lambda h: {**h, "epoch": 9}),
        "9 epochs are done, and 2 are to be trained",
    ),
    "a truth value": (
        dict(header=lambda h: {**h, "epoch": True}),
        "epoch is True: it should be a valid integer",
    ),
    "a part of an epoch": (
        dict(header=lambda h: {**h, "epoch": 1.7}),
        "epoch is 1.7: it should be a valid integer",
    ),
    "no epoch of its own": (dict(header=lambda h: {**h, "history": []}), "its history is of others"),
    "a torn history": (
        dict(header=lambda h: {**h, "history": "…"}),
        "history is '…': it should be a valid list",
    ),
    "no score": (
        dict(header=lambda h: {**h, "best_score": None}),
        "best_score is None: it should be a valid number",
    ),
    "no moments": (dict(tensors=without("adam/")), "Adam's moments of '.*' are missing"),
    "moments of some": (
        dict(tensors=without("adam/encoder.cls")),
        "Adam's moments of 'encoder.cls' are missing",
    ),
    "half of the moments": (dict(tensors=without("/exp_avg_sq")), "Adam has exp_avg, step"),
    "negative squares": (
        dict(tensors=changed("/exp_avg_sq", lambda x: x - 1)),
        "Adam's moments of .* are none",
    ),
    "no steps": (dict(tensors=changed("/step", torch.zeros_like)), "Adam's moments of .* are none"),
    "moments of one number": (
        dict(tensors=changed("/exp_avg", lambda x: x.flatten()[0].clone())),
        r"exp_avg.* has shape \(\)",
    ),
    "NaN in the moments": (dict(tensors=changed("/exp_avg", lambda x: x * torch.nan)), "exp_avg.* holds NaN"),
    "NaN in the weights": (dict(tensors=changed("model/encoder.cls", lambda x: x * torch.nan)), "holds NaN"),
}


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A run that was stopped after its first of two epochs."""
    out = tmp_path_factory.mktemp("begun") / "run"

    def stop(state):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train.train_on(*SETS, out, tiny_config(), settings(), on_epoch=stop)
    return out


@pytest.mark.parametrize("state", STATES)
def test_states_that_no_training_wrote(state, begun, tmp_path):
    changes, message = STATES[state]
    run = tmp_path / "run"
    run.mkdir()
    for name in ("config.json", "last.safetensors"):
        (run / name).write_bytes((begun / name).read_bytes())
    rewritten(run / "last.safetensors", **changes)
    before = (run / "last.safetensors").read_bytes()
    with pytest.raises(InputError, match=message) as caught:
        train.train_on(*SETS, run, tiny_config(), settings(), resume=True)
    assert "\n" not in str(caught.value)
    assert (run / "last.safetensors").read_bytes() == before


def test_a_warm_up_longer_than_the_training(tmp_path):
    with pytest.raises(InputError, match="warmup=50 steps, and the whole training has 4"):
        train.train_on(*SETS, tmp_path / "run", tiny_config(), settings(warmup=50))
    assert not (tmp_path / "run").exists()
    train.fit(DroneKeyPP(tiny_config()), *SETS, settings(epochs=1, warmup=100))  # the preset's own


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"WORLD_SIZE": "2"}, "WORLD_SIZE=2 in the environment without RANK: .*torchrun --nproc-per-node 2"),
        ({"WORLD_SIZE": "two"}, "WORLD_SIZE='two' in the environment: torchrun sets a number"),
        ({"WORLD_SIZE": "-1"}, "WORLD_SIZE='-1' in the environment"),
        (
            dict(WORLD_SIZE="2", RANK="2", LOCAL_RANK="0", MASTER_ADDR="127.0.0.1", MASTER_PORT="1"),
            "RANK=2 of WORLD_SIZE=2",
        ),
    ],
)
def test_world_size_without_torchrun(variables, message, tmp_path, monkeypatch):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=message):
        train.train_on(*SETS, tmp_path / "run", tiny_config(), settings())
    assert not (tmp_path / "run").exists()


def test_two_pretrainings_do_not_share_a_file(tmp_path):
    out = tmp_path / "backbone.safetensors"

    def pretrain_there(state):
        pretrain.pretrain_to(*SETS, out, tiny_config(), settings(epochs=1), resume=True)

    with pytest.raises(InputError, match="another process is at work on .*backbone.safetensors"):
        pretrain.pretrain_to(*SETS, out, tiny_config(), settings(epochs=1), on_epoch=pretrain_there)
    pretrain.pretrain_to(*SETS, out, tiny_config(), settings(epochs=1), resume=True)
    assert [path.name for path in tmp_path.iterdir()] == ["backbone.safetensors"]


def test_pretraining_without_validation_frames_says_how_to_have_some(small_dataset, tmp_path, monkeypatch):
    real = pretrain.open_dataset

    def without_validation(root, split, **options):
        if split == "val":
            raise InputError(f"{root}: no val frames")
        return real(root, split, **options)

    monkeypatch.setattr(pretrain, "open_dataset", without_validation)
    with pytest.raises(InputError, match="no val frames; name another data set with --val .*ends in 8"):
        pretrain.pretrain([small_dataset], tmp_path / "backbone.safetensors")


# --- commands and files -----------------------------------------------------------------------------------


def test_one_flight_is_drawn_by_one_process(tmp_path):
    first, second = scenes.subsequences([1], ["Tello"])[:2]
    with drawing(tmp_path, first):
        with drawing(tmp_path, second):
            pass
        with pytest.raises(InputError, match="another process is drawing flight"):
            with drawing(tmp_path, first):
                pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("seconds", [-1, float("nan"), float("inf")])
def test_bench_for_no_time(seconds, tmp_path):
    with pytest.raises(InputError, match=f"^seconds={seconds:g}: "):
        bench.bench(saved(tmp_path / "net"), seconds=seconds, progress=False)


HUBS = [[0.09, 0.11, 0.03], [0.09, -0.11, 0.03], [-0.08, -0.1, 0.03], [-0.08, 0.1, 0.03]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            dict(propeller_diameter=0.6),
            "two hubs are 0.17.* m apart: the propellers are larger than the drone",
        ),
        (dict(propeller_diameter="0.13"), "propeller_diameter is '0.13': it should be a valid number"),
        (dict(mass=True), "mass is True"),
        (dict(motor_radius=0.12), "propeller_diameter and motor_radius in metres"),
        (dict(hull_rgb=[1.7, 0, 0]), "hull_rgb.0 is 1.7: it should be a valid integer"),
        (dict(tip_rgb=[True, 0, 0]), "tip_rgb.0 is True"),
        (dict(body_mm=[True, 100, 100]), "body_mm.0 is True"),
    ],
)
def test_drones_that_cannot_fly(change, message, tmp_path):
    drone = {"name": "Racer", "mesh": "racer.stl", "hubs": HUBS, "propeller_diameter": 0.13, "mass": 0.4}
    (tmp_path / "racer.stl").write_bytes(b"")
    (tmp_path / "racer.json").write_text(json.dumps({**drone, **change}))
    with pytest.raises(InputError, match=message):
        own.read_drone(tmp_path / "racer.json")


@pytest.mark.parametrize("scene", [1.7, True, "1", None])
def test_a_scene_is_a_whole_number(scene, small_dataset, tmp_path):
    folder = shutil.copytree(next((small_dataset / "train").iterdir()), tmp_path / "flight")
    about = json.loads((folder / "flight.json").read_text())
    (folder / "flight.json").write_text(json.dumps({**about, "scene": scene}))
    with pytest.raises(InputError, match="flight.json: scene is .*: it should be a valid integer"):
        read_flight_file(folder)


def edited(folder, name, key, change):
    """Change a key of every entry in one of a flight's files."""
    path = folder / name
    table = json.loads(path.read_text())
    for entry in table.values():
        for part in entry if isinstance(entry, list) else [entry]:
            part[key] = change(part[key])
    path.write_text(json.dumps(table))


@pytest.mark.parametrize(
    ("name", "key", "change", "message"),
    [
        ("scene_camera.json", "cam_K", lambda K: [True, *K[1:]], "frame 0: cam_K is not a list of numbers"),
        ("scene_camera.json", "cam_K", lambda K: [str(v) for v in K], "cam_K is not a list of numbers"),
        ("scene_gt.json", "cam_t_m2c", lambda t: [*t[:2], True], "cam_t_m2c is not a list of numbers"),
        ("scene_gt.json", "obj_id", lambda number: True, "obj_id True is not a number"),
        ("scene_gt.json", "obj_id", lambda number: 1.7, "obj_id 1.7 is not a number"),
    ],
)
def test_annotations_that_are_no_numbers(name, key, change, message, tmp_path):
    root = make_plain_folder(tmp_path)
    edited(root / "train" / "flight_0", name, key, change)
    with pytest.raises(InputError, match=message):
        open_dataset(root, "train")


def test_a_camera_matrix_of_another_resolution(small_dataset, tmp_path):
    """Nothing but the places of the drones tells: every pose would be learned and measured wrongly."""
    root = shutil.copytree(small_dataset, tmp_path / "copy")
    flight = next((root / "train").iterdir())
    edited(flight, "scene_camera.json", "cam_K", lambda K: [v / 2 for v in K[:6]] + K[6:])
    with pytest.raises(InputError, match="cam_t_m2c and cam_K put the drone .* frames of this size"):
        open_dataset(root, "train")


@pytest.mark.parametrize("change", [dict(stride=1.7), dict(stride=0), dict(size=True), dict(seed=-1)])
def test_arguments_of_a_data_set(change, small_dataset):
    with pytest.raises(InputError, match=f"^{next(iter(change))}=.*a whole number"):
        open_dataset(small_dataset, "train", **change)


def test_yolo_goes_on_only_from_its_own_files(tmp_path):
    """The file is unpickled, so another one could run anything."""
    last = tmp_path / "kept" / "last.pt"
    last.parent.mkdir()
    last.write_bytes(b"anything")
    assert yolo.epochs_behind(last, {digest(b"anything"): 3}) == 3
    for written in ({}, {digest(b"another"): 3}, {digest(b"anything"): True}, None):
        with pytest.raises(InputError, match="last.pt is not a file that this training wrote"):
            yolo.epochs_behind(last, written)
