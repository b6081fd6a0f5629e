"""Exercises of notebook 03, the keypoint encoder."""

import math

import numpy as np
import torch

from dronekeypp import camera
from dronekeypp.checks import Exercise


def tensor(array):
    return torch.tensor(array, dtype=torch.float32)


def some_tokens(rng):
    """tokens (5,) as the encoder counts them, [cls] being 0; cells along a side; square (3,)."""
    side = int(rng.integers(5, 9))
    return rng.integers(1, side**2, 5), side, np.array([*rng.uniform(100, 900, 2), rng.uniform(60, 400)])


def token_pixels(tokens, side, square, cls=1, half=0.5, swap=False):
    """The solution, and with other arguments the mistakes."""
    row, column = np.divmod(np.asarray(tokens) - cls, side)
    cells = np.stack([row, column] if swap else [column, row], axis=1)  # (n, 2): x, y
    return camera.from_crop((cells + half) / side, square)


def queries_keys_values(rng):
    """q, k, v (7, 4), heard (7,) bool: two of the seven tokens are padding."""
    heard = torch.ones(7, dtype=torch.bool)
    heard[rng.choice(7, 2, replace=False)] = False
    return *(tensor(1.5 * rng.normal(size=(7, 4))) for _ in range(3)), heard


def masked_attention(q, k, v, heard, scale=math.sqrt, dim=-1, silent=-math.inf, rows=False):
    """The solution, and with other arguments the mistakes."""
    scores = q @ k.T / scale(q.shape[1])
    scores = scores.masked_fill(~(heard[:, None] if rows else heard[None, :]), silent)
    return torch.softmax(scores, dim=dim) @ v


def unmasked_weights(q, k):
    return torch.softmax(q @ k.T / math.sqrt(q.shape[1]), dim=-1)


def layer_outputs(rng):
    """x (3, 17, 16) with [cls] first and loud, W (8, 16), b (8,), W_g (3, 16); as many cells as channels, so that dimensions can be mixed up."""
    x, W = rng.normal(size=(3, 17, 16)), 0.4 * rng.normal(size=(8, 16))
    x[:, 0] *= 3
    W -= W.mean(
        axis=1, keepdims=True
    )  # maxima are all near 2: without it the three layers would nearly agree
    b = rng.uniform(0.3, 0.7, 8)
    b[rng.integers(8)] = -5  # one number that only the ReLU keeps from being negative
    return tensor(x), tensor(W), tensor(b), tensor(0.1 * rng.normal(size=(3, 16)))


def softmax(scores):
    return torch.softmax(scores, dim=0)


def gated_keypoints(
    x, W, b, Wg, cls=1, pool=lambda x: x.amax(dim=1), gate_from=-1, gate=softmax, relu="after", fold=None
):
    """The solution, and with other arguments the mistakes."""
    ir = pool(x[:, cls:])  # (N, d)
    cr = ir @ W.T + b  # (N, 8)
    cr = cr.unflatten(1, (2, 4)).transpose(1, 2) if fold == "xy" else cr.unflatten(1, (4, 2))  # (N, 4, 2)
    if relu == "before":
        cr = torch.relu(cr)
    y = (gate(Wg @ ir[gate_from])[:, None, None] * cr).sum(dim=0)
    return torch.relu(y) if relu == "after" else y


def convolution_stack(rng):
    """layers [(window, stride, dilation), ...]."""
    n = int(rng.integers(4, 7))
    strides = [2, *rng.choice([1, 2], n - 2).tolist(), 2]
    dilations = [1, *rng.choice([1, 2], n - 2).tolist(), 2]
    return (list(zip(rng.choice([3, 5, 7], n).tolist(), strides, dilations, strict=True)),)


def receptive_field(
    layers,
    reach=lambda k, dilation: (k - 1) * dilation,
    jump_first=False,
    jump=lambda j, s: j * s,
    with_jump=True,
):
    """The solution, and with other arguments the mistakes."""
    r, j = 1, 1
    for k, s, dilation in layers:
        step = jump(j, s)
        r += reach(k, dilation) * ((step if jump_first else j) if with_jump else 1)
        j = step
    return r, j


