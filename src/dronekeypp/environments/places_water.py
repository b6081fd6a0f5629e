"""Places at the water: a quay, a beach, a lake, a river.

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

HARBOUR_QUAY = Environment(
    "harbour_quay",
    sun_azimuth=-125,
    sun_elevation=33,
    clouds=Clouds(cumulus=0.34),
    relief=Relief(hills=70, width=1500, flat=400, woods=0.35),
    surface="concrete",
    strips=(Strip("water", heading=15, offset=64, width=112, length=1400),),
    waves=0.045,
    mirror_beyond=9.0,
    housing=(
        Housing(
            ("old_brick", "shed", "brick", "red_shed"),
            height=(9, 16),
            size=(20, 36, 14, 20),
            rise=(2, 4),
            line=(15, -30, -140, 150),
            gap=(0, 9),
        ),
        Housing(
            ("old_brick", "plaster", "white", "ochre"),
            height=(8, 15),
            size=(12, 20, 11, 14),
            rise=(3, 5),
            line=(15, 128, -220, 220),
            gap=(0, 4),
        ),
        Housing(
            ("container",), height=(2.6, 5.2), size=(12, 12.2, 2.5, 5), line=(15, -20, -70, -8), gap=(0.3, 5)
        ),
    ),
    plants=(Planting("broadleaf", 24, 130, 300, (8, 13), facing=105, sector=140),),
    props=(
        ("boats", 15, 18, -60, 70, 7.5),
        ("boats", 15, 42, -90, 100, 9.0),
        ("crane", -60.0, -46.0, 0.6, 33.0),
        ("lamps", 15, -9, -70, 70, 28, 9.0),
    ),
)

COAST_BEACH = Environment(
    "coast_beach",
    sun_azimuth=-150,
    sun_elevation=27,
    haze=2.2,
    clouds=Clouds(cumulus=0.14),
    surface="sand",
    waves=0.07,
    deep=(0.02, 0.05, 0.06),
    relief=Relief(
        hills=35,
        width=600,
        flat=90,
        mountains=420,
        beyond=2400,
        facing=75,
        sector=110,
        woods=0.3,
        woods_colour=(0.04, 0.05, 0.025),
    ),
    strips=(Strip("water", heading=0, offset=-20030, width=40000, wobble=5.0),),
    plants=(
        Planting("palm", 26, 26, 150, (6, 11), OLIVE, facing=90, sector=150),
        Planting("shrub", 70, 22, 160, (0.5, 1.8), OLIVE, facing=90, sector=170, clump=0.6),
        Planting("pine", 34, 60, 220, (7, 13), DARK, facing=90, sector=160, clump=0.5),
        Planting("tuft", 120, 8, 50, (0.3, 0.8), DRY, facing=90, sector=160, clump=0.7),
    ),
    housing=(
        Housing(
            ("white", "plaster", "ochre"),
            height=(5, 12),
            size=(12, 22, 10, 14),
            count=9,
            near=90,
            far=280,
            facing=95,
            sector=120,
        ),
    ),
)

LAKE_SHORE = Environment(
    "lake_shore",
    sun_azimuth=55,
    sun_elevation=9,
    haze=2.5,
    clouds=Clouds(cumulus=0.22, cirrus=0.5),
    surface="gravel",
    waves=0.02,
    mirror_beyond=70.0,
    visibility=26e3,
    relief=Relief(
        hills=90,
        width=700,
        flat=420,
        mountains=650,
        beyond=4000,
        woods=0.75,
        woods_colour=(0.028, 0.045, 0.018),
    ),
    strips=(Strip("water", heading=100, offset=-170, width=324, wobble=5.0, length=900),),
    plants=(
        Planting("pine", 40, 14, 120, (9, 17), DARK, facing=190, sector=170),
        Planting("birch", 20, 12, 90, (7, 13), GREENS, facing=190, sector=170),
        Planting(
            "reed",
            150,
            7,
            34,
            (0.9, 1.6),
            ((0.17, 0.16, 0.06), (0.12, 0.14, 0.045)),
            facing=60,
            sector=80,
            clump=0.5,
        ),
        Planting("rock", 30, 5, 26, (0.1, 0.7), clump=0.4),
        Planting("spruce", 150, 340, 480, (10, 20), DARK, facing=10, sector=150),
    ),
)

RIVER_BANK = Environment(
    "river_bank",
    sun_azimuth=25,
    sun_elevation=40,
    haze=3.2,
    clouds=Clouds(cover=0.85),
    surface="lawn",
    waves=0.03,
    mirror_beyond=24.0,
    relief=Relief(hills=24, width=700, flat=160, woods=0.5),
    strips=(
        Strip("water", heading=-25, offset=26, width=38, wobble=4.0, length=900),
        Strip("gravel", heading=-25, offset=-4, width=2.6, wobble=0.6),
    ),
    plants=(
        Planting("broadleaf", 60, 50, 180, (8, 16), clump=0.4),
        Planting("poplar", 14, 50, 200, (14, 21), line=(-25, 56, 9)),
        Planting("bush", 70, 46, 120, (1, 3), facing=65, sector=160),
        Planting("oak", 12, 16, 90, (9, 14), facing=-115, sector=150),
        Planting(
            "reed", 240, 5.5, 40, (0.8, 1.7), ((0.11, 0.13, 0.04), (0.15, 0.15, 0.055)), facing=65, sector=150
        ),
        Planting("tuft", 60, 3.5, 22, (0.12, 0.32), ((0.14, 0.18, 0.06), (0.18, 0.2, 0.07))),
    ),
)
