"""The network (Sec. III): `ModelConfig`, `DroneKeyPP`, and its parts."""

from .backbone import Backbone, CompactResNet, load_backbone
from .base import PoseNetwork
from .config import ModelConfig, Settings
from .decoder import PoseDecoder, RayFeatures
from .encoder import EncoderLayer, KeypointEncoder, SelfAttention, sine_positions
from .losses import TERMS, circular_loss, loss_terms, loss_weights, total_loss
from .network import DroneKeyPP

__all__ = [
    "TERMS", "Backbone", "CompactResNet", "DroneKeyPP", "EncoderLayer", "KeypointEncoder", "ModelConfig", "PoseDecoder", "PoseNetwork",
    "RayFeatures", "SelfAttention", "Settings", "circular_loss", "load_backbone", "loss_terms", "loss_weights",
    "sine_positions", "total_loss",
]  # fmt: skip
