"""Training: it memorises, it resumes to the bit, it says what is wrong. And the presets and the backbone's pretraining."""

import csv
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from fakes import FakeDrones, tiny
from safetensors import safe_open

from dronekeypp import camera, presets, pretrain, train
from dronekeypp.errors import InputError
from dronekeypp.model import TERMS, DroneKeyPP, ModelConfig, PoseNetwork, loss_terms, total_loss
from dronekeypp.presets import TrainConfig

TESTS = Path(__file__).parent


def settings(**changes):
    return TrainConfig(**{"epochs": 3, "batch": 8, "lr": 1e-3, "seed": 3, "device": "cpu", **changes})


def tensors(path):
    with safe_open(path, "pt") as file:
        return {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118


def same(a, b):
    a, b = tensors(a), tensors(b)
    return a.keys() == b.keys() and all(torch.equal(a[key], b[key]) for key in a)


def start(out, *, changes=None, model=None, **more):
    configs = ModelConfig(**tiny(**(model or {}))), settings(**(changes or {}))
    return train.train_on(FakeDrones(24), FakeDrones(9, seed=1), out, *configs, **more)


@pytest.mark.parametrize("rotation", ["euler", "sixd"])
def test_sixteen_frames_are_memorised(rotation):
    """Every loss term falls by 50 times or more: no head is dead, no gradient is missing, no target is on another scale.

    Headings stay 30° off the sigmoid's seam: across it the paper's head can memorise nothing, because it cannot get from 1 to 0.
    """
    dataset = next(iter(torch.utils.data.DataLoader(FakeDrones(16, yaw=150), batch_size=16)))
    torch.manual_seed(0)
    model = DroneKeyPP(
        ModelConfig(**tiny(width=32, ffn=64, decoder_width=128, rays="split", rotation=rotation))
    )
    model.fit_rays([dataset])
    optimiser = torch.optim.Adam(model.parameters())
    steps = 200
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = 2e-3 * min(1, (step + 1) / 20, 2 * (1 - step / steps))
        terms = loss_terms(
            model(dataset["image"], dataset["K"], dataset["square"]), dataset, keypoint_unit=10
        )
        if step == 0:
            first = {name: value.item() for name, value in terms.items()}
        optimiser.zero_grad()
        total_loss(terms).backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
    last = {name: value.item() for name, value in terms.items()}
    assert all(last[name] < first[name] / 50 for name in TERMS), (first, last)


def test_a_run_folder_and_its_history(tmp_path):
    best = start(tmp_path / "run")
    kept = sorted(p.name for p in (tmp_path / "run").iterdir() if p.name != ".lock")
    assert kept == ["best", "config.json", "last.safetensors", "metrics.csv"]
    rows = list(csv.DictReader(open(tmp_path / "run" / "metrics.csv")))
    assert [row["epoch"] for row in rows] == ["1", "2", "3"]
    wanted = [f"{part}_{name}" for part in ("train", "val") for name in (*TERMS, "total")]
    wanted += [
        "lr",
        "seconds",
        "score",
        "val_R_medae_deg",
        "val_t_medae_m",
        "val_class_accuracy",
        "val_keypoint_px",
    ]
    assert set(wanted) <= set(rows[0])
    model = DroneKeyPP.from_pretrained(best)
    score = train.validate(model, FakeDrones(9, seed=1), settings())["score"]
    assert score == pytest.approx(min(float(row["score"]) for row in rows), rel=1e-4)
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert (
        config["train"]["seed"] == 3
        and config["model"]["layers"] == 2
        and config["data"]["train_frames"] == 24
    )


def test_fit_in_memory_tells_every_epoch():
    seen = []
    torch.manual_seed(0)
    dataset = FakeDrones(16)
    model = DroneKeyPP(ModelConfig(**tiny()))
    history = train.fit(
        model,
        dataset,
        FakeDrones(8, seed=1),
        settings(),
        lambda state: seen.append(state.history[-1]["epoch"]),
    )
    assert seen == [1, 2, 3] and len(history) == 3 and dataset.epoch == 2
    assert history[-1]["lr"] < history[0]["lr"]


@pytest.mark.parametrize("schedule", ["tanh", "shifted", "biased"])
def test_schedules_and_truth_train(schedule):
    model = DroneKeyPP(ModelConfig(**tiny(encoder="truth", rays="split")))
    history = train.fit(
        model,
        FakeDrones(64),
        FakeDrones(8, seed=1),
        settings(schedule=schedule, clip=1, warmup=2, max_minutes=1e-9),
    )
    assert len(history) == 1 and history[0]["train_L_2D"] == 0  # max_minutes stopped it after one epoch


class OnlyPlace(PoseNetwork):
    """The least a network of one's own needs: where the drone is, and nothing else."""

    method = "Only place"

    def __init__(self, config, load_backbone=True):
        super().__init__()
        self.config, self.linear = config, torch.nn.Linear(3, 3)

    def forward(self, image, K, square):
        return {"t": self.linear(square / 1000)} if self.config.use_3d else {}

    def losses(self, output, batch, keypoint_unit):
        return {
            "L_trans": (output["t"] - batch["t"]).square().mean()
            if output
            else self.linear.weight.square().sum()
        }


def test_a_network_of_ones_own_may_predict_a_part(tmp_path):
    configs = ModelConfig(**tiny()), settings()
    best = train.train_on(
        FakeDrones(24), FakeDrones(9, seed=1), tmp_path / "run", *configs, network=OnlyPlace
    )
    assert OnlyPlace.from_pretrained(best).config == configs[0]
    with pytest.raises(InputError, match="is judged by its pose and predicts none"):
        train.train_on(
            FakeDrones(24),
            FakeDrones(9),
            tmp_path / "none",
            ModelConfig(**tiny(use_3d=False)),
            settings(),
            network=OnlyPlace,
        )


def test_a_part_of_a_set_is_augmented_anew_every_epoch():
    whole = FakeDrones(24)
    part = torch.utils.data.Subset(torch.utils.data.Subset(whole, range(9)), range(8))
    train.fit(DroneKeyPP(ModelConfig(**tiny())), part, FakeDrones(4), settings(epochs=2))
    assert whole.epoch == 1


def test_resuming_gives_the_same_bits(tmp_path):
    """Dropout, shuffling, Adam and the running statistics all go on exactly; so does the history."""
    model, changes = {"dropout": 0.1}, {"mirror": True}
    start(tmp_path / "whole", model=model, changes=changes)

    def kill(state):
        if state.epoch == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        start(tmp_path / "parts", model=model, changes=changes, on_epoch=kill)
    torch.rand(7)  # the state of the global generator must not matter
    start(tmp_path / "parts", model=model, changes=changes, resume=True)
    assert same(tmp_path / "whole" / "last.safetensors", tmp_path / "parts" / "last.safetensors")
    assert same(
        tmp_path / "whole" / "best" / "model.safetensors", tmp_path / "parts" / "best" / "model.safetensors"
    )
    rows = [[{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(open(tmp_path / name / "metrics.csv"))]
            for name in ("whole", "parts")]  # fmt: skip
    assert rows[0] == rows[1] and len(rows[0]) == 3
    start(tmp_path / "parts", model=model, changes=changes, resume=True)  # finished: nothing left to do
    assert same(tmp_path / "whole" / "last.safetensors", tmp_path / "parts" / "last.safetensors")


SCRIPT = """
import sys; sys.path.insert(0, {tests!r})
import os, torch
torch.set_num_threads(1)
from fakes import FakeDrones, tiny
from dronekeypp import train
from dronekeypp.model import ModelConfig
from test_train import settings
def on_epoch(state):
    if {kill} and state.epoch == 2: os.kill(os.getpid(), 9)
train.train_on(FakeDrones(24), FakeDrones(9, seed=1), {out!r}, ModelConfig(**tiny()), settings(epochs={epochs}),
               resume={resume}, on_epoch=on_epoch)
"""


def script(out, kill=False, resume=False, epochs=3):
    return SCRIPT.format(tests=str(TESTS), out=str(out), kill=kill, resume=resume, epochs=epochs)


def test_a_killed_process_resumes(tmp_path):
    killed = subprocess.run(
        [sys.executable, "-c", script(tmp_path / "run", kill=True)], capture_output=True, text=True
    )
    assert killed.returncode == -9, killed.stderr
    (tmp_path / "run" / ".last.safetensors.1.tmp").write_bytes(
        b"half"
    )  # as if the kill had come while writing
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        start(tmp_path / "run", resume=True)
        start(tmp_path / "whole")
    finally:
        torch.set_num_threads(before)
    assert same(tmp_path / "run" / "last.safetensors", tmp_path / "whole" / "last.safetensors")
    assert not list((tmp_path / "run").glob(".*.tmp"))


def test_two_processes_train_together(tmp_path):
    """torchrun with gloo. Slow: three interpreters import torch."""
    (tmp_path / "job.py").write_text(script(tmp_path / "run", epochs=1))
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE"}
    command = [
        sys.executable,
        "-m",
        "torch.distributed.run",
        "--standalone",
        "--nproc-per-node",
        "2",
        str(tmp_path / "job.py"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    rows = list(csv.DictReader(open(tmp_path / "run" / "metrics.csv")))
    assert len(rows) == 1
    DroneKeyPP.from_pretrained(tmp_path / "run" / "best")
    # Two halves of a batch and their mean gradient: close to one process with the whole batch (BatchNorm sees only halves).
    start(tmp_path / "one", changes={"epochs": 1})
    one = list(csv.DictReader(open(tmp_path / "one" / "metrics.csv")))
    assert math.isclose(float(rows[0]["train_total"]), float(one[0]["train_total"]), rel_tol=0.2)


def test_a_mirrored_frame_is_a_true_frame():
    items = next(iter(torch.utils.data.DataLoader(FakeDrones(6), batch_size=6)))
    chosen = torch.tensor([True, False] * 3)
    other = train.mirrored(items, chosen)
    hubs = items["keypoints_3d"] @ items["R"]  # body axes
    torch.testing.assert_close(other["keypoints_3d"], hubs @ other["R"].transpose(1, 2))  # the same drone
    torch.testing.assert_close(torch.linalg.det(other["R"]), torch.ones(6))
    pixels = camera.project(other["keypoints_3d"] + other["t"][:, None], other["K"])
    torch.testing.assert_close(camera.to_crop(pixels, other["square"]), other["keypoints"], atol=1e-4, rtol=0)
    assert all(torch.equal(other[k][1::2], items[k][1::2]) for k in items)
    assert torch.equal(other["image"][0], items["image"][0].flip(2)) and other["t"][0, 0] == -items["t"][0, 0]
    twice = train.mirrored(other, chosen)
    assert all(torch.allclose(twice[k].float(), items[k].float(), atol=1e-3) for k in items)


def test_epoch_order_shares_every_frame_among_processes():
    config = settings()
    whole = train.epoch_order(10, config, 0)
    assert sorted(whole) == list(range(10)) and whole == train.epoch_order(10, config, 0)
    assert whole != train.epoch_order(10, config, 1) != train.epoch_order(10, settings(seed=4), 1)
    parts = [train.epoch_order(10, config, 0, rank, 3) for rank in range(3)]
    assert {len(part) for part in parts} == {4} and {i for part in parts for i in part} == set(range(10))
    assert len(train.epoch_order(10, settings(frames=4), 0)) == 4


def test_learning_rate_warms_up_and_falls_to_nothing():
    config = settings(lr=1.0, warmup=9)
    rates = [train.learning_rate(config, step, 100) for step in range(100)]
    assert rates[0] == pytest.approx(0.1) and rates[-1] < 1e-3 and max(rates) > 0.97
    assert [train.learning_rate(settings(lr=1.0), step, 100) for step in (0, 50)] == pytest.approx([1, 0.5])


def test_a_run_from_before_a_setting_existed_goes_on_with_its_default():
    new = train.run_settings("DroneKey++", ModelConfig(), TrainConfig(), {})
    old = json.loads(json.dumps(new))
    del old["model"]["translation"], old["train"]["precision"]
    train.check_settings(old, new, Path("run"))
    new["model"]["translation"] = "site"
    with pytest.raises(InputError, match="model.translation was 'metres' and is now 'site'"):
        train.check_settings(old, new, Path("run"))


def test_resume_refuses_another_configuration_or_other_data(tmp_path):
    start(tmp_path / "run", changes={"epochs": 1})
    with pytest.raises(InputError, match="cannot resume .*train.lr was 0.001 and is now 0.1"):
        start(tmp_path / "run", changes={"epochs": 1, "lr": 0.1}, resume=True)
    with pytest.raises(InputError, match="model.pool was 'max' and is now 'mean'"):
        start(tmp_path / "run", changes={"epochs": 1}, model={"pool": "mean"}, resume=True)
    start(
        tmp_path / "run", changes={"epochs": 1, "max_minutes": 5}, resume=True
    )  # does not change the result
    with pytest.raises(InputError, match="data.train_frames was 24 and is now 5"):
        train.train_on(
            FakeDrones(5),
            FakeDrones(9, seed=1),
            tmp_path / "run",
            ModelConfig(**tiny()),
            settings(epochs=1),
            resume=True,
        )
    (tmp_path / "run" / "last.safetensors").write_bytes(b"broken")
    with pytest.raises(InputError, match="last.safetensors is not a readable training state"):
        start(tmp_path / "run", changes={"epochs": 1}, resume=True)
    (tmp_path / "run" / "config.json").write_text("{}")
    with pytest.raises(InputError, match="config.json is broken"):
        start(tmp_path / "run", changes={"epochs": 1}, resume=True)


def test_a_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty: add --resume to go on"):
        start(tmp_path)
    with pytest.raises(InputError, match="is not empty and not a run"):
        start(tmp_path, resume=True)
    with pytest.raises(InputError, match="notes.txt is not empty"):
        start(tmp_path / "notes.txt")
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_pose_that_is_nan_is_named(tmp_path):
    data = FakeDrones(24)
    data.data["t"][5] = float("nan")
    with pytest.raises(
        InputError, match=r"epoch 1 batch \d: L_trans is not finite, because t of scene 2 frame 5"
    ):
        train.train_on(data, FakeDrones(9), tmp_path / "run", ModelConfig(**tiny()), settings())


def test_weights_that_run_away_are_named():
    model = DroneKeyPP(ModelConfig(**tiny()))
    with torch.no_grad():
        model.decoder.mlp_pose[0].weight.fill_(float("inf"))
    with pytest.raises(InputError, match="epoch 1 batch 1: L_.* is not finite; lower lr"):
        train.fit(model, FakeDrones(8), FakeDrones(8), settings())


def test_empty_sets_are_errors():
    empty = torch.utils.data.Subset(FakeDrones(4), [])
    with pytest.raises(InputError, match="the training set has no frames"):
        train.fit(DroneKeyPP(ModelConfig(**tiny())), empty, FakeDrones(4), settings())
    with pytest.raises(InputError, match="the validation set has no frames"):
        train.fit(DroneKeyPP(ModelConfig(**tiny())), FakeDrones(4), empty, settings())


def test_presets_and_overrides():
    model, training = presets.preset("paper")
    assert (training.lr, training.batch, training.epochs, training.schedule, training.augment) == (
        1e-5,
        32,
        100,
        "equal",
        False,
    )
    assert (model.backbone, model.backbone_weights, model.image_size, model.rays, model.rotation) == (
        "resnet50", "imagenet", 224, "raw", "euler",
    )  # fmt: skip
    model, training = presets.preset(
        "cpu", presets.parse_overrides(["rays=raw", "lr=1e-4", "augment=false", "backbone_weights=none"])
    )
    assert (model.rays, training.lr, training.augment, model.backbone_weights) == ("raw", 1e-4, False, None)
    for name, overrides, match in [
        ("gpu", {}, "unknown preset 'gpu'; known: paper, cpu"), ("cpu", {"colour": 1}, "unknown setting 'colour'; known: .*rays.*epochs"),
        ("cpu", {"lr": "fast"}, "lr='fast' does not fit"), ("cpu", {"schedule": "late"}, "schedule='late' is not one of"),
        ("cpu", {"epochs": 0}, "epochs=0 must be at least 1"),
    ]:  # fmt: skip
        with pytest.raises(InputError, match=match):
            presets.preset(name, overrides)
    with pytest.raises(InputError, match="write key=value"):
        presets.parse_overrides(["lr"])
    assert not set(ModelConfig.keys()) & set(TrainConfig.keys())


def test_soft_argmax_finds_a_peak():
    logits = torch.full((1, 2, 6, 6), -100.0)
    logits[0, 0, 1, 4] = 0.0  # row 1, column 4
    logits[0, 1, 2, 2] = logits[0, 1, 2, 3] = 0.0  # between two cells
    torch.testing.assert_close(
        pretrain.soft_argmax(logits)[0], torch.tensor([[4.5 / 6, 1.5 / 6], [0.5, 2.5 / 6]])
    )


def test_pretraining_takes_several_data_sets(small_dataset, tmp_path):
    small = {**tiny(), "batch": 16, "device": "cpu"}
    path = pretrain.pretrain(
        [small_dataset, small_dataset], tmp_path / "b.safetensors", epochs=1, overrides=small, progress=False
    )
    with safe_open(path, "pt") as file:
        header = file.metadata()
    digest = json.loads((small_dataset / "manifest.json").read_text())["digest"]
    assert header["train_frames"] == "48" and header["dataset_digest"] == f"{digest}+{digest}"
    assert set(json.loads(header["validation"])) >= {
        "val_keypoint_crop_px",
        "val_class_accuracy",
        "val_R_medae_deg",
    }
    with pytest.raises(InputError, match="pretraining has its own losses and no schedule"):
        pretrain.pretrain([small_dataset], tmp_path / "c.safetensors", overrides={"schedule": "tanh"})


def test_pretraining_writes_a_backbone_that_fits_and_resumes(tmp_path):
    config, data, val = ModelConfig(**tiny()), FakeDrones(24), FakeDrones(8, seed=1)
    run = settings(epochs=2, mirror=True)

    def kill(state):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pretrain.pretrain_to(data, val, tmp_path / "a.safetensors", config, run, on_epoch=kill)
    with pytest.raises(InputError, match="a.safetensors.resume is left from an earlier run"):
        pretrain.pretrain_to(data, val, tmp_path / "a.safetensors", config, run)
    with pytest.raises(InputError, match="lr was 0.001 and is now 0.1"):
        pretrain.pretrain_to(data, val, tmp_path / "a.safetensors", config, run.replace(lr=0.1), resume=True)
    pretrain.pretrain_to(
        data,
        val,
        tmp_path / "a.safetensors",
        config,
        run,
        resume=True,
        command="python -m dronekeypp pretrain …",
    )
    pretrain.pretrain_to(data, val, tmp_path / "b.safetensors", config, run)
    assert same(tmp_path / "a.safetensors", tmp_path / "b.safetensors")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.safetensors", "b.safetensors"]
    with safe_open(tmp_path / "a.safetensors", "pt") as file:
        header = file.metadata()
    assert header["epochs"] == "2" and "pretrain" in header["command"] and header["train_frames"] == "24"
    model = DroneKeyPP(config.replace(backbone_weights=str(tmp_path / "a.safetensors")))
    stored = tensors(tmp_path / "a.safetensors")["net.0.0.weight"]
    torch.testing.assert_close(model.backbone.net[0][0].weight.detach(), stored.float())
    with pytest.raises(InputError, match="exists already"):
        pretrain.pretrain_to(data, val, tmp_path / "a.safetensors", config, run)


def test_two_processes_do_not_train_one_run(tmp_path):
    sets = FakeDrones(4), FakeDrones(4, seed=1)

    def second(state):
        train.train_on(*sets, tmp_path / "run", ModelConfig(**tiny()), settings(epochs=1), resume=True)

    with pytest.raises(InputError, match="another process is at work in .*run"):
        train.train_on(*sets, tmp_path / "run", ModelConfig(**tiny()), settings(epochs=1), on_epoch=second)
    train.train_on(
        *sets, tmp_path / "run", ModelConfig(**tiny()), settings(epochs=1), resume=True
    )  # and the lock is gone again
