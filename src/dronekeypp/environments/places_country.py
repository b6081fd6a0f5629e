"""Places in the country: fields, woods, mountains and dry lands.

The module `specs` says what the numbers mean.
"""

from __future__ import annotations

from dronekeypp.environments.specs import (
    DARK,
    DRY,
    GREENS,
    OLIVE,
    Clouds,
    Environment,
    Housing,
    Planting,
    Relief,
    Strip,
)

FIELD = Relief(hills=26, width=700, flat=120, woods=0.4)

VINE_COLOURS = ((0.075, 0.115, 0.03), (0.095, 0.13, 0.03))
VINES = tuple(
    Planting("bush", 46, 2.5, 70, (1.25, 1.6), VINE_COLOURS, line=(24.8, 1.2 + 2.4 * row, 1.15))
    for row in (-5, -4, -3, -2, 1, 2, 3, 4, 5)
)

MEADOW_NOON = Environment(
    "meadow_noon",
    sun_azimuth=62,
    sun_elevation=52,
    clouds=Clouds(cumulus=0.30),
    relief=FIELD,
    surface="meadow",
    plants=(
        Planting("broadleaf", 80, 55, 260, (9, 18), clump=0.9),
        Planting("oak", 22, 32, 170, (9, 16), clump=0.6),
        Planting("birch", 16, 30, 120, (8, 14), clump=0.7),
        Planting("bush", 60, 40, 220, (1.2, 3.2), clump=0.9),
        Planting("tuft", 90, 3, 30, (0.15, 0.38), ((0.17, 0.20, 0.07), (0.25, 0.24, 0.10))),
    ),
    props=(("power", 25, 70.0),),
)

WINTER_FIELD = Environment(
    "winter_field",
    sun_azimuth=140,
    sun_elevation=14,
    haze=2,
    clouds=Clouds(cirrus=0.3),
    surface="snow",
    exposure=1.12,
    relief=Relief(
        hills=30, width=800, flat=130, woods=0.45, woods_colour=(0.055, 0.06, 0.05), snow_line=-1.0
    ),
    plants=(
        Planting("bare", 90, 30, 240, (7, 16), clump=0.85),
        Planting("spruce", 110, 45, 230, (8, 20), DARK, clump=0.9, snow=0.8),
        Planting("shrub", 30, 18, 150, (0.6, 1.8), DRY, clump=0.5, snow=0.4),
    ),
    props=(("fence", (-60, 22), (70, 34), 1.1, "posts"),),
)

ALPINE_VALLEY = Environment(
    "alpine_valley",
    sun_azimuth=-30,
    sun_elevation=41,
    haze=1.4,
    clouds=Clouds(cumulus=0.22, base=2300),
    surface="meadow",
    visibility=45e3,
    relief=Relief(
        hills=60,
        width=600,
        flat=110,
        mountains=1900,
        beyond=3600,
        woods=0.55,
        woods_colour=(0.020, 0.036, 0.016),
        snow_line=1250,
    ),
    plants=(
        Planting("spruce", 110, 60, 330, (10, 24), DARK, clump=0.95),
        Planting("rock", 26, 9, 110, (0.3, 1.6), clump=0.5),
        Planting("tuft", 60, 3.5, 22, (0.12, 0.3), ((0.17, 0.20, 0.07), (0.22, 0.22, 0.09))),
    ),
    housing=(
        Housing(
            ("timber",), height=(4.5, 6), size=(9, 13, 8, 10), rise=(2.4, 3.4), count=4, near=70, far=190
        ),
    ),
    props=(("fence", (-40, -24), (60, -34), 1.1, "posts"),),
)

DESERT = Environment(
    "desert",
    sun_azimuth=10,
    sun_elevation=58,
    haze=3.5,
    clouds=Clouds(cirrus=0.25),
    surface="desert",
    visibility=30e3,
    relief=Relief(
        hills=45,
        width=1500,
        flat=200,
        mountains=900,
        beyond=3400,
        woods=0.0,
        rock_colour=(0.27, 0.165, 0.105),
    ),
    plants=(
        Planting("shrub", 120, 8, 220, (0.3, 1.1), ((0.15, 0.14, 0.07), (0.12, 0.115, 0.06)), clump=0.4),
        Planting("rock", 70, 6, 200, (0.12, 0.9), clump=0.6),
        Planting("tuft", 60, 4, 40, (0.2, 0.45), DRY, clump=0.3),
    ),
)

