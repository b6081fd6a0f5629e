"""Training memorises a few frames, resumes to the bit, and names what is wrong.

The presets and the pretraining of the backbone are tested here too.
"""

import csv
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from fakes import FakeDrones, tiny_config
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch.utils.data import Subset, default_collate

from dronekeypp import camera, presets, pretrain, train
from dronekeypp.augment import mirrored
from dronekeypp.checkpoint import network_class
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.model import (
    DECODERS,
    TERMS,
    Backbone,
    BackboneConfig,
    DroneKeyPP,
    ModelConfig,
    PoseNetwork,
    loss_terms,
    total_loss,
)
from dronekeypp.model.backbone import save_backbone
from dronekeypp.presets import TrainConfig

TESTS = Path(__file__).parent


def settings(**changes):
    return TrainConfig(**{"epochs": 3, "batch": 8, "lr": 1e-3, "seed": 3, "device": "cpu", **changes})


def header_of(path):
    with safe_open(path, "pt") as file:
        return file.metadata()


def same_tensors(first, second):
    """Whether two safetensors files hold the same tensors, to the bit."""
    first, second = load_file(first), load_file(second)
    return first.keys() == second.keys() and all(torch.equal(first[key], second[key]) for key in first)


def metrics_of(run_folder):
    """The rows of a run's metrics.csv, as dicts of text."""
    return list(csv.DictReader((run_folder / "metrics.csv").read_text().splitlines()))


def train_tiny(out, *, changes=None, model=None, **options):
    """Train a tiny network on 24 frames into `out`; return the folder of its best weights.

    `changes` are to the training settings, `model` to the network's, and `options` go to `train_on`.
    """
    model_config, train_config = tiny_config(**(model or {})), settings(**(changes or {}))
    return train.train_on(FakeDrones(24), FakeDrones(9, seed=1), out, model_config, train_config, **options)


def interrupt(state):
    raise KeyboardInterrupt


def interrupt_at_epoch_2(state):
    if state.epoch == 2:
        raise KeyboardInterrupt


def test_a_pretrained_stem_stays_and_a_new_one_learns(tmp_path):
    """frozen_stages holds stages of stored weights, a resumed run included; without weights all learn."""
    weights = tmp_path / "backbone.safetensors"
    backbone = Backbone(BackboneConfig(image_size=32))
    save_file(save_backbone(backbone), weights)
    freeze, model = {"frozen_stages": 1}, {"backbone_weights": weights}
    with pytest.raises(KeyboardInterrupt):
        train_tiny(tmp_path / "run", changes=freeze, model=model, on_epoch=interrupt_at_epoch_2)
    best = train_tiny(tmp_path / "run", changes=freeze, model=model, resume=True)
    trained, stored = load_file(best / "model.safetensors"), load_file(weights)
    assert torch.equal(trained["backbone.net.0.0.weight"], stored["net.0.0.weight"].float())
    assert torch.equal(trained["backbone.net.0.1.running_mean"], stored["net.0.1.running_mean"].float())
    assert not torch.equal(trained["backbone.net.1.0.conv1.weight"], stored["net.1.0.conv1.weight"].float())
    torch.manual_seed(3)
    start = DroneKeyPP(tiny_config()).state_dict()
    best = train_tiny(tmp_path / "scratch", changes=freeze)
    key = "backbone.net.0.0.weight"
    assert not torch.equal(load_file(best / "model.safetensors")[key], start[key])


def test_the_weight_of_the_rotation_scales_its_gradient(monkeypatch):
    """rotation_weight multiplies L_rot in the sum, and the history keeps the value without it."""
    totals = []

    def total(terms, weights):
        totals.append(terms)
        return total_loss(terms, weights)

    monkeypatch.setattr(train.loop, "total_loss", total)
    seen = []
    for weight in (1.0, 26.0):
        torch.manual_seed(0)
        config = settings(epochs=1, rotation_weight=weight)
        history = train.fit(DroneKeyPP(tiny_config()), FakeDrones(8), FakeDrones(8, seed=1), config)
        seen.append((totals[-1]["L_rot"].item(), history[0]["train_L_rot"]))
    (plain, printed), (weighted, printed_too) = seen
    assert weighted == pytest.approx(26 * plain)
    assert printed == pytest.approx(printed_too) == pytest.approx(plain)


