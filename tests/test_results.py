"""What the repository ships as measured: tables of recorded results, and networks that do what they say."""

import dataclasses
import importlib
import json
import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors import safe_open

from dronekeypp import checkpoint, files
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.evaluate import evaluate, measure
from dronekeypp.files import command_line, read_json
from dronekeypp.model import Backbone, BackboneConfig
from dronekeypp.reproduce import (
    ablations,
    beyond,
    claims,
    domains,
    figure6,
    priors,
    rates,
    read_result,
    table3_page,
    table3_runs,
    tables,
)
from dronekeypp.reproduce.picture import sheet
from dronekeypp.reproduce.results import describe
from dronekeypp.sixdronesyn import quadrotors
from dronekeypp.sixdronesyn.drones import EDITION

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "data_samples"
RESULTS = SAMPLES / "results"


def shipped(name):
    """A shipped network, and its errors on the sample's test crops, a twentieth of the frames of a table."""
    model = checkpoint.load(SAMPLES / name)
    return model, measure(
        evaluate(model, open_dataset(SAMPLES / "crops", "test", size=model.config.image_size))
    )


def test_nothing_recorded_names_a_machine_s_folders(monkeypatch):
    paths = [*RESULTS.glob("*.json"), *(ROOT / "figures").glob("*.md"), *SAMPLES.rglob("*.json")]
    for path in [*paths, ROOT / "README.md"]:
        assert not re.search(r"(?<![\w.:/])/(?:root|home|tmp|work|mnt|Users)/", path.read_text()), path
    words = ["reproduce", "figure6", "--real", "/home/me/my frames", "--set", "lr=1"]
    monkeypatch.setattr(sys, "argv", ["/usr/lib/x.py", *words])
    assert command_line() == "python -m dronekeypp reproduce figure6 --real 'my frames' --set lr=1"


