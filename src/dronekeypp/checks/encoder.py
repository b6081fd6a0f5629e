"""Exercises of notebook 03, the keypoint encoder."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import Tensor

from dronekeypp import camera
from dronekeypp.checks import Exercise, Mistake

Layer = tuple[int, int, int]  # window, stride and dilation of a convolution


def float_tensor(array: np.ndarray) -> Tensor:
    """Return a copy as a tensor of 32-bit floats."""
    return torch.tensor(array, dtype=torch.float32)


# --- token_pixels ---


def tokens_and_square(rng: np.random.Generator) -> tuple[np.ndarray, int, np.ndarray]:
    """Draw the numbers of image tokens (5,), the cells along a side, and the crop's square (3,) in pixels."""
    side = int(rng.integers(5, 9))
    return rng.integers(1, side**2, 5), side, np.array([*rng.uniform(100, 900, 2), rng.uniform(60, 400)])


def token_pixels(
    tokens: np.ndarray,
    side: int,
    square: np.ndarray,
    *,
    cls_tokens: int = 1,
    half_cell: float = 0.5,
    swaps_xy: bool = False,
) -> np.ndarray:
    """Solve the exercise: the middles (n, 2) of the cells in full-frame pixels. Options make mistakes."""
    row, column = np.divmod(np.asarray(tokens) - cls_tokens, side)
    cells = np.stack([row, column] if swaps_xy else [column, row], axis=1)  # (n, 2): x, y
    return camera.from_crop((cells + half_cell) / side, square)


def half_a_pixel(tokens: np.ndarray, side: int, square: np.ndarray) -> np.ndarray:
    return token_pixels(tokens, side, square, half_cell=0) + 0.5


def crop_units(tokens: np.ndarray, side: int, square: np.ndarray) -> np.ndarray:
    return token_pixels(tokens, side, np.array([0, 0, 1.0]))


# --- receptive_field ---


def convolutions(rng: np.random.Generator) -> tuple[list[Layer]]:
    """Draw a list of four to six convolutions."""
    n = int(rng.integers(4, 7))
    strides = [2, *rng.choice([1, 2], n - 2).tolist(), 2]
    dilations = [1, *rng.choice([1, 2], n - 2).tolist(), 2]
    windows = rng.choice([3, 5, 7], n).tolist()
    return (list(zip(windows, strides, dilations, strict=True)),)


def window_gaps(window: int, dilation: int) -> int:
    """Return by how many input cells a window is longer than one cell."""
    return (window - 1) * dilation


def gaps_without_dilation(window: int, dilation: int) -> int:
    return window - 1


def one_gap_too_many(window: int, dilation: int) -> int:
    return window * dilation


def dilated_window_too_wide(window: int, dilation: int) -> int:
    return window * dilation - 1


def receptive_field(
    layers: list[Layer],
    *,
    gaps: Callable[[int, int], int] = window_gaps,
    updates_jump_first: bool = False,
    adds_strides: bool = False,
    multiplies_by_jump: bool = True,
) -> tuple[int, int]:
    """Solve the exercise: the receptive field and the jump in pixels. Other options make mistakes."""
    field, jump = 1, 1
    for window, stride, dilation in layers:
        new_jump = jump + stride if adds_strides else jump * stride
        gap_length = new_jump if updates_jump_first else jump
        if not multiplies_by_jump:
            gap_length = 1
        field += gaps(window, dilation) * gap_length
        jump = new_jump
    return field, jump


# --- masked_attention ---


