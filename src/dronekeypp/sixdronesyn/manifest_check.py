"""Check what a data set's manifest.json holds, before anything relies on it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Field, model_validator

from dronekeypp.errors import InputError
from dronekeypp.schema import Count, Digest, FlightName, FrameNumber, Length, Schema, Words, check
from dronekeypp.sixdronesyn.plan import MOST_DRONES

NAME = "6DroneSyn"
Split = Literal["train", "val", "test"]
FrameKind = Literal["crop", "full"]
KINDS = get_args(FrameKind)
MEND = "mend it, or generate the data set in another folder"
# What the settings of older manifests lack.
OLDER: dict[str, Any] = {
    "edition": 1,
    "quadrotors": None,
    "depth": False,
    "masks": False,
    "own_drones": {},
}


class Settings(Schema):
    """This is what a data set was asked for."""

    version: str
    edition: int
    quadrotors: Annotated[list[Count], Field(min_length=2, max_length=2)] | None
    seed: Count
    frames: FrameKind
    size: Length | None
    stride: Length
    depth: bool
    masks: bool
    environments: str
    environment_digests: Words
    own_drones: Words

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.size is None) != (self.frames == "full"):
            raise ValueError(f"size {self.size!r} of {self.frames} frames")
        if self.quadrotors and self.quadrotors[0] >= self.quadrotors[1]:
            raise ValueError(f"quadrotors {self.quadrotors!r} are no range")
        return self


class ListedFlight(Schema):
    """This is what the manifest says of a finished flight, see `manifest.totals`."""

    split: Split
    digests: dict[FrameNumber, list[Digest]]


# What `generate` adds to a manifest at its end.
FINISHED = ("planned_frames", "frames", "digest", "annotation_digest", "flights")


class Manifest(Schema):
    """This is a manifest.json. Of what `generate` adds at its end all is there, or nothing."""

    name: Literal["6DroneSyn"] = NAME
    settings: Settings
    versions: list[Words] = []
    planned: dict[FlightName, Count]
    planned_frames: Count = Field(default=None)
    frames: dict[Split, Count] = Field(default=None)
    digest: Digest = Field(default=None)
    annotation_digest: Digest = Field(default=None)
    flights: dict[FlightName, ListedFlight] = Field(default=None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        missing = [key for key in FINISHED if key not in self.model_fields_set]
        if missing and len(missing) < len(FINISHED):
            raise ValueError(f"the field {missing[0]} is missing")
        if not missing and set(self.frames) != set(get_args(Split)):
            raise ValueError("frames are not those of train, val and test")
        return self


def check_manifest(path: Path, manifest: dict[str, Any]) -> None:
    """Check the settings, the plan, and what is listed of the flights.

    Args:
        path: of manifest.json, for the messages.
        manifest: what it holds.

    Raises:
        InputError: the edition is unknown, or a field is missing, unknown or of another kind.
    """
    settings = manifest.get("settings")
    if isinstance(settings, dict):
        settings = {**OLDER, **settings}
        edition = settings["edition"]
        if type(edition) is not int or edition not in MOST_DRONES:
            known = " and ".join(str(number) for number in MOST_DRONES)
            raise InputError(
                f"{path}: edition {edition!r} is unknown; this version of dronekeypp knows {known}"
            )
        manifest = {**manifest, "settings": settings}
    check(Manifest, manifest, f"{path}: not a data set's manifest", MEND)
