"""Intervals, verdicts and claims on made-up flights whose truth is known."""

import numpy as np
import pytest

from dronekeypp.errors import InputError
from dronekeypp.evaluate import (
    FLIGHT_MEASURES,
    MEASURES,
    bootstrap,
    compare_rows,
    flight_errors,
    interval_of_row,
)
from dronekeypp.files import write_json
from dronekeypp.reproduce import asked, claims, tables
from dronekeypp.reproduce.comparisons import closing_lines, difference, difference_text, differences_to
from dronekeypp.reproduce.evidence import PRINTED_KEYS, Results
from dronekeypp.reproduce.verdicts import Comparison

OURS, THEIRS = ("DroneKey++", None), ("DroneKey", None)
DRONES = ("A", "B", "C", "D", "E", "F", "G")
FLIGHTS = [(scene, drone, k) for scene in (6, 7) for drone in DRONES for k in range(3)]  # 42


def row(rng, mean, seeds=3, of_seed=0.3, of_flight=0.5):
    """Errors (seeds, 42): a mean, what each seed adds, and what each of its flights adds."""
    shape = seeds, len(FLIGHTS)
    return mean + rng.normal(0, of_seed, (seeds, 1)) + rng.normal(0, of_flight, shape)


def recorded_rows(rows, split="test"):
    """A result with these rows: {(method, variant): errors (seeds, 42)}, the same in every measure."""
    entries, listed = [], []
    for (method, variant), matrix in rows.items():
        for seed, values in enumerate(matrix):
            labels = {"method": method, "variant": variant, "seed": seed}
            scene, drone, subsequence = (list(part) for part in zip(*FLIGHTS, strict=True))
            entry = labels | {"split": split, "scene": scene, "drone": drone, "subsequence": subsequence}
            entries.append(entry | dict.fromkeys(FLIGHT_MEASURES, values.tolist()))
            for column in range(0, len(FLIGHTS), 3):
                place = {"scene": scene[column], "drone": drone[column]}
                value = float(values[column : column + 3].mean())
                listed.append(labels | place | dict.fromkeys(MEASURES, value))
    lists = {"rows": [], "validation": [], tables.LISTS[split]: listed}
    return {"name": "made up", "runs": [], "flights": entries, **lists}


# --- intervals --------------------------------------------------------------------------------------------


def test_a_flight_has_the_means_and_medians_of_its_frames():
    frames = {
        "R_deg": np.array([1.0, 2.0, 9.0, 5.0]),
        "t_m": np.array([0.1, 0.2, 0.3, 1 / 3]),
        "t_axis_m": np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9], [1.0, 1.0, 4.0]]),
        "class_correct": np.full(4, np.nan),
        "scene": np.array([6, 6, 6, 7]),
        "label": np.array([1, 1, 1, 0]),
        "subsequence": np.array([2, 2, 2, 0]),
    }
    assert flight_errors(frames, ["A", "B"]) == {
        "scene": [6, 7],
        "drone": ["B", "A"],
        "subsequence": [2, 0],
        "frames": [3, 1],
        "R_mae_deg": [4.0, 5.0],
        "R_medae_deg": [2.0, 5.0],
        "t_mae_m": [0.2, 0.33333],
        "t_medae_m": [0.2, 0.33333],
        "t_axis_mae_m": [0.5, 2.0],
        "class_accuracy": [None, None],
    }


def test_a_difference_draws_the_same_flights_for_both_rows():
    flights = np.random.default_rng(0).normal(5, 10, (1, 42))  # easy and hard ones, the same for both
    apart = compare_rows(flights + 1, flights)
    assert apart.interval == pytest.approx((1, 1)) and apart.verdict == "worse?"
    low, high = interval_of_row(flights)
    assert high - low > 4  # the flights alone would hide it
    assert compare_rows(flights, flights).verdict == "not told apart"
    assert compare_rows(flights, flights + 1, more_is_better=True).verdict == "worse?"


def test_seeds_make_an_interval_wider():
    flights = np.random.default_rng(0).normal(5, 1, (1, 42))
    alike, unlike = np.repeat(flights, 3, axis=0), flights + np.array([[-1], [0], [1]])
    widths = [np.ptp(interval_of_row(values)) for values in (flights, alike, unlike)]
    assert widths[0] == pytest.approx(widths[1]) and widths[2] > 2 * widths[0]
    # By Student's t the mean of three seeds with a spread of 1 lies within ±4.30 / √3 of the truth.
    assert np.ptp(interval_of_row(np.array([[-1.0], [0.0], [1.0]]))) / 2 == pytest.approx(2.48, rel=0.15)


