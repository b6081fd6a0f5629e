"""`reproduce` on a few hundred frames: rendered, trained, measured, written; killed and gone on with."""

import csv
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import torchvision
from conftest import paint_environments
from fakes import tiny
from scipy.spatial.transform import Rotation

from dronekeypp import checkpoint, rotations
from dronekeypp.baselines import yolo
from dronekeypp.cli import main
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.evaluate import bop_errors, evaluate, measure
from dronekeypp.files import read_json
from dronekeypp.model import loss_terms
from dronekeypp.presets import preset as find_preset
from dronekeypp.reproduce import (
    ablations,
    beyond,
    figure6,
    headings,
    priors,
    rates,
    read_result,
    reproduce,
    reproduce_all,
    table3_page,
    table3_runs,
    tables,
)
from dronekeypp.reproduce.comparisons import difference
from dronekeypp.reproduce.results import PAPER, read_npz, source_digest, write_npz
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.reproduce.table3_measures import measure_yolo, yolo_record
from dronekeypp.sixdronesyn.drones import DRONES, EDITION
from dronekeypp.sixdronesyn.object_shapes import read_shapes

BUDGET = {
    **tiny(layers=1),
    "backbone_weights": None,
    "epochs": 2,
    "frames": 64,
    "val_frames": 32,
    "batch": 32,
    "device": "cpu",
}
STRIDE = 120  # 441 frames: less than 1 % of the whole


def command(root, data, *more):
    """Table 3 on the command line.

    It runs in a process of its own: what other tests leave behind may change the last bit of a training.
    """
    line = [sys.executable, "-m", "dronekeypp", "reproduce", "table3"]
    line += ["--root", str(root), "--data", str(data), "--stride", str(STRIDE), "--seeds", "1", *more]
    for key, value in BUDGET.items():
        line += ["--set", f"{key}={'none' if value is None else value}"]
    return line


def files_written(root, *patterns):
    """When each file was written, by its path."""
    times = {}
    for pattern in patterns:
        for path in root.rglob(pattern):
            times[path] = path.stat().st_mtime_ns
    return times


def rows_of(recorded, variant, part="rows"):
    """The rows of DroneKey++ of one variant."""
    return [row for row in recorded[part] if (row["method"], row["variant"]) == ("DroneKey++", variant)]


def over_frames(recorded, variant=None):
    """The averages of DroneKey++ over all frames."""
    return next(row for row in rows_of(recorded, variant, "averages") if row["over"] == "frames")


def start(root, data, *more):
    subprocess.run(command(root, data, *more), check=True, stdout=subprocess.DEVNULL)
    return read_result("table3", root)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, environments):
    """Table 3 from nothing: (root, data set, recorded result)."""
    root = tmp_path_factory.mktemp("reproduce")
    return root, root / "data", start(root, root / "data", "--environments", str(environments))


def test_the_result_is_recorded_with_what_made_it(finished):
    root, data, recorded = finished
    stored = json.loads((root / "data_samples" / "results" / "table3.json").read_text())
    assert len(stored.pop("checksum")) == 16
    assert recorded == stored == read_result("table3", root)
    digest = json.loads((data / "manifest.json").read_text())["digest"]
    assert recorded["dataset"]["digest"] == digest and recorded["dataset"]["stride"] == STRIDE
    assert recorded["dataset"]["environments"] == "environments" and "CPU cores" in recorded["hardware"]
    assert recorded["preset"] == "cpu" and recorded["budget"]["frames"] == "64" and recorded["minutes"] >= 0
    assert [m for m in tables.methods(recorded) if not m[0].startswith("YOLO")] == [
        ("DroneKey++", None),
        ("DroneKey++", "6D"),
        ("DroneKey", None),
        ("DroneKey", "upright"),
        ("DronePose", None),
        ("DronePose", "told the crop"),
    ]
    assert recorded["dataset"]["edition"] == EDITION
    assert all(len(run["weights"]) == 16 and run["backbone"] is None for run in recorded["runs"])
    rows = rows_of(recorded, None)
    assert len(rows) == 14 and {row["scene"] for row in rows} == {6, 7}
    assert sum(row["frames"] for row in rows) == 42
    for row in recorded["rows"]:
        assert row["R_mae_deg"] >= 0 and row["t_mae_m"] > 0
        without_class = row["method"] in ("DroneKey", "DronePose")
        assert (row["class_accuracy"] is None) == without_class
    row = tables.average(recorded, "DroneKey", None)
    low, high = row["R_mae_deg_ci95"]
    assert low < row["R_mae_deg"] < high
    matrix = next(c for c in recorded["confusion"] if c["method"] == "DroneKey++")["true_by_predicted"]
    assert np.array(matrix).sum() == 42


def test_validation_stands_beside_test_flight_by_flight(finished):
    root, _, recorded = finished
    rows = rows_of(recorded, None, "validation")
    assert [(row["scene"], row["drone"]) for row in rows] == tables.columns(recorded, "val")
    assert {row["scene"] for row in rows} == {3, 9, 13} and sum(row["frames"] for row in rows) == 105
    for split, flights in (("test", 42), ("val", 63)):
        [entry] = [entry for entry in rows_of(recorded, None, "flights") if entry["split"] == split]
        assert {len(values) for values in entry.values() if isinstance(values, list)} == {flights}
        for key in ("R_mae_deg", "t_axis_mae_m", "class_accuracy"):
            # Every column has three flights of one length.
            column_mean = tables.cells(recorded, "DroneKey++", None, key, split)[-1]
            assert np.mean(entry[key]) == pytest.approx(column_mean, rel=1e-4)
    row = tables.average(recorded, "DroneKey++", None)
    for key in ("R_mae_deg", "R_medae_deg_of_flights", "t_axis_mae_m"):
        low, high = row[f"{key}_ci95"]
        assert low < row[key] < high
    assert "R_medae_deg_ci95" not in row  # no interval of another statistic
    text = (root / "figures" / "table3.md").read_text()
    assert "## Differences to DroneKey++" in text and "better?" in text  # one seed
    verdicts = len(tables.PRINTED) * (len(tables.methods(recorded)) - 1)
    assert f"This page holds {verdicts} verdicts" in text


