"""The kinds of plants (and the boulder), as numbers: shape of the crown, how much foliage, which bark."""

from __future__ import annotations

from dataclasses import dataclass

from dronekeypp.environments.specs import Colour, Range


@dataclass(frozen=True)
class Kind:
    """How a plant grows. Lengths are shares of its height.

    Attributes:
        shape: ellipsoid, cone, column, umbrella, flat (crowns of leaves), fan (a palm), tuft (grass), rock,
            none.
        crown: (bottom, top) of the crown.
        width: of the crown.
        clumps: how many clumps of foliage; for a fan, how many fronds.
        leaves: how many leaves in all; for a tuft, how many blades.
        leaf: (long, short) half axes of a leaf in drawn pixels.
        spread: size of a clump.
        bark: albedo of the bark, or of the rock.
        trunk: thickness of the trunk at its foot; 0 for none.
        twigs: stems of a shrub; above 500, a crown of bare twigs.
    """

    shape: str = "ellipsoid"
    crown: Range = (0.18, 1.0)
    width: float = 0.75
    clumps: int = 70
    leaves: int = 26000
    leaf: tuple[float, float] = (3.9, 2.4)
    spread: float = 0.085
    bark: Colour = (0.13, 0.10, 0.075)
    trunk: float = 0.035
    twigs: int = 0


KINDS: dict[str, Kind] = {
    "broadleaf": Kind(clumps=100, leaves=62000, spread=0.095),
    "oak": Kind(width=1.05, crown=(0.14, 1.0), clumps=120, leaves=80000, spread=0.095, trunk=0.05),
    "birch": Kind(
        width=0.42,
        crown=(0.2, 1.0),
        clumps=110,
        leaves=30000,
        spread=0.06,
        bark=(0.5, 0.48, 0.44),
        trunk=0.022,
        twigs=90,
    ),
    "poplar": Kind(
        shape="column", width=0.2, crown=(0.06, 1.0), clumps=160, leaves=36000, spread=0.05, trunk=0.02
    ),
    "cypress": Kind(
        shape="column",
        width=0.15,
        crown=(0.03, 1.0),
        clumps=220,
        leaves=34000,
        leaf=(4, 2),
        spread=0.04,
        trunk=0.02,
    ),
    "spruce": Kind(
        shape="cone",
        width=0.42,
        crown=(0.05, 1.0),
        clumps=230,
        leaves=46000,
        leaf=(7, 1.8),
        spread=0.04,
        trunk=0.022,
    ),
    "pine": Kind(
        shape="umbrella",
        width=0.62,
        crown=(0.5, 1.0),
        clumps=46,
        leaves=40000,
        leaf=(5.5, 1.4),
        spread=0.06,
        bark=(0.22, 0.12, 0.075),
    ),
    "acacia": Kind(
        shape="flat",
        width=1.25,
        crown=(0.62, 0.98),
        clumps=90,
        leaves=42000,
        leaf=(3.4, 1.8),
        spread=0.055,
        trunk=0.03,
    ),
    "palm": Kind(
        shape="fan", width=0.5, crown=(0.7, 1.0), clumps=26, leaves=0, bark=(0.2, 0.16, 0.12), trunk=0.028
    ),
    "bare": Kind(
        shape="none",
        width=0.75,
        crown=(0.25, 1.0),
        clumps=0,
        leaves=0,
        twigs=900,
        bark=(0.12, 0.10, 0.09),
        trunk=0.035,
    ),
    "bush": Kind(
        width=1.5, crown=(0.0, 1.0), clumps=60, leaves=60000, leaf=(7.0, 4.5), spread=0.15, trunk=0.0
    ),
    "shrub": Kind(
        width=1.7, crown=(0.0, 1.0), clumps=40, leaves=22000, leaf=(9, 3.5), spread=0.17, trunk=0.0, twigs=60
    ),
    "tuft": Kind(shape="tuft", width=1.3, crown=(0, 1), clumps=0, leaves=420, trunk=0.0),
    "rock": Kind(
        shape="rock", width=1.5, crown=(0, 1), clumps=0, leaves=0, trunk=0.0, bark=(0.24, 0.215, 0.185)
    ),
    "reed": Kind(shape="tuft", width=0.5, crown=(0, 1), clumps=0, leaves=260, trunk=0.0),
}
