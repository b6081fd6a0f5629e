"""`reproduce`, all the way through on a few hundred frames: rendered, trained, measured, written; killed and gone on with."""

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

from dronekeypp.baselines import load_network
from dronekeypp.errors import InputError
from dronekeypp.presets import preset as find_preset
from dronekeypp.reproduce import ablations, beyond, figure6, priors, read_result, reproduce, table3, tables
from dronekeypp.reproduce.runner import PAPER, read_npz, source_digest, write_npz
from dronekeypp.sixdronesyn.dataset import SixDroneSyn

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
    """Table 3 on the command line. In a process of its own: what other tests leave behind may change the last bit of a training."""
    line = [
        sys.executable,
        "-m",
        "dronekeypp",
        "reproduce",
        "table3",
        "--root",
        str(root),
        "--data",
        str(data),
        "--stride",
        str(STRIDE),
        *more,
    ]
    return line + [
        part
        for key, value in BUDGET.items()
        for part in ("--set", f"{key}={'none' if value is None else value}")
    ]


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
    assert (
        recorded
        == json.loads((root / "data_samples" / "results" / "table3.json").read_text())
        == read_result("table3", root)
    )
    digest = json.loads((data / "manifest.json").read_text())["digest"]
    assert recorded["dataset"]["digest"] == digest and recorded["dataset"]["stride"] == STRIDE
    assert recorded["dataset"]["environments"] == "environments" and "CPU cores" in recorded["hardware"]
    assert recorded["preset"] == "cpu" and recorded["budget"]["frames"] == "64" and recorded["minutes"] >= 0
    names = [
        ("DroneKey++", None),
        ("DroneKey", None),
        ("DroneKey", "upright"),
        ("DronePose", None),
        ("DronePose", "told the crop"),
    ]
    assert [m for m in tables.methods(recorded) if not m[0].startswith("YOLO")] == names
    rows = [row for row in recorded["rows"] if row["method"] == "DroneKey++"]
    assert (
        len(rows) == 14
        and {row["scene"] for row in rows} == {6, 7}
        and sum(row["frames"] for row in rows) == 42
    )
    for row in recorded["rows"]:
        assert row["R_mae_deg"] >= 0 and row["t_mae_m"] > 0
        assert (row["class_accuracy"] is None) == (
            row["method"] in ("DroneKey", "DronePose")
        )  # they have no classifier
    low, high = tables.average(recorded, "DroneKey", None)["R_mae_deg_ci95"]
    assert low < tables.average(recorded, "DroneKey", None)["R_mae_deg"] < high
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
    one = [
        r
        for r in rows
        if (r["method"], r["variant"], r["metric"], r["source"]) == ("DroneKey", "", "t_axis_mae_m", "paper")
    ]
    assert (
        len(one) == 15
        and float(one[0]["value"]) == PAPER["table3"]["DroneKey"]["t_m_MAE"]["scene_06"]["Mini3"]
    )
    assert (root / "figures" / "table3.png").stat().st_size > 10_000
    with np.load(root / "data_samples" / "results" / "table3_frames.npz") as stored:
        assert stored["DroneKey++/R_deg"].shape == (42,)
        assert np.median(stored["DronePose/t_m"].astype(float)) > 0


