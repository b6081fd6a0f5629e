"""Reading JSON, digests, writing a file so that nobody ever meets half of it, holding a folder, and the command that a file was made with."""

import contextlib
import hashlib
import json
import os
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from dronekeypp.errors import InputError


def read_json(path: str | Path, missing: str = "not found", mend: str = "") -> Any:
    """The content of a JSON file; a whole number that no float can hold comes back as infinity.

    Raises:
        InputError: missing, or not JSON; the message names the file, and says `missing` or the `mend`.
    """
    try:
        return json.loads(
            Path(path).read_text(encoding="utf-8"),
            parse_int=lambda text: int(text) if len(text) < 300 else float(text),
        )
    except FileNotFoundError:
        raise InputError(f"{path}: {missing}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error})" + (f"; {mend}" if mend else "")) from None


@contextlib.contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold a folder while writing to it: two processes that work in one would undo each other's work. Raises InputError if another holds it."""
    lock = folder / ".lock"
    try:
        with FileLock(lock, timeout=0):
            try:
                yield
            finally:
                with contextlib.suppress(OSError):  # Windows does not let go of an open file; then it stays
                    lock.unlink()
    except Timeout:
        raise InputError(
            f"another process is at work in {folder}: let it finish, or choose another folder"
        ) from None


def digest(content: bytes) -> str:
    """What tells one content from another: the first 16 hex digits of its SHA-256."""
    return hashlib.sha256(content).hexdigest()[:16]


def write_beside(path: Path, content: bytes) -> None:
    """Write `content` to a file beside `path`, then rename: a reader, or a kill, never meets half a file."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def command_line() -> str:
    """This process's command as it may be recorded: of an absolute path only the last part, the rest is a machine's own."""
    words = [Path(word).name if Path(word).is_absolute() else word for word in sys.argv[1:]]
    return f"python -m dronekeypp {shlex.join(words)}"
