"""What the repository ships as measured: tables made from recorded results, a checkpoint that does what they say."""

from pathlib import Path

import pytest

from dronekeypp.baselines import load_network
from dronekeypp.evaluate import evaluate, measure
from dronekeypp.reproduce import domains, read_result, table3, tables
from dronekeypp.reproduce.runner import describe
from dronekeypp.sixdronesyn.dataset import SixDroneSyn

ROOT = Path(__file__).parents[1]


def test_table_3_is_made_from_its_recorded_result():
    recorded = read_result("table3")
    assert (ROOT / "figures" / "table3.md").read_text() == table3.markdown(recorded)
    assert (ROOT / "figures" / "table3.csv").read_text() == table3.as_csv(recorded)
    assert recorded["dataset"]["seed"] == 0 and recorded["dataset"]["stride"] == 1
    assert (recorded["dataset"]["train_frames"], recorded["dataset"]["test_frames"]) == (35280, 5040)


def test_the_domain_table_is_made_from_its_recorded_result():
    recorded = read_result("domains")
    assert (ROOT / "figures" / "domains.md").read_text() == domains.markdown(recorded)
    drawn, photographs = (recorded["datasets"][name] for name in domains.DOMAINS)
    assert drawn["environments"] == "procedural" != photographs["environments"]
    assert {k: drawn[k] for k in ("train_frames", "test_frames", "seed")} == {k: photographs[k] for k in ("train_frames", "test_frames", "seed")}


def test_the_shipped_checkpoint_does_what_its_row_says():
    """On the sample's test crops, a twentieth of the frames that the row is about."""
    model, test_set = load_network(ROOT / "data_samples" / "checkpoint"), SixDroneSyn(ROOT / "data_samples" / "crops", "test")
    found, row = measure(evaluate(model, test_set)), tables.average(read_result("table3"), "DroneKey++", None)
    assert found["R_medae_deg"] == pytest.approx(row["R_medae_deg"], rel=0.25)
    assert found["t_medae_m"] == pytest.approx(row["t_medae_m"], rel=0.25)
    assert found["class_accuracy"] == pytest.approx(row["class_accuracy"], abs=0.03)


def test_the_samples_flight_is_what_its_command_makes():
    flight = describe(ROOT / "data_samples" / "flight")
    assert (flight["test_frames"], flight["stride"], flight["train_frames"]) == (180, 2, 0)