WHEAT_FIELD = Environment(
    "wheat_field",
    sun_azimuth=85,
    sun_elevation=24,
    haze=3,
    clouds=Clouds(cumulus=0.30, thickness=900),
    surface="wheat",
    relief=Relief(hills=30, width=1000, flat=140, woods=0.25),
    strips=(Strip("soil", heading=-35, offset=-1.0, width=3.4, wobble=0.5),),
    plants=(
        Planting("oak", 16, 60, 260, (8, 15), clump=0.5),
        Planting("poplar", 15, 90, 330, (14, 20), line=(60, 150, 11)),
        Planting(
            "reed", 800, 4.5, 42, (0.55, 0.85), ((0.36, 0.27, 0.10), (0.42, 0.31, 0.13), (0.30, 0.23, 0.09))
        ),
    ),
    props=(
        ("pylon", 190.0, 120.0, 0.9, 40.0),
        ("pylon", -60.0, 330.0, 0.9, 40.0),
        ("pylon", 420.0, -80.0, 0.9, 40.0),
    ),
)

FOREST_CLEARING = Environment(
    "forest_clearing",
    sun_azimuth=40,
    sun_elevation=46,
    clouds=Clouds(cumulus=0.25),
    relief=Relief(hills=20, width=500, flat=70, woods=0.9),
    surface="forest_floor",
    strips=(Strip("lawn", heading=30, offset=0, width=26, wobble=6.0),),
    plants=(
        Planting("spruce", 120, 19, 75, (13, 24), DARK),
        Planting("broadleaf", 60, 18, 70, (10, 18)),
        Planting("birch", 26, 16, 50, (9, 15), GREENS),
        Planting("bush", 60, 13, 50, (0.6, 1.8)),
        Planting("tuft", 120, 4, 26, (0.12, 0.35), ((0.14, 0.18, 0.06), (0.18, 0.2, 0.07))),
        Planting("pine", 24, 22, 60, (15, 22), DARK),
    ),
)

SAVANNA = Environment(
    "savanna",
    sun_azimuth=-10,
    sun_elevation=17,
    haze=4.5,
    clouds=Clouds(cumulus=0.15, base=2200),
    surface="dry_grass",
    visibility=14e3,
    relief=Relief(
        hills=16,
        width=1500,
        flat=220,
        mountains=300,
        beyond=8000,
        woods=0.25,
        woods_colour=(0.07, 0.07, 0.035),
        rock_colour=(0.16, 0.13, 0.09),
    ),
    plants=(
        Planting("acacia", 46, 35, 420, (5, 9), OLIVE, clump=0.4),
        Planting("shrub", 110, 18, 300, (0.6, 2.2), OLIVE + DRY, clump=0.5),
        Planting("tuft", 260, 2.5, 40, (0.3, 0.8), ((0.30, 0.24, 0.11), (0.24, 0.2, 0.09)), clump=0.3),
        Planting("rock", 12, 20, 120, (0.3, 1.4)),
    ),
)

QUARRY = Environment(
    "quarry",
    sun_azimuth=-95,
    sun_elevation=34,
    haze=3,
    clouds=Clouds(cumulus=0.12),
    surface="rock",
    relief=Relief(
        hills=20, width=300, flat=60, mountains=75, beyond=190, woods=0.15, rock_colour=(0.30, 0.265, 0.215)
    ),
    plants=(
        Planting("rock", 150, 5, 130, (0.2, 2.4), clump=0.6),
        Planting("shrub", 50, 15, 130, (0.5, 1.6), OLIVE, clump=0.5),
        Planting("birch", 14, 60, 150, (5, 9), GREENS, clump=0.4),
    ),
)

VINEYARD = Environment(
    "vineyard",
    sun_azimuth=70,
    sun_elevation=36,
    haze=2.6,
    clouds=Clouds(cumulus=0.24, thickness=500),
    surface="rows",
    relief=Relief(
        hills=90, width=600, flat=130, woods=0.35, mountains=500, beyond=5000, facing=-60, sector=140
    ),
    plants=(
        *VINES,
        Planting("cypress", 14, 70, 200, (9, 14), DARK, clump=0.5),
        Planting("oak", 14, 70, 200, (6, 11), OLIVE, clump=0.5),
    ),
    housing=(
        Housing(
            ("ochre", "stone"), height=(5, 8), size=(14, 20, 9, 12), rise=(2, 3), count=3, near=110, far=190
        ),
    ),
)
