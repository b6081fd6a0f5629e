"""This module starts a process for every contender, asks them round after round, and gives the result."""

from __future__ import annotations

import multiprocessing
import os
import platform
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from dronekeypp import __version__
from dronekeypp.bench.contender import Contender, contenders, named
from dronekeypp.bench.rendering import rendering_speed
from dronekeypp.bench.rows import detector_of, detectors_beside, row_of, table
from dronekeypp.bench.stages import Facts
from dronekeypp.bench.worker import Round, prepare, run
from dronekeypp.errors import InputError
from dronekeypp.export import export
from dronekeypp.exported import OnnxNetwork
from dronekeypp.files import check_writable, write_json
from dronekeypp.processes import end_with_parent, ending_children

LONGEST = 3600  # seconds that a contender may run in a round


def bench(
    checkpoints: str | Path | Sequence[str | Path],
    json_file: str | Path | None = None,
    threads: int | None = None,
    rounds: int = 7,
    seconds: float = 1.0,
    chosen: Sequence[Contender] | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Measure one or several checkpoints, print the table, and return (and write as JSON) the result.

    Args:
        checkpoints: folders of DroneKey++ networks.
        json_file: where to write the result.
        threads: the threads of each contender; by default one a core.
        rounds: how often every contender is asked.
        seconds: how long it runs in each round.
        chosen: who takes part; by default `contenders` of the checkpoints, and the rendering of the data.
        progress: whether to print the table, and to show a bar in a terminal.

    Returns:
        {"name", "hardware", "rounds", "seconds", "versions", "rows"}. A row holds name, engine, device,
        batch, threads, frames_per_s (median over the rounds), ratio_to_yolov8n_pose (median of the ratios
        within a round; None without the detector), ratios_in_onnx_runtime (the same against the detectors
        that ONNX Runtime runs, by their names, for what it runs too), peak_mb (of its process; on a GPU of
        PyTorch's memory on it), params, flops, stages (ms a frame). With the default contenders there is also
        "rendering", see `rendering_speed`; None where this machine cannot render.

    Raises:
        InputError: a checkpoint cannot be read, the folder of `json_file` does not exist, a number is too
            small or too large, or this is Windows.
    """
    if json_file:
        check_writable(Path(json_file))  # before the work, not after it
    sources = named([checkpoints] if isinstance(checkpoints, (str, Path)) else checkpoints)
    threads = os.cpu_count() if threads is None else threads
    if os.name == "nt":
        raise InputError("bench cannot measure the memory of a process on Windows; run it in WSL")
    if rounds < 1 or threads < 1:
        raise InputError(f"rounds={rounds}, threads={threads}: at least 1 of each")
    if not 0 <= seconds <= LONGEST:
        raise InputError(f"seconds={seconds:g}: of each contender in each round, 0 (once) to {LONGEST}")
    rendering = {}
    if chosen is None:
        rendering = {"rendering": _rendering(threads)}
    with tempfile.TemporaryDirectory(prefix="dronekeypp-bench-") as folder:
        if chosen is None:
            chosen = contenders(sources, _exported(sources, Path(folder)), threads)
        participants = _measure(chosen, Path(folder), rounds, seconds, progress)
    result = {
        "name": "speed",
        "hardware": {
            "cpu": processor(),
            "cores": threads,
            "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        },
        "rounds": rounds,
        "seconds": seconds,
        "versions": {
            "dronekeypp": __version__,
            "torch": torch.__version__,
            "python": platform.python_version(),
        },
        "rows": _rows(participants),
        **rendering,
    }
    if json_file:  # before it is printed: nobody may be reading
        write_json(Path(json_file), result, indent=1)
    if progress:
        print(table(result["rows"]))
        if result.get("rendering"):
            line = "generate: {frames_per_s} crops of {size} px a second, {workers} workers"
            print(line.format(**result["rendering"]))
    return result


def _rendering(workers: int) -> dict[str, Any] | None:
    """Return the speed of `generate`, or None where this machine cannot render."""
    try:
        return rendering_speed(workers)
    except (ImportError, InputError) as error:
        tqdm.write(f"generate is left out: {error}")
        return None


@dataclass
class _Participant:
    """A participant is a contender in its process, with what was measured of it."""

    contender: Contender
    process: ProcessPoolExecutor
    facts: Facts
    rounds: list[Round] = field(default_factory=list)


def _exported(sources: dict[str, str], folder: Path) -> dict[str, str]:
    """Write the checkpoints as ONNX files in `folder`, and return {name: file}.

    The answer is empty where the optional extra is missing.
    """
    if not OnnxNetwork.installed():
        return {}
    files = {}
    for number, (name, source) in enumerate(sources.items()):
        files[name] = str(export(source, folder / f"net_{number}.onnx"))
    return files


def _measure(
    chosen: Sequence[Contender], folder: Path, rounds: int, seconds: float, progress: bool
) -> list[_Participant]:
    """Prepare every contender and ask all of them in turn.

    A contender that cannot take part is named and left out.
    """
    hidden = None if progress else True  # None: shown in a terminal only
    spawn = multiprocessing.get_context("spawn")
    participants = []
    # Children are ended before their pools are left: a pool would wait for what they compute.
    with ExitStack() as stack, ending_children():
        for contender in tqdm(chosen, "prepare", leave=False, disable=hidden):
            pool = ProcessPoolExecutor(1, mp_context=spawn, initializer=end_with_parent, initargs=(True,))
            process = stack.enter_context(pool)
            facts = process.submit(prepare, contender, folder).result()
            if isinstance(facts, str):
                who = f"{contender.name}, {contender.engine}, {contender.device}"
                tqdm.write(f"{who} is left out: {facts}")
            else:
                participants.append(_Participant(contender, process, facts))
        for _ in tqdm(range(rounds), "rounds", leave=False, disable=hidden):
            for participant in participants:
                participant.rounds.append(participant.process.submit(run, seconds).result())
    return participants


def _rows(participants: Sequence[_Participant]) -> list[dict[str, Any]]:
    """Return a row for each participant, in the same order."""
    measured = [participant.contender for participant in participants]
    rounds = [participant.rounds for participant in participants]
    rows = []
    for participant in participants:
        contender = participant.contender
        theirs = detector_of(contender, measured, rounds)
        beside = detectors_beside(contender, measured, rounds)
        rows.append(row_of(contender, participant.facts, participant.rounds, theirs, beside))
    return rows


def processor() -> str:
    """Return the CPU's name, as far as the system tells."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
