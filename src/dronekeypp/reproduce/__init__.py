"""Measure a table of the paper, or one of ours, from nothing: `python -m dronekeypp reproduce NAME`.

`protocol.py` says what a table is, and `runner.py` says how its trainings are made.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.reproduce.ablations import ABLATIONS, AblationTable
from dronekeypp.reproduce.beyond import Beyond
from dronekeypp.reproduce.claims import Claims
from dronekeypp.reproduce.domains import Domains
from dronekeypp.reproduce.figure6 import Figure6
from dronekeypp.reproduce.priors import Priors
from dronekeypp.reproduce.protocol import Table
from dronekeypp.reproduce.rates import Rates
from dronekeypp.reproduce.results import read_result
from dronekeypp.reproduce.runner import Bench
from dronekeypp.reproduce.table3 import Table3

# What one training may cost, by preset. `cpu`: 470,000 crops for the four methods of Table 3, about 40 quiet
# minutes on two cores, and a quarter of that for a row of an ablation. `paper`: the paper's own.
BUDGETS: dict[str, dict[str, Any]] = {"cpu": {"epochs": 40, "frames": 11760}, "paper": {}}
ABLATION_BUDGETS: dict[str, dict[str, Any]] = {"cpu": {"epochs": 10, "frames": 11760}, "paper": {}}

# Every table but the ablations. These, yours too, are looked up when they are asked for.
TABLES: dict[str, type[Table]] = {
    table.name: table for table in (Table3, Rates, Priors, Domains, Beyond, Figure6, Claims)
}


def names() -> list[str]:
    """Return the names of everything that can be reproduced."""
    return [*TABLES, *ABLATIONS]


def check_names(asked: Sequence[str]) -> None:
    """Raise InputError, naming what there is, if one of these names is no table."""
    for name in asked:
        if name not in names():
            raise InputError(f"reproduce {name}: choose {', '.join(names())}")


def reproduce_all(asked: Sequence[str], **settings: Any) -> list[dict[str, Any]]:
    """Measure several tables one after the other, and return their results.

    Args:
        asked: their names. All are checked before the first is measured.
        settings: the other arguments of `reproduce`.

    Raises:
        InputError: A name is unknown, or `reproduce` raises it.
    """
    check_names(asked)
    return [reproduce(name, **settings) for name in asked]


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
    trainings: int = 1,
    progress: bool = True,
) -> dict[str, Any]:
    """Measure one table, and keep everything that an earlier call made.

    Args:
        name: one of `names()`.
        preset: the preset that every training starts from.
        seeds: trainings a row, with seeds 0, 1, …; None takes the table's own number, mostly 3.
        overrides: settings for every run, on top of the preset's budget (`BUDGETS`, `ABLATION_BUDGETS`).
        data: the data set (default ROOT/data/6dronesyn). Flights that are missing are rendered.
        root: the folder below which runs/, figures/ and data_samples/results/ lie. Choose another one to try
            things out, because what is recorded there is replaced.
        stride: of the rendering, which keeps every `stride`-th frame.
        environments: the backgrounds of the rendering (default: the drawn ones).
        photographs: a folder of 360° panoramas, for `domains` and `figure6`.
        real: a folder of real drone frames with boxes.csv, for `figure6`.
        workers: the number of processes that render.
        trainings: how many trainings run side by side, as processes that share the cores. On two cores two
            are faster than one, and each has one thread.
        progress: whether to print what is being done.

    Returns:
        The recorded result, which is also written to data_samples/results/NAME.json.

    Raises:
        InputError: The name or the preset is unknown, no method uses one of the settings, the settings differ
            from those that an unfinished run was started with, or there is no OpenGL.
    """
    check_names([name])
    if preset not in BUDGETS:
        raise InputError(f"unknown preset {preset!r}; known: {', '.join(BUDGETS)}")
    if seeds is not None and seeds < 1:
        raise InputError(f"--seeds {seeds}: at least 1")
    if trainings < 1:
        raise InputError(f"--trainings {trainings}: at least 1")
    if "max_minutes" in (overrides or {}):
        raise InputError(
            "--set max_minutes: a run that is cut short would count as finished; "
            "kill it instead, and call again to go on"
        )
    if int(os.environ.get("WORLD_SIZE", 1)) > 1:
        raise InputError("reproduce runs in one process; torchrun is for `train`")
    if workers < 1 or stride < 1:
        raise InputError(f"--workers {workers} --stride {stride}: at least 1 of each")
    _check_folders(Path(root), data, environments, photographs, real)
    table = TABLES[name]() if name in TABLES else AblationTable(name)
    budgets, group = (BUDGETS, "table3") if table.full_budget else (ABLATION_BUDGETS, "ablations")
    root = Path(root)
    bench = Bench(
        root=root,
        preset=preset,
        budget={**budgets[preset], **(overrides or {})},
        group=f"{group}-{preset}",
        data=Path(data) if data else root / "data" / "6dronesyn",
        stride=stride,
        environments=Path(environments) if environments else None,
        photographs=Path(photographs) if photographs else None,
        real=Path(real) if real else None,
        workers=workers,
        trainings=trainings,
        progress=progress,
    )
    return table.reproduce(bench, seeds)


def _check_folders(root: Path, data: str | Path | None, *sources: str | Path | None) -> None:
    """Check the folders before anything is rendered.

    Raises:
        InputError: one that is written to is a file, or one that is read is not there.
    """
    for folder in (root, *([Path(data)] if data else [])):
        for place in (folder, *folder.parents):
            if place.exists() and not place.is_dir():
                raise InputError(f"{place} is a file, not a folder")
    for source in sources:
        if source is not None and not Path(source).is_dir():
            raise InputError(f"{source}: no such folder")


__all__ = ["ABLATION_BUDGETS", "BUDGETS", "Bench", "names", "read_result", "reproduce", "reproduce_all"]