def test_a_killed_run_goes_on_and_ends_the_same(finished, tmp_path):
    _, data, recorded = finished
    process = subprocess.Popen(command(tmp_path, data), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    runs = tmp_path / "runs" / "table3-cpu"
    deadline = time.time() + 120
    while (
        time.time() < deadline
        and process.poll() is None
        and not (runs / "dronekey" / "seed0" / "metrics.csv").exists()
    ):
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
    states = {p: p.stat().st_mtime_ns for p in root.rglob("last.safetensors")} | {
        p: p.stat().st_mtime_ns for p in root.rglob("test*.npz")
    }
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


def test_the_flights_it_leaves_are_the_predictions(finished):
    root, data, recorded = finished
    with np.load(root / "data_samples" / "results" / "flights.npz") as stored:
        flights = dict(stored)
    assert (
        len(flights["test/t"]) == 42
        and len(flights["val/t"]) == 105
        and flights["test/t"].dtype == np.float16
    )
    true, found = (
        Rotation.from_rotvec(flights[f"test/{name}"].astype(float)) for name in ("true_rotvec", "rotvec")
    )
    turned = (true.inv() * found).magnitude()
    stored = next(a for a in recorded["averages"] if a["method"] == "DroneKey++" and a["over"] == "frames")
    assert np.degrees(turned).mean() == pytest.approx(stored["R_mae_deg"], rel=0.01)
    apart = np.linalg.norm(flights["test/t"].astype(float) - flights["test/true_t"], axis=1)
    assert apart.mean() == pytest.approx(stored["t_mae_m"], rel=0.01)


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
    variants = {row["variant"] for row in recorded["rows"]}
    assert variants == {
        f"trained {a}, tested {b}" for a in ("drawn", "photographs") for b in ("drawn", "photographs")
    }
    assert (
        len(list((root / "runs").rglob("dronekeypp/seed0/last.safetensors"))) == 2
    )  # the run of Table 3 serves here too
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
    gates = [story.get("gate") for story in recorded["runs"]]
    assert all(sum(gate) == pytest.approx(1, abs=1e-3) for gate in gates)
    for story in recorded["runs"]:
        own = [
            row
            for row in recorded["averages"]
            if (row["variant"], row["seed"], row["over"]) == (story["variant"], story["seed"], "frames")
        ]
        assert story["keypoints"]["its own"]["t_m"] == pytest.approx(own[0]["t_medae_m"], rel=1e-4)
        assert story["keypoints"]["true"]["t_m"] != story["keypoints"]["its own"]["t_m"]
    text = (root / "figures" / "table5.md").read_text()
    assert "(17.34)" in text and "not told apart" in text and text.count("| (1) only MLP_pose |") == 3
    rows = list(csv.DictReader(open(root / "figures" / "table5.csv")))
    assert len(rows) == 4 * (5 * 3 + 4)  # five metrics, three seeds; the paper prints four
    assert (root / "figures" / "table5.png").stat().st_size > 10_000


def test_equal_settings_are_one_training(ablated, finished):
    root, _ = ablated
    states = {p: p.stat().st_mtime_ns for p in root.rglob("last.safetensors")}
    again = dict(
        root=root, data=finished[1], stride=STRIDE, progress=False, overrides={**BUDGET, "epochs": 1}, seeds=1
    )
    recorded = reproduce("table6", **again)  # "equal" is Table 5's "(4) full decoder"
    assert len(states) == 12 and len(list(root.rglob("last.safetensors"))) == 12 + 3
    assert all(p.stat().st_mtime_ns == then for p, then in states.items())
    full = ablations.run_of(ablations.ABLATIONS["table5"].rows[3], "cpu")
    assert full.variant is None and full == ablations.run_of(
        ablations.Row("equal", {"schedule": "equal"}), "cpu"
    )
    assert ablations.run_of(ablations.Row("raw", {"rays": "raw"}), "cpu").slug == "dronekeypp-rays-raw"
    assert (
        ablations.run_of(ablations.Row("raw", {"rays": "raw"}), "paper").variant is None
    )  # the paper preset's own
    assert len({json.dumps(row["R_mae_deg"]) for row in recorded["averages"]}) > 2


def test_a_row_may_have_fewer_seeds_than_its_table(ablated, finished, monkeypatch):
    root, whole = ablated
    full, class_free = (
        ablations.Row("full"),
        {"use_class": False},
    )  # both trained for Table 5, three seeds each
    mine = ablations.Ablation(
        "Mine", (full, ablations.Row("no class", class_free, seeds=1)), reference="full"
    )
    monkeypatch.setitem(ablations.ABLATIONS, "mine", mine)
    bench = ablations.Bench(
        root, "cpu", {**BUDGET, "epochs": 1}, "ablations-cpu", finished[1], stride=STRIDE, progress=False
    )
    recorded = ablations.reproduce("mine", bench)
    assert [(run["variant"], run["seed"]) for run in recorded["runs"]] == [
        ("full", 0),
        ("no class", 0),
        ("full", 1),
        ("full", 2),
    ]
    assert tables.count_seeds(recorded) == "1 to 3 seeds" and tables.count_seeds(whole) == "3 seeds"
    assert ablations.difference(recorded, "no class", "t_mae_m").seeds.shape == (
        1,
        3,
    )  # its one against the reference's three
    three = tables.by_seed(whole, "DroneKey++", "(3) RayEmbed + MLP_pose + MLP_3D", "t_mae_m")
    assert tables.by_seed(recorded, "DroneKey++", "no class", "t_mae_m") == three[:1]
    assert len(ablations.reproduce("mine", bench, seeds=2)["runs"]) == 4  # asked for, every row gets them


def test_a_verdict_needs_an_interval_without_zero_and_seeds_that_agree(ablated):
    assert ablations.Difference(2.0, (1.0, 3.0), np.array([[1.9, 2.0, 2.1]] * 3)).verdict == "worse"
    assert ablations.Difference(-2.0, (-3.0, -1.0), np.full((1, 1), -2.0)).verdict == "better?"
    assert (
        ablations.Difference(-2.0, (-3.0, -1.0), np.full((1, 9), -2.0)).verdict == "better?"
    )  # nine pairs, and one training
    assert ablations.Difference(2.0, (-0.1, 3.0), np.full((3, 3), 2.0)).verdict == "not told apart"
    assert ablations.Difference(2.0, (1.0, 3.0), np.array([[4.0, 4.0, -2.0]] * 3)).verdict == "not told apart"
    _, recorded = ablated
    one = ablations.difference(recorded, "(1) only MLP_pose", "t_mae_m")
    cells = [
        tables.cells(recorded, "DroneKey++", name, "t_mae_m")[-1]
        for name in ("(1) only MLP_pose", "(4) full decoder")
    ]
    assert one.mean == pytest.approx(cells[0] - cells[1]) == pytest.approx(np.mean(one.seeds))


def test_an_ablation_of_ones_own_is_found_by_name(ablated, finished, monkeypatch):
    root, _ = ablated
    mine = ablations.Ablation(
        "Mine",
        (ablations.Row("full"), ablations.Row("geometric", {"pose": "geometric"})),
        reference="full",
        seeds=1,
    )
    monkeypatch.setitem(ablations.ABLATIONS, "mine", mine)
    again = dict(
        root=root, data=finished[1], stride=STRIDE, progress=False, overrides={**BUDGET, "epochs": 1}
    )
    recorded = reproduce("mine", **again)
    assert [("keypoints" in story) for story in recorded["runs"]] == [
        True,
        False,
    ]  # a geometric one does not take true keypoints
    with pytest.raises(InputError, match="unknown setting 'backbone_strid'; known"):
        ablations.run_of(ablations.Row("slip", {"backbone_strid": 8}), "cpu")


def test_a_method_of_ones_own_stands_in_table_3():
    recorded = read_result("table3")
    rows = [
        {**row, "method": "Mine"}
        for row in recorded["rows"]
        if (row["method"], row["variant"]) == ("DronePose", None)
    ]
    recorded = {**recorded, "rows": recorded["rows"] + rows}
    assert table3.markdown(recorded).count("| Mine |") == len(tables.PRINTED) + 1 and "Mine" in table3.as_csv(
        recorded
    )
    assert len(table3.draw(recorded).axes) == len(tables.PRINTED)


def test_every_row_of_every_ablation_is_a_setting_that_exists():
    for preset in ("cpu", "paper"):
        for ablation in ablations.ABLATIONS.values():
            for row in ablation.rows:
                find_preset(preset, ablations.run_of(row, preset).changes)
    for name in ("table4", "table5", "table6"):
        assert set(PAPER[name]) == {row.name for row in ablations.ABLATIONS[name].rows}


def test_priors(finished, tmp_path):
    recorded = reproduce(
        "priors",
        overrides={**BUDGET, "epochs": 1},
        root=tmp_path,
        data=finished[1],
        stride=STRIDE,
        progress=False,
    )
    assert recorded == read_result("priors", tmp_path)
    runs = {story["without"]: story for story in recorded["runs"]}
    assert set(runs) == {None, *priors.DRONES}
    settings = json.loads(
        (
            tmp_path / "runs" / "ablations-cpu" / "dronekeypp-without-tello" / "seed0" / "config.json"
        ).read_text()
    )
    whole = json.loads(
        (tmp_path / "runs" / "ablations-cpu" / "dronekeypp" / "seed0" / "config.json").read_text()
    )
    assert settings["data"]["train_frames"] * 7 == whole["data"]["train_frames"] * 6
    assert [row["drone"] for row in recorded["rows"] if row["variant"] == "without Tello"] == [
        "Tello",
        "Tello",
    ]  # scenes 6 and 7
    taken = next(t["share"] for t in recorded["taken_for"] if t["drone"] == "Tello")
    assert sum(taken) == pytest.approx(1)
    told = np.array(recorded["told"][0]["distance_ratio"])
    assert (
        told.shape == (7, 7) and (told > 0).all() and len({*told[0]}) > 1
    )  # another class, another distance
    assert priors.size_ratios(recorded)[0, 0] == 1 and np.array(
        recorded["embedding"][0]["distance"]
    ).shape == (7, 7)
    assert (
        "| Tello |" in (tmp_path / "figures" / "priors.md").read_text()
        and (tmp_path / "figures" / "priors.png").stat().st_size > 10_000
    )


def test_beyond(finished, tmp_path):
    root, data, table3 = finished
    recorded = reproduce("beyond", overrides=BUDGET, root=root, data=data, stride=STRIDE, progress=False)
    variants = [variant for _, variant in tables.methods(recorded)]
    assert variants == [
        None,
        "geometric",
        *beyond.PARTS.values(),
        *(run.variant for run in beyond.WITHOUT.values()),
    ]
    papers = [
        [row for row in r["rows"] if (row["method"], row["variant"]) == ("DroneKey++", None)]
        for r in (recorded, table3)
    ]
    assert papers[0] == papers[1]  # Table 3's own run
    assert {row["drone"] for row in recorded["rows"] if row["variant"] == "geometric without Tello"} == {
        "Tello"
    }
    for row in recorded["doubt"]:
        for name in beyond.HALVES:
            shares = row["coverage"][name]
            assert shares == sorted(shares) and 0 <= shares[0] and shares[-1] <= 1
    assert [row["hidden"] for row in recorded["occlusion"]] == [
        share for share in beyond.HIDDEN for _ in range(2)
    ]
    assert len(recorded["shapes"]) == 7 and all(
        0.9 < row["size_ratio"] < 1.1 for row in recorded["shapes"]
    )  # from the annotations
    assert [row["filter"] for row in recorded["sequences"]] == list(beyond.FILTERS)
    raw, *others = recorded["sequences"]
    assert raw["R_deg_change_ci95"] == [0, 0] and all(
        row["strength"] in beyond.FILTERS[row["filter"]][1] for row in others
    )
    frames = next(
        row for row in recorded["averages"] if row["variant"] == "geometric" and row["over"] == "frames"
    )
    assert raw["t_m"] == pytest.approx(frames["t_mae_m"], rel=0.05)  # flights count alike there, frames here
    shipped = load_network(root / "data_samples" / "beyond")
    assert (shipped.config.pose, shipped.config.classifier) == ("geometric", "features")
    text = (root / "figures" / "beyond.md").read_text()
    assert text == beyond.markdown(recorded) and text.count("geometric without") == 4
    assert all(
        (root / "figures" / name).stat().st_size > 10_000 for name in ("beyond.png", "beyond_doubt.png")
    )


def test_a_covariance_is_judged_by_how_often_it_holds():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(5000, 6, 6)) * 0.1
    covariance = roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(6)
    error = np.einsum("fij,fj->fi", np.linalg.cholesky(covariance), rng.normal(size=(5000, 6)))
    for name, shares in beyond.coverage(error, covariance).items():
        np.testing.assert_allclose(shares, beyond.LEVELS, atol=0.03, err_msg=name)
    np.testing.assert_allclose(beyond.calibration(error, covariance), 1, atol=0.03)
    np.testing.assert_allclose(beyond.calibration(3 * error, covariance), 3, atol=0.1)