EXERCISES = [
    Exercise(
        "token_pixels",
        token_pixels,
        some_tokens,
        {
            "one cell off: token 0 is [cls], the cells begin at 1": lambda *given: token_pixels(
                *given, cls=0
            ),
            "this is the cell's corner; its middle is half a cell further": lambda *given: token_pixels(
                *given, half=0
            ),
            "[cls] is forgotten, and this is the cell's corner, not its middle": lambda *given: token_pixels(
                *given, cls=0, half=0
            ),
            "x and y are swapped: the row counts down (y), the column to the right (x)": lambda *given: (
                token_pixels(*given, swap=True)
            ),
            "half a pixel is not half a cell: add 0.5 before dividing by the number of cells": (
                lambda tokens, side, square: token_pixels(tokens, side, square, half=0) + 0.5
            ),
            "these are crop units; the square (x, y, side) brings them to the frame": (
                lambda tokens, side, square: token_pixels(tokens, side, np.array([0, 0, 1.0]))
            ),
            "you forgot the corner of the square": lambda tokens, side, square: (
                token_pixels(tokens, side, square) - square[:2]
            ),
        },
    ),
    Exercise(
        "receptive_field",
        receptive_field,
        convolution_stack,
        {
            "a layer's window is still counted in its input's jump; update the jump afterwards": (
                lambda layers: receptive_field(layers, jump_first=True)
            ),
            "you left out the dilation": lambda layers: receptive_field(
                layers, reach=lambda k, dilation: k - 1
            ),
            "a window of k reaches k - 1 gaps, not k": lambda layers: receptive_field(
                layers, reach=lambda k, dilation: k * dilation
            ),
            "a dilated window is (k - 1) * dilation + 1 wide, not k * dilation": (
                lambda layers: receptive_field(layers, reach=lambda k, dilation: k * dilation - 1)
            ),
            "you add gaps of later layers as if they were one pixel; multiply by the jump": lambda layers: (
                receptive_field(layers, with_jump=False)
            ),
            "jumps multiply from layer to layer; you added the strides": lambda layers: receptive_field(
                layers, jump=lambda j, s: j + s
            ),
        },
    ),
    Exercise(
        "masked_attention",
        masked_attention,
        queries_keys_values,
        {
            "you forgot to divide the scores by the root of d": lambda *given: masked_attention(
                *given, scale=lambda d: 1
            ),
            "divide the scores by the root of d, not by d": lambda *given: masked_attention(
                *given, scale=lambda d: d
            ),
            "softmax over the wrong dimension: each row, one token's weights, must sum to 1": lambda *given: (
                masked_attention(*given, dim=0)
            ),
            "the padding is heard: your mask has no effect": lambda q, k, v, heard: (
                unmasked_weights(q, k) @ v
            ),
            "a score of 0 is not silence, for exp(0) = 1; it takes minus infinity": lambda *given: (
                masked_attention(*given, silent=0.0)
            ),
            "weights set to 0 after the softmax no longer sum to 1; mask the scores before it": (
                lambda q, k, v, heard: (unmasked_weights(q, k) * heard) @ v
            ),
            "your mask is the wrong way round: True may be heard": lambda q, k, v, heard: masked_attention(
                q, k, v, ~heard
            ),
            "you masked the rows, the tokens that ask; mask the columns, those that are heard": lambda *given: (
                masked_attention(*given, rows=True)
            ),
        },
    ),
    Exercise(
        "gated_keypoints",
        gated_keypoints,
        layer_outputs,
        {
            "[cls] is in your pool; take the image tokens only": lambda *given: gated_keypoints(
                *given, cls=0
            ),
            "maximum over the wrong dimension: for each channel the largest over the tokens": (
                lambda *given: gated_keypoints(*given, pool=lambda x: x.amax(dim=2))
            ),
            "this is the mean over the tokens; the paper takes the maximum": lambda *given: gated_keypoints(
                *given, pool=lambda x: x.mean(dim=1)
            ),
            "the gate reads the last layer's pooled vector (Eq. 3); you took the first": lambda *given: (
                gated_keypoints(*given, gate_from=0)
            ),
            "the gate's weights must sum to 1: softmax is missing": lambda *given: gated_keypoints(
                *given, gate=lambda scores: scores
            ),
            "all layers count alike here; weigh them with the gate": (
                lambda *given: gated_keypoints(
                    *given, gate=lambda scores: torch.ones_like(scores) / len(scores)
                )
            ),
            "the ReLU comes after the sum (Eq. 4), not on each layer's guess": lambda *given: gated_keypoints(
                *given, relu="before"
            ),
            "the ReLU of Eq. 4 is missing": lambda *given: gated_keypoints(*given, relu=None),
            "the eight numbers are x, y, x, y, ...; you read four x, then four y": lambda *given: (
                gated_keypoints(*given, fold="xy")
            ),
        },
        close=1e-4,
    ),
]
