"""What a command prints: on any terminal, and where nobody reads it any more."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator

from dronekeypp.errors import InputError


class OutputGone(OSError):
    """Stdout cannot be written: its reader has gone, or its disk is full."""


class _Stdout(io.FileIO):
    """Write to stdout. An error of its own kind says that it was this file, and not another, that failed."""

    def write(self, data: bytes | memoryview) -> int | None:
        try:
            return super().write(data)
        except OSError as error:
            raise OutputGone(error.errno, error.strerror) from None


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Let everything be printed in the block, and end it with one error where stdout cannot be written.

    A character that the terminal does not know is shown as "?". Where stdout is no file but what a notebook
    or a test has put there, nothing is done.

    Raises:
        InputError: stdout cannot be written.
    """
    before = sys.stdout
    try:
        if before is None or before is not sys.__stdout__:
            raise io.UnsupportedOperation
        file = _Stdout(before.fileno(), "w", closefd=False)
    except (OSError, ValueError):  # it is closed, or no file
        yield
        return
    before.flush()
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(file),
        encoding=before.encoding,
        errors="replace",
        line_buffering=before.line_buffering,
        write_through=before.write_through,
    )
    try:
        yield
        sys.stdout.flush()
    except OutputGone as error:
        _lead_nowhere(file.fileno())
        raise InputError(
            f"stdout cannot be written ({error.strerror}); what was computed until now is kept"
        ) from None
    finally:
        with contextlib.suppress(OSError):
            sys.stdout.flush()
        sys.stdout = before


def _lead_nowhere(stdout: int) -> None:
    """Let stdout lead to nowhere. Otherwise Python would try once more at the end, and complain."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stdout)
    os.close(nowhere)
