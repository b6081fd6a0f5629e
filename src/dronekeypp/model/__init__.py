"""The network (Sec. III): `ModelConfig`, `DroneKeyPP`, and its parts."""

from dronekeypp.model.backbone import Backbone, CompactResNet, load_backbone
from dronekeypp.model.base import PoseNetwork
from dronekeypp.model.config import ModelConfig, Settings
from dronekeypp.model.decoder import PoseDecoder, RayFeatures
from dronekeypp.model.encoder import EncoderLayer, KeypointEncoder, SelfAttention, sine_positions
from dronekeypp.model.losses import TERMS, circular_loss, loss_terms, loss_weights, total_loss
from dronekeypp.model.network import DroneKeyPP

__all__ = [
    "TERMS", "Backbone", "CompactResNet", "DroneKeyPP", "EncoderLayer", "KeypointEncoder", "ModelConfig", "PoseDecoder", "PoseNetwork",
    "RayFeatures", "SelfAttention", "Settings", "circular_loss", "load_backbone", "loss_terms", "loss_weights",
    "sine_positions", "total_loss",
]  # fmt: skip
