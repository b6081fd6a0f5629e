"""Train and test in front of drawn environments and of photographs, in every combination (the domain table).

The paper puts its drones in front of 360° photographs and says that these close the gap to reality. This
table measures what the background alone does. Drones, flights, cameras and budget are the same, and
photographs are split by panorama, as the drawn environments are.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from dronekeypp.environments.cache import environment_files
from dronekeypp.errors import InputError
from dronekeypp.reproduce.comparisons import closing_lines
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import describe, measurements
from dronekeypp.reproduce.runner import Bench
from dronekeypp.reproduce.table3_runs import PAPERS
from dronekeypp.reproduce.tables import average, interval, line, methods, percent

DOMAINS = ("drawn", "photographs")
RUN = PAPERS  # the one of Table 3: trained before drawn environments it is the same run
LEAST = 6  # photographs: with fewer, the splits would share them


def benches(bench: Bench) -> dict[str, Bench]:
    """Return the bench of each of DOMAINS: the one given, and one whose data have photographed backgrounds.

    Raises:
        InputError: The bench names no folder of photographs, or the folder holds fewer than six
            equirectangular ones.
    """
    if bench.photographs is None:
        raise InputError(
            "reproduce domains needs --photographs DIR: "
            "a folder of 360° panoramas (2:1 equirectangular), six or more"
        )
    if len(environment_files(bench.photographs)) < LEAST:
        raise InputError(f"{bench.photographs}: a split by panorama needs six images or more")
    photographed = dataclasses.replace(
        bench,
        data=bench.data.with_name(bench.data.name + "-photographs"),
        environments=bench.photographs,
        group=bench.group + "-photographs",
    )
    return {"drawn": bench, "photographs": photographed}


class Domains(Table):
    """Measure the four cells of the table.

    Each has one seed unless another number is given.
    """

    name = "domains"
    full_budget = True

    def check(self, bench: Bench, seeds: int | None) -> None:
        """Raise InputError also where the photographs are missing or too few, see `benches`."""
        self.benches = benches(bench)
        super().check(bench, seeds)

    def prepare(self, bench: Bench) -> None:
        """Render both data sets."""
        for domain in self.benches.values():
            domain.render()

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        jobs = []
        for seed in range(seeds or 1):
            for name, domain in self.benches.items():
                jobs.append(Job(domain, RUN, seed, label=name))
        return jobs

    def measure(self, job: Job) -> Part:
        """Ask one training about both backgrounds."""
        part: Part = {}
        for split in SPLITS:
            for tested, target in self.benches.items():
                name = f"{split}-{tested}"
                frames = job.bench.measure(job.run, job.seed, split, name, target.data)[None]
                variant = f"trained {job.label}, tested {tested}"
                labels = {"method": job.run.method, "variant": variant, "seed": job.seed}
                add_entries(part, measurements(frames, target.names, split, **labels))
        part["run"] = {**job.bench.training_record(job.run, job.seed), "trained": job.label}
        return part

    def details(self, bench: Bench) -> dict[str, Any]:
        return {"datasets": {name: describe(domain.data) for name, domain in self.benches.items()}}

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)


def markdown(recorded: dict[str, Any]) -> str:
    """Return the table with one line for each cell, with 95 % intervals."""
    lines = [
        "# What a background is worth: DroneKey++ trained and tested before drawn and photographed "
        "environments",
        "",
        "| trained | tested | R MAE (deg) | R MedAE (deg) | t MAE (m) | t MedAE (m) | class "
        "| keypoints (px) |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for method, variant in methods(recorded):
        row = average(recorded, method, variant)
        trained, tested = [part.split()[1] for part in variant.split(", ")]
        shown = [trained, tested]
        for key, digits in (("R_mae_deg", 2), ("R_medae_deg", 2), ("t_mae_m", 3), ("t_medae_m", 3)):
            shown.append(interval(row, key, digits))
        shown += [percent(row["class_accuracy"]), f"{row['keypoint_px']:.1f}"]
        lines.append(line(shown))
    lines += closing_lines(recorded, verdicts=0)
    return "\n".join(lines) + "\n"
