"""The distances between sets of pictures.

They are zero for the same set, grow with the difference, and never have a group on both sides of a test.
"""

import numpy as np
import pytest
import torch

from dronekeypp.errors import InputError
from dronekeypp.model import Backbone, ModelConfig
from dronekeypp.realism import (
    PARTS,
    auc,
    backbone_features,
    covered,
    descriptor,
    frechet,
    held_out_scores,
    interval,
    kernel_mmd,
)


def cloud(n: int = 300, shift: float = 0.0, scale: float = 1.0, seed: int = 0, D: int = 6) -> np.ndarray:
    """Draw features (n, D) from a normal distribution."""
    return np.random.default_rng(seed).normal(shift, scale, (n, D))


def shift_of_means(a: np.ndarray, b: np.ndarray) -> float:
    return b.mean() - a.mean()


def test_the_frechet_distance_of_known_normals() -> None:
    a, b = cloud(20000), cloud(20000, shift=2.0, scale=3.0, seed=1)
    by_hand = 6 * (2**2 + (3 - 1) ** 2)  # on each of 6 axes: shift² + (difference of the deviations)²
    assert frechet(a, b) == pytest.approx(by_hand, rel=0.03)
    assert abs(frechet(a, a)) < 1e-8
    assert frechet(a, b) == pytest.approx(frechet(b, a))


def test_the_frechet_distance_ignores_a_rotation_of_a_round_cloud() -> None:
    b = cloud(20000, shift=2.0, scale=3.0, seed=1)
    rotated = b @ np.linalg.qr(cloud(6, seed=3))[0]
    assert frechet(b - b.mean(axis=0), rotated - rotated.mean(axis=0)) == pytest.approx(0, abs=0.1)


def test_mmd_is_about_zero_for_one_kind_and_grows() -> None:
    same = [kernel_mmd(cloud(seed=2 * i), cloud(seed=2 * i + 1)) for i in range(20)]
    assert abs(np.mean(same)) < 3 * np.std(same) / np.sqrt(20) + 1e-3
    near = kernel_mmd(cloud(), cloud(shift=0.5, seed=1))
    far = kernel_mmd(cloud(), cloud(shift=1.0, seed=1))
    assert max(same) < near < far


def test_coverage() -> None:
    assert covered(cloud(), cloud(seed=1)).mean() > 0.9
    assert not covered(cloud(), cloud(shift=20.0, seed=1)).any()
    real = cloud()
    real[:150] += 50  # far from all made pictures
    assert covered(real, cloud(seed=1)).mean() == pytest.approx(0.5, abs=0.1)


def test_the_classifier_is_tested_on_groups_it_has_not_seen() -> None:
    """The groups differ, the sets do not. A split of groups would find a difference between the sets."""
    rng = np.random.default_rng(0)
    group_means = rng.normal(0, 5, (40, 60))
    groups = np.repeat(np.arange(20), 15)
    a = group_means[groups] + rng.normal(0, 0.1, (300, 60))
    b = group_means[groups + 20] + rng.normal(0, 0.1, (300, 60))
    assert abs(auc(*held_out_scores(a, b, groups, groups)) - 0.5) < 0.3
    single_frames = np.arange(300)
    assert auc(*held_out_scores(a, b, single_frames, single_frames)) > 0.95  # the classifier is misled
    assert auc(*held_out_scores(a, b + 30, groups, groups)) > 0.99


def test_the_classifier_needs_as_many_groups_as_folds() -> None:
    groups = np.repeat(np.arange(20), 15)
    with pytest.raises(InputError, match="needs as many groups"):
        held_out_scores(cloud(), cloud(seed=1), groups // 10, groups)


def test_an_interval_leaves_out_groups() -> None:
    x, groups = np.repeat(cloud(10, D=1), 30, axis=0), np.repeat(np.arange(10), 30)
    low, high = interval(np.mean, [x], [groups])
    low_by_frame, high_by_frame = interval(np.mean, [x], [np.arange(300)])
    assert low < x.mean() < high
    assert high - low > 3 * (high_by_frame - low_by_frame)  # ten groups say less than 300 pictures would
    # For a mean the jackknife gives the standard error of the textbooks.
    assert high - x.mean() == pytest.approx(1.96 * x[::30].std(ddof=1) / np.sqrt(10))


def test_an_interval_of_a_distance_holds_the_truth() -> None:
    """The means of two clouds are 1 apart, and the interval should hold 1 in about 95 of 100 draws."""
    groups = np.arange(60) // 2
    inside = 0
    for k in range(40):
        a, b = cloud(60, seed=2 * k), cloud(60, shift=1.0, seed=2 * k + 1)
        low, high = interval(shift_of_means, [a, b], [groups, groups])
        inside += low < 1 < high
    assert inside >= 34


def test_what_paired_sets_share_cancels() -> None:
    """The same flights in front of two backgrounds: what a flight adds to both is no difference."""
    flights = np.repeat(np.arange(12), 10)
    flight_means = np.random.default_rng(0).normal(0, 5, 12)[flights][:, None]
    a = flight_means + cloud(120, D=1)
    b = flight_means + cloud(120, shift=1.0, seed=1, D=1)
    separate = np.ptp(interval(shift_of_means, [a, b], [flights, flights]))
    paired = np.ptp(interval(shift_of_means, [a, b], [flights, flights], paired=(0, 1)))
    assert paired < separate / 5


def random_images() -> torch.Tensor:
    torch.manual_seed(0)
    return torch.rand(4, 3, 48, 48)


def test_the_descriptor_is_finite() -> None:
    features = descriptor(random_images())
    assert features.shape == (4, 3 * 8 + 16 + 16 * 8)
    assert np.isfinite(features).all()
    assert np.isfinite(descriptor(torch.zeros(1, 3, 48, 48))).all()


def test_the_descriptor_sees_tones() -> None:
    images = random_images()
    tones = descriptor(images)[:, PARTS["tones"]].reshape(4, 3, 8)
    np.testing.assert_allclose(tones.sum(axis=2), 1, atol=1e-5)
    dark_tones = descriptor(images * 0.1)[:, PARTS["tones"]].reshape(4, 3, 8)
    assert (dark_tones[:, :, 0] > 0.99).all()  # nearly all pixels have the darkest tone


def test_the_descriptor_sees_sharpness() -> None:
    images = random_images()
    blurred = torch.nn.functional.avg_pool2d(images, 5, 1, 2)
    sharp_rings = descriptor(images)[:, PARTS["sharpness"]]
    blurred_rings = descriptor(blurred)[:, PARTS["sharpness"]]
    assert (blurred_rings[:, 12:] < sharp_rings[:, 12:] - 1).all()  # the highest frequencies are gone


def test_the_descriptor_sees_the_direction_of_edges() -> None:
    stripes = torch.sin(torch.arange(48) / 2).expand(1, 3, 48, 48) / 2 + 0.5
    upright = descriptor(stripes)[0, PARTS["edges"]].reshape(16, 8).mean(axis=0)
    lying = descriptor(stripes.transpose(2, 3))[0, PARTS["edges"]].reshape(16, 8).mean(axis=0)
    assert set(np.argsort(upright)[-2:]) == {0, 4}
    assert set(np.argsort(lying)[-2:]) == {2, 6}


def test_backbone_features_leave_the_backbone_as_it_was() -> None:
    backbone = Backbone(ModelConfig(image_size=32), load=False).train()
    features = backbone_features(backbone, torch.rand(5, 3, 32, 32), batch=2)
    assert features.shape == (5, 256)
    assert backbone.training