def test_the_field_s_measures_stand_in_table_3(finished):
    root, data, recorded = finished
    model = checkpoint.load(root / "runs" / "table3-cpu" / "dronekeypp" / "seed0")
    dataset = open_dataset(data, "test", size=model.config.image_size)
    shapes, _ = read_shapes(data, {frame.annotation.obj_id for frame in dataset.stored})
    errors = bop_errors(evaluate(model, dataset), dataset, shapes)
    row = over_frames(recorded)
    assert row["mspd_recall"] == pytest.approx(errors["mspd_recall"].mean(), rel=1e-5)
    assert row["add_recall"] == pytest.approx((errors["add_recall"]).mean(), abs=1e-6)
    assert row["mssd_mean_m"] == pytest.approx(errors["mssd_m"].mean(), rel=1e-5)
    mean = tables.average(recorded, "DroneKey++", None)["mspd_recall"]
    text = (root / "figures" / "table3.md").read_text().partition("## The field's measures")[2]
    assert f"{100 * mean:.1f} % |" in next(line for line in text.splitlines() if "| DroneKey++ |" in line)


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
    with open(root / "figures" / "table3.csv") as file:
        values = []
        for row in csv.DictReader(file):
            name = row["method"], row["variant"], row["metric"], row["source"]
            if name == ("DroneKey", "", "t_axis_mae_m", "paper"):
                values.append(float(row["value"]))
    assert len(values) == 15
    assert values[0] == PAPER["table3"]["DroneKey"]["t_m_MAE"]["scene_06"]["Mini3"]
    assert (root / "figures" / "table3.png").stat().st_size > 10_000
    with np.load(root / "data_samples" / "results" / "table3_frames.npz") as stored:
        assert stored["DroneKey++/R_deg"].shape == (42,)
        assert np.median(stored["DronePose/t_m"].astype(float)) > 0


