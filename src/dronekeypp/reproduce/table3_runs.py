"""Name the trainings of Table 3: the methods that are set side by side, and what is compared among them."""

from __future__ import annotations

import dataclasses

from dronekeypp.baselines import yolo
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.flights import Name
from dronekeypp.reproduce.run import Run

METHOD = DroneKeyPP.method
# The learning rates of methods whose best one on validation is not the preset's, see `rates.best_rate`. Other
# tables take a run of this table with its rate.
RATES: dict[Name, float] = {}


def with_rate(run: Run) -> Run:
    """Return a run with the learning rate that RATES has for it, or as it is."""
    name = run.method, run.variant
    return dataclasses.replace(run, changes={**run.changes, "lr": RATES[name]}) if name in RATES else run


# YOLOv8n-pose trains itself, at a rate that its library chooses.
YOLO_RUN = Run(yolo.METHOD, hypotheses=("fit", "upright"))
PAPERS, SIX_NUMBERS = with_rate(Run(METHOD)), with_rate(Run(METHOD, "6D", {"rotation": "sixd"}))
RUNS = (
    PAPERS,
    SIX_NUMBERS,
    with_rate(Run("DroneKey", hypotheses=("fit", "upright"))),
    with_rate(Run("DronePose")),
    with_rate(Run("DronePose", "told the crop", {"use_rays": True})),
    YOLO_RUN,
)
OURS: Name = (PAPERS.method, PAPERS.variant)
# DronePose has six numbers. What they give DroneKey++ is split by heading.
GAINS = (((METHOD, SIX_NUMBERS.variant), OURS),)
