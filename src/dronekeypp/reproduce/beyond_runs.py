"""Name the trainings of `beyond`: both networks, ours without its search, and two without a drone."""

from __future__ import annotations

from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.run import Run
from dronekeypp.reproduce.table3_runs import with_rate

METHOD = DroneKeyPP.method
SETTINGS = {"pose": "geometric", "classifier": "features"}
GEOMETRIC = with_rate(Run(METHOD, "geometric", SETTINGS))
# Trained without its search, which its direct branch alone is not: that one was trained beside the search.
NO_SEARCH = Run(METHOD, "geometric, trained without its search", {**GEOMETRIC.changes, "search": False})
# Each drone left out in turn would be seven trainings. These are the smallest and one whose size others have
# too, with a quarter of the budget.
WITHOUT = {
    name: Run(METHOD, f"geometric without {name}", {**GEOMETRIC.changes, "epochs": 10}, without=name)
    for name in ("Tello", "Air2")
}
LEFT_OUT = [run.variant for run in WITHOUT.values()]