@pytest.mark.parametrize("seeds, of_seed, of_flight", [(1, 0, 1), (3, 1, 0.3)])
def test_equal_rows_are_told_apart_about_once_in_twenty(monkeypatch, seeds, of_seed, of_flight):
    """Whether only the flights of a training vary, or mostly the trainings."""
    monkeypatch.setattr(bootstrap, "DRAWS", 200)
    rng = np.random.default_rng(0)
    apart = 0
    for _ in range(400):
        ours, theirs = (row(rng, 10, seeds, of_seed, of_flight) for _ in range(2))
        apart += compare_rows(ours, theirs).verdict != "not told apart"
    assert 0.025 < apart / 400 < 0.085


def test_rows_that_differ_are_told_apart():
    rng = np.random.default_rng(0)
    recorded = recorded_rows({OURS: row(rng, 10), THEIRS: row(rng, 13)})
    apart = difference(recorded, OURS, THEIRS, "R_mae_deg")
    assert apart.verdict == "better" and apart.interval[0] < -3 < apart.interval[1]
    assert difference(recorded, THEIRS, OURS, "R_mae_deg").verdict == "worse"
    assert difference(recorded, OURS, THEIRS, "class_accuracy").verdict == "worse"  # there more is better
    assert difference(recorded, OURS, THEIRS, "R_mae_deg", "val") is None  # not measured
    two_seeds = recorded_rows({OURS: row(rng, 10), THEIRS: row(rng, 13, seeds=2)})
    assert difference(two_seeds, OURS, THEIRS, "R_mae_deg").verdict == "better?"
    assert difference_text(apart, 1, with_verdict=False).startswith("-") and difference_text(None, 1) == "–"


def test_a_row_of_some_flights_is_compared_on_those():
    rng = np.random.default_rng(0)
    recorded = recorded_rows({OURS: row(rng, 10), THEIRS: row(rng, 10)})
    for entry in recorded["flights"]:
        if entry["method"] == "DroneKey":  # which saw only the first drone of scene 6, and badly
            for key, values in entry.items():
                if isinstance(values, list):
                    entry[key] = values[:3]
            entry["R_mae_deg"] = [20.0, 20.0, 20.0]
    ours = np.mean([entry["R_mae_deg"][:3] for entry in recorded["flights"][:3]])
    assert difference(recorded, THEIRS, OURS, "R_mae_deg").mean == pytest.approx(20 - ours)


# --- pages ------------------------------------------------------------------------------------------------


def test_a_page_counts_its_verdicts():
    rng = np.random.default_rng(0)
    others = [("DroneKey", f"number {k}") for k in range(8)]
    recorded = recorded_rows({OURS: row(rng, 10)} | {name: row(rng, 13) for name in others})
    lines, verdicts = differences_to(recorded, OURS, others, "ours")
    assert verdicts == 8 * len(tables.PRINTED) == sum(text.count("worse") for text in lines[6:])
    assert "holds 40 verdicts at 95 %" in closing_lines(recorded, verdicts)[-1]
    assert "here 2, would still be told apart" in closing_lines(recorded, verdicts)[-1]
    assert closing_lines(recorded, 0) == []


def answered(weights, seed=0, error=1.0, digest="d"):
    """A result of one run."""
    run = {"method": "DroneKey++", "variant": None, "seed": seed, "weights": weights}
    run |= {"epochs": 1, "minutes": 2.0, "rows": [None]}
    means = {"method": "DroneKey++", "variant": None, "seed": seed, "over": "rows"}
    means |= dict.fromkeys(asked.KEPT, error)
    about = {"name": "table", "hardware": "a CPU", "versions": {}}
    return {**about, "dataset": {"digest": digest}, "runs": [run], "averages": [means]}