def test_a_killed_run_goes_on_and_ends_the_same(finished, tmp_path):
    _, data, recorded = finished
    process = subprocess.Popen(command(tmp_path, data), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    runs = tmp_path / "runs" / "table3-cpu"
    deadline = time.time() + 120
    epoch = runs / "dronekey" / "seed0" / "metrics.csv"
    while time.time() < deadline and process.poll() is None and not epoch.exists():
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
    (tmp_path / "first").write_bytes(b"1")
    (tmp_path / "second").write_bytes(b"2")
    assert source_digest(tmp_path / "first", data) != source_digest(tmp_path / "second", data)


def test_trainings_side_by_side_fill_the_same_table(finished, tmp_path):
    """Two trainings at a time make the table of one at a time, but for the last digits of another thread."""
    root, data, one_by_one = finished
    recorded = start(tmp_path, data, "--trainings", "2")
    assert tables.methods(recorded) == tables.methods(one_by_one)
    assert [run["seed"] for run in recorded["runs"]] == [run["seed"] for run in one_by_one["runs"]]
    assert {run["hardware"].split(" of ")[0] for run in recorded["runs"]} == {"1 thread"}
    first, second = over_frames(recorded), over_frames(one_by_one)
    assert first["R_mae_deg"] == pytest.approx(second["R_mae_deg"], rel=0.2)


def test_a_second_call_trains_nothing(finished):
    root, data, recorded = finished
    next(root.rglob("hardware.txt")).unlink()  # as a kill after the last epoch leaves a run
    before = files_written(root, "last.safetensors", "test*.npz")
    assert start(root, data)["rows"] == recorded["rows"]
    assert files_written(root, "last.safetensors", "test*.npz") == before


def test_the_checkpoint_it_leaves_measures_the_same(finished):
    root, data, recorded = finished
    model = checkpoint.load(root / "data_samples" / "checkpoint")
    measured = measure(evaluate(model, open_dataset(data, "test", size=model.config.image_size)))
    assert measured["R_mae_deg"] == pytest.approx(over_frames(recorded)["R_mae_deg"], rel=0.02)


def test_the_flights_it_leaves_are_the_predictions(finished):
    root, data, recorded = finished
    with np.load(root / "data_samples" / "results" / "flights.npz") as stored:
        flights = dict(stored)
    assert len(flights["test/t"]) == 42 and len(flights["val/t"]) == 105
    assert flights["test/t"].dtype == np.float16
    true = Rotation.from_rotvec(flights["test/true_rotvec"].astype(float))
    predicted = Rotation.from_rotvec(flights["test/rotvec"].astype(float))
    turned = (true.inv() * predicted).magnitude()
    stored = over_frames(recorded)
    assert np.degrees(turned).mean() == pytest.approx(stored["R_mae_deg"], rel=0.01)
    apart = np.linalg.norm(flights["test/t"].astype(float) - flights["test/true_t"], axis=1)
    assert apart.mean() == pytest.approx(stored["t_mae_m"], rel=0.01)


class Detector:
    """Stands for the optional extra: it finds the true keypoints in every picture but the first."""

    def __init__(self, dataset):
        self.truth = dataset.annotations()
        self.sizes = []  # of the batches that it was handed

    def train(self, datasets, out, settings, device):
        assert [len(dataset) for dataset in datasets.values()] == [294, 63]
        (out / "kept").mkdir(parents=True, exist_ok=True)
        (out / "kept" / "epoch").write_text(str(settings["epochs"]))
        (out / "epochs.csv").write_text("1,6.00\n2,6.00\n")
        (out / "kept" / "best.pt").write_bytes(b"weights")
        return out / "kept" / "best.pt"

    def detect(self, weights, batches, classes, device):
        self.sizes += [len(images) for images in batches]
        detected = torch.ones(len(self.truth["label"]), dtype=torch.bool)
        detected[0] = False
        probs = torch.nn.functional.one_hot(self.truth["label"], classes) * detected[:, None]
        return {"keypoints": self.truth["keypoints"], "class_probs": probs.float(), "detected": detected}


def test_yolo_is_measured_in_batches(finished, tmp_path, monkeypatch):
    _, data, _ = finished
    detector = Detector(open_dataset(data, "test", size=32))
    monkeypatch.setattr(yolo, "train", detector.train)
    monkeypatch.setattr(yolo, "detect", detector.detect)
    monkeypatch.setattr("dronekeypp.reproduce.table3_measures.BATCH", 16)
    bench = Bench(tmp_path, "cpu", BUDGET, "table3-cpu", data, stride=STRIDE, progress=False)
    run = table3_runs.YOLO_RUN
    frames_of, record = measure_yolo(bench, run, 0), yolo_record(bench, run, 0)
    assert detector.sizes == [16, 16, 10] and list(frames_of) == [None, "upright"]
    assert record["epochs"] == 2 and record["minutes"] == 0.2
    for frames in frames_of.values():
        assert frames["failed"].tolist() == [True] + 41 * [False] and frames["predicted"][0] == -1
        assert np.nanmax(frames["keypoint_crop_px"]) == 0 and np.median(frames["t_m"]) < 0.01
    assert measure_yolo(bench, run, 0).keys() == frames_of.keys()
    assert detector.sizes == [16, 16, 10]  # what was measured is read


def test_domains(finished, tmp_path):
    root, data, _ = finished
    photographs = paint_environments(tmp_path / "photographs", seed=6)
    recorded = reproduce(
        "domains",
        overrides=BUDGET,
        root=root,
        data=data,
        stride=STRIDE,
        photographs=photographs,
        progress=False,
    )
    assert [variant for _, variant in tables.methods(recorded)] == [
        "trained drawn, tested drawn",
        "trained drawn, tested photographs",
        "trained photographs, tested drawn",
        "trained photographs, tested photographs",
    ]
    assert [run["trained"] for run in recorded["runs"]] == ["drawn", "photographs"]
    # The run of Table 3 serves here too.
    assert len(list((root / "runs").rglob("dronekeypp/seed0/last.safetensors"))) == 2
    assert (root / "figures" / "domains.md").read_text().count("| drawn |") == 3
    errors = [tables.average(recorded, *name)["keypoint_px"] for name in tables.methods(recorded)]
    assert len(set(errors)) == 4  # every cell has its own pictures
    assert recorded["datasets"]["photographs"]["environments"] == "photographs"
    few = paint_environments(tmp_path / "few", n=5)
    with pytest.raises(InputError, match="needs six images or more"):
        reproduce(
            "domains", overrides=BUDGET, root=root, data=data, stride=STRIDE, photographs=few, progress=False
        )


@pytest.fixture(scope="module")
def ablated(finished, tmp_path_factory):
    """Table 5 of a tiny network, three seeds: (root, recorded result)."""
    root = tmp_path_factory.mktemp("ablations")
    return root, reproduce(
        "table5",
        overrides={**BUDGET, "epochs": 1},
        root=root,
        data=finished[1],
        stride=STRIDE,
        seeds=3,
        progress=False,
    )


def test_an_ablation_has_every_row_and_seed(ablated):
    root, recorded = ablated
    names = [row.name for row in ablations.ABLATIONS["table5"].rows]
    assert [variant for _, variant in tables.methods(recorded)] == names == list(PAPER["table5"])
    assert len(recorded["rows"]) == 4 * 3 * 14 and recorded["budget"]["epochs"] == "1"
    assert recorded == read_result("table5", root)
    for run in recorded["runs"]:
        assert sum(run["gate"]) == pytest.approx(1, abs=1e-3)
        averages = rows_of(recorded, run["variant"], "averages")
        own = next(row for row in averages if (row["seed"], row["over"]) == (run["seed"], "frames"))
        assert run["keypoints"]["its own"]["t_m"] == pytest.approx(own["t_medae_m"], rel=1e-4)
        assert run["keypoints"]["true"]["t_m"] != run["keypoints"]["its own"]["t_m"]
    text = (root / "figures" / "table5.md").read_text()
    assert "(17.34)" in text and "not told apart" in text and text.count("| (1) only MLP_pose |") == 3
    rows = list(csv.DictReader(open(root / "figures" / "table5.csv")))
    assert len(rows) == 4 * (5 * 3 + 4)  # five metrics, three seeds; the paper prints four
    assert (root / "figures" / "table5.png").stat().st_size > 10_000


def test_equal_settings_are_one_training(ablated, finished):
    root, _ = ablated
    before = files_written(root, "last.safetensors")
    budget = {**BUDGET, "epochs": 1}
    where = dict(root=root, data=finished[1], stride=STRIDE, progress=False)
    # The row "equal" of Table 6 is the row "(4) full decoder" of Table 5.
    recorded = reproduce("table6", overrides=budget, seeds=1, **where)
    after = files_written(root, "last.safetensors")
    assert len(before) == 12 and len(after) == 12 + 3
    assert {path: after[path] for path in before} == before
    assert len({json.dumps(row["R_mae_deg"]) for row in recorded["averages"]}) > 2
    full = ablations.run_of(ablations.ABLATIONS["table5"].rows[3], "cpu")
    equal = ablations.run_of(ablations.Row("equal", {"schedule": "equal"}), "cpu")
    assert full.variant is None and full == equal
    raw = ablations.Row("raw", {"rays": "raw"})
    assert ablations.run_of(raw, "cpu").slug == "dronekeypp-rays-raw"
    assert ablations.run_of(raw, "paper").variant is None  # the paper preset's own


def test_a_row_may_set_what_only_its_own_choices_have():
    geometric = ablations.Row("geometric", {"pose": "geometric", "decoder_width": 64})
    assert ablations.run_of(geometric, "cpu").changes == {"pose": "geometric", "decoder_width": 64}
    angles = ablations.Row("angles", {"pose": "geometric", "angle_zero": "edge"})
    with pytest.raises(InputError, match="row 'angles': unknown setting 'angle_zero'; known: .*rays"):
        ablations.run_of(angles, "cpu")
    with pytest.raises(InputError, match="unknown setting 'backbone_strid'; known"):
        ablations.run_of(ablations.Row("slip", {"backbone_strid": 8}), "cpu")


def test_a_run_takes_of_the_budget_what_its_method_uses(finished, tmp_path):
    budget = {**BUDGET, "rotation": "sixd", "pool": "max", "rays": "raw"}
    bench = Bench(tmp_path, "cpu", budget, "none", finished[1], stride=STRIDE, progress=False)
    model, _ = bench.settings(Run("DroneKey++"), 0)
    assert (model.decoder.rotation, model.decoder.rays, model.width, model.classes) == ("sixd", "raw", 16, 7)
    model, _ = bench.settings(Run("DroneKey++", "geometric", {"pose": "geometric"}), 0)
    assert model.decoder.rays == "raw" and model.decoder.decoder_width == 32
    model, _ = bench.settings(Run("DroneKey++", "truth", {"encoder": "truth"}), 0)
    assert model.decoder.rotation == "sixd" and model.width == 128  # it has no encoder
    model, _ = bench.settings(Run("DroneKey"), 0)
    assert (model.width, model.pool) == (16, "mean")  # the method's own
    model, training = bench.settings(Run("DronePose"), 3)
    assert model.image_size == 32 and training.epochs == 2 and training.seed == 3


def test_a_row_may_have_fewer_seeds_than_its_table(ablated, finished, monkeypatch):
    root, whole = ablated
    # Both were trained for Table 5, three seeds each.
    full, class_free = ablations.Row("full"), ablations.Row("no class", {"use_class": False}, seeds=1)
    mine = ablations.Ablation("Mine", (full, class_free), reference="full")
    monkeypatch.setitem(ablations.ABLATIONS, "mine", mine)
    budget = {**BUDGET, "epochs": 1}
    bench = ablations.Bench(root, "cpu", budget, "ablations-cpu", finished[1], stride=STRIDE, progress=False)
    recorded = ablations.reproduce("mine", bench)
    runs = [(run["variant"], run["seed"]) for run in recorded["runs"]]
    assert runs == [("full", 0), ("no class", 0), ("full", 1), ("full", 2)]
    assert tables.count_seeds(recorded) == "1 to 3 seeds" and tables.count_seeds(whole) == "3 seeds"
    # Its one against the reference's three.
    assert ablations.difference(recorded, "no class", "t_mae_m").seeds.shape == (1, 3)
    three = tables.by_seed(whole, "DroneKey++", "(3) RayEmbed + MLP_pose + MLP_3D", "t_mae_m")
    assert tables.by_seed(recorded, "DroneKey++", "no class", "t_mae_m") == three[:1]
    assert len(ablations.reproduce("mine", bench, seeds=2)["runs"]) == 4  # asked for, every row gets them


def verdict(mean, interval, seeds):
    return ablations.Difference(mean, interval, np.array(seeds)).verdict


def test_a_verdict_needs_an_interval_without_zero_and_seeds_that_agree(ablated):
    assert verdict(2.0, (1.0, 3.0), [[1.9, 2.0, 2.1]] * 3) == "worse"
    assert verdict(-2.0, (-3.0, -1.0), [[-2.0]]) == "better?"
    assert verdict(-2.0, (-3.0, -1.0), [[-2.0] * 9]) == "better?"  # nine pairs, and one training
    assert verdict(2.0, (-0.1, 3.0), [[2.0] * 3] * 3) == "not told apart"
    assert verdict(2.0, (1.0, 3.0), [[4.0, 4.0, -2.0]] * 3) == "not told apart"
    _, recorded = ablated
    only_pose, full = ("DroneKey++", "(1) only MLP_pose"), ("DroneKey++", "(4) full decoder")
    for split in ("val", "test"):
        difference = ablations.difference(recorded, "(1) only MLP_pose", "t_mae_m", split)
        apart = tables.cells(recorded, *only_pose, "t_mae_m", split)[-1]
        apart -= tables.cells(recorded, *full, "t_mae_m", split)[-1]
        assert difference.mean == pytest.approx(apart, abs=1e-4)  # flights have five digits
        assert difference.mean == pytest.approx(np.mean(difference.seeds))
        assert difference.interval[0] < difference.mean < difference.interval[1]
    # The verdict is that of the validation scenes.
    on_val = ablations.difference(recorded, "(1) only MLP_pose", "t_mae_m")
    on_test = ablations.difference(recorded, "(1) only MLP_pose", "t_mae_m", "test")
    text = ablations.markdown(recorded)
    low, high = on_val.interval
    assert f"{on_val.mean:+.3f} [{low:+.3f}, {high:+.3f}] {on_val.verdict}; test {on_test.mean:+.3f}" in text
    assert "This page holds 15 verdicts at 95 %" in text and "here 1, would still be told apart" in text


def test_what_is_asked_again_of_other_weights_is_said(ablated, finished, tmp_path):
    root = shutil.copytree(ablated[0], tmp_path / "again")
    runs = root / "runs" / "ablations-cpu" / "dronekeypp"
    other = runs / "seed1" / "best" / "model.safetensors"
    shutil.copy(other, runs / "seed0" / "best" / "model.safetensors")  # as if it had been trained again
    where = dict(root=root, data=finished[1], stride=STRIDE, progress=False)
    first = ablated[1]
    for _ in range(2):  # once more, from the same weights, nothing is lost and nothing added
        recorded = reproduce("table5", overrides={**BUDGET, "epochs": 1}, seeds=1, **where)
        [run] = [run for run in recorded["runs"] if run.get("earlier")]
        before = next(old for old in first["runs"] if (old["variant"], old["seed"]) == (run["variant"], 0))
        assert run["variant"] == "(4) full decoder" and run["weights"] != before["weights"]
        [earlier] = run["earlier"]
        assert earlier["weights"] == before["weights"]
        value = tables.by_seed(first, "DroneKey++", "(4) full decoder", "R_mae_deg")[0]
        [row] = earlier["averages"]
        assert row["R_mae_deg"] == pytest.approx(value, rel=1e-4)
        assert len(recorded["earlier"]) == 8  # seeds 1 and 2, which this call did not ask for
        text = (root / "figures" / "table5.md").read_text()
        assert "## Asked more than once" in text and f"({value:.2f}) |" in text
    assert "Asked more than once" not in ablations.markdown(first)


def test_an_ablation_of_ones_own_is_found_by_name(ablated, finished, monkeypatch):
    root, _ = ablated
    rows = ablations.Row("full"), ablations.Row("geometric", {"pose": "geometric"})
    monkeypatch.setitem(ablations.ABLATIONS, "mine", ablations.Ablation("Mine", rows, "full", seeds=1))
    budget = {**BUDGET, "epochs": 1}
    where = dict(root=root, data=finished[1], stride=STRIDE, progress=False)
    recorded = reproduce("mine", overrides=budget, **where)
    # A geometric one does not take true keypoints.
    assert ["keypoints" in run for run in recorded["runs"]] == [True, False]


def test_a_method_of_ones_own_stands_in_table_3():
    recorded = read_result("table3")
    rows = []
    for row in recorded["rows"]:
        if (row["method"], row["variant"]) == ("DronePose", None):
            rows.append({**row, "method": "Mine"})
    recorded = {**recorded, "rows": recorded["rows"] + rows}
    assert table3_page.markdown(recorded).count("| Mine |") == len(tables.PRINTED) + 1
    assert "Mine" in table3_page.as_csv(recorded)
    assert len(table3_page.draw(recorded).axes) == len(tables.PRINTED)


def test_every_row_of_every_ablation_is_a_setting_that_exists():
    for preset in ("cpu", "paper"):
        for ablation in ablations.ABLATIONS.values():
            for row in ablation.rows:
                find_preset(preset, ablations.run_of(row, preset).changes)
    for name in ("table4", "table5", "table6"):
        assert set(PAPER[name]) == {row.name for row in ablations.ABLATIONS[name].rows}


def test_priors(finished, tmp_path):
    budget = {**BUDGET, "epochs": 1}
    where = dict(root=tmp_path, data=finished[1], stride=STRIDE, progress=False)
    recorded = reproduce("priors", overrides=budget, **where)
    assert recorded == read_result("priors", tmp_path)
    drones = list(recorded["hub_radius_m"])
    assert [run["without"] for run in recorded["runs"]] == [None, *drones] and len(drones) == 7
    runs = tmp_path / "runs" / "ablations-cpu"
    part = read_json(runs / "dronekeypp-without-tello" / "seed0" / "config.json")
    whole = read_json(runs / "dronekeypp" / "seed0" / "config.json")
    assert part["data"]["train_frames"] * 7 == whole["data"]["train_frames"] * 6
    rows = [row["drone"] for row in recorded["rows"] if row["variant"] == "without Tello"]
    assert rows == ["Tello", "Tello"]  # scenes 6 and 7
    pooled = priors.pooled(recorded)
    apart = difference(pooled, ("DroneKey++", priors.LEFT_OUT), ("DroneKey++", None), "t_mae_m")
    inside, outside = zip(*(priors.left_out(recorded, drone, "t_mae_m") for drone in drones), strict=True)
    assert apart.mean == pytest.approx(np.mean(outside) - np.mean(inside), abs=1e-4)
    share = next(entry["share"] for entry in recorded["taken_for"] if entry["drone"] == "Tello")
    assert sum(share) == pytest.approx(1)
    ratios = np.array(recorded["told"][0]["distance_ratio"])
    assert ratios.shape == (7, 7) and (ratios > 0).all()
    assert len(set(ratios[0])) > 1  # another class, another distance
    assert priors.size_ratios(recorded)[0, 0] == 1
    assert np.array(recorded["embedding"][0]["distance"]).shape == (7, 7)
    assert "| Tello |" in (tmp_path / "figures" / "priors.md").read_text()
    assert (tmp_path / "figures" / "priors.png").stat().st_size > 10_000


def test_beyond(finished, tmp_path):
    root, data, table3_recorded = finished
    where = dict(root=root, data=data, stride=STRIDE, progress=False)
    recorded = reproduce("beyond", overrides=BUDGET, seeds=1, **where)
    variants = [variant for _, variant in tables.methods(recorded)]
    left_out = [run.variant for run in beyond.WITHOUT.values()]
    no_search = beyond.NO_SEARCH.variant
    assert variants == [None, "geometric", *beyond.PARTS.values(), no_search, *left_out]
    assert rows_of(recorded, None) == rows_of(table3_recorded, None)  # Table 3's own run
    for part in ("rows", "validation"):
        assert {row["drone"] for row in rows_of(recorded, "geometric without Tello", part)} == {"Tello"}
    for row in recorded["rows"]:
        assert 0 <= row["mssd_recall"] <= 1 and row["mssd_mean_m"] > 0
    for row in recorded["doubt"]:
        for name in beyond.HALVES:
            shares = row["coverage"][name]
            assert shares == sorted(shares) and 0 <= shares[0] and shares[-1] <= 1
    hidden = [row["hidden"] for row in recorded["occlusion"]]
    assert hidden == sorted([*beyond.HIDDEN, *beyond.HIDDEN])
    ratios = [row["size_ratio"] for row in recorded["shapes"]]
    assert len(ratios) == 7 and 0.9 < min(ratios) and max(ratios) < 1.1  # from the annotations
    assert [row["filter"] for row in recorded["sequences"]] == list(beyond.FILTERS)
    raw, *others = recorded["sequences"]
    assert raw["R_deg_change_ci95"] == [0, 0]
    for row in others:
        assert row["strength"] in beyond.FILTERS[row["filter"]][1]
    # Flights count alike there, frames here.
    assert raw["t_m"] == pytest.approx(over_frames(recorded, "geometric")["t_mae_m"], rel=0.05)
    shipped = checkpoint.load(root / "data_samples" / "beyond")
    assert (shipped.config.pose, shipped.config.classifier) == ("geometric", "features")
    assert shipped.config.decoder.search  # not the one that was trained without
    assert [row["variant"] for row in recorded["doubt"]] == ["geometric", no_search, *left_out]
    text = (root / "figures" / "beyond.md").read_text()
    assert text == beyond.markdown(recorded) and text.count("geometric without") == 4
    assert "## Differences to the paper’s network" in text and "## The field's measures" in text
    assert text.count(no_search) == 4  # rows, differences, the field's measures, covariance
    for name in ("beyond.png", "beyond_doubt.png"):
        assert (root / "figures" / name).stat().st_size > 10_000


def test_a_covariance_is_judged_by_how_often_it_holds():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(5000, 6, 6)) * 0.1
    covariance = roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(6)
    error = np.einsum("fij,fj->fi", np.linalg.cholesky(covariance), rng.normal(size=(5000, 6)))
    for name, shares in beyond.coverage(error, covariance).items():
        np.testing.assert_allclose(shares, beyond.LEVELS, atol=0.03, err_msg=name)
    np.testing.assert_allclose(beyond.calibration(error, covariance), 1, atol=0.03)
    np.testing.assert_allclose(beyond.calibration(3 * error, covariance), 3, atol=0.1)


