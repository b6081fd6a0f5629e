"""Save and load checkpoints: folders that say by themselves what they hold.

A checkpoint holds two files:

    model.safetensors   the weights; nothing is pickled
    config.json         {"format": 2, "method": …, "drones": [{"name", "label", "hubs", "hubs_digest"}, …],
                         "settings": {…}, "checksum": …}

`drones` are the classes in their order, with the hubs that the network was trained on (body axes, metres).
`settings` are those of the method. The first format held only the settings, beside the method; it can be read
too.

A method of your own is one line in `METHODS`: its name, and where its class is. The class derives from
`model.PoseNetwork`.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any, Protocol

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from safetensors.torch import save as to_bytes
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from dronekeypp.classes import FIRST_EDITION, DroneClass, names_of, unnamed
from dronekeypp.errors import InputError
from dronekeypp.files import read_json, write_beside
from dronekeypp.schema import CHECKSUM, check_checksum, with_checksum
from dronekeypp.settings import Settings, usable

WEIGHTS, CONFIG, BEST = "model.safetensors", "config.json", "best"
FORMAT = 2

# Every method that a checkpoint can hold, and its class as MODULE:CLASS. A class is imported only when it is
# asked for.
METHODS: dict[str, str] = {
    "DroneKey++": "dronekeypp.model.network:DroneKeyPP",
    "DroneKey": "dronekeypp.baselines.dronekey:DroneKey",
    "DronePose": "dronekeypp.baselines.dronepose:DronePose",
}
EXPORTED = "dronekeypp.exported:OnnxNetwork"  # the class that runs a file of `export`

# The settings that every checkpoint of the first format held, whether its method used them or not.
FIRST_FORMAT = (
    *("backbone", "backbone_weights", "backbone_stride", "image_size", "width", "layers", "heads", "ffn"),
    *("norm", "dropout", "pool", "gate", "keypoint_head", "layer_input", "encoder", "classifier"),
    *("use_rays", "use_class", "use_3d", "rays", "rotation", "translation", "pose", "angle_zero"),
    *("decoder_width", "decoder_layers", "classes"),
)


class Network(Protocol):
    """This is what every loaded checkpoint offers: a `PoseNetwork`, or an exported file."""

    method: str
    config: Settings
    drones: tuple[DroneClass, ...]

    def __call__(self, image: Tensor, K: Tensor, square: Tensor, **truth: Tensor) -> dict[str, Any]: ...


def network_class(method: str) -> type:
    """Return the class of a method.

    Raises:
        InputError: there is no such method; the known ones are listed.
    """
    if method not in METHODS:
        raise InputError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
    return _imported(METHODS[method])


def _imported(place: str) -> type:
    """Import the class at MODULE:CLASS."""
    module, name = place.split(":")
    return getattr(importlib.import_module(module), name)


def find(path: str | Path) -> Path:
    """Return the folder or file of a checkpoint.

    It is `path` itself or, where `path` is a training run, its folder best/.
    """
    path = Path(path)
    best = path / BEST
    return best if (best / CONFIG).is_file() else path


def weights_file(path: str | Path) -> Path:
    """Return the file that holds the weights of a checkpoint.

    For an exported network this is the file itself.
    """
    path = find(path)
    return path if is_exported(path) else path / WEIGHTS


def is_exported(path: str | Path) -> bool:
    """Say whether a path has the suffix of a file that `export` writes."""
    return Path(path).suffix.lower() == ".onnx"


def load(path: str | Path, threads: int = 0) -> Network:
    """Load any checkpoint in evaluation mode.

    Args:
        path: a folder that `save` wrote, a run folder (its best/ is taken), or a file of `export`.
        threads: of ONNX Runtime, for a file of `export`; 0 means as many as there are cores.

    Raises:
        InputError: the checkpoint is missing, broken, or of an unknown method. The message names the file.
    """
    path = find(path)
    if is_exported(path):
        return _imported(EXPORTED)(path, threads)
    method, _, _ = read_config(path)
    return network_class(method).from_pretrained(path)


def save(network: nn.Module, folder: str | Path, half: bool = False) -> None:
    """Write a network's two files into `folder`, which is made if needed.

    Each file is first written beside its place and then renamed. With `half` the weights are stored as
    float16: the file is half as large, and is read back as float32.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    state = {}
    for key, value in network.state_dict().items():
        stored = value.half() if half and value.is_floating_point() else value
        state[key] = stored.detach().cpu().contiguous()
    write_beside(folder / WEIGHTS, to_bytes(state))
    text = json.dumps(describe(network), indent=2) + "\n"
    write_beside(folder / CONFIG, text.encode())