def test_no_answer_of_the_test_scenes_is_lost(tmp_path):
    path = tmp_path / "table.json"
    first = asked.with_earlier(answered("a", error=1.0), path)
    assert "earlier" not in first and "earlier" not in first["runs"][0]
    write_json(path, first)
    assert asked.with_earlier(answered("a"), path)["runs"] == first["runs"]  # the same weights
    second = asked.with_earlier(answered("b", error=2.0), path)
    [kept] = second["runs"][0]["earlier"]
    assert kept["weights"] == "a" and kept["averages"][0]["t_mae_m"] == 1.0
    write_json(path, second)
    third = asked.with_earlier(answered("c", error=3.0), path)
    assert [entry["weights"] for entry in third["runs"][0]["earlier"]] == ["a", "b"]
    # A kill after another run was recorded alone loses nothing.
    other = asked.with_earlier(answered("x", seed=1), path)
    assert "earlier" not in other["runs"][0] and [e["weights"] for e in other["earlier"]] == ["a", "b"]
    write_json(path, other)
    back = asked.with_earlier(answered("c", error=3.0), path)
    assert [entry["weights"] for entry in back["runs"][0]["earlier"]] == ["a", "b"]
    assert [entry["weights"] for entry in back["earlier"]] == ["x"]
    assert "earlier" not in asked.with_earlier(answered("c", digest="other"), path)["runs"][0]  # other scenes


# --- claims -----------------------------------------------------------------------------------------------


class MadeUp(Results):
    """Results that are not read but given."""

    def __init__(self, **results):
        super().__init__()
        self._read = results


@pytest.mark.parametrize(
    "theirs, seeds, verdict, mark, words",
    [
        (13, 3, claims.REPRODUCED, "", "all four better"),
        (10, 3, claims.DIFFERS, "", "all four not told apart"),
        (7, 3, claims.DIFFERS, "", "all four worse"),
        (13, 1, claims.REPRODUCED, "?", "all four better?"),
    ],
)
def test_a_verdict_is_derived_from_intervals(theirs, seeds, verdict, mark, words):
    """The paper's DroneKey++ is better than its DroneKey in all four numbers."""
    rng = np.random.default_rng(1)
    results = MadeUp(table3=recorded_rows({OURS: row(rng, 10, seeds), THEIRS: row(rng, theirs, seeds)}))
    comparison = Comparison("table3", OURS, (THEIRS,))
    claim = claims.Claim("Table 3", "better", "code", "test", "notebook", "1", compares=comparison)
    assert (claim.derived_verdict(results), claim.mark(results), claim.reason(results)) == (
        verdict,
        mark,
        words,
    )


def test_a_lower_mean_alone_is_no_verdict():
    """Ours is better in the point estimate of every measure; the interval holds 0."""
    rng = np.random.default_rng(3)
    ours = row(rng, 10, of_seed=1)
    theirs = row(rng, 10, of_seed=1)
    theirs += 0.2 + max(0, ours.mean() - theirs.mean())
    results = MadeUp(table3=recorded_rows({OURS: ours, THEIRS: theirs}))
    assert ours.mean() < theirs.mean()
    assert Comparison("table3", OURS, (THEIRS,)).verdict(results) == claims.DIFFERS


def test_the_order_is_the_papers_own():
    """Its YOLO is worse in rotation and ahead in the median translation."""
    yolo = ("YOLOv8n-pose + PnP", None)
    comparison = Comparison("table3", OURS, (yolo,))
    assert comparison.printed_word(yolo, "R_mae_deg") == "better"
    assert comparison.printed_word(yolo, "t_medae_m") == "worse"


def test_a_number_is_of_one_order_or_not(monkeypatch):
    results = MadeUp(table3=recorded_rows({OURS: row(np.random.default_rng(0), 10)}))
    [claim] = [claim for claim in claims.CLAIMS if claim.verdict == claims.SAME_ORDER]
    assert not claim.holds(results)  # 10 degrees may be, 10 m is not
    numbers = dict(zip(PRINTED_KEYS, (10, 8, 0.05, 0.7), strict=True))
    monkeypatch.setattr(results, "row", lambda name: numbers)
    assert claim.holds(results)


def test_editions_are_not_mixed():
    def of(edition):
        return {"dataset": {"edition": edition}}

    MadeUp(a=of(2), b=of(2)).check_editions(["a", "b"])
    with pytest.raises(InputError, match="a is of edition 2, b is of edition 1; reproduce all"):
        MadeUp(a=of(2), b={"dataset": {"digest": "old"}}).check_editions(["a", "b"])
    backgrounds = {"dataset": {"edition": 2}, "datasets": {"photographs": {"edition": 1}}}
    with pytest.raises(InputError, match="different editions"):
        MadeUp(domains=backgrounds).check_editions(["domains"])
