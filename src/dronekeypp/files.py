"""Writing a file so that nobody ever meets half of it."""

import os
from pathlib import Path


def write_beside(path: Path, content: bytes) -> None:
    """Write `content` to a file beside `path`, then rename: a reader, or a kill, never meets half a file."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
