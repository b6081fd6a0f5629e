"""Say what became of the boxes of a file, in a line for people and in numbers for machines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class BoxReport:
    """Hold what became of the boxes of a file.

    Attributes:
        file: its name, without its folder.
        format: what the README calls its format.
        boxes: how many it has; entries that say "no drone here" are none.
        used: how many are the drone's box of a frame.
        left_out: how many are left out, by the reason.
        on_no_frame: how many are of pictures that the footage does not have.
        no_drone: how many entries say that there is no drone.
        first_name: what the file calls its first picture.
        footage_first_name: what the footage calls its first frame.
        first_number: the number from which the file counts, where numbers were taken, else None.
        scaled: how many boxes were scaled from pictures of another size.
        remarks: what may be wrong with them.
    """

    file: str
    format: str
    boxes: int
    used: int
    left_out: Mapping[str, int]
    on_no_frame: int
    no_drone: int
    first_name: str
    footage_first_name: str
    first_number: int | None
    scaled: int
    remarks: tuple[str, ...] = ()

    def line(self) -> str:
        """Return the report in one line."""
        parts = [f"{self.used} of {self.boxes} boxes used", f"{sum(self.left_out.values())} left out"]
        if self.left_out:
            reasons = ", ".join(f"{count} {reason}" for reason, count in self.left_out.items())
            parts[-1] += f" ({reasons})"
        parts.append(f"{self.on_no_frame} on no frame")
        if self.no_drone:
            parts.append(f"{self.no_drone} times no drone")
        if self.scaled:
            parts.append(f"{self.scaled} scaled to the size of the frames")
        counted = "" if self.first_number is None else f", counted from {self.first_number}"
        names = f"its first name {self.first_name}{counted}, the footage's {self.footage_first_name}"
        notes = "".join(f"; NOTE: {remark}" for remark in self.remarks)
        return f"{self.file} ({self.format}): {', '.join(parts)}; {names}{notes}"

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON holds it."""
        return asdict(self)