def describe(network: nn.Module) -> dict[str, Any]:
    """Return what config.json says of a network; the metadata of an exported file say the same."""
    drones = [drone.to_dict() for drone in network.drones]
    settings = network.config.to_dict()
    about = {"format": FORMAT, "method": network.method, "drones": drones, "settings": settings}
    return with_checksum(about)


def read_config(folder: str | Path, kind: type | None = None) -> tuple[str, Settings, tuple[DroneClass, ...]]:
    """Read the method's name, the settings and the drones of a checkpoint.

    Args:
        folder: the checkpoint.
        kind: a network's class that need not be among METHODS. It is used where its method is the stored one.

    Raises:
        InputError: a file is missing or broken. The message names it.
    """
    folder = Path(folder)
    for name in (CONFIG, WEIGHTS):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name} not found: a checkpoint is a folder with {CONFIG} and {WEIGHTS}"
            )
    method, config, drones = parse(read_json(folder / CONFIG), folder / CONFIG, kind)
    if kind is None or kind.method != method:
        kind = network_class(method)
    # A weight takes two bytes at least; a small network may have numbers that are not stored.
    stored, needed = (folder / WEIGHTS).stat().st_size, 2 * count_numbers(kind, config)
    if needed > stored + 1e8:
        raise InputError(
            f"{folder / CONFIG} describes a network of {needed / 2e6:.0f} million weights, "
            f"and {folder / WEIGHTS} holds {stored / 2e6:.0f} million at most: they do not belong together"
        )
    return method, config, drones


def count_numbers(network: type[nn.Module], config: Settings) -> int:
    """Return how many numbers the weights and buffers of a network are, without asking for their memory."""
    with torch.random.fork_rng(devices=()), _WithoutMemory():
        model = network(config, load_backbone=False)
    return sum(tensor.numel() for tensor in (*model.parameters(), *model.buffers()))


class _WithoutMemory(TorchFunctionMode):
    """Put the weights of layers on the device "meta", where nothing is stored, and do not fill them.

    Layers make their weights with `torch.empty`. The constants that networks compute stay on the CPU, because
    for arithmetic and draws on "meta" torch imports its compiler, which takes a second.
    """

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if func is torch.empty:
            return func(*args, **{**kwargs, "device": "meta"})
        name = func.__name__
        in_place = name == "__setitem__" or (name.endswith("_") and not name.endswith("__"))  # `fill_`
        if in_place and args and torch.is_tensor(args[0]) and args[0].is_meta:
            return args[0]
        return func(*args, **kwargs)


def parse(
    values: Any, source: str | Path, kind: type | None = None
) -> tuple[str, Settings, tuple[DroneClass, ...]]:
    """Return the method's name, the settings and the drones from what `describe` wrote.

    Both this format and the first one are read.

    Args:
        values: the content of config.json.
        source: what an error message calls it.
        kind: as in `read_config`.

    Raises:
        InputError: the values are not the description of a checkpoint. The message names `source`.
    """
    try:
        if not isinstance(values, dict):
            raise InputError(f"not the description of a checkpoint but a {type(values).__name__}")
        if "settings" not in values:
            method, settings = _from_first_format(values)
        elif values.get("format") == FORMAT:
            method, settings = str(values.get("method")), values["settings"]
        else:
            raise InputError(
                f"format {values.get('format')!r}; this version of the package reads 1 and {FORMAT}"
            )
        if kind is None or kind.method != method:
            kind = network_class(method)
        config = kind.Config.from_dict(settings)
        if "drones" not in values:
            return method, config, _drones_of_first_edition(getattr(config, "classes", 7))
        drones = tuple(DroneClass.from_dict(entry) for entry in values["drones"])
        names = names_of(drones)
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"two of its drones are called {name}")
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except TypeError:
        raise InputError(f"{source}: drones is not a list of classes") from None
    classes = getattr(config, "classes", len(drones))
    if classes != len(drones):
        raise InputError(f"{source}: names {len(drones)} drones, its settings have {classes} classes")
    # A setting that is missing would stand for its default.
    check_checksum(values, source, f"take its original, or delete its {CHECKSUM} if you mean the change")
    return method, config, drones


