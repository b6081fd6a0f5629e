"""This module runs in a contender's own process: it builds the contender once, then runs it in its turns."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from dronekeypp.bench.contender import COMPILED, GRAPHS, Contender
from dronekeypp.bench.stages import Facts, Frame, Stages, build, pictures

# Calls before the first one that counts. torch.compile makes a CUDA graph in three: it runs the kernels,
# records them, and replays them from then on.
WARM_UP_CALLS = 3

# Seconds a frame of each stage and of the "whole", and "peak_mb", the process's peak memory.
Round = dict[str, float]


@dataclass
class Prepared:
    """This class holds a contender that is ready to run."""

    contender: Contender
    stages: Stages
    frames: list[Frame]


_prepared: list[Prepared] = []  # the one of this process


def prepare(contender: Contender, folder: Path) -> Facts | str:
    """Build the contender of this process and run it a few times.

    What it has to write goes below `folder`.

    Returns:
        Its facts or, in one line, why it cannot take part: there is no C++ compiler to compile with, or no
        CUDA graph can be made of it.
    """
    torch.set_num_threads(contender.threads)
    words = f"{contender.name} {contender.engine} {contender.device} {contender.batch}"
    facts, stages = build(contender, folder / "".join(c if c.isalnum() else "-" for c in words))
    _prepared[:] = [Prepared(contender, stages, pictures(contender.batch))]
    try:
        for _ in range(WARM_UP_CALLS):
            run(0.0)
    except Exception as error:
        if contender.engine not in (COMPILED, GRAPHS):
            raise
        lines = str(error).strip().splitlines() or [""]
        return f"torch.compile failed ({type(error).__name__}: {lines[0][:100]})"
    return facts


def run(seconds: float) -> Round:
    """Run one round of this process's contender.

    Its calls take about `seconds` together, and there is at least one.
    """
    [prepared] = _prepared
    contender, stages = prepared.contender, prepared.stages
    spent, calls, began = dict.fromkeys(stages, 0.0), 0, time.perf_counter()
    with torch.inference_mode():
        while calls == 0 or time.perf_counter() - began < seconds:
            value = prepared.frames
            for name, stage in stages.items():
                tic = time.perf_counter()
                value = stage(value)
                if contender.device == "cuda":
                    torch.cuda.synchronize()
                spent[name] += time.perf_counter() - tic
            calls += 1
    times = {name: total / calls / contender.batch for name, total in spent.items()}
    if contender.device == "cuda":
        peak = torch.cuda.max_memory_allocated() / 1e6
    else:
        peak = _peak_memory()
    return {**times, "whole": sum(times.values()), "peak_mb": peak}


def _peak_memory() -> float:
    """Return the largest resident memory of this process so far, MB.

    On Linux it is not taken from getrusage: that hands a parent's peak on to its children.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1.024e-3
    import resource  # not on Windows, see `bench`

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