@pytest.mark.parametrize("rotation", ["euler", "sixd"])
def test_sixteen_frames_are_memorised(rotation):
    """Every loss term falls by 50 times or more.

    So no head is dead, no gradient is missing, and no target is on another scale. Headings stay 30° off the
    sigmoid's seam: across it the paper's head can memorise nothing, because it cannot get from 1 to 0.
    """
    dataset = FakeDrones(16, yaw=150)
    items = default_collate([dataset[i] for i in range(16)])
    torch.manual_seed(0)
    model = DroneKeyPP(tiny_config(width=32, ffn=64, decoder_width=128, rays="split", rotation=rotation))
    model.prepare(items)
    optimiser = torch.optim.Adam(model.parameters())
    steps = 200
    history = []
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = 2e-3 * min(1, (step + 1) / 20, 2 * (1 - step / steps))
        terms = loss_terms(model(items["image"], items["K"], items["square"]), items, keypoint_unit=10)
        history.append({name: value.item() for name, value in terms.items()})
        optimiser.zero_grad()
        total_loss(terms).backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
    first, last = history[0], history[-1]
    for name in TERMS:
        assert last[name] < first[name] / 50, (name, first, last)


def test_a_run_folder_and_its_history(tmp_path):
    """A run holds its settings, a row of measures per epoch, the last state, and the best weights."""
    run = tmp_path / "run"
    best = train_tiny(run)
    files = sorted(p.name for p in run.iterdir() if p.name != ".lock")
    assert files == ["best", "config.json", "last.safetensors", "metrics.csv"]
    rows = metrics_of(run)
    assert [row["epoch"] for row in rows] == ["1", "2", "3"]
    columns = {"lr", "seconds", "score", "val_R_medae_deg", "val_t_medae_m"}
    columns |= {"val_class_accuracy", "val_keypoint_px"}
    for name in (*TERMS, "total"):
        columns |= {f"train_{name}", f"val_{name}"}
    assert columns <= set(rows[0])
    model = DroneKeyPP.from_pretrained(best)
    score = train.validate(model, FakeDrones(9, seed=1), settings())["score"]
    assert score == pytest.approx(min(float(row["score"]) for row in rows), rel=1e-4)
    config = json.loads((run / "config.json").read_text())
    assert config["train"]["seed"] == 3
    assert config["model"]["layers"] == 2
    assert config["data"]["train_frames"] == 24


def test_fit_in_memory_tells_every_epoch():
    """`fit` calls back after every epoch and tells the training set the number of the epoch."""
    epochs = []
    torch.manual_seed(0)
    dataset = FakeDrones(16)
    model = DroneKeyPP(tiny_config())

    def note_epoch(state):
        epochs.append(state.history[-1]["epoch"])

    history = train.fit(model, dataset, FakeDrones(8, seed=1), settings(), note_epoch)
    assert epochs == [1, 2, 3]
    assert len(history) == 3
    assert dataset.epoch == 2
    assert history[-1]["lr"] < history[0]["lr"]


@pytest.mark.parametrize("schedule", ["tanh", "shifted", "biased"])
def test_schedules_and_truth_train(schedule):
    """A decoder on true keypoints trains with every schedule. max_minutes stops it after one epoch."""
    model = DroneKeyPP(tiny_config(encoder="truth", rays="split"))
    config = settings(schedule=schedule, clip=1, warmup=2, max_minutes=1e-9)
    history = train.fit(model, FakeDrones(64), FakeDrones(8, seed=1), config)
    assert len(history) == 1
    assert history[0]["train_L_2D"] == 0


class OnlyPlace(PoseNetwork):
    """The least that a network of one's own needs: it predicts where the drone is, and nothing else."""

    method = "Only place"
    Config = ModelConfig

    def __init__(self, config, load_backbone=True):
        super().__init__()
        self.config, self.linear = config, torch.nn.Linear(3, 3)

    def forward(self, image, K, square):
        return {"t": self.linear(square / 1000)} if self.config.decoder.use_3d else {}

    def losses(self, output, batch, keypoint_unit):
        if output:
            return {"L_trans": (output["t"] - batch["t"]).square().mean()}
        return {"L_trans": self.linear.weight.square().sum()}