def test_rates_are_chosen_on_validation(finished, tmp_path, monkeypatch):
    monkeypatch.setattr(rates, "METHODS", {name: rates.METHODS[name] for name in ("DroneKey++", "DronePose")})
    where = dict(root=tmp_path, data=finished[1], stride=STRIDE, progress=False)
    recorded = reproduce("rates", overrides={**BUDGET, "epochs": 1}, **where)
    assert recorded == read_result("rates", tmp_path) and recorded["usual_lr"] == 1e-3
    trained = [(entry["name"], entry["lr"], entry["seed"]) for entry in recorded["rates"]]
    ours = [(3e-4, 0), (1e-3, 0), (1e-3, 1), (1e-3, 2), (3e-3, 0)]  # three seeds tell the noise
    assert trained[:5] == [("DroneKey++", *entry) for entry in ours]
    assert trained[5:] == [("DronePose", rate, 0) for rate in (3e-4, 1e-3, 3e-3)]
    runs = tmp_path / "runs" / "ablations-cpu"
    with open(runs / "dronepose-lr-0-003" / "seed0" / "metrics.csv") as file:
        [row] = csv.DictReader(file)
    entry = recorded["rates"][-1]
    assert entry["score"] == float(row["score"]) and entry["val_R_medae_deg"] == float(row["val_R_medae_deg"])
    assert not list(tmp_path.rglob("*.npz"))  # no scene was asked beyond the training's own validation
    assert (runs / "dronekeypp" / "seed2").is_dir()  # the ablations' own run
    text = (tmp_path / "figures" / "rates.md").read_text()
    assert text == rates.markdown(recorded) and text.count("**") == 4 and "YOLOv8n-pose + PnP is not" in text
    with pytest.raises(InputError, match="--set lr: the rows of rates differ in it"):
        reproduce("rates", overrides={"lr": 1e-2}, **where)


