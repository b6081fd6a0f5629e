"""`reproduce`, all the way through on a few hundred frames: rendered, trained, measured, written; killed and gone on with."""

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import paint_environments
from fakes import tiny

from dronekeypp.errors import InputError
from dronekeypp.reproduce import read_result, reproduce, table3
from dronekeypp.reproduce.runner import PAPER, read_npz, source_digest, write_npz

BUDGET = {**tiny(layers=1), "backbone_weights": None, "epochs": 2, "frames": 64, "val_frames": 32, "batch": 32, "device": "cpu"}
STRIDE = 120  # 441 frames: less than 1 % of the whole


def start(root, data, **more):
    return reproduce("table3", overrides=BUDGET, root=root, data=data, stride=STRIDE, progress=False, **more)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, environments):
    """Table 3 from nothing: (root, data set, recorded result)."""
    root = tmp_path_factory.mktemp("reproduce")
    return root, root / "data", start(root, root / "data", environments=environments)


def test_the_result_is_recorded_with_what_made_it(finished):
    root, data, recorded = finished
    assert recorded == json.loads((root / "data_samples" / "results" / "table3.json").read_text()) == read_result("table3", root)
    digest = json.loads((data / "manifest.json").read_text())["digest"]
    assert recorded["dataset"]["digest"] == digest and recorded["dataset"]["stride"] == STRIDE
    assert recorded["dataset"]["environments"] == "environments" and "CPU cores" in recorded["hardware"]
    assert recorded["preset"] == "cpu" and recorded["budget"]["frames"] == "64" and recorded["minutes"] >= 0
    names = [("DroneKey++", None), ("DroneKey", None), ("DroneKey", "upright"), ("DronePose", None), ("DronePose", "told the crop")]
    assert [m for m in table3.methods(recorded) if not m[0].startswith("YOLO")] == names
    rows = [row for row in recorded["rows"] if row["method"] == "DroneKey++"]
    assert len(rows) == 14 and {row["scene"] for row in rows} == {6, 7} and sum(row["frames"] for row in rows) == 42
    for row in recorded["rows"]:
        assert row["R_mae_deg"] >= 0 and row["t_mae_m"] > 0
        assert (row["class_accuracy"] is None) == (row["method"] in ("DroneKey", "DronePose"))  # they have no classifier
    low, high = table3.average(recorded, "DroneKey", None)["R_mae_deg_ci95"]
    assert low < table3.average(recorded, "DroneKey", None)["R_mae_deg"] < high
    matrix = next(c for c in recorded["confusion"] if c["method"] == "DroneKey++")["true_by_predicted"]
    assert np.array(matrix).sum() == 42


def test_the_table_is_the_papers(finished):
    root, _, recorded = finished
    text = (root / "figures" / "table3.md").read_text()
    head = next(line for line in text.splitlines() if line.startswith("| method | metric"))
    assert head.count("|") == 1 + 3 + 14 + 1
    paper = next(line for line in text.splitlines() if line.startswith("| DroneKey++ | R MAE (deg) | paper"))
    assert paper.rstrip(" |").endswith("17.34")
    ours = next(line for line in text.splitlines() if line.startswith("| DroneKey++ | R MAE (deg) | ours"))
    values = [float(cell) for cell in ours.split("|")[4:-1]]
    assert values[-1] == pytest.approx(np.mean(values[:-1]), abs=0.02)
    rows = list(csv.DictReader(open(root / "figures" / "table3.csv")))
    one = [r for r in rows if (r["method"], r["variant"], r["metric"], r["source"]) == ("DroneKey", "", "t_axis_mae_m", "paper")]
    assert len(one) == 15 and float(one[0]["value"]) == PAPER["table3"]["DroneKey"]["t_m_MAE"]["scene_06"]["Mini3"]
    assert (root / "figures" / "table3.png").stat().st_size > 10_000
    with np.load(root / "data_samples" / "results" / "table3_frames.npz") as stored:
        assert stored["DroneKey++/R_deg"].shape == (42,)
        assert np.median(stored["DronePose/t_m"].astype(float)) > 0


