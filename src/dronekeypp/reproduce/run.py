"""Describe one training: a method, and the settings in which it differs from the preset."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dronekeypp import checkpoint
from dronekeypp.model import DroneKeyPP, PoseNetwork


@dataclass(frozen=True)
class Run:
    """Describe one training: a method, a variant of it, and the settings in which it differs from the preset.

    Args:
        method: its name, one of `checkpoint.METHODS`.
        variant: the name of the variant; None is the method as it is.
        changes: settings in which it differs from the preset.
        without: the name of a drone that is left out of training and validation.
        hypotheses: for a method with PnP, the readings of its two poses; each is a row of its own.
    """

    method: str
    variant: str | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    without: str | None = None
    hypotheses: tuple[str, ...] = ()

    @property
    def slug(self) -> str:
        """Return the name of its folder."""
        text = f"{self.method} {self.variant or ''}".strip().lower().replace("++", "pp")
        return "".join(c if c.isalnum() else "-" for c in text)

    @property
    def network(self) -> type[PoseNetwork]:
        """Return the class of its network.

        A detector of another library takes the settings of DroneKey++.
        """
        if self.method in checkpoint.METHODS:
            return checkpoint.network_class(self.method)
        return DroneKeyPP

    def row_name(self, hypothesis: str | None) -> str | None:
        """Return the variant's name in a table.

        A PnP that takes the upright pose is a variant of its own.
        """
        if hypothesis != "upright":
            return self.variant
        return f"{self.variant}, upright" if self.variant else "upright"
