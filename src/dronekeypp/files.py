"""Writing a file so that nobody ever meets half of it, and the command that a file was made with."""

import os
import shlex
import sys
from pathlib import Path


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
