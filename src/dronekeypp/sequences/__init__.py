"""Turn single frames into a flight: with a Gaussian over its poses (the paper's Fig. 4), or a live filter.

A pose is R (3, 3), camera←body, and t (3,) metres. A flight is one drone's poses at rising times in seconds.
Where the drone was lost for longer than `longest_gap` seconds, a new flight begins: neither the Gaussian nor
the filter carries anything across such a gap. The Gaussian also looks at later frames. The filter does not.
"""

from dronekeypp.sequences.flights import LONGEST_GAP, check_flight, default_longest_gap, flights
from dronekeypp.sequences.gaussian import gaussian, inverse_variances
from dronekeypp.sequences.live import LiveFilter, filtered

__all__ = [
    "LONGEST_GAP",
    "LiveFilter",
    "check_flight",
    "default_longest_gap",
    "filtered",
    "flights",
    "gaussian",
    "inverse_variances",
]
