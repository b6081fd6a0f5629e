"""Errors of single frames by hand, their summaries by scene and drone, and the constant answer."""

import json

import numpy as np
import pytest
import torch
from fakes import FakeDrones, tiny_config, turn
from torch import nn
from torch.utils.data import default_collate

from dronekeypp.camera import square_around
from dronekeypp.data import read_annotations
from dronekeypp.errors import InputError
from dronekeypp.evaluate import (
    MEASURES,
    averages,
    constant_baseline,
    evaluate,
    format_table,
    frame_errors,
    summarise,
)
from dronekeypp.model import DroneKeyPP, loss_terms
from dronekeypp.rotations import best_constant_rotation, geodesic_degrees

NAMES = list("ABCDEFG")


class Oracle(nn.Module):
    """It knows every frame of a FakeDrones by its camera square, and errs by known amounts."""

    def __init__(self, data, R_error, t_error):
        super().__init__()
        self.data, self.R_error, self.t_error = data, R_error, torch.tensor(t_error)
        self.weight = nn.Parameter(torch.zeros(()))

    def forward(self, image, K, square):
        same = (self.data["square"] == square[:, None]).all(dim=-1)  # (B, frames)
        rows = same.nonzero()[:, 1]
        return {
            "R": self.data["R"][rows] @ self.R_error,
            "t": self.data["t"][rows] + self.t_error,
            "keypoints": self.data["keypoints"][rows] + torch.tensor([0.03, 0.04]),
            "class_probs": torch.eye(7)[self.data["label"][rows]],
        }


def test_known_errors_come_back():
    """Every measure is what the known errors of the Oracle make it."""
    dataset = FakeDrones(24)
    data = dataset.data
    frames = evaluate(Oracle(data, turn(0, 12), [0.0, 0.3, 0.4]), dataset, batch=7)
    np.testing.assert_allclose(frames["R_deg"], 12, atol=1e-2)
    np.testing.assert_allclose(frames["t_m"], 0.5, atol=1e-5)
    np.testing.assert_allclose(frames["t_axis_m"], np.tile([0, 0.3, 0.4], (24, 1)), atol=1e-5)
    np.testing.assert_allclose(frames["keypoint_crop_px"], 0.05 * 32, rtol=1e-3)
    np.testing.assert_allclose(frames["keypoint_px"], 0.05 * data["square"][:, 2], rtol=1e-3)
    distance = data["t"].norm(dim=1).numpy()
    predicted = (data["t"] + torch.tensor([0.0, 0.3, 0.4])).norm(dim=1).numpy()
    np.testing.assert_allclose(frames["distance_ratio"], predicted / distance, rtol=1e-5)
    # The law of cosines in the triangle of the camera, the true and the predicted place.
    cosine = (predicted**2 + distance**2 - 0.5**2) / (2 * predicted * distance)
    np.testing.assert_allclose(np.cos(np.radians(frames["direction_deg"])), cosine, atol=1e-5)
    assert frames["class_correct"].all()
    assert not frames["flip"].any()
    assert not frames["failed"].any()
    assert frames["frame"].tolist() == list(range(24))
    np.testing.assert_allclose(np.cos(np.radians(frames["heading_deg"])), heading_cosine(data), atol=1e-4)


def heading_cosine(data):
    """The cosine (F,) of the angle between the nose and the way from the drone to the camera."""
    away = data["t"] / data["t"].norm(dim=1, keepdim=True)
    return -(data["R"][:, :, 0] * away).sum(dim=1).numpy()


@pytest.mark.parametrize("error, share", [(0.041, 1.0), (0.042, 0.0)])
def test_pck_counts_keypoints_within_a_twentieth_of_the_box(error, share):
    """The box's longer side is the crop's over 1.2, so 5 % of it are 0.0417 crop units.

    The output holds keypoints only, so every measure of the pose and of the class is missing.
    """
    assert square_around((0, 0, 100, 50))[2] == 120
    data = FakeDrones(5).data
    output = {"keypoints": data["keypoints"] + torch.tensor([error, 0.0])}
    frames = frame_errors(output, {**data, "image": torch.zeros(5, 3, 32, 32)})
    assert (frames["pck"] == share).all()
    assert np.isnan(frames["R_deg"]).all()
    assert np.isnan(frames["class_correct"]).all()
    assert (frames["predicted"] == -1).all()


