"""Distances between sets of pictures: zero for the same, growing with the difference, and no group on both sides of a test."""

import numpy as np
import pytest
import torch

from dronekeypp.errors import InputError
from dronekeypp.model import Backbone, ModelConfig
from dronekeypp.realism import (
    auc,
    backbone_features,
    covered,
    descriptor,
    frechet,
    held_out_scores,
    interval,
    kernel_mmd,
)


def cloud(n=300, shift=0.0, scale=1.0, seed=0, D=6):
    return np.random.default_rng(seed).normal(shift, scale, (n, D))


def test_the_frechet_distance_of_known_normals():
    a, b = cloud(20000), cloud(20000, shift=2.0, scale=3.0, seed=1)
    assert frechet(a, b) == pytest.approx(
        6 * (2**2 + (3 - 1) ** 2), rel=0.03
    )  # by hand: per axis, shift² + (difference of deviations)²
    assert abs(frechet(a, a)) < 1e-8 and frechet(a, b) == pytest.approx(frechet(b, a))
    turned = b @ np.linalg.qr(cloud(6, seed=3)[:, :6])[0]
    assert frechet(b - b.mean(0), turned - turned.mean(0)) == pytest.approx(
        0, abs=0.1
    )  # a round cloud looks the same from everywhere


def test_mmd_is_about_zero_for_one_kind_and_grows():
    same = [kernel_mmd(cloud(seed=2 * i), cloud(seed=2 * i + 1)) for i in range(20)]
    assert abs(np.mean(same)) < 3 * np.std(same) / np.sqrt(20) + 1e-3
    assert (
        max(same)
        < kernel_mmd(cloud(), cloud(shift=0.5, seed=1))
        < kernel_mmd(cloud(), cloud(shift=1.0, seed=1))
    )


def test_coverage():
    assert covered(cloud(), cloud(seed=1)).mean() > 0.9
    assert not covered(cloud(), cloud(shift=20.0, seed=1)).any()
    half = cloud()
    half[:150] += 50
    assert covered(half, cloud(seed=1)).mean() == pytest.approx(
        0.5, abs=0.1
    )  # made pictures miss half of the real ones


def test_the_classifier_is_tested_on_groups_it_has_not_seen():
    """Every group has a look of its own, the sets have none: who splits groups finds a difference that is not there."""
    rng = np.random.default_rng(0)
    looks = rng.normal(0, 5, (40, 60))
    groups = np.repeat(np.arange(20), 15)
    a, b = (looks[groups + k] + rng.normal(0, 0.1, (300, 60)) for k in (0, 20))
    assert abs(auc(*held_out_scores(a, b, groups, groups)) - 0.5) < 0.3
    assert (
        auc(*held_out_scores(a, b, np.arange(300), np.arange(300))) > 0.95
    )  # frames as groups of their own: fooled
    assert auc(*held_out_scores(a, b + 30, groups, groups)) > 0.99
    with pytest.raises(InputError, match="needs as many groups"):
        held_out_scores(a, b, groups // 10, groups)


def test_an_interval_leaves_out_groups():
    x, groups = np.repeat(cloud(10, D=1), 30, axis=0), np.repeat(np.arange(10), 30)
    low, high = interval(lambda v: v.mean(), [x], [groups])
    narrow = interval(lambda v: v.mean(), [x], [np.arange(300)])
    assert low < x.mean() < high and high - low > 3 * (narrow[1] - narrow[0])  # ten groups, not 300 pictures
    by_hand = (
        1.96 * x[::30].std(ddof=1) / np.sqrt(10)
    )  # of a mean, the jackknife gives the textbook's standard error
    assert high - x.mean() == pytest.approx(by_hand)


def test_an_interval_of_a_distance_holds_the_truth():
    """Two clouds one apart: the interval of the difference of their means holds 1 in about 95 draws of 100."""
    inside = 0
    for k in range(40):
        a, b = cloud(60, seed=2 * k), cloud(60, shift=1.0, seed=2 * k + 1)
        low, high = interval(lambda p, q: q.mean() - p.mean(), [a, b], [np.arange(60) // 2] * 2)
        inside += low < 1 < high
    assert inside >= 34


def test_what_sets_share_is_no_difference_between_them():
    """The same flights before two backgrounds: what is common to a flight cancels in a paired difference."""
    flights = np.repeat(np.arange(12), 10)
    common = np.random.default_rng(0).normal(0, 5, 12)[flights][:, None]
    one, other = common + cloud(120, D=1), common + cloud(120, shift=1.0, seed=1, D=1)
    apart = lambda a, b: b.mean() - a.mean()  # noqa: E731
    alone, together = (
        np.ptp(interval(apart, [one, other], [flights, flights], paired=paired)) for paired in ((), (0, 1))
    )
    assert together < alone / 5


def test_the_descriptor_sees_tone_sharpness_and_edges():
    torch.manual_seed(0)
    images = torch.rand(4, 3, 48, 48)
    found = descriptor(images)
    assert found.shape == (4, 3 * 8 + 16 + 16 * 8) and np.isfinite(found).all()
    np.testing.assert_allclose(found[:, :24].reshape(4, 3, 8).sum(axis=2), 1, atol=1e-5)
    dark = descriptor(images * 0.1)
    assert (dark[:, [0, 8, 16]] > 0.99).all()  # all in the darkest tone
    blurred = descriptor(torch.nn.functional.avg_pool2d(images, 5, 1, 2))
    assert (
        blurred[:, 24 + 12 : 24 + 16] < found[:, 24 + 12 : 24 + 16] - 1
    ).all()  # the highest frequencies are gone
    stripes = torch.sin(torch.arange(48) / 2).expand(1, 3, 48, 48) / 2 + 0.5
    across, along = (
        descriptor(s)[0, 40:].reshape(16, 8).mean(axis=0) for s in (stripes, stripes.transpose(2, 3))
    )
    assert set(np.argsort(across)[-2:]) == {0, 4} and set(np.argsort(along)[-2:]) == {2, 6}
    assert np.isfinite(descriptor(torch.zeros(1, 3, 48, 48))).all()


def test_backbone_features_leave_the_backbone_as_it_was():
    backbone = Backbone(ModelConfig(image_size=32), load=False).train()
    found = backbone_features(backbone, torch.rand(5, 3, 32, 32), batch=2)
    assert found.shape == (5, 256) and backbone.training