def made_up_rates(usual, others, noise):
    """A result of `rates` with one method, three seeds of the paper's network, and these scores."""
    entries = []
    for seed, score in enumerate(noise):
        entries.append({"name": "DroneKey++", "lr": 1e-3, "seed": seed, "score": score})
    for rate, score in {3e-4: others[0], 1e-3: usual, 3e-3: others[1]}.items():
        entries.append({"name": "DronePose", "lr": rate, "seed": 0, "score": score})
    return {"usual_lr": 1e-3, "rates": entries}


def test_a_rate_is_changed_only_where_it_is_better_by_more_than_the_noise():
    noise = (0.98, 1.0, 1.02)  # a deviation of 2 %, so 5.7 % are two deviations of a difference
    close = made_up_rates(1.05, (1.0, 1.3), noise)
    assert rates.best_rate(close, "DronePose") == 3e-4 and rates.is_noise(close, "DronePose")
    assert rates.noise(close) == pytest.approx(0.02) and rates.chosen_rate(close, "DronePose") == 1e-3
    far = made_up_rates(1.07, (1.3, 1.0), noise)
    assert rates.excess(far, "DronePose") == pytest.approx(0.07) and not rates.is_noise(far, "DronePose")
    assert rates.chosen_rate(far, "DronePose") == 3e-3
    alone = made_up_rates(1.0, (1.1, 1.2), noise[:1])  # the best already; one seed tells no noise
    assert np.isnan(rates.noise(alone)) and rates.chosen_rate(alone, "DronePose") == 1e-3
    with pytest.raises(InputError, match=r"rates: no method 'Mine'; known: DroneKey\+\+, DronePose"):
        rates.best_rate(alone, "Mine")


