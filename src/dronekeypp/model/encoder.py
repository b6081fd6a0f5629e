"""Encode a feature map as keypoints and a class (Sec. III-A, Eq. 1-5).

The parts are tokens, self-attention, the gated sum of the layers, and the classifier on the token [cls].
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from dronekeypp.model.config import EncoderConfig


def sine_positions(side: int, width: int) -> Tensor:
    """Return a fixed 2D positional encoding (side*side, width), row by row.

    Half of the channels encode the row and half the column, as sines and cosines of geometric wavelengths
    (Vaswani et al. 2017 in two dimensions). The paper only says "positional encoding".
    """
    quarter = width // 4
    # (d/4,); grids are small, so 100 and not 10,000.
    frequency = 1.0 / (100.0 ** (torch.arange(quarter) / quarter))
    angle = torch.arange(side)[:, None] * frequency  # (side, d/4)
    wave = torch.cat([angle.sin(), angle.cos()], dim=1)  # (side, d/2)
    rows = wave[:, None, :].expand(side, side, -1)
    columns = wave[None, :, :].expand(side, side, -1)
    return torch.cat([rows, columns], dim=2).reshape(side * side, width)


def cell_centres(side: int) -> Tensor:
    """Return the middle (x, y) of every cell of a side x side grid in crop units.

    They are (side*side, 2), row by row.
    """
    middle = (torch.arange(side) + 0.5) / side
    return torch.stack([middle.repeat(side), middle.repeat_interleave(side)], dim=1)


class SelfAttention(nn.Module):
    """This is multi-head self-attention, written with matrix products.

    It turns tokens (B, T, d) into tokens (B, T, d), and also returns the weights (B, heads, T, T).
    """

    def __init__(self, width: int, heads: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width)  # Q, K and V stacked, as in nn.MultiheadAttention.in_proj
        self.out = nn.Linear(width, width)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        B, T, d = x.shape
        # Each is (B, h, T, d/h).
        q, k, v = self.qkv(x).view(B, T, 3, self.heads, d // self.heads).permute(2, 0, 3, 1, 4)
        weights = torch.softmax(q @ k.transpose(-2, -1) / math.sqrt(d // self.heads), dim=-1)  # (B, h, T, T)
        mixed = self.dropout(weights) @ v  # (B, h, T, d/h)
        return self.out(mixed.transpose(1, 2).reshape(B, T, d)), weights


class EncoderLayer(nn.Module):
    """This is one layer of Eq. 1.

    It has self-attention and then a feed-forward part, each with a sum and a LayerNorm.
    """

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        self.pre = config.norm == "pre"
        self.attention = SelfAttention(config.width, config.heads, config.dropout)
        self.norm1 = nn.LayerNorm(config.width)
        self.norm2 = nn.LayerNorm(config.width)
        self.ffn = nn.Sequential(
            nn.Linear(config.width, config.ffn),
            nn.ReLU(),
            nn.Dropout(config.dropout),
            nn.Linear(config.ffn, config.width),
        )
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        attended, weights = self.attention(self.norm1(x) if self.pre else x)
        x = x + self.dropout(attended)
        if not self.pre:
            x = self.norm1(x)
        x = x + self.dropout(self.ffn(self.norm2(x) if self.pre else x))
        return (x if self.pre else self.norm2(x)), weights


class KeypointEncoder(nn.Module):
    """This encoder turns a feature map into keypoints and a class.

    It takes features (B, C, s, s) and returns a dict of keypoints (B, 4, 2) in crop units and class_logits
    (B, classes). For a reader who wants to look inside, it also returns gate (B, N), ir (B, N, d), cr
    (B, N, 4, 2), and attention: N tensors (B, heads, 1+M, 1+M) with [cls] first.
    """

    def __init__(self, config: EncoderConfig, channels: int) -> None:
        super().__init__()
        self.config = config
        d, N = config.width, config.layers
        self.tokenise = nn.Conv2d(channels, d, 1)  # one token per cell of the feature map
        side = config.image_size // config.stride  # s
        self.register_buffer("positions", sine_positions(side, d), persistent=False)
        self.cls = nn.Parameter(torch.zeros(1, 1, d))
        self.blocks = nn.ModuleList(EncoderLayer(config) for _ in range(N))
        if config.keypoint_head == "heatmap":  # not the paper's: how much each cell looks like each keypoint
            # A bias would raise the whole map, and the softmax would not see it.
            self.to_heatmap = nn.Linear(d, 4, bias=False)
            self.register_buffer("centres", cell_centres(side), persistent=False)  # (M, 2)
        else:
            self.to_keypoints = nn.Linear(d, 4 * 2)  # W of Eq. 2, one for all layers
        self.to_gate = nn.Linear(d, N, bias=False) if config.gate == "learned" else None  # W_g of Eq. 3
        self.to_class = nn.Linear(d, config.classes)  # W_cls of Eq. 5
        nn.init.trunc_normal_(self.cls, std=0.02)
        if config.keypoint_head == "linear":
            # Eq. 4 ends in a ReLU, whose gradient is zero below zero. Eq. 2 prints no bias. Ours starts at
            # the middle of the crop, with small weights. So every keypoint is positive, and therefore learns,
            # from the first step.
            nn.init.trunc_normal_(self.to_keypoints.weight, std=0.005)
            nn.init.constant_(self.to_keypoints.bias, 0.5)
        # All layers count alike at the start; from random weights one layer soon takes everything.
        if self.to_gate is not None:
            nn.init.zeros_(self.to_gate.weight)

    def gate(self, last_ir: Tensor) -> Tensor:
        """Return the weights of the layers (B, N), each row summing to 1 (Eq. 3).

        They follow from the last layer's IR (B, d).
        """
        B, N = last_ir.shape[0], self.config.layers
        if self.to_gate is not None:
            return torch.softmax(self.to_gate(last_ir), dim=-1)
        gate = last_ir.new_zeros(B, N)
        if self.config.gate == "last":
            gate[:, -1] = 1.0
        else:
            gate[:] = 1.0 / N
        return gate

    def forward(self, features: Tensor) -> dict[str, Tensor | list[Tensor]]:
        tokens = self.tokenise(features).flatten(2).transpose(1, 2) + self.positions  # (B, M, d) = X^(0)
        start = torch.cat([self.cls.expand(tokens.shape[0], -1, -1), tokens], dim=1)  # (B, 1+M, d)
        x, image_tokens, attention = start, [], []
        for block in self.blocks:  # Eq. 1
            x, weights = block(x if self.config.layer_input == "previous" else start)
            image_tokens.append(x[:, 1:])  # the pool leaves [cls] out
            attention.append(weights)
        maps = torch.stack(image_tokens, dim=1)  # (B, N, M, d)
        ir = maps.amax(dim=2) if self.config.pool == "max" else maps.mean(dim=2)  # (B, N, d)
        if self.config.keypoint_head == "heatmap":
            heat = torch.softmax(self.to_heatmap(maps), dim=2)  # (B, N, M, 4), each map sums to 1
            cr = heat.transpose(2, 3) @ self.centres  # (B, N, 4, 2): the mean place
        else:
            cr = self.to_keypoints(ir).unflatten(-1, (4, 2))  # (B, N, 4, 2), Eq. 2
        gate = self.gate(ir[:, -1])  # (B, N), Eq. 3
        keypoints = torch.relu((gate[:, :, None, None] * cr).sum(dim=1))  # (B, 4, 2), Eq. 4
        logits = self.to_class(x[:, 0])  # (B, classes), Eq. 5 before its softmax
        return {
            "keypoints": keypoints,
            "class_logits": logits,
            "gate": gate,
            "ir": ir,
            "cr": cr,
            "attention": attention,
        }


def layer_spread(encoded: dict[str, Tensor]) -> Tensor:
    """Return how far the layers' keypoints of Eq. 2 lie from their gated sum.

    It is the root mean square with the gate's weights. It is not a sign of doubt: on the test flights it does
    not grow with the error. For that see `predict.mirror_doubt`.

    Args:
        encoded: cr (B, N, 4, 2), gate (B, N), and keypoints (B, 4, 2), or coarse_keypoints where sharper ones
            took their place.

    Returns:
        (B,) crop units.
    """
    mixed = encoded.get("coarse_keypoints", encoded["keypoints"])
    apart = (encoded["cr"] - mixed[:, None]).square().sum(dim=-1).mean(dim=-1)  # (B, N)
    return (encoded["gate"] * apart).sum(dim=-1).sqrt()
