import json
import os
import re
from pathlib import Path

# Two busy processes with spinning OpenMP threads stall each other; sleeping ones do not. Must be set before a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# --- at the end of a run: how long each notebook took, beside what its first cell promises, and the memory it needed -------------------------

_seconds, _peak_mb = {}, {}

def _promised(path):
    """Minutes that the first cell of a notebook promises, or None."""
    first = "".join(json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"])
    found = re.search(r"\*\*Time\*\* about (\d+) minutes? on two cores", first)
    return int(found.group(1)) if found else None

def _kernel_mb():
    """Largest resident memory so far of the children of this process, MB: the notebook's kernel. 0 where the system has no /proc."""
    largest = 0.0
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
            if int(fields["PPid"]) == os.getpid() and "VmHWM" in fields:
                largest = max(largest, float(fields["VmHWM"].split()[0]) * 1.024e-3)
        except (OSError, KeyError, ValueError):  # it ended while we looked
            continue
    return largest

def pytest_runtest_logreport(report):
    file, _, cell = report.nodeid.partition("::")
    if not file.endswith(".ipynb"):
        return
    name = Path(file).stem
    _seconds[name] = _seconds.get(name, 0.0) + report.duration
    if report.when == "call":
        _peak_mb[name] = max(_peak_mb.get(name, 0.0), _kernel_mb())

def pytest_terminal_summary(terminalreporter):
    if not _seconds:
        return
    terminalreporter.section("notebooks")
    for name, seconds in sorted(_seconds.items()):
        promised = _promised(Path(__file__).parent / f"{name}.ipynb")
        late = "" if promised is None or seconds <= 60 * promised else "  longer than promised on this machine"
        terminalreporter.write_line(f"{name:28s} {seconds / 60:5.1f} min (promised: {promised})  {_peak_mb[name]:6.0f} MB{late}")