def _drones_of_first_edition(classes: int) -> tuple[DroneClass, ...]:
    """Return the drones of a checkpoint that does not name them: the seven, or classes by number."""
    if classes == len(FIRST_EDITION):
        return tuple(DroneClass(name) for name in FIRST_EDITION)
    return unnamed(classes)


def _from_first_format(values: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the method and the settings of a checkpoint of the first format.

    Settings that its method ignored are left out.
    """
    settings = dict(values)
    method = str(settings.pop("method", "DroneKey++"))
    kind = network_class(method).Config
    used = usable(kind, settings, {})
    for key in settings:
        if key not in FIRST_FORMAT:
            used[key] = settings[key]  # `from_dict` then says that there is no such setting
    return method, used


def read_state(folder: str | Path, method: str) -> dict[str, Tensor]:
    """Read the weights of a checkpoint as float32, under the names that they have today.

    Raises:
        InputError: the file cannot be read.
    """
    tensors = read_tensors(Path(folder) / WEIGHTS)
    return {name_of_today(key, method): value for key, value in tensors.items()}


def name_of_today(tensor: str, method: str) -> str:
    """Return the name that a tensor has today.

    The first format kept the head of a geometric network beside its decoder.
    """
    if method == "DroneKey++" and tensor.startswith("head."):
        return f"decoder.{tensor}"
    return tensor


def read_tensors(path: str | Path) -> dict[str, Tensor]:
    """Read the tensors of a safetensors file; float16 becomes float32.

    Raises:
        InputError: the file cannot be read. The message names it.
    """
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not a readable safetensors file ({error})") from None
    for key, value in tensors.items():
        if value.dtype == torch.half:
            tensors[key] = value.float()
    return tensors


def load_state(module: nn.Module, state: dict[str, Tensor], path: str | Path) -> None:
    """Put weights into a module.

    It is `load_state_dict` with one kind of error.

    Raises:
        InputError: a tensor is missing, unknown, of another shape or type, or holds NaN. The message names
            the file and the first such tensor.
    """
    own = module.state_dict()
    missing, extra = sorted(set(own) - set(state)), sorted(set(state) - set(own))
    if missing:
        raise InputError(f"{path} lacks {missing[0]!r}: it belongs to another configuration")
    if extra:
        raise InputError(f"{path} has an unknown tensor {extra[0]!r}: it belongs to another configuration")
    for key, value in state.items():
        check_tensor(f"{path}: {key!r}", value, own[key])
    module.load_state_dict(state)


def check_tensor(name: str, value: Tensor, own: Tensor) -> None:
    """Check that a stored tensor can take the place of a network's `own`.

    Weights may have been stored in another precision; the integers and truth values of quantised or edited
    files are no weights.

    Raises:
        InputError: it has another shape or another kind of numbers, or is not finite as `own` would hold it.
    """
    if value.shape != own.shape:
        raise InputError(f"{name} has shape {tuple(value.shape)}, the configuration needs {tuple(own.shape)}")
    if (
        value.is_floating_point() != own.is_floating_point()
        or value.is_complex()
        or value.dtype == torch.bool
    ):
        raise InputError(f"{name} holds {value.dtype}, the network {own.dtype}: no weights of this network")
    if not value.to(own.dtype).isfinite().all():
        raise InputError(f"{name} holds NaN or infinity: the training diverged, or the file was changed")