def test_a_network_of_ones_own_may_predict_a_part(tmp_path):
    """A network that predicts only a place trains and loads; one that predicts nothing is refused."""
    config = tiny_config()
    sets = FakeDrones(24), FakeDrones(9, seed=1)
    best = train.train_on(*sets, tmp_path / "run", config, settings(), network=OnlyPlace)
    assert OnlyPlace.from_pretrained(best).config == config
    predicts_nothing = tiny_config(use_3d=False)
    with pytest.raises(InputError, match="is judged by its pose and predicts none"):
        train.train_on(*sets, tmp_path / "none", predicts_nothing, settings(), network=OnlyPlace)


def test_a_part_of_a_set_is_augmented_anew_every_epoch():
    """The epoch's number reaches a data set through any number of Subsets."""
    whole = FakeDrones(24)
    part = Subset(Subset(whole, range(9)), range(8))
    train.fit(DroneKeyPP(tiny_config()), part, FakeDrones(4), settings(epochs=2))
    assert whole.epoch == 1


def test_resuming_gives_the_same_bits(tmp_path):
    """Dropout, shuffling, Adam and the running statistics all go on exactly; so does the history."""
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    model, changes = {"dropout": 0.1}, {"mirror": True}
    train_tiny(whole, model=model, changes=changes)
    with pytest.raises(KeyboardInterrupt):
        train_tiny(parts, model=model, changes=changes, on_epoch=interrupt_at_epoch_2)
    torch.rand(7)  # The state of the global generator must not matter.
    train_tiny(parts, model=model, changes=changes, resume=True)
    assert same_tensors(whole / "last.safetensors", parts / "last.safetensors")
    assert same_tensors(whole / "best" / "model.safetensors", parts / "best" / "model.safetensors")
    whole_rows, parts_rows = metrics_of(whole), metrics_of(parts)
    for row in whole_rows + parts_rows:
        del row["seconds"]
    assert whole_rows == parts_rows
    assert len(whole_rows) == 3
    # The run is finished: resuming once more has nothing left to do.
    train_tiny(parts, model=model, changes=changes, resume=True)
    assert same_tensors(whole / "last.safetensors", parts / "last.safetensors")


SCRIPT = """
import os
import sys

import torch

sys.path.insert(0, {tests!r})
from fakes import FakeDrones, tiny_config
from test_train import settings

from dronekeypp import train

torch.set_num_threads(1)


def on_epoch(state):
    if {kill} and state.epoch == 2:
        os.kill(os.getpid(), 9)


sets = FakeDrones(24), FakeDrones(9, seed=1)
train.train_on(*sets, {out!r}, tiny_config(), settings(epochs={epochs}), resume={resume}, on_epoch=on_epoch)
"""


def script(out, kill=False, resume=False, epochs=3):
    """The text of a program that does what `train_tiny` does, in one thread.

    With `kill` it kills itself after the second epoch.
    """
    return SCRIPT.format(tests=str(TESTS), out=str(out), kill=kill, resume=resume, epochs=epochs)


def test_a_killed_process_resumes(tmp_path):
    """A run that was killed goes on to the same bits, and half-written files disappear."""
    run, whole = tmp_path / "run", tmp_path / "whole"
    command = [sys.executable, "-c", script(run, kill=True)]
    killed = subprocess.run(command, capture_output=True, text=True)
    assert killed.returncode == -9, killed.stderr
    # This is what is left when the kill comes during a write.
    (run / ".last.safetensors.0123456789abcdef.tmp.safetensors").write_bytes(b"half")
    (run / ".letter.tmp").write_bytes(b"somebody's")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        train_tiny(run, resume=True)
        train_tiny(whole)
    finally:
        torch.set_num_threads(threads)
    assert same_tensors(run / "last.safetensors", whole / "last.safetensors")
    assert [path.name for path in run.glob(".*")] == [".letter.tmp"]


