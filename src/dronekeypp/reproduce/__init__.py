"""`python -m dronekeypp reproduce NAME`: a table of the paper, or one of ours, measured from nothing. See `runner.py`."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.reproduce import ablations, beyond, claims, domains, figure6, priors, table3
from dronekeypp.reproduce.runner import Bench, read_result

# What one training may cost, by preset. `cpu`: 470,000 crops for the four methods of Table 3, about 40 quiet minutes on two cores, and a
# quarter of that for a row of an ablation; `paper`: the paper's own.
BUDGETS: dict[str, dict[str, Any]] = {"cpu": {"epochs": 40, "frames": 11760}, "paper": {}}
ABLATION_BUDGETS: dict[str, dict[str, Any]] = {"cpu": {"epochs": 10, "frames": 11760}, "paper": {}}


def _domains(bench: Bench, seeds: int | None) -> dict[str, Any]:
    if bench.photographs is None:
        raise InputError(
            "reproduce domains needs --photographs DIR: a folder of 360° panoramas (2:1 equirectangular), six or more"
        )
    return domains.reproduce(bench, bench.photographs, seeds or 1)


# name -> what makes it from a Bench and the number of seeds (None: its own); the ablations, yours too, are looked up when asked for
TABLES: dict[str, Callable[[Bench, int | None], dict[str, Any]]] = {
    "table3": lambda bench, seeds: table3.reproduce(bench, seeds or 1),
    "priors": lambda bench, seeds: priors.reproduce(bench, seeds or 1),
    "domains": _domains,
    "beyond": lambda bench, seeds: beyond.reproduce(bench, seeds or 1),
    "figure6": lambda bench, _: figure6.reproduce(bench),
    "claims": lambda bench, _: claims.reproduce(bench.root),
}
FULL = (
    "table3",
    "domains",
    "beyond",
)  # at the full budget, and sharing their runs; the others are ablations, and share theirs


def names() -> list[str]:
    """What can be reproduced."""
    return [*TABLES, *ablations.ABLATIONS]


def reproduce(
    name: str,
    preset: str = "cpu",
    seeds: int | None = None,
    overrides: dict[str, Any] | None = None,
    data: str | Path | None = None,
    root: str | Path = ".",
    stride: int = 1,
    environments: str | Path | None = None,
    photographs: str | Path | None = None,
    real: str | Path | None = None,
    workers: int = 2,
    progress: bool = True,
) -> dict[str, Any]:
    """Measure one table; everything that is already there is kept. Returns the recorded result (also data_samples/results/NAME.json).

    Args:
        name: one of `names()`. seeds: trainings a row, seed 0, 1, … (default: 1, or what the ablation's entry says)
        overrides: settings for every run, on top of the preset's budget (`BUDGETS`, `ABLATION_BUDGETS`).
        data: the data set (default ROOT/data/6dronesyn); flights that are missing are rendered, every `stride`-th frame, before `environments`
            (default: the drawn ones), with `workers` processes.
        photographs: a folder of 360° panoramas, for `domains` and `figure6`. real: a folder of real drone frames with boxes.csv, for `figure6`.
        root: below it lie runs/, figures/ and data_samples/results/. Try things out in another one: what is recorded there is replaced.

    Raises:
        InputError: an unknown name or preset, settings that differ from those an unfinished run was started with, or no OpenGL.
    """
    if name not in names():
        raise InputError(f"reproduce {name}: choose {', '.join(names())}")
    if preset not in BUDGETS:
        raise InputError(f"unknown preset {preset!r}; known: {', '.join(BUDGETS)}")
    if seeds is not None and seeds < 1:
        raise InputError(f"--seeds {seeds}: at least 1")
    if "max_minutes" in (overrides or {}):
        raise InputError(
            "--set max_minutes: a run that is cut short would count as finished; kill it instead, and call again to go on"
        )
    if int(os.environ.get("WORLD_SIZE", 1)) > 1:
        raise InputError("reproduce runs in one process; torchrun is for `train`")
    root = Path(root)
    budget, group = (BUDGETS, "table3") if name in FULL else (ABLATION_BUDGETS, "ablations")
    bench = Bench(
        root=root, preset=preset, budget={**budget[preset], **(overrides or {})}, group=f"{group}-{preset}",
        data=Path(data) if data else root / "data" / "6dronesyn", stride=stride,
        environments=Path(environments) if environments else None, workers=workers, progress=progress,
        photographs=Path(photographs) if photographs else None, real=Path(real) if real else None,
    )  # fmt: skip
    return TABLES[name](bench, seeds) if name in TABLES else ablations.reproduce(name, bench, seeds)


__all__ = ["ABLATION_BUDGETS", "BUDGETS", "Bench", "names", "read_result", "reproduce"]
