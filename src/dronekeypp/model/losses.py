"""The five losses (Sec. III-C, Eq. 9-12) and the weight schedules of Table 6."""

from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, mse_loss, smooth_l1_loss

from dronekeypp import rotations
from dronekeypp.errors import InputError

ENCODER_TERMS = ("L_2D", "L_cls")  # Eq. 9
DECODER_TERMS = ("L_3D", "L_rot", "L_trans")  # Eq. 11
TERMS = ENCODER_TERMS + DECODER_TERMS
LIKELIHOOD_WEIGHT = 0.01  # weight of the likelihoods of `geometric_loss_terms`
KEYPOINT_NEAR = 0.02  # crop units, 2 of 96 px: what most keypoints reach
METRES_NEAR = 0.05  # m
TURN_NEAR = 0.03  # of ‖R - R*‖, which is 1.4 times a small angle in radians: 1.2°
SCHEDULES = ("equal", "tanh", "shifted", "biased")


def circular_loss(predicted: Tensor, true: Tensor) -> Tensor:
    """Eq. 10: mean squared distance of normalised angles (B, 3) in turns, the short way round (0 and 1 are one point)."""
    apart = (predicted - true).abs()
    return torch.minimum(apart, 1 - apart).square().mean()


def loss_terms(output: dict, batch: dict, keypoint_unit: float = 1.0) -> dict[str, Tensor]:
    """The five terms of Eq. 9 and 11 as scalars, unweighted.

    `keypoint_unit` is the side of the crop in the unit of y2D: 1 measures L_2D in crop units, 96 in pixels of a 96 px
    crop. The paper does not name its unit, and calls all weights equal. L_2D grows with the unit's square, so the unit
    *is* L_2D's weight: too small starves the keypoints, too large starves the rest.

    L_2D: MSE over 4x2 numbers · L_cls: cross-entropy · L_3D: MSE over 4x3 numbers, m² · L_trans: MSE over 3 numbers, m².
    L_rot: Eq. 10 in turns² for the Euler head; for the 6D head MSE over the 9 numbers of R, 8 sin²(angle/2) / 9, which
    is about 26 times Eq. 10 for a small turn about one axis. Without angles it is R that counts, and without keypoints_3d L_3D is 0.
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


def geometric_loss_terms(output: dict, batch: dict, keypoint_unit: float = 1.0) -> dict[str, Tensor]:
    """The same five terms for `pose="geometric"` (see geometry.py), which answers twice: a first guess and the refined pose.

    L_2D: absolute error of the sharp and of the encoder's own keypoints, which pulls as hard as the paper's squares do at KEYPOINT_NEAR: from near
    still, and from far no harder (Sun et al., ECCV 2018) · L_rot, L_trans: distance of the direct branch's and of the refined pose · L_3D: distance
    of the hubs as the refined pose has them, which teaches the shapes. These three also count an error itself and no square of it, down to
    METRES_NEAR and TURN_NEAR: a square would leave the last degrees and centimetres nearly without a pull. Every sigma learns by the Gaussian
    likelihood of the error it stands for; that error is taken as given, so that no branch pays for its doubts with its accuracy.
    """
    near = partial(smooth_l1_loss, beta=METRES_NEAR)
    off = (output["keypoints"] - batch["keypoints"]).square().sum(dim=2)  # (B, 4)
    turned = rotations.geodesic_degrees(output["R_direct"], batch["R"]).deg2rad().square()  # (B,)
    moved = (output["t_direct"] - batch["t"]).square().sum(dim=1) / batch["t"][
        :, 2
    ].square()  # (B,) as shares of the distance
    steep = partial(smooth_l1_loss, beta=KEYPOINT_NEAR / 4)
    keypoints = (
        2
        * KEYPOINT_NEAR
        * sum(steep(output[name], batch["keypoints"]) for name in ("keypoints", "coarse_keypoints"))
    )
    rotation = (apart(output["R_direct"], batch["R"]) + apart(output["R"], batch["R"])) / 3
    translation = near(output["t_direct"], batch["t"]) + near(output["t"], batch["t"])
    return {
        "L_2D": keypoints * keypoint_unit**2
        + LIKELIHOOD_WEIGHT * likelihood(off, output["keypoint_sigma"], 2),
        "L_cls": cross_entropy(output["class_logits"], batch["label"]),
        "L_3D": near(output["keypoints_3d"], batch["keypoints_3d"]),
        "L_rot": rotation + LIKELIHOOD_WEIGHT * likelihood(turned, output["angle_sigma"], 3),
        "L_trans": translation + LIKELIHOOD_WEIGHT * likelihood(moved, output["distance_sigma"], 3),
    }


def apart(a: Tensor, b: Tensor) -> Tensor:
    """Mean distance ‖a - b‖ (Frobenius) of rotations (B, 3, 3), 2√2 sin(angle/2), rounded off below TURN_NEAR so that it has a slope at 0."""
    return ((a - b).square().sum(dim=(1, 2)) + TURN_NEAR**2).sqrt().mean()


def likelihood(squared_error: Tensor, sigma: Tensor, dimensions: int) -> Tensor:
    """Mean negative log-likelihood of an isotropic normal error, up to a constant; the error itself gets no gradient."""
    return (squared_error.detach() / (2 * sigma.square()) + dimensions * sigma.log()).mean()


def loss_weights(schedule: str, progress: float) -> tuple[float, float]:
    """Weights of L_enc and L_dec at `progress` (0 = first step, 1 = last) of training. Table 6; no formula is printed.

    equal: 1 and 1 (Eq. 12) · tanh: a steep switch from encoder to decoder at half of training · shifted: the same
    handover as one half cosine over the whole run · biased: 1 and 5.
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
    """Eq. 12: L_enc + L_dec, each times its weight. A baseline that has only some of the terms sums those."""
    unknown = set(terms) - set(TERMS)
    if unknown:
        raise InputError(f"unknown loss term {sorted(unknown)[0]!r}; known: {', '.join(TERMS)}")
    encoder = sum(terms[name] for name in ENCODER_TERMS if name in terms)
    decoder = sum(terms[name] for name in DECODER_TERMS if name in terms)
    return weights[0] * encoder + weights[1] * decoder
