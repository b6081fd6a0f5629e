"""Turn a crop into the feature map X (Sec. III-A).

There are torchvision's ResNets, cut before the pooling, and a compact ResNet for small crops.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import torch
from torch import Tensor, nn

from dronekeypp.checkpoint import load_state, read_tensors
from dronekeypp.errors import InputError
from dronekeypp.files import repository_root
from dronekeypp.model.config import BackboneConfig

# ImageNet's channel means and deviations: every torchvision weight expects them, and they suit any outdoor
# photograph.
MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)
IMAGENET = {"resnet18": "IMAGENET1K_V1", "resnet34": "IMAGENET1K_V1", "resnet50": "IMAGENET1K_V1"}
COMPACT_CHANNELS = (32, 64, 128, 256)
COMPACT_BLOCKS = (1, 1, 2, 2)


class Block(nn.Module):
    """This block has two 3x3 convolutions and a shortcut (He et al. 2016, Fig. 2).

    It turns (B, inp, h, w) into (B, out, h/stride, w/stride).
    """

    def __init__(self, inp: int, out: int, stride: int) -> None:
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
    """This network has four stages of residual blocks, for crops of 96 to 128 px.

    It turns (B, 3, S, S) into (B, 256, S/stride, S/stride).

    The first convolution halves the crop and stage 1 keeps that size, so that small propellers survive. With
    stride 8 the last stage keeps its size too: 12x12 tokens from 96 px. Strides have no weights, so one
    weights file fits both strides.
    """

    def __init__(self, stride: int = 16) -> None:
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
    """This network turns a crop into a feature map.

    It takes RGB (B, 3, S, S) in [0, 1], returns (B, C, S/stride, S/stride), and normalises the image itself.
    The weights, and the features handed on, are float32 even where `bfloat16` is set (see `half_precision`).

    Args:
        config: which backbone, and its weights.
        load: False skips the weights that `config.backbone_weights` names, because a checkpoint brings its
            own.

    Raises:
        InputError: ImageNet's weights cannot be downloaded, or a weights file does not fit.
    """

    bfloat16 = False

    def __init__(self, config: BackboneConfig, load: bool = True) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(1, 3, 1, 1), persistent=False)
        weights = config.backbone_weights if load else None
        self.frozen: list[nn.Module] = []  # see `freeze`
        if config.backbone == "compact":
            self.net, self.stem, self.levels = CompactResNet(config.backbone_stride), 1, (2, 3, 4)
            self.pyramid_channels = COMPACT_CHANNELS[1:]
        else:
            net = _torchvision_resnet(config.backbone, imagenet=weights == "imagenet")
            last = net.fc.in_features
            # Without the pooling and the classifier.
            self.net, self.stem, self.levels = nn.Sequential(*list(net.children())[:-2]), 4, (4, 5, 7)
            self.pyramid_channels = (last // 8, last // 4, last)
        self.channels = self.pyramid_channels[-1]
        if weights not in (None, "imagenet"):
            load_backbone(self, weights)
        # A fifth to a third faster on a CPU; the numbers are the same.
        self.to(memory_format=torch.channels_last)

    def freeze(self, stages: int) -> None:
        """Keep the first stages as they are while the rest trains.

        Their weights get no gradient, and their batch norms use the stored statistics in training too. The
        first stages of a pretrained network find edges and blobs, which every picture has (Yosinski et al.,
        NeurIPS 2014), and at their size of map they cost more time than all others.

        Args:
            stages: how many; 0 none, 1 the stem, 2 the stem and the first stage, and so on.
        """
        count = self.stem + stages - 1 if stages else 0
        self.frozen = list(self.net.children())[:count]
        for i, stage in enumerate(self.net):
            stage.requires_grad_(i >= count)
        self.train(self.training)

    def train(self, mode: bool = True) -> Backbone:
        super().train(mode)
        for stage in self.frozen:
            stage.eval()
        return self

    def forward(self, image: Tensor) -> Tensor:
        return self.pyramid(image)[-1]

    def pyramid(self, image: Tensor) -> list[Tensor]:
        """Return the maps at stride 4 and 8, and the last one.

        Args:
            image: (B, 3, S, S) RGB in [0, 1].

        Returns:
            three tensors, which have the numbers of channels in `pyramid_channels`.
        """
        x = ((image - self.mean) / self.std).contiguous(memory_format=torch.channels_last)
        maps = []
        with half_precision(self, x.device):
            for i, stage in enumerate(self.net):
                x = stage(x)
                if i in self.levels:
                    maps.append(x.float())
        return maps


def half_precision(module: nn.Module, device: torch.device) -> torch.autocast:
    """Return the context in which a module that looks at the picture computes.

    With `module.bfloat16` set to True, the convolutions and matrix products of a module in training mode are
    computed in bfloat16. Elsewhere the context changes nothing.
    """
    return torch.autocast(device.type, torch.bfloat16, enabled=module.bfloat16 and module.training)


def _torchvision_resnet(name: str, imagenet: bool) -> nn.Module:
    """Return a ResNet of torchvision.

    Raises:
        InputError: ImageNet's weights cannot be downloaded.
    """
    import torchvision  # takes a second, and only these networks need it

    try:
        return getattr(torchvision.models, name)(weights=IMAGENET[name] if imagenet else None)
    # URLError is an OSError. A file that was cut off, and so has a wrong hash, is a RuntimeError.
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"ImageNet weights for {name} could not be downloaded ({error}); connect to the network once, "
            "or train from scratch with backbone_weights=none"
        ) from None


def find_weights(path: str | Path) -> Path:
    """Return the path of a weights file, as given or below the repository's root.

    So a notebook in notebooks/ finds it too.

    Raises:
        InputError: it is in neither place.
    """
    path = Path(path)
    if path.is_file():
        return path
    # The package may be installed without the repository.
    with contextlib.suppress(InputError):
        if (repository_root() / path).is_file():
            return repository_root() / path
    raise InputError(
        f"backbone weights {path} not found; they come with the repository: clone it and run this inside it, "
        "make them with `python -m dronekeypp pretrain`, or train from scratch with backbone_weights=none"
    )


def load_backbone(backbone: Backbone, path: str | Path) -> None:
    """Copy a backbone's weights from a safetensors file into `backbone`.

    They become float32; float16 on disk is fine.

    Raises:
        InputError: the file is missing, cannot be read, or does not fit.
    """
    path = find_weights(path)
    load_state(backbone, read_tensors(path), path)


def save_backbone(backbone: Backbone) -> dict[str, Tensor]:
    """Return the backbone's tensors as float16, ready for safetensors.

    The file is then half as large. Whole numbers keep their type.
    """
    tensors = {}
    for key, value in backbone.state_dict().items():
        stored = value.half() if value.is_floating_point() else value
        tensors[key] = stored.detach().cpu().contiguous()
    return tensors