def test_a_mirror_that_says_the_same_changes_nothing():
    keypoints, sigma = torch.rand(2, 4, 2), torch.rand(2, 4) + 0.1
    swap = [1, 0, 3, 2]
    mirror = {
        "keypoints": torch.stack([1 - keypoints[:, swap, 0], keypoints[:, swap, 1]], dim=2),
        "keypoint_sigma": sigma[:, swap],
    }
    both = beyond.merged({"keypoints": keypoints, "keypoint_sigma": sigma}, mirror)
    torch.testing.assert_close(both["keypoints"], keypoints)
    torch.testing.assert_close(both["keypoint_sigma"], sigma)
    unsure = {
        **mirror,
        "keypoints": mirror["keypoints"] + 1,
        "keypoint_sigma": 100 * mirror["keypoint_sigma"],
    }
    assert (
        beyond.merged({"keypoints": keypoints, "keypoint_sigma": sigma}, unsure)["keypoints"] - keypoints
    ).abs().max() < 1e-3


def test_a_hidden_square_is_as_large_as_it_says(finished):
    data = SixDroneSyn(finished[1], "test", size=48)
    plain, covered = data[3], beyond.Hidden(data, 0.25)[3]
    changed = (plain["image"] != covered["image"]).any(dim=0).float().mean()
    assert 0.2 < float(changed) <= 0.25 and torch.equal(plain["keypoints"], covered["keypoints"])
    assert torch.equal(beyond.Hidden(data, 0.0)[3]["image"], plain["image"])


