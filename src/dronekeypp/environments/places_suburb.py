"""Places where people live and walk: two suburbs, a park, a village.

The module `specs` says what the numbers mean.
"""

from __future__ import annotations

from dronekeypp.environments.specs import (
    AUTUMN,
    DARK,
    GREENS,
    TOWN,
    Clouds,
    Environment,
    Housing,
    Planting,
    Relief,
    Strip,
)

FLAT = Relief(hills=9, width=1200, flat=250, woods=0.3)
SUBURB_STREET = Environment(
    "suburb_street",
    sun_azimuth=115,
    sun_elevation=31,
    clouds=Clouds(cumulus=0.18, cirrus=0.3),
    relief=TOWN,
    surface="lawn",
    strips=(
        Strip("concrete", heading=0, offset=1.5, width=11.5),
        Strip("asphalt", heading=0, offset=1.5, width=7.2, marks="road", kerb=0.14),
    ),
    housing=(
        Housing(
            ("white", "brick", "plaster"),
            height=(4.6, 6.2),
            size=(10, 14, 8.5, 10),
            rise=(2.8, 4),
            line=(0, 17, -120, 130),
            gap=(6, 13),
        ),
        Housing(
            ("brick", "plaster", "white"),
            height=(4.6, 6.2),
            size=(10, 14, 8.5, 10),
            rise=(2.8, 4),
            line=(0, -15, -120, 130),
            gap=(6, 13),
        ),
        Housing(
            ("white", "plaster", "brick"),
            height=(4.6, 6),
            size=(10, 13, 9, 10),
            rise=(3, 4),
            count=20,
            near=60,
            far=190,
        ),
    ),
    plants=(
        Planting("broadleaf", 20, 9, 130, (5.5, 9), line=(0, 9.6, 13)),
        Planting("broadleaf", 20, 9, 130, (5, 8.5), line=(0, -7.4, 14)),
        Planting("bush", 46, 11, 90, (0.8, 1.7)),
        Planting("oak", 40, 40, 200, (8, 14), clump=0.4),
        Planting("spruce", 9, 25, 140, (7, 13), DARK),
    ),
    props=(
        ("cars", 0, 4.2, -70, 90, 9, 0.45, "along"),
        ("cars", 0, -1.2, 14, 120, 13, 0.35, "along"),
        ("power", 0, 13.0, 8.0, 34.0, 5),
        ("lamps", 0, -5.2, -80, 90, 34, 7.0),
    ),
)

DUSK_SUBURB = Environment(
    "dusk_suburb",
    sun_azimuth=170,
    sun_elevation=2.2,
    haze=3,
    clouds=Clouds(cumulus=0.16, cirrus=0.7, base=2200),
    relief=TOWN,
    surface="lawn",
    glow=0.9,
    exposure=0.8,
    strips=(Strip("asphalt", heading=-20, offset=-2, width=8, marks="road", kerb=0.14),),
    housing=(
        Housing(
            ("brick", "plaster", "slab"),
            height=(8, 13),
            size=(14, 24, 10, 12),
            rise=(0, 4),
            line=(-20, 24, -130, 130),
            gap=(5, 14),
        ),
        Housing(
            ("white", "plaster"),
            height=(4.8, 6.2),
            size=(11, 14, 9, 10),
            rise=(3, 4),
            line=(-20, -20, -120, 120),
            gap=(6, 14),
        ),
        Housing(("slab",), height=(24, 36), size=(22, 40, 12, 14), count=5, near=150, far=320),
    ),
    plants=(
        Planting("broadleaf", 18, 9, 120, (6, 10), line=(-20, 10, 15)),
        Planting("broadleaf", 50, 50, 230, (7, 13), clump=0.5),
        Planting("spruce", 12, 30, 150, (7, 13), DARK),
    ),
    props=(("lamps", -20, 5, -100, 110, 30, 7.5), ("cars", -20, 3.4, -60, 70, 11, 0.4, "along")),
)

AUTUMN_PARK = Environment(
    "autumn_park",
    sun_azimuth=-40,
    sun_elevation=28,
    haze=2.5,
    clouds=Clouds(cirrus=0.2),
    relief=FLAT,
    surface="autumn_grass",
    strips=(Strip("gravel", heading=55, offset=6, width=3.2, wobble=1.0),),
    plants=(
        Planting("broadleaf", 90, 38, 150, (9, 18), AUTUMN, clump=0.55),
        Planting("oak", 30, 30, 120, (10, 17), AUTUMN, clump=0.4),
        Planting("birch", 16, 26, 90, (9, 14), ((0.34, 0.22, 0.04), (0.28, 0.20, 0.05))),
        Planting("bush", 50, 35, 150, (1, 2.6), AUTUMN + GREENS, clump=0.5),
        Planting("spruce", 14, 60, 150, (10, 19), DARK),
    ),
    props=(("lamps", 55, 8.5, -60, 70, 26, 4.2),),
)

SNOWY_VILLAGE = Environment(
    "snowy_village",
    sun_azimuth=-60,
    sun_elevation=19,
    haze=2.5,
    clouds=Clouds(cumulus=0.2, cirrus=0.3),
    surface="snow",
    exposure=0.9,
    relief=Relief(
        hills=60,
        width=600,
        flat=200,
        mountains=800,
        beyond=3500,
        facing=60,
        sector=220,
        woods=0.5,
        woods_colour=(0.05, 0.06, 0.055),
        snow_line=-1.0,
    ),
    strips=(Strip("trodden_snow", heading=35, offset=-3, width=4.2, wobble=0.8),),
    housing=(
        Housing(
            ("timber", "white", "ochre", "plaster"),
            height=(4.5, 7),
            size=(9, 14, 8, 11),
            rise=(3, 4.5),
            line=(35, 14, -110, 110),
            gap=(5, 16),
            snow=0.95,
        ),
        Housing(
            ("timber", "white", "red_shed"),
            height=(4, 6.5),
            size=(9, 14, 8, 11),
            rise=(3, 4.5),
            line=(35, -17, -110, 110),
            gap=(6, 20),
            snow=0.95,
        ),
        Housing(
            ("white", "timber"),
            height=(4, 7),
            size=(9, 14, 8, 11),
            rise=(3, 4.5),
            count=14,
            near=60,
            far=220,
            snow=0.95,
        ),
    ),
    plants=(
        Planting("spruce", 60, 30, 240, (7, 17), DARK, clump=0.6, snow=0.85),
        Planting("bare", 30, 12, 180, (5, 11), clump=0.3),
    ),
    props=(("fence", (-40, -19.5), (10, 15.5), 1.1, "posts"), ("power", 35, 6.5, 7.5, 32.0, 4)),
)
