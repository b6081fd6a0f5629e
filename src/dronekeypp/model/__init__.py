"""Build the network (Sec. III): `ModelConfig`, `DroneKeyPP`, and its parts."""

from dronekeypp.model.backbone import Backbone, CompactResNet, load_backbone
from dronekeypp.model.base import PoseNetwork
from dronekeypp.model.config import BackboneConfig, EncoderConfig
from dronekeypp.model.contract import Decoder, PictureShape
from dronekeypp.model.decoder import DecoderConfig, PoseDecoder, RayFeatures
from dronekeypp.model.encoder import EncoderLayer, KeypointEncoder, SelfAttention, sine_positions
from dronekeypp.model.geometry import GeometricConfig, GeometricDecoder
from dronekeypp.model.losses import TERMS, circular_loss, loss_terms, loss_weights, total_loss
from dronekeypp.model.network import DECODERS, DroneKeyPP, ModelConfig
from dronekeypp.model.rotation_heads import ROTATION_HEADS, RotationHead

__all__ = [
    "DECODERS",
    "ROTATION_HEADS",
    "TERMS",
    "Backbone",
    "BackboneConfig",
    "CompactResNet",
    "Decoder",
    "DecoderConfig",
    "DroneKeyPP",
    "EncoderConfig",
    "EncoderLayer",
    "GeometricConfig",
    "GeometricDecoder",
    "KeypointEncoder",
    "ModelConfig",
    "PictureShape",
    "PoseDecoder",
    "PoseNetwork",
    "RayFeatures",
    "RotationHead",
    "SelfAttention",
    "circular_loss",
    "load_backbone",
    "loss_terms",
    "loss_weights",
    "sine_positions",
    "total_loss",
]
