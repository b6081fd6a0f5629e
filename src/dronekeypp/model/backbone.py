"""The feature map X (Sec. III-A): torchvision's ResNets cut before the pooling, and a compact ResNet for small crops."""

from __future__ import annotations

from pathlib import Path

import torch
import torchvision
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from dronekeypp.errors import InputError
from dronekeypp.model.config import ModelConfig

# ImageNet's channel means and deviations: every torchvision weight expects them, and they suit any outdoor photograph.
MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)
IMAGENET = {"resnet18": "IMAGENET1K_V1", "resnet34": "IMAGENET1K_V1", "resnet50": "IMAGENET1K_V1"}
COMPACT_CHANNELS = (32, 64, 128, 256)
COMPACT_BLOCKS = (1, 1, 2, 2)


class Block(nn.Module):
    """Two 3x3 convolutions and a shortcut (He et al. 2016, Fig. 2). (B, inp, h, w) -> (B, out, h/stride, w/stride)."""

    def __init__(self, inp: int, out: int, stride: int):
        super().__init__()
        self.conv1 = nn.Conv2d(inp, out, 3, stride, 1, bias=False)
        self.norm1 = nn.BatchNorm2d(out)
        self.conv2 = nn.Conv2d(out, out, 3, 1, 1, bias=False)
        self.norm2 = nn.BatchNorm2d(out)
        same = inp == out and stride == 1
        self.shortcut = (
            nn.Identity()
            if same
            else nn.Sequential(nn.Conv2d(inp, out, 1, stride, bias=False), nn.BatchNorm2d(out))
        )

    def forward(self, x: Tensor) -> Tensor:
        h = torch.relu(self.norm1(self.conv1(x)))
        h = self.norm2(self.conv2(h))
        return torch.relu(h + self.shortcut(x))


class CompactResNet(nn.Sequential):
    """Four stages of residual blocks for 96-128 px crops. (B, 3, S, S) -> (B, 256, S/stride, S/stride).

    The first convolution halves the crop and stage 1 keeps that size, so that small propellers survive. With stride 8
    the last stage keeps its size too: 12x12 tokens from 96 px. Strides have no weights: a file fits both.
    """

    def __init__(self, stride: int = 16):
        stem = nn.Sequential(nn.Conv2d(3, 32, 5, 2, 2, bias=False), nn.BatchNorm2d(32), nn.ReLU())
        stages, width = [], 32
        for channels, blocks, step in zip(
            COMPACT_CHANNELS, COMPACT_BLOCKS, (1, 2, 2, stride // 8), strict=True
        ):
            layers = []
            for i in range(blocks):
                layers.append(Block(width, channels, step if i == 0 else 1))
                width = channels
            stages.append(nn.Sequential(*layers))
        super().__init__(stem, *stages)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")


class Backbone(nn.Module):
    """(B, 3, S, S) RGB in [0, 1] -> feature map (B, C, S/stride, S/stride). The normalisation of the image is inside.

    `load=False` skips the weights that `config.backbone_weights` names (a checkpoint brings its own). With `bfloat16` set to True
    the convolutions of a network in training mode are computed in bfloat16; the weights, and the features handed on, stay float32.
    Raises InputError when ImageNet's weights cannot be downloaded or a weights file does not fit.
    """

    bfloat16 = False

    def __init__(self, config: ModelConfig, load: bool = True):
        super().__init__()
        self.register_buffer("mean", torch.tensor(MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(1, 3, 1, 1), persistent=False)
        weights = config.backbone_weights if load else None
        if config.backbone == "compact":
            self.net, self.levels = CompactResNet(config.backbone_stride), (2, 3, 4)
            self.pyramid_channels = COMPACT_CHANNELS[1:]
        else:
            net = _torchvision_resnet(config.backbone, imagenet=weights == "imagenet")
            last = net.fc.in_features
            self.net, self.levels = (
                nn.Sequential(*list(net.children())[:-2]),
                (4, 5, 7),
            )  # without the pooling and the classifier
            self.pyramid_channels = (last // 8, last // 4, last)
        self.channels = self.pyramid_channels[-1]
        if weights not in (None, "imagenet"):
            load_backbone(self, weights)
        self.to(
            memory_format=torch.channels_last
        )  # a fifth to a third faster on a CPU; the numbers are the same

    def forward(self, image: Tensor) -> Tensor:
        return self.pyramid(image)[-1]

    def pyramid(self, image: Tensor) -> list[Tensor]:
        """The maps at stride 4 and 8, and the last one: image (B, 3, S, S) -> three tensors with `pyramid_channels` channels."""
        x = ((image - self.mean) / self.std).contiguous(memory_format=torch.channels_last)
        maps = []
        halved = self.bfloat16 and self.training
        with torch.autocast(x.device.type, torch.bfloat16, enabled=halved):
            for i, stage in enumerate(self.net):
                x = stage(x)
                if i in self.levels:
                    maps.append(x.float() if halved else x)
        return maps


def _torchvision_resnet(name: str, imagenet: bool) -> nn.Module:
    try:
        return getattr(torchvision.models, name)(weights=IMAGENET[name] if imagenet else None)
    except (
        OSError,
        RuntimeError,
    ) as error:  # URLError is an OSError; a cut-off file, with a wrong hash, a RuntimeError
        raise InputError(
            f"ImageNet weights for {name} could not be downloaded ({error}); connect to the network once, "
            "or train from scratch with backbone_weights=none"
        ) from None


def find_weights(path: str | Path) -> Path:
    """`path` as given, or below the repository's root, so that a notebook in notebooks/ finds data_samples/ too."""
    path = Path(path)
    for candidate in (path, Path(__file__).parents[3] / path):
        if candidate.is_file():
            return candidate
    raise InputError(
        f"backbone weights {path} not found; make them with `python -m dronekeypp pretrain`, or train from scratch "
        "with backbone_weights=none"
    )


def load_backbone(backbone: Backbone, path: str | Path) -> None:
    """Copy a backbone's weights from a safetensors file (float16 on disk is fine) into `backbone`, as float32."""
    path = find_weights(path)
    try:
        state = {
            key: value.float() if value.is_floating_point() else value
            for key, value in load_file(path).items()
        }
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not a readable safetensors file ({error})") from None
    load_state(backbone, state, path)


def load_state(module: nn.Module, state: dict[str, Tensor], path: str | Path) -> None:
    """`load_state_dict` whose every failure is one InputError naming the file and the first tensor that is wrong."""
    own = module.state_dict()
    missing, extra = sorted(set(own) - set(state)), sorted(set(state) - set(own))
    if missing or extra:
        what = f"lacks {missing[0]!r}" if missing else f"has an unknown tensor {extra[0]!r}"
        raise InputError(f"{path} {what}: it belongs to another configuration")
    for key, value in state.items():
        if value.shape != own[key].shape:
            raise InputError(
                f"{path}: {key!r} has shape {tuple(value.shape)}, the configuration needs {tuple(own[key].shape)}"
            )
    module.load_state_dict(state)


def save_backbone(backbone: Backbone) -> dict[str, Tensor]:
    """The backbone's tensors as float16 (half the file; integers stay), ready for safetensors."""
    return {
        key: (value.half() if value.is_floating_point() else value).detach().cpu().contiguous()
        for key, value in backbone.state_dict().items()
    }