def test_a_method_s_rate_is_set_in_one_place(monkeypatch):
    monkeypatch.setattr(table3_runs, "RATES", {("DronePose", None): 3e-4})
    told = Run("DronePose", "told the crop", {"use_rays": True})
    assert table3_runs.with_rate(Run("DronePose")).changes == {"lr": 3e-4}
    assert table3_runs.with_rate(told) is told
    # What `rates` trains does not depend on what was chosen before.
    assert rates.at_rate(table3_runs.with_rate(Run("DronePose")), 1e-3, "cpu") == Run("DronePose")


def test_six_numbers_weigh_26_times_three_angles():
    R = torch.tensor(Rotation.from_rotvec([[0.0, 0.03, 0.0]]).as_matrix())  # yaw, about the camera's y
    level = rotations.angles_to_matrix(torch.zeros(1, 3, dtype=torch.double))
    unused = {"t": torch.zeros(1, 3), "keypoints": torch.zeros(1, 4, 2), "class_logits": torch.zeros(1, 7)}
    truth = {**unused, "label": torch.zeros(1, dtype=torch.long), "R": level}
    six = loss_terms({**unused, "R": R @ level}, truth)["L_rot"]
    angles = rotations.matrix_to_angles(R @ level)
    ratio = float(six / loss_terms({**unused, "angles": angles, "R": R @ level}, truth)["L_rot"])
    assert ratio == pytest.approx(8 * np.pi**2 / 3, rel=1e-3)
    assert round(ratio) == ablations.MATRIX_OVER_ANGLES
    changes = {row.name: row.changes for row in ablations.ABLATIONS["heads"].rows}
    assert changes["rotation: 6D, L_rot / 26"] == {"rotation": "sixd", "rotation_weight": 1 / 26}
    assert changes["rotation: angles, L_rot × 26"] == {"rotation_weight": 26}


def made_up_headings(errors):
    """A result whose rows have these rotation errors (near the camera, elsewhere), by row and seed."""
    entries = []
    for variant, seeds in errors.items():
        for seed, (near, far) in enumerate(seeds):
            frames = {
                "heading_deg": np.array([10.0, 50.0, 100.0, 44.9, 180.0]),
                "R_deg": np.array([near, far, far, near, far]),
            }
            labels = {"method": "DroneKey++", "variant": variant, "seed": seed, "split": "test"}
            entries += headings.by_heading(frames, **labels)
    return {"by_heading": entries}