def test_two_processes_train_together(tmp_path):
    """Two processes (torchrun, gloo) write one run, with nearly the loss of one process.

    Each has half of every batch, and they share their mean gradient. The loss is not the same because
    BatchNorm sees only halves. The test is slow, because three interpreters import torch.
    """
    run, single = tmp_path / "run", tmp_path / "single"
    (tmp_path / "job.py").write_text(script(run, epochs=1))
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE"}
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command.append(str(tmp_path / "job.py"))
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    rows = metrics_of(run)
    assert len(rows) == 1
    DroneKeyPP.from_pretrained(run / "best")
    train_tiny(single, changes={"epochs": 1})
    loss_of_two = float(rows[0]["train_total"])
    loss_of_one = float(metrics_of(single)[0]["train_total"])
    assert math.isclose(loss_of_two, loss_of_one, rel_tol=0.2)


def test_a_mirrored_frame_is_a_true_frame():
    """Mirrored frames show the same drone in a pose that projects onto their keypoints.

    The frames that were not chosen stay as they are, and mirroring twice undoes it.
    """
    dataset = FakeDrones(6)
    items = default_collate([dataset[i] for i in range(6)])
    chosen = torch.tensor([True, False] * 3)
    other = mirrored(items, chosen)
    hubs = items["keypoints_3d"] @ items["R"]  # in body axes
    torch.testing.assert_close(other["keypoints_3d"], hubs @ other["R"].transpose(1, 2))
    torch.testing.assert_close(torch.linalg.det(other["R"]), torch.ones(6))
    pixels = camera.project(other["keypoints_3d"] + other["t"][:, None], other["K"])
    torch.testing.assert_close(camera.to_crop(pixels, other["square"]), other["keypoints"], atol=1e-4, rtol=0)
    assert torch.equal(other["image"][0], items["image"][0].flip(2))
    assert other["t"][0, 0] == -items["t"][0, 0]
    twice = mirrored(other, chosen)
    for name, value in items.items():
        assert torch.equal(other[name][1::2], value[1::2]), name
        assert torch.allclose(twice[name].float(), value.float(), atol=1e-3), name


def test_epoch_order_shares_every_frame_among_processes():
    """The order depends on epoch and seed alone, and the processes' equal parts cover all frames."""
    config = settings()
    whole = train.epoch_order(10, config, 0)
    assert sorted(whole) == list(range(10))
    assert whole == train.epoch_order(10, config, 0)
    next_epoch = train.epoch_order(10, config, 1)
    assert whole != next_epoch
    assert next_epoch != train.epoch_order(10, settings(seed=4), 1)
    parts = [train.epoch_order(10, config, 0, rank, 3) for rank in range(3)]
    assert [len(part) for part in parts] == [4, 4, 4]
    assert set().union(*parts) == set(range(10))
    assert len(train.epoch_order(10, settings(frames=4), 0)) == 4


def test_learning_rate_warms_up_and_falls_to_nothing():
    config = settings(lr=1.0, warmup=9)
    rates = [train.learning_rate(config, step, 100) for step in range(100)]
    assert rates[0] == pytest.approx(0.1)
    assert rates[-1] < 1e-3
    assert max(rates) > 0.97
    without_warmup = settings(lr=1.0)
    assert train.learning_rate(without_warmup, 0, 100) == pytest.approx(1)
    assert train.learning_rate(without_warmup, 50, 100) == pytest.approx(0.5)


def test_a_run_from_before_a_setting_existed_goes_on_with_its_default():
    new = train.run_settings("DroneKey++", ModelConfig(), TrainConfig(), {})
    old = json.loads(json.dumps(new))
    del old["model"]["translation"], old["train"]["precision"]
    train.check_settings(old, new, Path("run"))
    new["model"]["translation"] = "site"
    with pytest.raises(InputError, match="model.translation was 'metres' and is now 'site'"):
        train.check_settings(old, new, Path("run"))