@pytest.mark.parametrize(
    "axis, angle, flipped", [(2, 100, True), (2, 80, False), (0, 170, False), (1, 100, True)]
)
def test_a_flip_is_a_nose_that_points_the_other_way(axis, angle, flipped):
    dataset = FakeDrones(4)
    frames = evaluate(Oracle(dataset.data, turn(axis, angle), [0.0, 0.0, 0.0]), dataset)
    assert (frames["flip"] == flipped).all()


def test_rows_by_scene_and_drone():
    """Rows and averages are worked out by hand from four frames, and print as an aligned table."""
    frames = {
        "R_deg": np.array([1.0, 2.0, 6.0, 10.0]),
        "t_m": np.array([0.1, 0.2, 0.6, 1.0]),
        "t_axis_m": np.ones((4, 3)) * 0.1,
        "class_correct": np.array([True, True, False, True]),
        "keypoint_px": np.ones(4),
        "keypoint_crop_px": np.ones(4),
        "pck": np.ones(4),
        "failed": np.zeros(4, dtype=bool),
        "distance_ratio": np.ones(4),
        "direction_deg": np.zeros(4),
        "flip": np.array([False, False, True, False]),
        "scene": np.array([6, 6, 6, 7]),
        "label": np.array([1, 1, 1, 0]),
        "subsequence": np.array([0, 0, 1, 0]),
    }
    rows = summarise(frames, NAMES, method="DroneKey++", seed=0)
    labels = ("scene", "drone", "frames", "method", "seed")
    assert len(rows) == 2
    assert [rows[0][label] for label in labels] == [6, "B", 3, "DroneKey++", 0]
    assert [rows[1][label] for label in labels] == [7, "A", 1, "DroneKey++", 0]
    assert rows[0]["R_mae_deg"] == pytest.approx(3)
    assert rows[0]["R_medae_deg"] == 2
    assert rows[0]["flip_rate"] == pytest.approx(1 / 3)
    assert rows[0]["class_accuracy"] == pytest.approx(2 / 3)
    assert rows[0]["t_medae_m"] == pytest.approx(0.2)
    by_rows, by_frames = averages(frames, draws=50, method="DroneKey++")
    assert by_rows["over"] == "rows"
    assert by_rows["R_mae_deg"] == pytest.approx(6.5)
    assert by_frames["over"] == "frames"
    assert by_frames["R_mae_deg"] == pytest.approx(4.75)
    low, high = by_frames["R_mae_deg_ci95"]
    assert 1 <= low <= 4.75 <= high <= 10
    _, drawn_again = averages(frames, draws=50)
    assert by_frames["R_mae_deg_ci95"] == drawn_again["R_mae_deg_ci95"]  # the same draws every time
    lines = format_table(rows + [by_rows, by_frames]).splitlines()
    assert len(lines) == 5
    assert len({len(line) for line in lines}) == 1
    json.dumps(rows + [by_rows, by_frames])
    assert set(MEASURES) <= set(rows[0])


def test_evaluation_is_quiet_about_randomness_and_mode():
    """Evaluating leaves the random state and the training mode alone. The batch size does not matter."""
    model, dataset = DroneKeyPP(tiny_config()), FakeDrones(10)
    model.train()
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    first = evaluate(model, dataset, batch=4)
    assert torch.equal(torch.rand(1), expected)
    assert model.training
    second = evaluate(model, dataset, batch=10)
    np.testing.assert_allclose(first["R_deg"], second["R_deg"], atol=1e-2)


def test_losses_are_means_over_frames():
    """A last batch that is smaller than the others does not shift the mean loss."""
    model, dataset = DroneKeyPP(tiny_config()), FakeDrones(10)
    in_batches = evaluate(model, dataset, batch=3, criterion=loss_terms)["losses"]
    at_once = evaluate(model, dataset, batch=10, criterion=loss_terms)["losses"]
    assert in_batches == pytest.approx(at_once, rel=1e-4)


