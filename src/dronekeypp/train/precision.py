"""Compute in bfloat16 while training, which is faster on some processors.

Only the parts that look at the picture do so, by convolutions and matrix products. The weights and all that
one part hands on to the next stay float32. So does the pose decoder: three digits of a pose are too few.
"""

from __future__ import annotations

from functools import partial

from torch import Tensor, nn

from dronekeypp.model.backbone import half_precision
from dronekeypp.model.encoder import EncoderLayer


def set_precision(network: nn.Module, precision: str) -> None:
    """Choose in what precision the parts of a network that look at the picture compute while they train.

    They are those with an attribute `bfloat16` (see `half_precision`), and the layers of the encoder, between
    which the tokens stay float32.

    Args:
        network: any network; what has no such part is left as it is.
        precision: "float32" or "bfloat16".
    """
    for module in network.modules():
        if isinstance(module, EncoderLayer):
            module.bfloat16 = False
            module.forward = partial(_layer_forward, module)
        if hasattr(module, "bfloat16"):
            module.bfloat16 = precision == "bfloat16"


def _layer_forward(layer: EncoderLayer, x: Tensor) -> tuple[Tensor, Tensor]:
    """Compute a layer of the encoder in its precision.

    The class itself is left as notebook 03 builds it.
    """
    with half_precision(layer, x.device):
        return EncoderLayer.forward(layer, x)