def test_resume_refuses_another_configuration_or_other_data(tmp_path):
    """Whatever would change the result is refused by name, and so are broken files. max_minutes would not."""
    run = tmp_path / "run"
    train_tiny(run, changes={"epochs": 1})
    with pytest.raises(InputError, match="cannot resume .*train.lr was 0.001 and is now 0.1"):
        train_tiny(run, changes={"epochs": 1, "lr": 0.1}, resume=True)
    with pytest.raises(InputError, match="model.pool was 'max' and is now 'mean'"):
        train_tiny(run, changes={"epochs": 1}, model={"pool": "mean"}, resume=True)
    train_tiny(run, changes={"epochs": 1, "max_minutes": 5}, resume=True)
    with pytest.raises(InputError, match="data.train_frames was 24 and is now 5"):
        other_sets = FakeDrones(5), FakeDrones(9, seed=1)
        train.train_on(*other_sets, run, tiny_config(), settings(epochs=1), resume=True)
    (run / "last.safetensors").write_bytes(b"broken")
    with pytest.raises(InputError, match="last.safetensors is not a readable training state"):
        train_tiny(run, changes={"epochs": 1}, resume=True)
    (run / "config.json").write_text("{}")
    with pytest.raises(InputError, match="config.json is broken"):
        train_tiny(run, changes={"epochs": 1}, resume=True)


def test_a_folder_in_use_is_left_alone(tmp_path):
    """A folder or file that is not a run is refused, and nothing in it changes."""
    (tmp_path / "notes.txt").write_text("mine")
    for resume in (False, True):
        with pytest.raises(InputError, match="is not empty and not a run: choose another folder"):
            train_tiny(tmp_path, resume=resume)
    with pytest.raises(InputError, match="notes.txt is not empty"):
        train_tiny(tmp_path / "notes.txt")
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_pose_that_is_nan_is_named(tmp_path):
    data = FakeDrones(24)
    data.data["t"][5] = float("nan")
    message = r"epoch 1 batch \d: L_trans is not finite, because t of scene 2 frame 5"
    with pytest.raises(InputError, match=message):
        train.train_on(data, FakeDrones(9), tmp_path / "run", tiny_config(), settings())


def test_weights_that_run_away_are_named():
    """Where the data is finite and a loss is not, the error says to lower the learning rate."""
    model = DroneKeyPP(tiny_config())
    with torch.no_grad():
        model.decoder.mlp_pose[0].weight.fill_(float("inf"))
    with pytest.raises(InputError, match="epoch 1 batch 1: L_.* is not finite; lower lr"):
        train.fit(model, FakeDrones(8), FakeDrones(8), settings())


def test_empty_sets_are_errors():
    empty = Subset(FakeDrones(4), [])
    with pytest.raises(InputError, match="the training set has no frames"):
        train.fit(DroneKeyPP(tiny_config()), empty, FakeDrones(4), settings())
    with pytest.raises(InputError, match="the validation set has no frames"):
        train.fit(DroneKeyPP(tiny_config()), FakeDrones(4), empty, settings())


def test_presets_and_overrides():
    """The preset `paper` holds the paper's values, and overrides given as text replace those of a preset."""
    model, training = presets.preset("paper")
    assert (training.lr, training.batch, training.epochs) == (1e-5, 32, 100)
    assert (training.schedule, training.augment) == ("equal", False)
    assert (model.backbone, model.backbone_weights, model.image_size) == ("resnet50", "imagenet", 224)
    assert (model.decoder.rays, model.decoder.rotation) == ("raw", "euler")
    overrides = presets.parse_overrides(["rays=raw", "lr=1e-4", "augment=false", "backbone_weights=none"])
    model, training = presets.preset("cpu", overrides)
    assert (model.decoder.rays, model.backbone_weights) == ("raw", None)
    assert (training.lr, training.augment) == (1e-4, False)
    with pytest.raises(InputError, match="write key=value"):
        presets.parse_overrides(["lr"])
    # No two parts share the name of a setting, so `--set` knows where each belongs.
    for decoder in DECODERS.values():
        keys = [*ModelConfig.own_keys(), *decoder.Config.keys(), *TrainConfig.keys()]
        assert len(set(keys)) == len(keys)


