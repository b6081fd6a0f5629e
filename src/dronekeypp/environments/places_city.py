"""Places in a city: a square, a car park, a building site, a roof, a stadium.

The module `specs` says what the numbers mean.
"""

from __future__ import annotations

from dronekeypp.environments.specs import DRY, TOWN, Clouds, Environment, Housing, Planting, Relief, Strip

CITY_SQUARE = Environment(
    "city_square",
    sun_azimuth=-70,
    sun_elevation=38,
    haze=3,
    clouds=Clouds(cirrus=0.35),
    relief=TOWN,
    surface="paving",
    housing=(
        Housing(
            ("stone", "ochre", "plaster", "white"),
            height=(13, 21),
            size=(13, 24, 12, 15),
            rise=(3, 6),
            line=(8, 46, -75, 80),
        ),
        Housing(
            ("stone", "brick", "plaster"),
            height=(14, 20),
            size=(14, 26, 12, 15),
            rise=(3, 6),
            line=(8, -38, -70, 60),
        ),
        Housing(
            ("ochre", "stone", "white"),
            height=(14, 19),
            size=(14, 22, 12, 15),
            rise=(3, 6),
            line=(98, 72, -28, 34),
        ),
        Housing(
            ("glass", "office"), height=(20, 38), size=(22, 32, 16, 22), line=(98, -84, -30, 40), gap=(2, 6)
        ),
        Housing(
            ("slab", "brick", "office"), height=(20, 34), size=(18, 30, 14, 18), count=12, near=130, far=300
        ),
    ),
    plants=(
        Planting("broadleaf", 9, 14, 80, (7, 9), line=(8, 29, 10)),
        Planting("broadleaf", 9, 14, 80, (6.5, 8.5), line=(8, -24, 11)),
    ),
    props=(("lamps", 8, 20, -50, 55, 21, 6.0), ("lamps", 8, -17, -50, 55, 24, 6.0)),
)

PARKING_LOT = Environment(
    "parking_lot",
    sun_azimuth=20,
    sun_elevation=44,
    clouds=Clouds(cumulus=0.27, base=1500),
    relief=TOWN,
    surface="lawn",
    strips=(Strip("asphalt", heading=12, offset=0, width=68, marks="bays", kerb=0.15),),
    housing=(
        Housing(
            ("shed", "white", "office"),
            height=(7, 10),
            size=(40, 70, 25, 35),
            line=(12, 62, -150, 160),
            gap=(12, 40),
        ),
        Housing(
            ("brick", "slab", "plaster"),
            height=(9, 16),
            size=(18, 34, 12, 16),
            count=9,
            near=95,
            far=260,
            facing=-80,
            sector=170,
        ),
    ),
    plants=(
        Planting("broadleaf", 18, 30, 120, (6, 10), line=(12, -37, 11)),
        Planting("broadleaf", 30, 70, 240, (7, 13), clump=0.7),
        Planting("bush", 26, 34, 150, (0.9, 1.6), line=(12, 36.5, 4)),
    ),
    props=(
        ("cars", 12, 14.3, -70, 80, 2.6, 0.62, "across"),
        ("cars", 12, -14.3, -80, 80, 2.6, 0.35, "across"),
        ("cars", 12, 31.0, -80, 90, 2.6, 0.5, "across"),
        ("lamps", 12, 17, -70, 90, 32, 8.0),
        ("lamps", 12, -17, -60, 90, 32, 8.0),
    ),
)

