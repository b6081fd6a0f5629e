"""Losses against values worked out by hand (Eq. 9-12), and the schedules of Table 6."""

import math

import pytest
import torch
from fakes import turn

from dronekeypp import rotations
from dronekeypp.errors import InputError
from dronekeypp.model import TERMS, circular_loss, loss_terms, loss_weights, total_loss


def truth():
    """The true values of two frames."""
    return {
        "keypoints": torch.full((2, 4, 2), 0.5),
        "label": torch.tensor([0, 3]),
        "keypoints_3d": torch.zeros(2, 4, 3),
        "R": torch.stack([turn(0, 10), turn(1, 20)]),
        "t": torch.tensor([[0.0, 0.0, 4.0], [1.0, 1.0, 2.0]]),
    }


def perfect():
    """The output of a network that is right about both frames of `truth`."""
    output = truth()
    output["class_logits"] = torch.full((2, 7), -50.0)
    output["class_logits"][0, 0] = 50.0
    output["class_logits"][1, 3] = 50.0
    output["angles"] = rotations.matrix_to_angles(output["R"])
    return output


def test_perfect_answers_cost_nothing():
    terms = loss_terms(perfect(), truth())
    assert tuple(terms) == TERMS
    for value in terms.values():
        assert value < 1e-9


def test_each_term_by_hand():
    """With one wrong number in each output, every term is the value worked out by hand."""
    output = perfect()
    output["keypoints"][0, 0, 0] += 0.4  # one of 16 numbers
    output["class_logits"] = torch.zeros(2, 7)
    output["keypoints_3d"][1, 2, 1] = 0.6  # one of 24
    output["t"][0, 2] = 7.0  # one of 6, 3 m off
    output["angles"] = output["angles"].clone()
    output["angles"][0, 0] += 0.3  # one of 6
    terms = {name: float(value) for name, value in loss_terms(output, truth()).items()}
    expected = {
        "L_2D": 0.16 / 16,
        "L_cls": math.log(7),
        "L_3D": 0.36 / 24,
        "L_rot": 0.09 / 6,
        "L_trans": 9 / 6,
    }
    assert terms == pytest.approx(expected, rel=1e-4)
    assert float(total_loss(loss_terms(output, truth()))) == pytest.approx(sum(expected.values()), rel=1e-4)
    encoder = expected["L_2D"] + expected["L_cls"]
    decoder = expected["L_3D"] + expected["L_rot"] + expected["L_trans"]
    weighted = total_loss(loss_terms(output, truth()), (0.5, 5.0))
    assert float(weighted) == pytest.approx(0.5 * encoder + 5 * decoder, rel=1e-4)


def test_the_unit_of_the_keypoints_is_a_weight():
    """L_2D grows with the square of the unit in which keypoints are measured."""
    output = perfect()
    output["keypoints"] += 0.1
    in_units = loss_terms(output, truth(), 1.0)["L_2D"]
    in_pixels = loss_terms(output, truth(), 96.0)["L_2D"]
    assert float(in_units) == pytest.approx(0.01, rel=1e-4)
    assert float(in_pixels) == pytest.approx(9.6**2, rel=1e-4)


def test_circular_loss_takes_the_short_way_round():
    """Angles on both sides of 0 are close, in either order; half a turn is the worst case."""
    a, b = torch.tensor([[0.98, 0.5, 0.0]]), torch.tensor([[0.02, 0.1, 1.0]])
    assert float(circular_loss(a, b)) == pytest.approx((0.04**2 + 0.4**2 + 0.0) / 3, rel=1e-5)
    assert circular_loss(a, b) == circular_loss(b, a)
    half_a_turn = circular_loss(torch.tensor([[0.25]]), torch.tensor([[0.75]]))
    assert float(half_a_turn) == pytest.approx(0.25)


def test_sixd_rotation_loss_is_the_chord():
    """Without angles, L_rot is the mean squared error of R, which is 8 sin²(angle/2) / 9 for one frame."""
    output = perfect()
    output["angles"] = None
    output["R"] = output["R"] @ turn(2, 40)
    expected = 8 * math.sin(math.radians(20)) ** 2 / 9
    assert float(loss_terms(output, truth())["L_rot"]) == pytest.approx(expected, rel=1e-4)


def test_a_head_left_out_costs_nothing():
    """Without 3D keypoints, L_3D is 0."""
    output = perfect()
    output["keypoints_3d"] = None
    assert loss_terms(output, truth())["L_3D"] == 0


def test_schedules():
    """Two schedules are constant; the other two move the weight from the encoder to the decoder."""
    assert loss_weights("equal", 0.3) == (1, 1)
    assert loss_weights("biased", 0.3) == (1, 5)
    for name in ("tanh", "shifted"):
        weights = [loss_weights(name, step / 10) for step in range(11)]
        for encoder, decoder in weights:
            assert encoder + decoder == pytest.approx(1)
        assert weights[0][0] > 0.999
        assert weights[5] == pytest.approx((0.5, 0.5))
        assert weights[10][1] > 0.999
        decoder_weights = [decoder for _, decoder in weights]
        assert decoder_weights == sorted(decoder_weights)
    # The switch is abrupt in "tanh" and spread out in "shifted".
    assert loss_weights("tanh", 0.4)[1] < 0.02 < 0.3 < loss_weights("shifted", 0.4)[1]
    with pytest.raises(InputError, match="schedule='late' is not one of: equal, tanh"):
        loss_weights("late", 0.5)