@pytest.mark.parametrize(
    ("preset", "overrides", "match"),
    [
        ("gpu", {}, "unknown preset 'gpu'; known: paper, cpu"),
        ("cpu", {"colour": 1}, "unknown setting 'colour' for DroneKey\\+\\+; known: .*rays.*epochs"),
        ("cpu", {"lr": "fast"}, "lr='fast' does not fit"),
        ("cpu", {"schedule": "late"}, "schedule='late' is not one of"),
        ("cpu", {"epochs": 0}, "epochs=0 must be at least 1"),
        ("cpu", {"pose": "cubic"}, "pose='cubic' is not one of: mlp, geometric"),
        (
            "cpu",
            {"rotation": "sixd", "angle_zero": "edge"},
            "angle_zero=edge is not used: it needs rotation=euler",
        ),
        ("paper", {"backbone_stride": 8}, "backbone_stride=8 is not used: it needs backbone=compact"),
        ("cpu", {"use_rays": "false", "rays": "raw"}, "rays=raw is not used: it needs use_rays=True"),
        ("cpu", {"encoder": "truth", "gate": "last"}, "gate=last is not used: it needs encoder=learned"),
        (
            "cpu",
            {"encoder": "truth", "backbone_stride": 8},
            "backbone_stride=8 is not used: it needs encoder",
        ),
        (
            "cpu",
            {"encoder": "truth", "precision": "bfloat16"},
            "precision=bfloat16 is not used: it needs enc",
        ),
        ("cpu", {"pose": "geometric", "rotation": "sixd"}, "unknown setting 'rotation'"),
    ],
)
def test_overrides_that_do_not_fit_or_are_not_used(preset, overrides, match):
    with pytest.raises(InputError, match=match):
        presets.preset(preset, overrides)


@pytest.mark.parametrize(("method", "setting"), [("DroneKey", "rotation"), ("DronePose", "layers")])
def test_a_baseline_refuses_the_settings_of_others(method, setting):
    with pytest.raises(InputError, match=f"unknown setting '{setting}' for {method}; known: "):
        presets.preset("cpu", {setting: 1}, network_class(method))
    with pytest.raises(InputError, match="rotation_weight=2 is not used: DroneKey learns no rotation"):
        presets.preset("cpu", {"rotation_weight": 2}, network_class("DroneKey"))
    with pytest.raises(InputError, match="keypoint_unit=5 is not used: DronePose finds no keypoints"):
        presets.preset("cpu", {"keypoint_unit": 5}, network_class("DronePose"))


def test_what_a_preset_sets_and_a_choice_makes_useless_is_left_out():
    """A choice that makes a preset's own value useless resets that value; it is not an error."""
    assert presets.preset("cpu", {"use_rays": "false"})[0].decoder.rays == "raw"
    assert presets.preset("cpu", {"encoder": "truth"})[0].backbone_weights is None
    assert presets.preset("cpu", {"pose": "geometric"})[0].decoder.rays == "split"
    assert presets.preset("cpu", {"use_rays": "true"})[0].decoder.rays == "split"


def test_soft_argmax_finds_a_peak():
    """A peak in one cell is at the cell's centre, one in two cells is between them."""
    logits = torch.full((1, 2, 6, 6), -100.0)
    logits[0, 0, 1, 4] = 0.0  # row 1, column 4
    logits[0, 1, 2, 2] = logits[0, 1, 2, 3] = 0.0  # row 2, between columns 2 and 3
    expected = torch.tensor([[4.5 / 6, 1.5 / 6], [0.5, 2.5 / 6]])
    torch.testing.assert_close(pretrain.soft_argmax(logits)[0], expected)


def test_cell_weights_are_the_opposite_of_soft_argmax():
    """The centre of mass of the weights is the keypoint, as far as the cell centres reach."""
    keypoints = torch.tensor([[[0.3, 0.6], [0.5, 0.91], [0.0, 1.2]]])
    weights = pretrain.cell_weights(keypoints, 6)
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(1, 3))
    reached = keypoints.clamp(1 / 12, 11 / 12)
    torch.testing.assert_close(pretrain.soft_argmax(weights.log().unflatten(2, (6, 6))), reached)