def real_frames(folder, n=36, videos=12):
    """Pictures of noise and a table of boxes, three frames a video; returns the folder."""
    folder.mkdir()
    lines = ["file,video,x,y,w,h"]
    for i in range(n):
        cv2.imwrite(
            str(folder / f"{i}.png"), np.random.default_rng(i).integers(0, 256, (120, 160, 3), dtype=np.uint8)
        )
        lines.append(f"{i}.png,{i % videos},{10 + i},20,{30 + i % 9},18")
    (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_figure_6(finished, tmp_path, monkeypatch):
    _, data, _ = finished
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))  # as if ImageNet's weights had been downloaded
    (tmp_path / "torch" / "hub" / "checkpoints").mkdir(parents=True)
    torch.manual_seed(0)
    torch.save(
        torchvision.models.resnet18().state_dict(),
        tmp_path / "torch" / "hub" / "checkpoints" / "resnet18-f37072fd.pth",
    )
    real, photographs = real_frames(tmp_path / "real"), paint_environments(tmp_path / "photographs", seed=6)
    where = dict(root=tmp_path, data=shutil.copytree(data, tmp_path / "data"), stride=STRIDE, progress=False)
    recorded = reproduce("figure6", real=real, photographs=photographs, **where)
    names = [row["set"] for row in recorded["rows"] if row["features"] == "descriptor"]
    assert names == [
        "real",
        *(made + version for made in list(figure6.SETS)[1:] for version in figure6.VERSIONS),
    ]
    for row in recorded["rows"]:
        for key in figure6.MEASURES:
            assert row[f"{key}_ci95"][0] <= row[key] <= row[f"{key}_ci95"][1]
        assert (row["auc"] > 0.9) == (row["set"] != "real")  # noise is not a drone, and looks like noise
    assert list(recorded["variance_kept"]) == ["descriptor", "backbone", "imagenet"]
    assert len(recorded["answers"]) == 10
    for row in recorded["answers"]:
        assert (
            row["doubt_px"] > 0
            and 1 / 7 < row["class_probability"] < 1
            and sum(row["named"].values()) == (36 if row["set"] == "real" else 42)
        )
    drawn = next(row for row in recorded["answers"] if row["set"] == "drawn")
    assert (
        drawn["inside"] > 0.98 and drawn["R_medae_deg"] < 40
    )  # keypoints lie on the drone, in another world too
    assert "R_medae_deg" not in recorded["answers"][0]  # nobody knows the real ones' poses
    assert (
        np.unique(figure6.read_features(tmp_path)["real/groups"], return_counts=True)[1].tolist() == [3] * 12
    )
    again = reproduce("figure6", **where)  # from the recorded features alone
    same = ("rows", "nearer", "answers", "datasets")
    assert [again[part] for part in same] == [recorded[part] for part in same]
    assert (tmp_path / "figures" / "figure6.md").read_text() == figure6.markdown(again)
    assert all(
        (tmp_path / "figures" / name).stat().st_size > 10_000
        for name in ("figure6.png", "figure6_distances.png")
    )


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
    assert priors.hub_radius("Tello") < priors.hub_radius("Mini2") < priors.hub_radius("Mav3")