def test_nothing_and_nan_are_errors():
    """A data set without frames and a true pose that holds NaN are refused."""
    dataset = FakeDrones(6)
    with pytest.raises(InputError, match="no frames"):
        evaluate(Oracle(dataset.data, turn(0, 1), [0.0] * 3), torch.utils.data.Subset(dataset, []))
    dataset.data["t"] = dataset.data["t"].clone()
    dataset.data["t"][3, 1] = float("nan")
    with pytest.raises(InputError, match="frame 3 .scene 2. is not finite"):
        evaluate(Oracle(dataset.data, turn(0, 1), [0.0] * 3), dataset)


def test_constant_rotation_is_at_least_as_good_as_any_candidate():
    """No rotation of the set has a smaller median angle to the set.

    Of turns about one axis the best is the middle one.
    """
    R = FakeDrones(300).data["R"]
    best = best_constant_rotation(R)
    torch.testing.assert_close(best @ best.T, torch.eye(3), atol=1e-5, rtol=0)
    median = geodesic_degrees(best[None], R).median()
    for candidate in R:
        assert median <= geodesic_degrees(candidate[None], R).median() + 1e-3
    turns = torch.stack([turn(2, angle) for angle in (-10, 0, 10, 0, 0)])
    torch.testing.assert_close(best_constant_rotation(turns), torch.eye(3), atol=1e-5, rtol=0)


class WithoutAnnotations(torch.utils.data.Dataset):
    """The first five frames of a data set, without its method `annotations`."""

    def __init__(self, dataset):
        self.dataset = dataset

    def __len__(self):
        return 5

    def __getitem__(self, i):
        return self.dataset[i]


def test_constant_baseline_needs_no_images_but_one():
    """The constant answer is the median of the training set, and is measured on annotations alone.

    Annotations can also be read from a data set that only gives items.
    """
    train, test = FakeDrones(100, seed=1), FakeDrones(40, seed=2)
    frames = constant_baseline(train, test)
    assert np.allclose(frames["t"], train.data["t"].median(dim=0).values)
    assert len(frames["R_deg"]) == 40
    assert len(np.unique(frames["predicted"])) == 1
    rows = summarise(frames, NAMES, method="constant")
    assert sum(row["frames"] for row in rows) == 40
    batch = default_collate([test[i] for i in range(3)])
    output = {
        "R": torch.eye(3).expand(3, 3, 3),
        "t": batch["t"],
        "keypoints": batch["keypoints"],
        "class_probs": torch.eye(7)[batch["label"]],
    }
    assert frame_errors(output, batch)["t_m"].max() == 0
    annotations = read_annotations(WithoutAnnotations(test))
    assert torch.equal(annotations["t"], test.data["t"][:5])
    assert "image" not in annotations


class Guess:
    """It is called like a network without being one.

    It has no parameters, answers in float64, and gives no more than a place and scores below 0.
    """

    def __call__(self, image, K, square):
        scores = torch.full((len(K), 7), -9.0, dtype=torch.float64)
        scores[:, 2] = -0.1
        t = torch.tensor([0.0, 0.0, 4.0], dtype=torch.float64).expand(len(K), 3)
        return {"t": t, "class_probs": scores}


def test_whatever_is_called_like_a_network_can_be_measured():
    """Measures of what a method does not answer are NaN, and scores that are NaN count as no class."""
    dataset = FakeDrones(12)
    frames = evaluate(Guess(), dataset)
    assert np.isnan(frames["R_deg"]).all()
    assert np.isfinite(frames["t_m"]).all()
    assert (frames["predicted"] == 2).all()
    without_image = frame_errors(Guess()(None, dataset.data["K"], None), dataset.data)
    np.testing.assert_array_equal(without_image["t_m"], frames["t_m"])
    assert np.isnan(without_image["keypoint_crop_px"]).all()
    no_class = {"t": dataset.data["t"], "class_probs": torch.full((12, 7), torch.nan)}
    assert (frame_errors(no_class, dataset.data)["predicted"] == -1).all()


def test_a_table_of_two_methods_names_them():
    """The method is a column of the table only when there is more than one."""
    frames = evaluate(Guess(), FakeDrones(12))
    guess = summarise(frames, NAMES, method="Guess")
    another = summarise(frames, NAMES, method="Another")
    assert "Guess" not in format_table(guess)
    table = format_table(guess + another)
    assert "Another" in table
    assert len({len(line) for line in table.splitlines()}) == 1