def queries_keys_values(rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Draw q, k, v (7, 4), and heard (7,) bool, which is False for the two tokens that are padding."""
    heard = torch.ones(7, dtype=torch.bool)
    heard[rng.choice(7, 2, replace=False)] = False
    q = float_tensor(1.5 * rng.normal(size=(7, 4)))
    k = float_tensor(1.5 * rng.normal(size=(7, 4)))
    v = float_tensor(1.5 * rng.normal(size=(7, 4)))
    return q, k, v, heard


def masked_attention(
    q: Tensor,
    k: Tensor,
    v: Tensor,
    heard: Tensor,
    *,
    scale_power: float = 0.5,
    softmax_dim: int = -1,
    silent_score: float = -math.inf,
    masks_rows: bool = False,
) -> Tensor:
    """Solve the exercise: the mixed values (T, d). Other options make mistakes."""
    scores = q @ k.T / q.shape[1] ** scale_power  # (T, T)
    silent = ~heard[:, None] if masks_rows else ~heard[None, :]
    scores = scores.masked_fill(silent, silent_score)
    return torch.softmax(scores, dim=softmax_dim) @ v


def unmasked_weights(q: Tensor, k: Tensor) -> Tensor:
    """Return the attention weights (T, T) without a mask."""
    return torch.softmax(q @ k.T / math.sqrt(q.shape[1]), dim=-1)


def forgets_mask(q: Tensor, k: Tensor, v: Tensor, heard: Tensor) -> Tensor:
    return unmasked_weights(q, k) @ v


def masks_after_softmax(q: Tensor, k: Tensor, v: Tensor, heard: Tensor) -> Tensor:
    return (unmasked_weights(q, k) * heard) @ v


# --- gated_keypoints ---


def layer_outputs(rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Draw x (3, 17, 16) with [cls] first, W (8, 16), b (8,) and Wg (3, 16).

    A map has as many cells as channels, so a maximum over the wrong dimension has the right shape. [cls] has
    large numbers, so it shows in a maximum.
    """
    x, W = rng.normal(size=(3, 17, 16)), 0.4 * rng.normal(size=(8, 16))
    x[:, 0] *= 3
    # All maxima are near 2. Without this line the three layers would give nearly the same keypoints.
    W -= W.mean(axis=1, keepdims=True)
    b = rng.uniform(0.3, 0.7, 8)
    b[rng.integers(8)] = -5  # makes one number negative, so that the ReLU changes something
    return float_tensor(x), float_tensor(W), float_tensor(b), float_tensor(0.1 * rng.normal(size=(3, 16)))


def maximum_over_tokens(x: Tensor) -> Tensor:
    return x.amax(dim=1)


def maximum_over_channels(x: Tensor) -> Tensor:
    return x.amax(dim=2)


def mean_over_tokens(x: Tensor) -> Tensor:
    return x.mean(dim=1)


def softmax_gate(scores: Tensor) -> Tensor:
    return torch.softmax(scores, dim=0)


def gate_without_softmax(scores: Tensor) -> Tensor:
    return scores


def equal_weights(scores: Tensor) -> Tensor:
    return torch.ones_like(scores) / len(scores)


def gated_keypoints(
    x: Tensor,
    W: Tensor,
    b: Tensor,
    Wg: Tensor,
    *,
    cls_tokens: int = 1,
    pool: Callable[[Tensor], Tensor] = maximum_over_tokens,
    gate_layer: int = -1,
    gate: Callable[[Tensor], Tensor] = softmax_gate,
    relu: str | None = "after",
    x_before_y: bool = False,
) -> Tensor:
    """Solve the exercise: the keypoints (4, 2) of Eq. 2 to 4. Other options make mistakes."""
    ir = pool(x[:, cls_tokens:])  # (N, d)
    cr = ir @ W.T + b  # (N, 8)
    if x_before_y:
        cr = cr.unflatten(1, (2, 4)).transpose(1, 2)
    else:
        cr = cr.unflatten(1, (4, 2))  # (N, 4, 2)
    if relu == "before":
        cr = torch.relu(cr)
    y = (gate(Wg @ ir[gate_layer])[:, None, None] * cr).sum(dim=0)  # (4, 2)
    return torch.relu(y) if relu == "after" else y


EXERCISES = [
    Exercise(
        name="token_pixels",
        solution=token_pixels,
        inputs=tokens_and_square,
        mistakes=[
            Mistake(
                "You are one cell off. Token 0 is [cls], so the cells begin at 1.",
                partial(token_pixels, cls_tokens=0),
            ),
            Mistake(
                "This is the corner of the cell. Its middle is half a cell further.",
                partial(token_pixels, half_cell=0),
            ),
            Mistake(
                "Token 0 is [cls], so the cells begin at 1. And this is the cell's corner, not its middle.",
                partial(token_pixels, cls_tokens=0, half_cell=0),
            ),
            Mistake(
                "x and y are swapped. The row counts downwards (y), the column to the right (x).",
                partial(token_pixels, swaps_xy=True),
            ),
            Mistake(
                "You added half a pixel instead of half a cell. Add 0.5 before you divide by `side`.",
                half_a_pixel,
            ),
            Mistake("These are crop units. Use the square to turn them into frame pixels.", crop_units),
            Mistake(
                "You did not add the corner of the square.",
                lambda tokens, side, square: token_pixels(tokens, side, square) - square[:2],
            ),
        ],
    ),
    Exercise(
        name="receptive_field",
        solution=receptive_field,
        inputs=convolutions,
        mistakes=[
            Mistake(
                "Count the window of a layer with the jump of its input. Update the jump afterwards.",
                partial(receptive_field, updates_jump_first=True),
            ),
            Mistake("The dilation is missing.", partial(receptive_field, gaps=gaps_without_dilation)),
            Mistake(
                "A window of k has k - 1 gaps, not k.",
                partial(receptive_field, gaps=one_gap_too_many),
            ),
            Mistake(
                "A dilated window is (k - 1) * dilation + 1 wide, not k * dilation.",
                partial(receptive_field, gaps=dilated_window_too_wide),
            ),
            Mistake(
                "In later layers a gap is longer than one pixel. Multiply it by the jump.",
                partial(receptive_field, multiplies_by_jump=False),
            ),
            Mistake(
                "The jump is the product of the strides. You added them.",
                partial(receptive_field, adds_strides=True),
            ),
        ],
    ),
    Exercise(
        name="masked_attention",
        solution=masked_attention,
        inputs=queries_keys_values,
        mistakes=[
            Mistake(
                "You did not divide the scores by the root of d.",
                partial(masked_attention, scale_power=0),
            ),
            Mistake(
                "Divide the scores by the root of d, not by d.",
                partial(masked_attention, scale_power=1),
            ),
            Mistake(
                "The softmax runs over the wrong dimension. The weights of each row must sum to 1.",
                partial(masked_attention, softmax_dim=0),
            ),
            Mistake("Your mask has no effect: the padding is still heard.", forgets_mask),
            Mistake(
                "A score of 0 does not silence a token, because exp(0) = 1. Use minus infinity.",
                partial(masked_attention, silent_score=0.0),
            ),
            Mistake(
                "If you set weights to 0 after the softmax, they do not sum to 1. Mask the scores before it.",
                masks_after_softmax,
            ),
            Mistake(
                "Your mask is inverted. True marks a token that may be heard.",
                lambda q, k, v, heard: masked_attention(q, k, v, ~heard),
            ),
            Mistake(
                "You masked the rows, which are the tokens that ask. Mask the columns, which are heard.",
                partial(masked_attention, masks_rows=True),
            ),
        ],
    ),
    Exercise(
        name="gated_keypoints",
        solution=gated_keypoints,
        inputs=layer_outputs,
        mistakes=[
            Mistake(
                "Your maximum includes [cls]. Take only the image tokens.",
                partial(gated_keypoints, cls_tokens=0),
            ),
            Mistake(
                "The maximum runs over the wrong dimension. Take the largest token of each channel.",
                partial(gated_keypoints, pool=maximum_over_channels),
            ),
            Mistake(
                "This is the mean over the tokens. The paper takes the maximum.",
                partial(gated_keypoints, pool=mean_over_tokens),
            ),
            Mistake(
                "The gate reads the pooled vector of the last layer (Eq. 3). You took the first layer.",
                partial(gated_keypoints, gate_layer=0),
            ),
            Mistake(
                "The weights of the gate must sum to 1. The softmax is missing.",
                partial(gated_keypoints, gate=gate_without_softmax),
            ),
            Mistake(
                "You gave all layers the same weight. Use the weights of the gate.",
                partial(gated_keypoints, gate=equal_weights),
            ),
            Mistake(
                "The ReLU comes after the sum (Eq. 4). You applied it to each layer.",
                partial(gated_keypoints, relu="before"),
            ),
            Mistake("The ReLU of Eq. 4 is missing.", partial(gated_keypoints, relu=None)),
            Mistake(
                "The eight numbers are x, y, x, y, and so on. You read four x first and then four y.",
                partial(gated_keypoints, x_before_y=True),
            ),
        ],
        close=1e-4,
    ),
]