def test_the_gain_is_split_by_heading():
    recorded = made_up_headings({None: [(30.0, 10.0), (32.0, 12.0)], "6D": [(10.0, 6.0), (10.0, 6.0)]})
    first = recorded["by_heading"][0]
    assert (first["part"], first["frames"], first["share"]) == ("towards the camera", 2, 0.4)
    assert first["R_mae_deg"] == first["R_medae_deg"] == 30
    pair = ("DroneKey++", "6D"), ("DroneKey++", None)
    near, elsewhere = headings.gain_lines(recorded, [pair])[-2:]
    # 0.4 × 21 and 0.6 × 5 degrees of 11.4.
    assert "| towards the camera | 40.0 % | +21.00 [+20.00, +22.00] | 73.7 % |" in near
    assert "| elsewhere | 60.0 % | +5.00 [+4.00, +6.00] | 26.3 % |" in elsewhere
    worse = headings.gain_lines(recorded, [pair[::-1]])[-1]
    assert "-5.00" in worse and "| – |" in worse  # no part of a loss
    assert headings.gain_lines(recorded, [(pair[0], ("DroneKey++", "other"))]) == []
    assert headings.gain_lines({}, [pair]) == []


def test_table_3_splits_the_gain_of_six_numbers_by_heading(finished):
    root, _, recorded = finished
    entries = recorded["by_heading"]
    assert {(entry["method"], entry["variant"]) for entry in entries} == set(sum(table3_runs.GAINS, ()))
    for split, frames in (("val", 105), ("test", 42)):
        own = [entry for entry in entries if entry["split"] == split and entry["variant"] == "6D"]
        assert [entry["part"] for entry in own] == list(headings.PARTS)
        assert sum(entry["frames"] for entry in own) == frames
        assert sum(entry["share"] for entry in own) == pytest.approx(1, abs=1e-5)
    whole = over_frames(recorded, "6D")["R_mae_deg"]
    assert sum(e["share"] * e["R_mae_deg"] for e in own) == pytest.approx(whole, rel=1e-4)
    text = (root / "figures" / "table3.md").read_text()
    assert text.count("| DroneKey++ (6D) over DroneKey++ |") == 4


def test_an_ablation_may_split_a_gain_by_heading(ablated, finished, monkeypatch):
    root, _ = ablated
    rows = ablations.Row("full"), ablations.Row("no class", {"use_class": False})  # trained for Table 5
    mine = ablations.Ablation("Mine", rows, "full", seeds=1, gains=(("no class", "full"),))
    monkeypatch.setitem(ablations.ABLATIONS, "mine", mine)
    budget = {**BUDGET, "epochs": 1}
    where = dict(root=root, data=finished[1], stride=STRIDE, progress=False)
    recorded = reproduce("mine", overrides=budget, **where)
    assert len(recorded["by_heading"]) == 2 * 2 * 2  # rows, splits and parts
    text = ablations.markdown(recorded)
    gain = text.index("| DroneKey++ (no class) over DroneKey++ (full) |")
    assert gain < text.index("This page holds 5 verdicts at 95 %.")  # the page's last sentence


def test_a_mirror_that_says_the_same_changes_nothing():
    keypoints, sigma = torch.rand(2, 4, 2), torch.rand(2, 4) + 0.1
    swap = [1, 0, 3, 2]
    encoded = {"keypoints": keypoints, "keypoint_sigma": sigma}
    mirrored = torch.stack([1 - keypoints[:, swap, 0], keypoints[:, swap, 1]], dim=2)
    both = beyond.merged(encoded, {"keypoints": mirrored, "keypoint_sigma": sigma[:, swap]})
    torch.testing.assert_close(both["keypoints"], keypoints)
    torch.testing.assert_close(both["keypoint_sigma"], sigma)
    unsure = {"keypoints": mirrored + 1, "keypoint_sigma": 100 * sigma[:, swap]}
    assert (beyond.merged(encoded, unsure)["keypoints"] - keypoints).abs().max() < 1e-3


def test_a_hidden_square_is_as_large_as_it_says(finished):
    data = open_dataset(finished[1], "test", size=48)
    whole, covered = data[3], beyond.Hidden(data, 0.25)[3]
    changed = (whole["image"] != covered["image"]).any(dim=0).float().mean()
    assert 0.2 < float(changed) <= 0.25 and torch.equal(whole["keypoints"], covered["keypoints"])
    assert torch.equal(beyond.Hidden(data, 0.0)[3]["image"], whole["image"])