def test_pretraining_takes_several_data_sets(small_dataset, tmp_path):
    """The header of the backbone's file names all the data sets, and how well the backbone did."""
    sets, out = [small_dataset, small_dataset], tmp_path / "b.safetensors"
    overrides = {"image_size": 32, "backbone_stride": 8, "batch": 16, "device": "cpu"}
    path = pretrain.pretrain(sets, out, epochs=1, overrides=overrides, progress=False)
    header = header_of(path)
    digest = json.loads((small_dataset / "manifest.json").read_text())["digest"]
    assert header["train_frames"] == "48"
    assert header["dataset_digest"] == f"{digest}+{digest}"
    assert header["drones"] == "Mini2, Tello"
    measures = json.loads(header["validation"])
    assert {"val_keypoint_crop_px", "val_R_medae_deg"} <= set(measures)
    assert not [name for name in measures if "class" in name or "cls" in name]
    with pytest.raises(InputError, match="pretraining has its own losses and no schedule"):
        pretrain.pretrain([small_dataset], tmp_path / "c.safetensors", overrides={"schedule": "tanh"})


def test_joined_sets_keep_their_drones_apart(small_dataset):
    """The second part's class indices come behind those of the first, in items and in annotations."""
    parts = [open_dataset(small_dataset, split, size=32) for split in ("train", "val")]
    joined = pretrain.Joined(parts)
    labels = joined.annotations()["label"].tolist()
    drones = len(parts[0].drones)
    assert labels == parts[0].labels + [drones + label for label in parts[1].labels]
    assert [joined[i]["label"].item() for i in (0, len(parts[0]), -1)] == [labels[0], labels[24], labels[-1]]
    assert joined.drones[labels[-1]] is parts[1].drones[parts[1].labels[-1]]


def test_pretraining_writes_a_backbone_that_fits_and_resumes(tmp_path):
    """An interrupted pretraining goes on to the same bits, and a network loads the backbone that it writes.

    Neither a file left from an earlier run, nor other settings, nor a finished file is overwritten.
    """
    config, run = tiny_config(), settings(epochs=2, mirror=True)
    sets = FakeDrones(24), FakeDrones(8, seed=1)
    resumed, whole = tmp_path / "a.safetensors", tmp_path / "b.safetensors"
    with pytest.raises(KeyboardInterrupt):
        pretrain.pretrain_to(*sets, resumed, config, run, on_epoch=interrupt)
    with pytest.raises(InputError, match="a.safetensors.resume is left from an earlier run"):
        pretrain.pretrain_to(*sets, resumed, config, run)
    with pytest.raises(InputError, match="lr was 0.001 and is now 0.1"):
        pretrain.pretrain_to(*sets, resumed, config, run.replace(lr=0.1), resume=True)
    facts = {"command": "python -m dronekeypp pretrain …"}
    pretrain.pretrain_to(*sets, resumed, config, run, resume=True, facts=facts)
    pretrain.pretrain_to(*sets, whole, config, run)
    assert same_tensors(resumed, whole)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.safetensors", "b.safetensors"]
    header = header_of(resumed)
    assert header["epochs"] == "2"
    assert "pretrain" in header["command"]
    assert header["train_frames"] == "24"
    model = DroneKeyPP(config.replace(backbone_weights=str(resumed)))
    stored = load_file(resumed)["net.0.0.weight"]
    torch.testing.assert_close(model.backbone.net[0][0].weight.detach(), stored.float())
    with pytest.raises(InputError, match="exists already"):
        pretrain.pretrain_to(*sets, resumed, config, run)


def test_two_processes_do_not_train_one_run(tmp_path):
    """While one run trains, a second one in its folder is refused. Afterwards the folder is free again."""
    sets = FakeDrones(4), FakeDrones(4, seed=1)
    run, config = tmp_path / "run", settings(epochs=1)

    def train_in_the_same_folder(state):
        train.train_on(*sets, run, tiny_config(), config, resume=True)

    with pytest.raises(InputError, match="another process is at work in .*run"):
        train.train_on(*sets, run, tiny_config(), config, on_epoch=train_in_the_same_folder)
    train.train_on(*sets, run, tiny_config(), config, resume=True)