def test_outside_a_clone_a_recorded_result_is_said_to_need_the_repository(monkeypatch, tmp_path):
    monkeypatch.setattr(files, "__file__", str(tmp_path / "site-packages" / "dronekeypp" / "files.py"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="clone the repository"):
        read_result("table3")
    with pytest.raises(InputError, match="clone the repository"):
        figure6.read_features()
    monkeypatch.chdir(ROOT / "notebooks")  # inside a clone it is found from anywhere
    assert read_result("table3")["name"] == "table3"


@pytest.mark.parametrize("path", sorted(RESULTS.glob("*.json")), ids=lambda path: path.stem)
def test_a_result_names_what_made_it(path):
    recorded = read_json(path)
    for run in recorded.get("runs", []):
        assert {"seed", "hardware", "minutes", "changes"} <= set(run)
        if "edition" in recorded["dataset"]:  # those of the first edition do not name it
            assert len(run["weights"]) == 16 and "backbone" in run
            assert recorded["flights"] and recorded["validation"]
    if recorded.get("runs"):
        assert recorded["budget"] and recorded["preset"] and len(recorded["dataset"]["digest"]) >= 16


def test_table_3_is_made_from_its_recorded_result():
    recorded = read_result("table3")
    assert (ROOT / "figures" / "table3.md").read_text() == table3_page.markdown(recorded)
    assert (ROOT / "figures" / "table3.csv").read_text() == table3_page.as_csv(recorded)
    assert recorded["dataset"]["seed"] == 0 and recorded["dataset"]["stride"] == 1
    assert (recorded["dataset"]["train_frames"], recorded["dataset"]["test_frames"]) == (35280, 5040)


@pytest.mark.skipif(not (RESULTS / "rates.json").is_file(), reason="the rates are not recorded yet")
def test_table_3_has_the_rates_that_were_chosen():
    recorded = read_result("rates")
    assert (ROOT / "figures" / "rates.md").read_text() == rates.markdown(recorded)
    chosen = {}
    for title, run in rates.METHODS.items():
        if rates.chosen_rate(recorded, title) != recorded["usual_lr"]:
            chosen[run.method, run.variant] = rates.chosen_rate(recorded, title)
    assert chosen == table3_runs.RATES


def test_the_domain_table_is_made_from_its_recorded_result():
    recorded = read_result("domains")
    assert (ROOT / "figures" / "domains.md").read_text() == domains.markdown(recorded)
    drawn, photographs = (recorded["datasets"][name] for name in domains.DOMAINS)
    assert drawn["environments"] == "procedural" != photographs["environments"]
    assert {k: drawn[k] for k in ("train_frames", "test_frames", "seed")} == {
        k: photographs[k] for k in ("train_frames", "test_frames", "seed")
    }


@pytest.mark.parametrize(
    "name", sorted(name for name in ablations.ABLATIONS if (RESULTS / f"{name}.json").is_file())
)
def test_an_ablations_table_is_made_from_its_recorded_result(name):
    recorded = read_result(name)
    assert (ROOT / "figures" / f"{name}.md").read_text() == ablations.markdown(recorded)
    assert (ROOT / "figures" / f"{name}.csv").read_text() == ablations.as_csv(recorded)
    ablation = ablations.ABLATIONS[name]
    if recorded["dataset"].get("edition") == EDITION:  # the first edition's tables had other rows
        wanted = []
        for row in ablation.rows:
            wanted += [(row.name, seed) for seed in range(row.seeds or ablation.seeds)]
        assert sorted((run["variant"], run["seed"]) for run in recorded["runs"]) == sorted(wanted)
    # Equal budgets, none cut short.
    assert {run["epochs"] for run in recorded["runs"]} == {int(recorded["budget"]["epochs"])}


def test_the_paper_s_ablations_are_recorded():
    assert {"table4", "table5", "table6"} <= {path.stem for path in RESULTS.glob("*.json")}


def test_figure_6_is_made_from_its_recorded_result():
    recorded, features = read_result("figure6"), figure6.read_features()
    assert (ROOT / "figures" / "figure6.md").read_text() == figure6.markdown(recorded)
    assert recorded["of"] == len(features["real/groups"]) == 156
    assert {row["set"] for row in recorded["rows"]} == set(figure6.sets_of(features))


def test_the_recorded_speed_reaches_its_goals():
    rows = []
    for row in read_result("speed")["rows"]:
        if (row["name"], row["device"], row["batch"], row["threads"]) == ("DroneKey++", "cpu", 1, 2):
            rows.append(row)
    fastest = max(rows, key=lambda row: row["frames_per_s"])
    assert fastest["frames_per_s"] >= 100 and fastest["ratio_to_yolov8n_pose"] >= 3


def test_the_second_stand_in_has_never_seen_the_seven():
    """Its header names 480 random quadrotors of the training split, and it fits the backbone."""
    path = files.repository_root() / "data_samples" / "backbone" / "quadrotors.safetensors"
    with safe_open(path, "pt") as file:
        drones = file.metadata()["drones"].split(", ")
    numbers = [quadrotors.number_of(drone) for drone in drones]
    assert len(set(numbers)) == 480
    assert all(number is not None and number < 600 and number % 10 < 8 for number in numbers)
    features = Backbone(BackboneConfig(backbone_weights=path)).eval()(torch.zeros(1, 3, 96, 96))
    assert features.shape == (1, 256, 6, 6) and features.isfinite().all()


def test_the_shipped_checkpoint_does_what_its_row_says():
    _, measured = shipped("checkpoint")
    row = tables.average(read_result("table3"), "DroneKey++", None)
    assert measured["R_medae_deg"] == pytest.approx(row["R_medae_deg"], rel=0.25)
    assert measured["t_medae_m"] == pytest.approx(row["t_medae_m"], rel=0.25)
    assert measured["class_accuracy"] == pytest.approx(row["class_accuracy"], abs=0.03)


def test_the_samples_flight_is_what_its_command_makes():
    flight = describe(ROOT / "data_samples" / "flight")
    assert (flight["test_frames"], flight["stride"], flight["train_frames"]) == (180, 2, 0)


def test_priors_is_made_from_its_recorded_result():
    recorded = read_result("priors")
    assert (ROOT / "figures" / "priors.md").read_text() == priors.markdown(recorded)
    own = list(recorded["hub_radius_m"])
    assert sorted(entry["drone"] for entry in recorded["taken_for"]) == sorted(own)  # each left out once
    for entry in recorded["taken_for"]:
        # Nobody told it that there is such a drone.
        assert entry["share"][own.index(entry["drone"])] < 0.01


def test_beyond_is_made_from_its_recorded_result():
    recorded = read_result("beyond")
    assert (ROOT / "figures" / "beyond.md").read_text() == beyond.markdown(recorded)
    row = {}
    for method, variant in tables.methods(recorded):
        row[variant] = tables.average(recorded, method, variant)
    paper, ours, exact = row[None], row["geometric"], row[beyond.PARTS["exact"]]
    table = tables.average(read_result("table3"), "DroneKey++", None)
    for key in ("R_mae_deg", "t_mae_m", "class_accuracy"):
        assert paper[key] == table[key]  # one run, two tables
    # The goals that were met.
    assert ours["R_mae_deg"] <= 6 and ours["R_medae_deg"] <= 3 and ours["flip_rate"] < 0.0105
    for key, factor in (("R_mae_deg", 1.6), ("t_mae_m", 1.6), ("R_medae_deg", 2), ("t_medae_m", 2)):
        assert ours[key] < paper[key] / factor
    assert exact["R_mae_deg"] < 1 and exact["t_mae_m"] < 0.05  # what the solver could do
    [doubt] = [doubt for doubt in recorded["doubt"] if doubt["variant"] == "geometric"]
    for name in beyond.HALVES:
        shares = doubt["coverage"][name]
        assert abs(shares[4] - 0.5) < 0.12 and abs(shares[8] - 0.9) < 0.03


def test_the_shipped_geometric_network_does_what_its_row_says():
    _, measured = shipped("beyond")
    assert (SAMPLES / "beyond" / "model.safetensors").stat().st_size < 10e6
    recorded = tables.average(read_result("beyond"), "DroneKey++", "geometric")
    assert abs(measured["class_accuracy"] - recorded["class_accuracy"]) < 0.03
    for key, factor in (("R_medae_deg", 1.3), ("t_medae_m", 1.4)):  # a twentieth of the frames
        assert 1 / factor < measured[key] / recorded[key] < factor


# --- the table of claims --------------------------------------------------------------------------------


def test_the_claims_in_the_readme_are_those_of_the_recorded_results():
    text = (ROOT / "README.md").read_text()
    assert text == claims.fill_readme(text, claims.Results())


def test_the_readmes_lines_for_one_picture(monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    [code] = [block for block in blocks if "clamp_square" in block]
    metres = {}
    for name, pattern in (("answer", r"metres: \((.*?)\)"), ("truth", r"truth: \((.*?)\)")):
        metres[name] = [float(v) for v in re.search(pattern, code)[1].split(",")]
    monkeypatch.chdir(ROOT)
    variables = {}
    exec(code, variables)
    assert variables["pose"]["t"][0].tolist() == pytest.approx(metres["answer"], abs=0.02)
    [truth] = read_json(ROOT / "data_samples" / "frames" / "test" / "000651" / "scene_gt.json")["0"]
    assert [v / 1000 for v in truth["cam_t_m2c"]] == pytest.approx(metres["truth"], abs=0.006)


def test_the_readmes_picture_shows_seven_drones():
    picture = cv2.imdecode(np.frombuffer(sheet(ROOT / "data_samples"), np.uint8), cv2.IMREAD_COLOR)
    stored = cv2.imread(str(ROOT / "figures" / "overlay.jpg"))
    assert picture.shape == stored.shape == (2 * 326, 4 * 486, 3)
    assert np.abs(picture.astype(float) - stored).mean() < 0.5  # drawn with the shipped network


@pytest.mark.parametrize("claim", claims.CLAIMS, ids=lambda c: f"{c.where}: {c.says}"[:60])
def test_a_claim_points_at_what_there_is_and_still_holds(claim):
    package, _, name = f"dronekeypp.{claim.code}".rpartition(".")
    try:
        assert hasattr(importlib.import_module(package), name)
    except ModuleNotFoundError:
        importlib.import_module(f"{package}.{name}")
    assert (ROOT / claims.source_of(claim.code)).is_file()
    file, _, function = claim.test.partition("::")
    assert not function or f"def {function}(" in (ROOT / "tests" / file).read_text()
    assert (ROOT / "tests" / file).is_file()
    notebook = json.loads((ROOT / "notebooks" / f"{claim.notebook}.ipynb").read_text())
    headings = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            headings += "".join(cell["source"]).split("\n")
    assert any(re.match(rf"## {claim.section}\b", line) for line in headings)
    results = claims.Results()
    verdict = claim.derived_verdict(results)
    assert verdict in claims.VERDICTS and bool(claim.verdict) == (claim.compares is None)
    assert claim.reason(results) or verdict == claims.REPRODUCED
    if claim.holds:
        assert claim.holds(results), "the verdict no longer fits the results"
    if claim.ours and claim.rests_on and "°" in claim.ours(results):
        assert claim.verdict == claims.SAME_ORDER  # a number on other data is never reproduced


def test_a_verdict_that_no_longer_holds_is_told(monkeypatch, tmp_path):
    wrong = dataclasses.replace(next(c for c in claims.CLAIMS if c.holds), holds=lambda results: False)
    monkeypatch.setattr(claims, "CLAIMS", (wrong,))
    with pytest.raises(InputError, match="no longer fits the results"):
        claims.reproduce(tmp_path)
    with pytest.raises(InputError, match="has lost the marks"):
        claims.fill_readme("no marks", claims.Results())
