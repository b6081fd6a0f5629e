"""Commands that are killed leave what can be gone on with, and no process; signals are answered."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dronekeypp import processes

TESTS = Path(__file__).parent

# A parent with two children, of joblib and of a pool as `bench` has it. The second has a child of its own.
PARENT = """
import multiprocessing, os, subprocess, sys, time
from concurrent.futures import ProcessPoolExecutor
import joblib
from dronekeypp.processes import end_with_parent

def wait(folder, name, start=False):
    if start:
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(120)"])
        open(os.path.join(folder, str(child.pid)), "w").close()
    open(os.path.join(folder, str(os.getpid())), "w").close()
    time.sleep(120)

if __name__ == "__main__":
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, mp_context=spawn, initializer=end_with_parent, initargs=(True,))
    pool.submit(wait, sys.argv[1], "pool", True)
    joblib.Parallel(2, initializer=end_with_parent)(joblib.delayed(wait)(sys.argv[1], n) for n in "ab")
"""


def is_running(process):
    """Tell whether a process is there that has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="it looks into /proc")
def test_children_end_with_their_parent(tmp_path):
    script, folder = tmp_path / "parent.py", tmp_path / "processes"
    script.write_text(PARENT)
    folder.mkdir()
    parent = subprocess.Popen([sys.executable, script, folder], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while len(list(folder.iterdir())) < 4 and time.monotonic() < deadline:
        time.sleep(0.05)
    children = [int(path.name) for path in folder.iterdir()]
    assert len(children) == 4 and all(map(is_running, children))
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 20
    while any(map(is_running, children)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(is_running, children))


def test_a_process_without_a_parent_of_its_kind_is_left_alone():
    processes.end_with_parent()
    assert multiprocessing.parent_process() is None and not processes._watched


def sleep():
    time.sleep(120)


def test_children_are_ended_where_their_parent_is_stopped():
    child = multiprocessing.get_context("spawn").Process(target=sleep)
    with pytest.raises(KeyboardInterrupt), processes.ending_children():
        child.start()
        raise KeyboardInterrupt
    child.join(20)
    assert child.exitcode == -signal.SIGKILL


# A verb that waits until it is stopped, and tidies up.
WAITING = """
import sys, time
from dronekeypp import cli
def wait(_):
    try:
        print("ready", flush=True)
        time.sleep(60)
    finally:
        print("tidied up", flush=True)
cli.VERBS = [("check", "", lambda _: None, wait)]
sys.exit(cli.main(["check"]))
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_stops_a_command_in_one_line(number, status):
    command = [sys.executable, "-c", WAITING]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    process.wait(30)
    out, err = process.stdout.read(), process.stderr.read()
    assert (process.returncode, out, err) == (status, "tidied up\n", "stopped\n")


def test_the_handler_of_sigterm_is_put_back():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(processes.Terminated), processes.stopping_at_sigterm():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
    assert signal.getsignal(signal.SIGTERM) is before


def test_torchrun_keeps_its_own_way_to_end_processes(monkeypatch):
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "none")
    before = signal.getsignal(signal.SIGTERM)
    with processes.stopping_at_sigterm():
        assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="it forks")
def test_killed_commands_go_on_to_the_same_files(tmp_path):
    """Eight kills at random times; `tests/kills.py` makes as many as you like, of more commands."""
    command = [sys.executable, TESTS / "kills.py", tmp_path / "kills", "1", "8"]
    command += ["convert", "predict", "train", "evaluate"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("identical") == 4
