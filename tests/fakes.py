"""A small data set in memory with the fields of the real one. Coloured dots stand for the propellers."""

import math

import torch

from dronekeypp import camera, rotations
from dronekeypp.model import DroneKeyPP, ModelConfig

# FL, FR, RR, RL
CORNERS = torch.tensor([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
COLOURS = torch.tensor([[1.0, 0.1, 0.1], [0.1, 1.0, 0.1], [0.2, 0.2, 1.0], [1.0, 1.0, 0.1]])
K = torch.tensor([[1500.0, 0.0, 960.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]])


class FakeDrones(torch.utils.data.Dataset):
    """`n` pictures of `size` pixels of `classes` drones that differ in size and shape.

    The drones head up to `yaw` degrees and lean up to `tilt` degrees either way, and are 1.5 to `far` metres
    ahead of the camera. The frames take turns through `scenes`.
    """

    def __init__(self, n=32, size=32, seed=0, classes=7, yaw=180.0, tilt=20.0, scenes=(1, 2), far=6.0):
        draw = torch.Generator().manual_seed(seed)
        u = torch.rand(n, 6, generator=draw)
        label = torch.randint(classes, (n,), generator=draw)
        # Hubs are 0.06 to 0.18 m sideways. Every class has a length-to-width ratio of its own.
        side = 0.06 + 0.12 * label / max(1, classes - 1)
        length = side * (0.7 + 0.1 * (label % 4))
        hubs = CORNERS * torch.stack([length, side, side], dim=1)[:, None]  # (n, 4, 3)
        angles = (2 * u[:, :3] - 1) * torch.tensor([yaw, tilt, tilt]) / 360 % 1
        R = rotations.angles_to_matrix(angles)
        z = 1.5 + (far - 1.5) * u[:, 5]
        # The drones are below the camera, which sees them from above.
        t = torch.stack([z * (u[:, 3] - 0.5), z * (0.1 + 0.3 * u[:, 4]), z], dim=1)
        points = hubs @ R.transpose(1, 2)
        pixels = camera.project(points + t[:, None], K)
        low, high = pixels.amin(dim=1), pixels.amax(dim=1)
        extent = 1.4 * (high - low).amax(dim=1)
        square = torch.cat([(low + high) / 2 - extent[:, None] / 2, extent[:, None]], dim=1)
        self.data = {
            "K": K.expand(n, 3, 3).clone(),
            "square": square,
            "keypoints": camera.to_crop(pixels, square),
            "label": label,
            "keypoints_3d": points,
            "R": R,
            "t": t,
            "visible": torch.ones(n, 4, dtype=torch.bool),
            "scene": torch.tensor(scenes)[torch.arange(n) % len(scenes)],
            "frame": torch.arange(n),
            "subsequence": torch.arange(n) % 3,
        }
        self.size, self.epoch = size, None

    def set_epoch(self, epoch):
        self.epoch = epoch

    def __len__(self):
        return len(self.data["label"])

    def annotations(self):
        return self.data

    def __getitem__(self, i):
        item = {name: value[i] for name, value in self.data.items()}
        grid = (torch.arange(self.size) + 0.5) / self.size
        x, y = item["keypoints"].unbind(1)
        squared_distance = (grid[None, :, None] - x) ** 2 + (grid[:, None, None] - y) ** 2  # (S, S, 4)
        dots = torch.exp(-squared_distance / (2 * 0.05**2))  # (S, S, 4)
        image = 0.3 + torch.einsum("yxk,kc->cyx", dots, COLOURS) * 0.7
        # The grey of the upper left corner tells the class.
        image[:, : self.size // 8, : self.size // 8] = (item["label"] + 1) / 8
        return {"image": image.clamp(0, 1), **item}


def tiny(**changes):
    """Settings, as a dict, of a network that trains in seconds."""
    settings = dict(
        image_size=32,
        backbone_stride=8,
        width=16,
        layers=2,
        heads=2,
        ffn=32,
        decoder_width=32,
        decoder_layers=2,
    )
    return {**settings, **changes}


def tiny_config(**changes):
    """The settings of `tiny` as a ModelConfig. What the changes make useless goes back to its default."""
    return ModelConfig.from_dict(tiny()).replace(**changes)


def saved(folder, **changes):
    """Write a tiny DroneKey++ that was never trained as a checkpoint in `folder`; return the folder."""
    torch.manual_seed(0)
    DroneKeyPP(tiny_config(**changes)).save_pretrained(folder)
    return folder


def turn(axis, angle_degrees):
    """Rotation matrix (3, 3) about axis 0, 1 or 2."""
    c, s = math.cos(math.radians(angle_degrees)), math.sin(math.radians(angle_degrees))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = torch.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R
