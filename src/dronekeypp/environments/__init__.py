"""The 22 procedural outdoor environments that stand behind the drones.

The paper uses 22 photographed 360 degree environments (Sec. IV); these are drawn instead.
`render_environment` draws one. `python -m dronekeypp.environments --sheet FILE` draws all of them small, on
one sheet.

The places are described in `places` and `places_*`, with the classes of `specs`. `scene` draws a place onto a
`canvas`: first the `sky`, then the ground (`terrain`, `water`), then the things that `placing` puts there.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from dronekeypp.environments.places import PLACES
from dronekeypp.environments.scene import paint
from dronekeypp.environments.specs import Environment
from dronekeypp.errors import InputError

__all__ = ["ENVIRONMENTS", "Environment", "contact_sheet", "environment_spec", "render_environment"]

_BY_NAME: dict[str, Environment] = {place.name: place for place in PLACES}

ENVIRONMENTS: tuple[str, ...] = tuple(_BY_NAME)


def environment_spec(name: str) -> Environment:
    """Return the description of a place: its sun, its weather, what grows and stands there.

    Raises:
        InputError: there is no environment with this name.
    """
    try:
        return _BY_NAME[name]
    except KeyError:
        raise InputError(f"no environment named {name!r}; choose one of {', '.join(ENVIRONMENTS)}") from None


def render_environment(name: str, height: int = 2048, seed: int = 0) -> np.ndarray:
    """Draw an environment.

    The same (name, height, seed) gives the same pixels. Another seed gives another place of the same kind
    under the same sun.

    Args:
        name: one of `ENVIRONMENTS`.
        height: pixels; even, and 32 or more. The width is twice the height.
        seed: a whole number.

    Returns:
        (height, 2 height, 3) uint8 RGB, equirectangular. The module `sixdronesyn.panorama` describes the
        axes.

    Raises:
        InputError: there is no environment with this name, or the height is not allowed.
    """
    if not isinstance(height, int | np.integer) or height < 32 or height % 2:
        raise InputError(f"height must be an even whole number of pixels, 32 or more, got {height!r}")
    return paint(environment_spec(name), int(height), int(seed))


def contact_sheet(
    path: str | Path, height: int = 1024, columns: int = 4, seed: int = 0, width: int = 480
) -> None:
    """Draw all 22 environments on one sheet, each with its name, and write it to `path`.

    Args:
        path: where to write; it ends in .png or .jpg.
        height: pixels that each environment is drawn high.
        columns: environments side by side.
        seed: see `render_environment`.
        width: pixels that each environment is shown wide.

    Raises:
        InputError: the image cannot be written.
    """
    tiles = [_tile(name, height, seed, width) for name in ENVIRONMENTS]
    rows = []
    for first in range(0, len(tiles), columns):
        rows.append(np.concatenate(tiles[first : first + columns], 1))
    missing = rows[0].shape[1] - rows[-1].shape[1]  # the last row is shorter and goes to the middle
    margins = (missing // 2, missing - missing // 2)
    rows[-1] = np.pad(rows[-1], ((0, 0), margins, (0, 0)), constant_values=255)
    sheet = np.concatenate(rows)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR)):
        raise InputError(f"{path}: cannot write an image there; give a path that ends in .png or .jpg")


def _tile(name: str, height: int, seed: int, width: int) -> np.ndarray:
    """Draw one environment of a contact sheet, (width / 2 + 4, width + 4, 3) uint8 RGB, with its name."""
    panorama = render_environment(name, height, seed)
    tile = cv2.resize(panorama, (width, width // 2), interpolation=cv2.INTER_AREA)
    text = name.replace("_", " ")
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.8
    (text_width, text_height), baseline = cv2.getTextSize(text, font, scale, 1)
    bottom = width // 2
    # A dark box makes the letters legible on any ground.
    top_left = (0, bottom - text_height - baseline - 6)
    cv2.rectangle(tile, top_left, (text_width + 16, bottom), (40, 40, 40), -1)
    start = (8, bottom - baseline - 2)
    cv2.putText(tile, text, start, font, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return np.pad(tile, ((2, 2), (2, 2), (0, 0)), constant_values=255)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line, `python -m dronekeypp.environments`. arguments: None for those of the process."""
    parser = argparse.ArgumentParser(
        prog="python -m dronekeypp.environments", description="Draw the procedural environments."
    )
    parser.add_argument("--sheet", required=True, help="where to write the sheet of all 22 (.png or .jpg)")
    parser.add_argument("--height", type=int, default=1024, help="pixels each is drawn high")
    parser.add_argument(
        "--seed", type=int, default=0, help="another seed draws other places of the same kinds"
    )
    values = parser.parse_args(arguments)
    contact_sheet(values.sheet, values.height, seed=values.seed)