def test_a_killed_run_goes_on_and_ends_the_same(finished, tmp_path):
    _, data, recorded = finished
    command = [sys.executable, "-m", "dronekeypp", "reproduce", "table3", "--root", str(tmp_path), "--data", str(data), "--stride", str(STRIDE)]
    command += [part for key, value in BUDGET.items() for part in ("--set", f"{key}={'none' if value is None else value}")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    runs = tmp_path / "runs" / "table3-cpu"
    deadline = time.time() + 120
    while time.time() < deadline and process.poll() is None and not (runs / "dronekey" / "seed0" / "metrics.csv").exists():
        time.sleep(0.005)
    process.kill()  # DroneKey has one of its two epochs
    process.wait()
    first = runs / "dronekeypp" / "seed0" / "last.safetensors"
    before = first.stat().st_mtime_ns
    assert not (runs / "dronepose" / "seed0").exists()
    again = start(tmp_path, data)
    assert first.stat().st_mtime_ns == before
    assert again["rows"] == recorded["rows"] and again["averages"] == recorded["averages"]


def test_what_was_measured_from_other_weights_or_frames_is_measured_again(finished, tmp_path):
    path = tmp_path / "test.npz"
    write_npz(path, {"R_deg": np.arange(3.0)}, "these weights on those frames")
    assert read_npz(path, "these weights on those frames")["R_deg"].tolist() == [0, 1, 2]
    assert read_npz(path, "other weights on those frames") is None
    path.write_bytes(path.read_bytes()[:100])
    assert read_npz(path, "these weights on those frames") is None
    assert read_npz(tmp_path / "none.npz", "") is None
    _, data, _ = finished
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_bytes(b"1"), two.write_bytes(b"2")
    assert source_digest(one, data) != source_digest(two, data)


def test_a_second_call_trains_nothing(finished):
    root, data, recorded = finished
    next(root.rglob("hardware.txt")).unlink()  # as a kill after the last epoch leaves a run
    states = {p: p.stat().st_mtime_ns for p in root.rglob("last.safetensors")} | {p: p.stat().st_mtime_ns for p in root.rglob("test*.npz")}
    assert start(root, data)["rows"] == recorded["rows"]
    assert all(p.stat().st_mtime_ns == then for p, then in states.items())


def test_the_checkpoint_it_leaves_measures_the_same(finished):
    from dronekeypp.baselines import load_network
    from dronekeypp.evaluate import evaluate, measure
    from dronekeypp.sixdronesyn.dataset import SixDroneSyn

    root, data, recorded = finished
    model = load_network(root / "data_samples" / "checkpoint")
    frames = evaluate(model, SixDroneSyn(data, "test", size=model.config.image_size))
    stored = next(a for a in recorded["averages"] if a["method"] == "DroneKey++" and a["over"] == "frames")
    assert measure(frames)["R_mae_deg"] == pytest.approx(stored["R_mae_deg"], rel=0.02)


def test_domains(finished, tmp_path):
    root, data, _ = finished
    photographs = paint_environments(tmp_path / "photographs", seed=6)
    recorded = reproduce("domains", overrides=BUDGET, root=root, data=data, stride=STRIDE, photographs=photographs, progress=False)
    variants = {row["variant"] for row in recorded["rows"]}
    assert variants == {f"trained {a}, tested {b}" for a in ("drawn", "photographs") for b in ("drawn", "photographs")}
    assert len(list((root / "runs").rglob("dronekeypp/seed0/last.safetensors"))) == 2  # the run of Table 3 serves here too
    assert (root / "figures" / "domains.md").read_text().count("| drawn |") == 3
    errors = [table3.average(recorded, *name)["keypoint_px"] for name in table3.methods(recorded)]
    assert len(set(errors)) == 4  # every cell has its own pictures
    assert recorded["datasets"]["photographs"]["environments"] == "photographs"
    few = paint_environments(tmp_path / "few", n=5)
    with pytest.raises(InputError, match="needs six images or more"):
        reproduce("domains", overrides=BUDGET, root=root, data=data, stride=STRIDE, photographs=few, progress=False)


def test_bad_calls_are_one_clear_error(finished, tmp_path):
    root, data, _ = finished
    for arguments, match in [
        (dict(name="table9"), "reproduce table9: choose table3, domains"),
        (dict(name="table3", preset="huge"), "unknown preset 'huge'"),
        (dict(name="table3", seeds=0), "--seeds 0"),
        (dict(name="table3", overrides={"max_minutes": 1}), "kill it instead"),
        (dict(name="table3", root=root, data=data, stride=STRIDE, environments=tmp_path), "was rendered before environments, not before"),
        (dict(name="domains", root=root, data=data, stride=STRIDE), "needs --photographs DIR"),
        (dict(name="table3", root=root, data=data, stride=60), "keeps every 120. frame, not every 60."),
        (dict(name="table3", root=root, data=data, stride=STRIDE, overrides={**BUDGET, "lr": 1e-2}), "cannot resume .*lr was 0.001 and is now 0.01"),
    ]:
        with pytest.raises(InputError, match=match):
            reproduce(**arguments, progress=False)
    with pytest.raises(InputError, match="table4.json not found: make it with `python -m dronekeypp reproduce table4`"):
        read_result("table4", Path(tmp_path))
