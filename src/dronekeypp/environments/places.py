"""The 22 places in their fixed order.

The split into training, validation and test counts on this order: each of the three holds a mix of seasons,
hours, weather and kinds.
"""

from __future__ import annotations

from dronekeypp.environments.places_city import (
    CITY_SQUARE,
    CONSTRUCTION_SITE,
    PARKING_LOT,
    ROOFTOP,
    STADIUM_LOT,
)
from dronekeypp.environments.places_country import (
    ALPINE_VALLEY,
    DESERT,
    FOREST_CLEARING,
    MEADOW_NOON,
    QUARRY,
    SAVANNA,
    VINEYARD,
    WHEAT_FIELD,
    WINTER_FIELD,
)
from dronekeypp.environments.places_suburb import AUTUMN_PARK, DUSK_SUBURB, SNOWY_VILLAGE, SUBURB_STREET
from dronekeypp.environments.places_water import COAST_BEACH, HARBOUR_QUAY, LAKE_SHORE, RIVER_BANK
from dronekeypp.environments.specs import Environment

PLACES: tuple[Environment, ...] = (
    MEADOW_NOON,
    CITY_SQUARE,
    WINTER_FIELD,
    PARKING_LOT,
    ALPINE_VALLEY,
    SUBURB_STREET,
    DESERT,
    HARBOUR_QUAY,
    WHEAT_FIELD,
    DUSK_SUBURB,
    FOREST_CLEARING,
    COAST_BEACH,
    AUTUMN_PARK,
    CONSTRUCTION_SITE,
    SAVANNA,
    LAKE_SHORE,
    ROOFTOP,
    QUARRY,
    RIVER_BANK,
    SNOWY_VILLAGE,
    STADIUM_LOT,
    VINEYARD,
)
