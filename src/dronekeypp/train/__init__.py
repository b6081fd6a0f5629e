"""Train a network (Sec. V-A).

`fit` trains in memory. `train` adds a run folder that survives being killed.
"""

from dronekeypp.checkpoint import BEST, CONFIG
from dronekeypp.train.loop import (
    check_finite,
    choose_device,
    epoch_order,
    fit,
    learning_rate,
    mirror_generator,
    spaced,
    validate,
)
from dronekeypp.train.run import (
    LAST,
    METRICS,
    describe_data,
    process_group,
    to_csv,
    train,
    train_on,
    weights_digest,
)
from dronekeypp.train.state import BrokenState, TrainState, check_settings, run_settings

__all__ = [
    "BEST",
    "BrokenState",
    "CONFIG",
    "LAST",
    "METRICS",
    "TrainState",
    "check_finite",
    "check_settings",
    "choose_device",
    "describe_data",
    "epoch_order",
    "fit",
    "learning_rate",
    "mirror_generator",
    "process_group",
    "run_settings",
    "spaced",
    "to_csv",
    "train",
    "train_on",
    "validate",
    "weights_digest",
]
