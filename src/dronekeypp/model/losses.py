"""Compute the five losses (Sec. III-C, Eq. 9-12) and the weight schedules of Table 6."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, mse_loss

from dronekeypp import rotations
from dronekeypp.errors import InputError

ENCODER_TERMS = ("L_2D", "L_cls")  # Eq. 9
DECODER_TERMS = ("L_3D", "L_rot", "L_trans")  # Eq. 11
TERMS = ENCODER_TERMS + DECODER_TERMS
SCHEDULES = ("equal", "tanh", "shifted", "biased")


def circular_loss(predicted: Tensor, true: Tensor) -> Tensor:
    """Return the mean squared distance of angles, the short way round (Eq. 10).

    The normalised angles (B, 3) are in turns, where 0 and 1 are the same point.
    """
    apart = (predicted - true).abs()
    return torch.minimum(apart, 1 - apart).square().mean()


def loss_terms(output: dict, batch: dict, keypoint_unit: float = 1.0) -> dict[str, Tensor]:
    """Return the five terms of Eq. 9 and 11 as scalars, unweighted.

    They are:
        L_2D: the MSE over 4x2 numbers, in the square of the unit of y2D.
        L_cls: the cross-entropy.
        L_3D: the MSE over 4x3 numbers in m²; 0 without keypoints_3d.
        L_rot: Eq. 10 in turns² where there are angles. Elsewhere it is the MSE over the 9 numbers of R, which
            is 8 sin²(angle/2) / 9: about 26 times Eq. 10 for a small turn about one axis.
        L_trans: the MSE over 3 numbers in m².

    `keypoint_unit` is the side of the crop in the unit of y2D: 1 measures L_2D in crop units, 96 in pixels of
    a 96 px crop. The paper does not name its unit, and calls all weights equal. L_2D grows with the square of
    the unit, so the unit *is* the weight of L_2D: too small starves the keypoints, too large starves the
    rest.
    """
    zero = output["t"].new_zeros(())
    if output.get("angles") is not None:
        rotation = circular_loss(output["angles"], rotations.matrix_to_angles(batch["R"]))
    else:
        rotation = mse_loss(output["R"], batch["R"])
    points = output.get("keypoints_3d")
    return {
        "L_2D": mse_loss(output["keypoints"], batch["keypoints"]) * keypoint_unit**2,
        "L_cls": cross_entropy(output["class_logits"], batch["label"]),
        "L_3D": zero if points is None else mse_loss(points, batch["keypoints_3d"]),
        "L_rot": rotation,
        "L_trans": mse_loss(output["t"], batch["t"]),
    }


def loss_weights(schedule: str, progress: float) -> tuple[float, float]:
    """Return the weights of L_enc and L_dec at some progress of the training (Table 6).

    The paper prints no formula. "equal" is 1 and 1 (Eq. 12), "biased" is 1 and 5. "tanh" switches steeply
    from the encoder to the decoder at half of the training. "shifted" does it as one half cosine over the
    whole run.

    Args:
        schedule: one of SCHEDULES.
        progress: 0 at the first step, 1 at the last.

    Raises:
        InputError: there is no such schedule.
    """
    if schedule == "equal":
        return 1.0, 1.0
    if schedule == "biased":
        return 1.0, 5.0
    if schedule == "tanh":
        decoder = 0.5 * (1 + math.tanh(20 * (progress - 0.5)))
    elif schedule == "shifted":
        decoder = 0.5 * (1 - math.cos(math.pi * progress))
    else:
        raise InputError(f"schedule={schedule!r} is not one of: {', '.join(SCHEDULES)}")
    return 1.0 - decoder, decoder


def total_loss(terms: dict[str, Tensor], weights: tuple[float, float] = (1.0, 1.0)) -> Tensor:
    """Return the total loss of Eq. 12: L_enc + L_dec, each times its weight.

    For a method that has only some of the terms, those are summed.

    Raises:
        InputError: a term is not one of TERMS.
    """
    unknown = set(terms) - set(TERMS)
    if unknown:
        raise InputError(f"unknown loss term {sorted(unknown)[0]!r}; known: {', '.join(TERMS)}")
    encoder = sum(terms[name] for name in ENCODER_TERMS if name in terms)
    decoder = sum(terms[name] for name in DECODER_TERMS if name in terms)
    return weights[0] * encoder + weights[1] * decoder
