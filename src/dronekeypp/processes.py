"""Processes that are started, and that end: with their parent, and at a signal.

A process that is killed cannot tidy up after itself. So those that it started look after it.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType

LOOK_EVERY = 0.2  # seconds between two looks at the parent
TERMINATED = 128 + signal.SIGTERM  # the exit status after SIGTERM, as a shell gives it
INTERRUPTED = 128 + signal.SIGINT

_watched: list[int] = []  # the parent that this process looks after


class Terminated(KeyboardInterrupt):
    """SIGTERM came. It stops everything that Ctrl-C stops."""


def end_with_parent(group: bool = False) -> None:
    """Let this process end as soon as the process that started it has ended, however that came.

    A thread looks every LOOK_EVERY seconds. Calling it again changes nothing. In a process that no other
    process of Python started, nothing is done. Linux can do the same by itself (PR_SET_PDEATHSIG), but there
    the death of the thread that started the process counts. Where a fork server stands between the two,
    nothing is done either.

    Args:
        group: whether what this process starts ends as well. It then leads a process group of its own, and
            Ctrl-C in a terminal does not reach it any more.
    """
    parent = multiprocessing.parent_process()
    if parent is None or _watched or not hasattr(os, "getppid"):
        return
    if os.getppid() != parent.pid and _is_there(parent.pid):
        return
    _watched.append(parent.pid)
    if group and hasattr(os, "setpgid"):
        os.setpgid(0, 0)
    threading.Thread(target=_watch, args=(parent.pid, group), name="parent", daemon=True).start()


def _is_there(process: int) -> bool:
    """Tell whether there is a process with this number that has not ended."""
    with contextlib.suppress(OSError, IndexError), open(f"/proc/{process}/stat") as file:
        return file.read().rpartition(")")[2].split()[0] not in ("Z", "X")  # ended, and not looked after yet
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True


def _watch(parent: int, group: bool) -> None:
    """Wait until this process has another parent, and kill it then, or its whole group."""
    while os.getppid() == parent:
        time.sleep(LOOK_EVERY)
    if group and hasattr(os, "killpg"):
        os.killpg(os.getpgrp(), signal.SIGKILL)
    os._exit(1)


@contextlib.contextmanager
def ending_children() -> Iterator[None]:
    """Kill the processes that were started in the block by `multiprocessing`, if an exception ends it.

    Otherwise whoever leaves a pool of processes waits for what they are doing.
    """
    before = set(multiprocessing.active_children())
    try:
        yield
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            _kill(child)
        raise


def _kill(child: multiprocessing.process.BaseProcess) -> None:
    """Kill a process, and its group if it leads one (see `end_with_parent`)."""
    with contextlib.suppress(OSError, AttributeError):  # it has ended, or this is Windows
        if os.getpgid(child.pid) == child.pid:
            os.killpg(child.pid, signal.SIGKILL)
    child.kill()


@contextlib.contextmanager
def stopping_at_sigterm() -> Iterator[None]:
    """Raise `Terminated` where SIGTERM comes in the block, so that children and files are looked after.

    Under torchrun nothing is done: it ends its processes by SIGTERM, also those that wait for one another in
    native code, where Python hears no signal. Nor in another thread than the main one, which alone may.
    """
    if "TORCHELASTIC_RUN_ID" in os.environ or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def total_memory() -> int | None:
    """Return the memory of this machine, or of the container that we are in, bytes; None if not known."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):  # Windows does not tell
        return None
    for path in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with contextlib.suppress(OSError, ValueError), open(path) as file:
            total = min(total, int(file.read()))
    return total