CONSTRUCTION_SITE = Environment(
    "construction_site",
    sun_azimuth=95,
    sun_elevation=47,
    haze=3.5,
    clouds=Clouds(cover=0.97),
    relief=TOWN,
    surface="mud",
    housing=(
        Housing(("frame",), height=(16, 24), size=(26, 36, 16, 20), line=(-15, 36, -40, 45), gap=(9, 16)),
        Housing(
            ("container", "white"),
            height=(2.6, 5.2),
            size=(6, 6.2, 2.5, 5),
            line=(-15, -17, -30, 20),
            gap=(0.2, 2),
        ),
        Housing(
            ("slab", "brick", "plaster"), height=(14, 26), size=(18, 32, 12, 15), count=14, near=85, far=240
        ),
        Housing(("wall",), height=(2.0, 2.1), size=(30, 34, 0.3, 0.35), line=(-15, -34, -70, 80)),
    ),
    plants=(
        Planting("broadleaf", 26, 60, 180, (7, 12), clump=0.5),
        Planting("tuft", 70, 5, 40, (0.2, 0.5), DRY, clump=0.7),
        Planting("rock", 30, 5, 30, (0.1, 0.5), clump=0.5),
    ),
    props=(
        ("crane", 22.0, 30.0, 2.5, 40.0),
        ("crane", -34.0, 62.0, 0.4, 46.0),
        ("fence", (-36, -12), (-14, -30), 2.0, "mesh"),
        ("cars", -15, -12, -30, 0, 7, 0.5, "along"),
    ),
)

ROOFTOP = Environment(
    "rooftop",
    sun_azimuth=130,
    sun_elevation=36,
    haze=3.5,
    clouds=Clouds(cumulus=0.36, base=1700),
    surface="plates",
    visibility=12e3,
    eye=1.7,
    relief=Relief(hills=30, width=2500, flat=700, woods=0.3),
    housing=(
        Housing(("wall",), height=(0.95, 1.0), size=(24, 24.1, 0.35, 0.4), line=(10, 9.5, -12, 8)),
        Housing(("wall",), height=(0.95, 1.0), size=(24, 24.1, 0.35, 0.4), line=(10, -9.5, -12, 8)),
        Housing(("wall",), height=(0.95, 1.0), size=(19, 19.1, 0.35, 0.4), line=(100, 12, -9.6, 8)),
        Housing(("wall",), height=(0.95, 1.0), size=(19, 19.1, 0.35, 0.4), line=(100, -12, -9.6, 8)),
        Housing(
            ("shed",),
            height=(2.6, 3),
            size=(4, 5, 3, 4),
            count=1,
            near=6.5,
            far=7.5,
            facing=20,
            sector=20,
            heading=10,
        ),
        Housing(
            ("office", "slab", "brick", "glass", "stone"),
            height=(4, 16),
            size=(18, 34, 14, 24),
            count=46,
            near=26,
            far=160,
            heading=10,
        ),
        Housing(
            ("glass", "office", "slab"),
            height=(22, 70),
            size=(22, 34, 20, 28),
            count=22,
            near=170,
            far=600,
            heading=10,
        ),
        Housing(
            ("slab", "brick", "white"), height=(4, 20), size=(20, 50, 15, 25), count=60, near=160, far=700
        ),
    ),
    plants=(Planting("broadleaf", 30, 60, 300, (2, 5)),),
)

STADIUM_LOT = Environment(
    "stadium_lot",
    sun_azimuth=-165,
    sun_elevation=8,
    haze=3.5,
    clouds=Clouds(cumulus=0.2, cirrus=0.6),
    relief=TOWN,
    surface="lawn",
    strips=(Strip("asphalt", heading=-8, offset=0, width=96, marks="bays", kerb=0.15),),
    housing=(
        Housing(("stand",), height=(19, 21), size=(36, 36.1, 24, 26), line=(-8, 58, -90, 90)),
        Housing(
            ("shed", "office"), height=(6, 11), size=(30, 50, 20, 30), line=(-8, -70, -160, 150), gap=(15, 50)
        ),
    ),
    plants=(
        Planting("broadleaf", 26, 30, 170, (6, 9), line=(-8, -51, 10)),
        Planting("poplar", 12, 60, 220, (12, 17), line=(82, 110, 9)),
        Planting("broadleaf", 30, 90, 260, (7, 13), clump=0.6),
    ),
    props=(
        ("cars", -8, 31.4, -90, 100, 2.6, 0.4, "across"),
        ("cars", -8, -19.6, -90, 100, 2.6, 0.22, "across"),
        ("floodlight", 60.0, 52.0, 34.0),
        ("floodlight", -75.0, 70.0, 34.0),
        ("floodlight", -50.0, 130.0, 34.0),
        ("lamps", -8, 0, 25, 120, 34, 9.0),
        ("lamps", -8, 0, -110, -20, 34, 9.0),
    ),
)