def real_frames(folder, n=36, videos=12):
    """Pictures of noise and a table of boxes, three frames a video; returns the folder."""
    folder.mkdir()
    lines = ["file,video,x,y,w,h"]
    for i in range(n):
        image = np.random.default_rng(i).integers(0, 256, (120, 160, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{i}.png"), image)
        lines.append(f"{i}.png,{i % videos},{10 + i},20,{30 + i % 9},18")
    (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_figure_6(finished, tmp_path, monkeypatch):
    _, data, _ = finished
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))  # as if ImageNet's weights had been downloaded
    weights = tmp_path / "torch" / "hub" / "checkpoints" / "resnet18-f37072fd.pth"
    weights.parent.mkdir(parents=True)
    torch.manual_seed(0)
    torch.save(torchvision.models.resnet18().state_dict(), weights)
    real, photographs = real_frames(tmp_path / "real"), paint_environments(tmp_path / "photographs", seed=6)
    where = dict(root=tmp_path, data=shutil.copytree(data, tmp_path / "data"), stride=STRIDE, progress=False)
    recorded = reproduce("figure6", real=real, photographs=photographs, **where)
    names = [row["set"] for row in recorded["rows"] if row["features"] == "descriptor"]
    wanted = ["real"]
    for name in ("plain", "drawn", "photographs"):
        wanted += [name, f"{name} small", f"{name} degraded"]
    assert names == wanted
    for row in recorded["rows"]:
        for key in figure6.MEASURES:
            assert row[f"{key}_ci95"][0] <= row[key] <= row[f"{key}_ci95"][1]
        assert (row["auc"] > 0.9) == (row["set"] != "real")  # noise is not a drone, and looks like noise
    assert list(recorded["variance_kept"]) == ["descriptor", "backbone", "imagenet"]
    assert len(recorded["answers"]) == 10
    for row in recorded["answers"]:
        assert row["doubt_px"] > 0 and 1 / 7 < row["class_probability"] < 1
        assert sum(row["named"].values()) == (36 if row["set"] == "real" else 42)
    drawn = next(row for row in recorded["answers"] if row["set"] == "drawn")
    # Keypoints lie on the drone, in another world too.
    assert drawn["inside"] > 0.98 and drawn["R_medae_deg"] < 40
    assert "R_medae_deg" not in recorded["answers"][0]  # nobody knows the real ones' poses
    groups = figure6.read_features(tmp_path)["real/groups"]
    assert np.unique(groups, return_counts=True)[1].tolist() == [3] * 12
    again = reproduce("figure6", **where)  # from the recorded features alone
    same = ("rows", "nearer", "answers", "datasets")
    assert [again[part] for part in same] == [recorded[part] for part in same]
    assert (tmp_path / "figures" / "figure6.md").read_text() == figure6.markdown(again)
    for name in ("figure6.png", "figure6_distances.png"):
        assert (tmp_path / "figures" / name).stat().st_size > 10_000


def test_real_frames_that_cannot_be_used_are_named(finished, tmp_path):
    folder = real_frames(tmp_path / "real", n=6, videos=3)
    table = (folder / "boxes.csv").read_text()
    for text, match in [
        (table.replace("video", "clip"), "column 'video' is missing; frames of one video are alike"),
        (table.replace(",w,", ",width,"), "column 'w' is missing"),
        (table.replace("4.png", "40.png"), "line 6: .*40.png is missing or no picture"),
        (table.replace("11,20", "11,high"), "line 3: the box is not four numbers"),
    ]:
        (folder / "boxes.csv").write_text(text)
        with pytest.raises(InputError, match=match):
            figure6.real_pictures(folder, 32)
    with pytest.raises(InputError, match="boxes.csv not found"):
        figure6.real_pictures(tmp_path, 32)
    with pytest.raises(InputError, match="make it with"):
        reproduce("figure6", root=tmp_path, data=finished[1], progress=False)


def test_the_size_of_a_drone():
    """It is the one that the result was made with, whatever edition of the drones that was."""
    recorded = {"hub_radius_m": {"Tello": 0.06, "Mav3": 0.5}}
    np.testing.assert_array_equal(priors.hub_radii(recorded), [0.06, 0.5])
    np.testing.assert_allclose(priors.size_ratios(recorded)[0], [1, 0.5 / 0.06])
    hubs = DRONES["Tello"].hubs
    np.testing.assert_allclose(priors.radius(hubs + [1, 2, 3]), 0.06)


def test_bad_calls_are_one_clear_error(finished, tmp_path):
    root, data, _ = finished
    where = dict(root=root, data=data, stride=STRIDE)
    for arguments, match in [
        (dict(name="table9"), "reproduce table9: choose table3, .*table4"),
        (dict(name="table3", preset="huge"), "unknown preset 'huge'"),
        (dict(name="table3", seeds=0), "--seeds 0"),
        (dict(name="rays", overrides={"rays": "raw"}), "--set rays: the rows of rays differ in it"),
        (dict(name="table3", overrides={"max_minutes": 1}), "kill it instead"),
        (dict(name="table3", **where, overrides={"epoch": 1}), "unknown setting 'epoch' for the methods of"),
        (
            dict(name="table4", **where, overrides={"use_rays": False, "rays": "raw"}),
            "rays=raw is not used by any training of table4",
        ),
        (
            dict(name="table3", **where, environments=tmp_path),
            "was rendered before environments, not before",
        ),
        (dict(name="domains", **where), "needs --photographs DIR"),
        (dict(name="table3", root=root, data=data, stride=60), "keeps every 120. frame, not every 60."),
        (
            dict(name="table3", **where, overrides={**BUDGET, "lr": 1e-2}),
            "cannot resume .*lr was 0.001 and is now 0.01",
        ),
        (dict(name="claims", root=tmp_path), "table3.json not found"),
    ]:
        with pytest.raises(InputError, match=match):
            reproduce(**arguments, progress=False)
    trained = files_written(root, "last.safetensors")
    with pytest.raises(InputError, match="reproduce table9: choose"):
        reproduce_all(["table3", "table9"], **where, progress=False)
    assert files_written(root, "last.safetensors") == trained
    message = "table4.json not found: make it with `python -m dronekeypp reproduce table4`"
    with pytest.raises(InputError, match=message):
        read_result("table4", tmp_path)


def test_data_of_another_edition_are_refused(tmp_path):
    manifest = json.loads(
        (Path(__file__).parents[1] / "data_samples" / "crops" / "manifest.json").read_text()
    )
    manifest["settings"]["edition"] = 3 - EDITION
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    bench = Bench(tmp_path, "cpu", {}, "none", tmp_path, progress=False)
    message = (
        f"is of edition {3 - EDITION}, and results are recorded on edition {EDITION}; set --data to another"
    )
    with pytest.raises(InputError, match=message):
        bench.render()


def test_several_tables_are_made_one_after_the_other(monkeypatch):
    asked = []
    monkeypatch.setattr("dronekeypp.reproduce.reproduce", lambda name, **more: asked.append((name, more)))
    main(["reproduce", "table4", "beyond", "--seeds", "2"])
    assert [name for name, _ in asked] == ["table4", "beyond"]
    assert all(more["seeds"] == 2 for _, more in asked)


def test_a_finished_data_set_needs_no_renderer(finished):
    _, data, _ = finished
    code = "\n".join(
        [
            "import pathlib, sys",
            "sys.modules['pyvista'] = None",
            "from dronekeypp.reproduce import Bench",
            f"data = pathlib.Path({str(data)!r})",
            f"Bench(None, 'cpu', {{}}, 'none', data, stride={STRIDE}).render()",
        ]
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
