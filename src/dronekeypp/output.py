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


class _Stdout(io.TextIOWrapper):
    """Write to stdout. An error of its own kind says that it was this file, and not another, that failed."""

    def write(self, text: str) -> int:
        with _of_stdout():
            return super().write(text)

    def flush(self) -> None:
        with _of_stdout():
            super().flush()


@contextlib.contextmanager
def _of_stdout() -> Iterator[None]:
    """Raise OutputGone in place of any other OSError."""
    try:
        yield
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
        file = open(before.fileno(), "wb", closefd=False)
    except (OSError, ValueError):  # it is closed, or no file
        yield
        return
    before.flush()
    sys.stdout = _Stdout(
        file,
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
