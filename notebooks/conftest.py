"""At the end of a run, a table of the notebooks: minutes taken, minutes promised, and memory needed."""

import json
import os
import re
from pathlib import Path

import pytest

# Two busy processes with spinning OpenMP threads stall each other; sleeping ones do not. This must be set
# before a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# The seconds taken and the largest memory in MB, by the notebook's name.
_seconds: dict[str, float] = {}
_peak_mb: dict[str, float] = {}


def _promised(path: Path) -> int | None:
    """The minutes that the first cell of a notebook promises, or None."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    first_cell = "".join(notebook["cells"][0]["source"])
    promise = re.search(r"\*\*Time\*\* about (\d+) minutes? on two cores", first_cell)
    return int(promise.group(1)) if promise else None


def _kernel_mb() -> float:
    """The largest resident memory so far, in MB, of a child of this process: the notebook's kernel.

    It is 0 where the system has no /proc.
    """
    largest = 0.0
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
            if int(fields["PPid"]) == os.getpid() and "VmHWM" in fields:
                kibibytes = float(fields["VmHWM"].split()[0])
                largest = max(largest, kibibytes * 1.024e-3)
        except (OSError, KeyError, ValueError):
            # The process ended while we looked.
            continue
    return largest


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add the time of a cell to its notebook's, and note the memory of the kernel."""
    file, _, _ = report.nodeid.partition("::")
    if not file.endswith(".ipynb"):
        return
    name = Path(file).stem
    _seconds[name] = _seconds.get(name, 0.0) + report.duration
    if report.when == "call":
        _peak_mb[name] = max(_peak_mb.get(name, 0.0), _kernel_mb())


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table, if any notebook ran."""
    if not _seconds:
        return
    terminalreporter.section("notebooks")
    for name, seconds in sorted(_seconds.items()):
        promised = _promised(Path(__file__).parent / f"{name}.ipynb")
        line = f"{name:28s} {seconds / 60:5.1f} min (promised: {promised})  {_peak_mb[name]:6.0f} MB"
        if promised is not None and seconds > 60 * promised:
            line += "  longer than promised on this machine"
        terminalreporter.write_line(line)
