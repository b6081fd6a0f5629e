"""The speed table: every contender answers, ratios belong to the same device and batch, nothing here judges a time."""

import json

import pytest
from fakes import saved

from dronekeypp import bench as bench_module
from dronekeypp.baselines import yolo
from dronekeypp.bench import (
    COMPILED,
    EAGER,
    LIBRARY,
    POSE34,
    YOLO,
    Contender,
    bench,
    contenders,
    detector_of,
    named,
    row_of,
    table,
)
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("bench"))


def test_rows_of_two_contenders(checkpoint, tmp_path):
    chosen = [
        Contender("DroneKey++", EAGER, "cpu", 2, 1, str(checkpoint)),
        Contender(POSE34, EAGER, "cpu", 1, 1, ""),
    ]
    found = bench(checkpoint, tmp_path / "speed.json", rounds=1, seconds=0.0, chosen=chosen, progress=False)
    assert found == json.loads((tmp_path / "speed.json").read_text())
    ours, theirs = found["rows"]
    keys = {
        "name",
        "engine",
        "device",
        "batch",
        "threads",
        "frames_per_s",
        "ratio_to_yolov8n_pose",
        "peak_mb",
        "params",
        "flops",
        "stages",
    }
    assert set(ours) == keys == set(theirs)
    assert set(ours["stages"]) == {"crop", "network", "pose"} and set(theirs["stages"]) == {
        "crop",
        "network and pose",
    }
    network = DroneKeyPP.from_pretrained(checkpoint)
    assert (
        ours["params"] == sum(p.numel() for p in network.parameters()) and theirs["params"] > 21e6
    )  # ResNet-34
    assert theirs["flops"] == pytest.approx(2 * 3.66e9, rel=0.02)  # torchvision: 3.66 GMAC at 224 px
    assert ours["ratio_to_yolov8n_pose"] is None and ours["peak_mb"] > 50 and ours["frames_per_s"] > 0
    assert len(table(found["rows"]).splitlines()) == 3


def test_without_a_compiler_the_others_are_measured(checkpoint, monkeypatch, capsys):
    monkeypatch.setenv("CXX", "/no/such/compiler")
    monkeypatch.setenv("TORCHINDUCTOR_FORCE_DISABLE_CACHES", "1")
    chosen = [Contender("DroneKey++", engine, "cpu", 1, 1, str(checkpoint)) for engine in (EAGER, COMPILED)]
    found = bench(checkpoint, rounds=1, seconds=0.0, chosen=chosen, progress=False)
    assert [row["engine"] for row in found["rows"]] == [EAGER]
    assert "DroneKey++, compiled, cpu is left out: torch.compile failed" in capsys.readouterr().out


def test_a_ratio_is_taken_within_a_round():
    kinds = ((YOLO, LIBRARY, 1), ("DroneKey++", EAGER, 1), ("DroneKey++", EAGER, 64))
    chosen = [Contender(name, engine, "cpu", batch, 2, "") for name, engine, batch in kinds]
    found = [
        [{"crop": 0.0, "whole": w, "peak_mb": 9.0} for w in whole]
        for whole in ((0.2, 0.4, 0.8), (0.1, 0.1, 0.1), (0.1, 0.1, 0.1))
    ]
    row = row_of(chosen[1], {"params": 1, "flops": 2}, found[1], detector_of(chosen[1], chosen, found))
    assert row["ratio_to_yolov8n_pose"] == 4 and row["frames_per_s"] == 10
    assert detector_of(chosen[2], chosen, found) is None  # another batch


def test_who_takes_part(monkeypatch):
    monkeypatch.setattr(bench_module.torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(yolo, "installed", lambda: False)
    found = contenders({"DroneKey++": "here"}, {}, 2)
    assert {c.device for c in found} == {"cpu", "cuda"} and {c.batch for c in found} == {1, 64, 512}
    assert not {c.name for c in found} & {YOLO} and all(c.engine != "ONNX Runtime" for c in found)


def test_the_detector_takes_part():
    if not yolo.installed():
        pytest.skip("the optional extra is not installed")
    [row] = bench(
        "data_samples/checkpoint",
        rounds=1,
        seconds=0.0,
        chosen=[Contender(YOLO, LIBRARY, "cpu", 1, 1, "")],
        progress=False,
    )["rows"]
    assert (
        row["ratio_to_yolov8n_pose"] == 1
        and set(row["stages"]) == {"crop", "network", "pose"}
        and row["params"] > 3e6
    )


def test_several_checkpoints_have_names(checkpoint, tmp_path):
    geometric = saved(tmp_path / "geometric", rays="split", pose="geometric")
    assert named([checkpoint, geometric]) == {
        "DroneKey++": str(checkpoint),
        "DroneKey++, geometric": str(geometric),
    }
    assert list(named([checkpoint, checkpoint])) == ["DroneKey++", f"DroneKey++ ({checkpoint.name})"]
    chosen = [
        Contender(name, EAGER, "cpu", 1, 1, folder) for name, folder in named([checkpoint, geometric]).items()
    ]
    rows = bench([checkpoint, geometric], rounds=1, seconds=0.0, chosen=chosen, progress=False)["rows"]
    assert [row["name"] for row in rows] == ["DroneKey++", "DroneKey++, geometric"] and rows[0][
        "params"
    ] != rows[1]["params"]


def test_bad_calls(checkpoint, tmp_path, capsys):
    with pytest.raises(InputError, match="its folder does not exist"):
        bench(checkpoint, tmp_path / "none" / "speed.json")
    with pytest.raises(InputError, match="rounds=0, threads=2: at least 1"):
        bench(checkpoint, rounds=0, threads=2)
    assert (
        main(["bench", "--checkpoint", str(tmp_path)]) == 2
        and "not found: a checkpoint is a folder" in capsys.readouterr().err
    )