def test_bad_calls_are_one_clear_error(finished, tmp_path):
    root, data, _ = finished
    for arguments, match in [
        (dict(name="table9"), "reproduce table9: choose table3, .*table4"),
        (dict(name="table3", preset="huge"), "unknown preset 'huge'"),
        (dict(name="table3", seeds=0), "--seeds 0"),
        (dict(name="rays", overrides={"rays": "raw"}), "--set rays: the rows of rays differ in it"),
        (dict(name="table3", overrides={"max_minutes": 1}), "kill it instead"),
        (
            dict(name="table3", root=root, data=data, stride=STRIDE, environments=tmp_path),
            "was rendered before environments, not before",
        ),
        (dict(name="domains", root=root, data=data, stride=STRIDE), "needs --photographs DIR"),
        (dict(name="table3", root=root, data=data, stride=60), "keeps every 120. frame, not every 60."),
        (
            dict(name="table3", root=root, data=data, stride=STRIDE, overrides={**BUDGET, "lr": 1e-2}),
            "cannot resume .*lr was 0.001 and is now 0.01",
        ),
    ]:
        with pytest.raises(InputError, match=match):
            reproduce(**arguments, progress=False)
    with pytest.raises(
        InputError, match="table4.json not found: make it with `python -m dronekeypp reproduce table4`"
    ):
        read_result("table4", Path(tmp_path))


def test_a_finished_data_set_needs_no_renderer(finished):
    _, data, _ = finished
    code = (
        "import sys; sys.modules['pyvista'] = None\n"
        "from dronekeypp.reproduce import Bench\n"
        f"Bench(None, 'cpu', {{}}, 'none', __import__('pathlib').Path({str(data)!r}), stride={STRIDE}).render()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
