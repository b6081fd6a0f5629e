"""The 22 procedural outdoor environments: what stands behind the drones (paper, Sec. IV: 22 photographed 360 degree
environments).

`render_environment` draws one; `python -m dronekeypp.environments --sheet FILE` draws all of them small,
on one sheet. The modules beside this one draw: `sky`, `terrain` with `surfaces`, `plants`, `buildings`, `props`, all
onto a `canvas`; `scene` puts them together.
"""

from __future__ import annotations

import argparse
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.environments.places import PLACES
from dronekeypp.environments.scene import Environment, paint
from dronekeypp.errors import InputError

__all__ = ["ENVIRONMENTS", "Environment", "contact_sheet", "environment_spec", "render_environment"]

ENVIRONMENTS: tuple[str, ...] = tuple(place.name for place in PLACES)


@lru_cache(maxsize=1)
def _by_name() -> dict[str, Environment]:
    return {place.name: place for place in PLACES}


def environment_spec(name: str) -> Environment:
    """The description of a place: where its sun stands (`sun_azimuth`, `sun_elevation`, degrees), its weather, what
    grows and stands there.

    Raises InputError for an unknown name.
    """
    try:
        return _by_name()[name]
    except KeyError:
        raise InputError(f"no environment named {name!r}; choose one of {', '.join(ENVIRONMENTS)}") from None


def render_environment(name: str, height: int = 2048, seed: int = 0) -> np.ndarray:
    """Draw an environment: (height, 2 height, 3) uint8 RGB, equirectangular (see `panorama` for its axes).

    Deterministic: the same (name, height, seed) gives the same pixels. Another seed gives another place of the same
    kind under the same sun.
    """
    if not isinstance(height, int | np.integer) or height < 32 or height % 2:
        raise InputError(f"height must be an even whole number of pixels, 32 or more, got {height!r}")
    return paint(environment_spec(name), int(height), int(seed))


def contact_sheet(
    path: str | Path, height: int = 1024, columns: int = 4, seed: int = 0, width: int = 480
) -> None:
    """All 22 on one sheet written to `path`: drawn `height` pixels high, shown `width` wide, each with its name."""
    tiles = []
    for name in ENVIRONMENTS:
        tile = cv2.resize(
            render_environment(name, height, seed), (width, width // 2), interpolation=cv2.INTER_AREA
        )
        text, font = name.replace("_", " "), (cv2.FONT_HERSHEY_SIMPLEX, 0.8)
        (wide, high), below = cv2.getTextSize(text, *font, 1)
        cv2.rectangle(
            tile, (0, width // 2 - high - below - 6), (wide + 16, width // 2), (40, 40, 40), -1
        )  # letters are legible on any ground
        cv2.putText(tile, text, (8, width // 2 - below - 2), *font, (255, 255, 255), 1, cv2.LINE_AA)
        tiles.append(np.pad(tile, ((2, 2), (2, 2), (0, 0)), constant_values=255))
    rows = [np.concatenate(tiles[i : i + columns], 1) for i in range(0, len(tiles), columns)]
    short = rows[0].shape[1] - rows[-1].shape[1]
    rows[-1] = np.pad(rows[-1], ((0, 0), (short // 2, short - short // 2), (0, 0)), constant_values=255)
    sheet = np.concatenate(rows)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR)):
        raise InputError(f"{path}: cannot write an image there; give a path that ends in .png or .jpg")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Draw the procedural environments.")
    parser.add_argument("--sheet", required=True, help="where to write the sheet of all 22 (.png or .jpg)")
    parser.add_argument("--height", type=int, default=1024, help="pixels each is drawn high")
    parser.add_argument("--seed", type=int, default=0)
    values = parser.parse_args(arguments)
    contact_sheet(values.sheet, values.height, seed=values.seed)
