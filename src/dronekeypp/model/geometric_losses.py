"""Compute the losses of the geometric decoder.

They are the same five terms, for a network that answers twice.
"""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import cross_entropy, smooth_l1_loss

from dronekeypp import rotations

LIKELIHOOD_WEIGHT = 0.01  # weight of the likelihoods, beside the errors themselves
KEYPOINT_NEAR = 0.02  # crop units, 2 of 96 px: what most keypoints reach
METRES_NEAR = 0.05  # m
TURN_NEAR = 0.03  # of ‖R - R*‖, which is 1.4 times a small angle in radians: 1.2°


def geometric_loss_terms(output: dict, batch: dict, keypoint_unit: float = 1.0) -> dict[str, Tensor]:
    """Return the five terms of Eq. 9 and 11 for `GeometricDecoder`, which gives a guess and a refined pose.

    L_2D is the absolute error of the sharp keypoints and of the encoder's own. At an error of KEYPOINT_NEAR
    it pulls as hard as the paper's squares do. It still pulls on a nearer keypoint, and no harder on one that
    is far off (Sun et al., ECCV 2018). L_rot and L_trans are the distances of the direct branch's pose and of
    the refined one. L_3D is the distance of the hubs as the refined pose has them, which teaches the shapes.
    These three also count an error itself and not its square, down to METRES_NEAR and TURN_NEAR: a square
    would leave the last degrees and centimetres nearly without a pull.

    Every sigma learns by the Gaussian likelihood of the error it stands for. That error is taken as given, so
    that no branch pays for its doubts with its accuracy.
    """
    pixels = (output["keypoints"] - batch["keypoints"]).square().sum(dim=2)  # (B, 4)
    turn = rotations.geodesic_degrees(output["R_direct"], batch["R"]).deg2rad().square()  # (B,)
    depth = batch["t"][:, 2]
    # As a share of the depth, squared: (B,).
    shift = (output["t_direct"] - batch["t"]).square().sum(dim=1) / depth.square()
    keypoints = (
        2
        * KEYPOINT_NEAR
        * (
            near(output["keypoints"], batch["keypoints"], KEYPOINT_NEAR / 4)
            + near(output["coarse_keypoints"], batch["keypoints"], KEYPOINT_NEAR / 4)
        )
    )
    rotation = (apart(output["R_direct"], batch["R"]) + apart(output["R"], batch["R"])) / 3
    translation = near(output["t_direct"], batch["t"], METRES_NEAR) + near(
        output["t"], batch["t"], METRES_NEAR
    )
    claimed_keypoints = likelihood(pixels, output["keypoint_sigma"], 2)
    claimed_rotation = likelihood(turn, output["angle_sigma"], 3)
    claimed_translation = likelihood(shift, output["distance_sigma"], 3)
    return {
        "L_2D": keypoints * keypoint_unit**2 + LIKELIHOOD_WEIGHT * claimed_keypoints,
        "L_cls": cross_entropy(output["class_logits"], batch["label"]),
        "L_3D": near(output["keypoints_3d"], batch["keypoints_3d"], METRES_NEAR),
        "L_rot": rotation + LIKELIHOOD_WEIGHT * claimed_rotation,
        "L_trans": translation + LIKELIHOOD_WEIGHT * claimed_translation,
    }


def near(predicted: Tensor, true: Tensor, beta: float) -> Tensor:
    """Return the mean absolute error, which turns into a square below `beta`."""
    return smooth_l1_loss(predicted, true, beta=beta)


def apart(a: Tensor, b: Tensor) -> Tensor:
    """Return the mean distance ‖a - b‖ (Frobenius) of rotations (B, 3, 3).

    For each pair it is 2√2 sin(angle/2). It is rounded off below TURN_NEAR, so that it has a slope at 0.
    """
    return ((a - b).square().sum(dim=(1, 2)) + TURN_NEAR**2).sqrt().mean()


def likelihood(squared_error: Tensor, sigma: Tensor, dimensions: int) -> Tensor:
    """Return the mean negative log-likelihood of an isotropic normal error, up to a constant.

    The error itself gets no gradient.
    """
    return (squared_error.detach() / (2 * sigma.square()) + dimensions * sigma.log()).mean()
