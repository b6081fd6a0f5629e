"""Read and write files safely, and find those of the repository.

There are JSON files, digests, writing that never leaves half a file, and a lock for a folder.
"""

import contextlib
import hashlib
import json
import os
import re
import secrets
import shlex
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, TextIO

from filelock import FileLock, Timeout

from dronekeypp.errors import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LOCK = ".dronekeypp.lock"  # in a folder that a process is at work in
# A file that is being written: a dot, the name that it will have, what tells it from any other, its suffix.
_UNFINISHED = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{16}\.tmp(?:\.[^.]*)?")


def read_json(path: str | Path, missing: str = "not found", mend: str = "") -> Any:
    """Return the content of a JSON file.

    A whole number that no float can hold comes back as infinity.

    Args:
        path: the file.
        missing: what the message says of a file that is missing.
        mend: what the message tells the reader to do about a file that is not JSON.

    Raises:
        InputError: the file is missing, or it is not JSON, or has a key twice. The message names the file.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: {missing}") from None
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON ({error})" + (f"; {mend}" if mend else "")) from None
    return parse_json(text, path, mend)


def parse_json(text: str | bytes, path: str | Path, mend: str = "") -> Any:
    """Return the content of JSON text. A whole number that no float can hold comes back as infinity.

    Args:
        text: the text.
        path: the file it is of, for messages.
        mend: what the message tells the reader to do about text that is not JSON.

    Raises:
        InputError: it is not JSON, or an object has a key twice, of which JSON would keep the last.
    """
    try:
        return json.loads(text, parse_int=_whole_number, object_pairs_hook=_unique_keys)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error})" + (f"; {mend}" if mend else "")) from None


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        repeated = [key for key, _ in pairs if sum(key == other for other, _ in pairs) > 1]
        raise ValueError(f"the key {repeated[0]!r} is there twice in one object")
    return content


def _whole_number(text: str) -> int | float:
    return int(text) if len(text) < 300 else float(text)


def lock_folder(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Hold a folder while writing to it.

    Two processes that work in one folder would undo each other's work.

    Raises:
        InputError: another process holds the folder.
    """
    message = f"another process is at work in {folder}: let it finish, or choose another folder"
    return lock_file(folder / LOCK, message)


@contextlib.contextmanager
def lock_file(lock: Path, message: str) -> Iterator[None]:
    """Hold a lock, which is a file that is there as long.

    Raises:
        InputError: another process holds it, which `message` says, or the file is a link.
    """
    if lock.is_symlink():
        raise InputError(f"{lock}: a link, and a lock is a file; remove it")
    try:
        with FileLock(lock, timeout=0):
            try:
                yield
            finally:
                # Windows does not remove an open file; then it stays.
                with contextlib.suppress(OSError):
                    lock.unlink()
    except Timeout:
        raise InputError(message) from None


def digest(content: bytes) -> str:
    """Return the first 16 hex digits of the SHA-256 of `content`.

    They tell one content from another.
    """
    return hashlib.sha256(content).hexdigest()[:16]


@contextlib.contextmanager
def writing_beside(path: Path) -> Iterator[Path]:
    """Give a new file beside `path` to write to, and rename it to `path` at the end.

    It is renamed only when the block ends without an error. So no reader ever meets half a file, and a kill
    leaves none under the name of `path`. Its name is random, and nothing of that name was there before, no
    link either: nobody's file is written over. It has the suffix of `path`, because some writers look at it.
    """
    beside = path.with_name(f".{path.name}.{secrets.token_hex(8)}.tmp{path.suffix}")
    created = os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0), 0o666)
    try:
        if fcntl is None:
            os.close(created)  # Windows renames no open file
        else:
            # Held until the end, so that `remove_unfinished` can tell a dead writer from one at work.
            with contextlib.suppress(OSError):  # some network drives have no locks
                fcntl.flock(created, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
        if fcntl is not None:
            os.close(created)


def write_beside(path: Path, content: bytes) -> None:
    """Write `content` to a file beside `path`, then rename it to `path`.

    Raises:
        OSError: the disk is full, or the file too large. The error names `path`.
    """
    with writing_beside(path) as beside:
        try:
            beside.write_bytes(content)
        except OSError as error:  # while it writes, Python does not say of which file
            raise OSError(error.errno, error.strerror, str(path)) from None


def write_json(path: Path, value: Any, indent: int | None = None) -> None:
    """Write `value` as JSON beside `path`, then rename it to `path`.

    Without `indent` no space is wasted.
    """
    separators = None if indent else (",", ":")
    text = json.dumps(value, indent=indent, separators=separators)
    write_beside(path, (text + "\n").encode())


def append_to(path: Path) -> TextIO:
    """Open a text file to append lines to it. Bytes of file names that are no UTF-8 are kept.

    Raises:
        InputError: it is a link. Then what is written would go to somebody else's file.
    """
    if path.is_symlink():
        raise InputError(f"{path}: a link, and nothing is written through one; remove it")
    flags = os.O_CREAT | os.O_APPEND | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0)
    return open(os.open(path, flags, 0o666), "a", newline="", encoding="utf-8", errors="surrogateescape")


def make_folder(path: Path) -> None:
    """Make a folder that files of a run are written to, and those above it.

    Raises:
        InputError: it is a link or a file. Then what is written would go elsewhere, or nowhere.
    """
    if path.is_symlink():
        raise InputError(f"{path}: a link, and nothing is written through one; remove it")
    if path.exists() and not path.is_dir():
        raise InputError(f"{path} is a file, not a folder")
    path.mkdir(parents=True, exist_ok=True)


def is_unfinished(path: Path, names: Collection[str]) -> bool:
    """Tell whether a path is what a kill has left of a file with one of these names."""
    match = _UNFINISHED.fullmatch(path.name)
    return match is not None and match["name"] in names and path.is_file() and not path.is_symlink()


def remove_unfinished(folder: Path, names: Collection[str]) -> None:
    """Remove what kills have left in a folder of files with these names; folders in it are not searched.

    Other files stay, whatever they are called, and so does what a process is writing at this moment.
    """
    if not folder.is_dir():
        return
    for path in list(folder.iterdir()):
        if is_unfinished(path, names) and not _is_being_written(path):
            path.unlink(missing_ok=True)


def _is_being_written(path: Path) -> bool:
    """Tell whether a process is in `writing_beside` with this file. Windows does not let it be removed."""
    if fcntl is None:
        return False
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:  # renamed meanwhile
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def holds_nothing(folder: Path, names: Collection[str] = ()) -> bool:
    """Tell whether a folder holds nothing but what kills have left there of files with these names."""
    return all(path.name == LOCK or is_unfinished(path, names) for path in folder.iterdir())


def check_writable(path: Path) -> None:
    """Check that a file can be written at a path, and clear what a kill has left of it.

    Raises:
        InputError: the path is a folder, a link, a pipe or a device, or lies in a folder that does not exist.
    """
    check_replaceable(path)
    if not path.resolve().parent.is_dir():
        raise InputError(f"{path}: its folder does not exist; make it first")
    remove_unfinished(path.parent, (path.name,))


def check_replaceable(path: Path) -> None:
    """Check that a path is free, or that a plain file is there, which may be replaced.

    Raises:
        InputError: the path is a folder, a link, a pipe or a device.
    """
    if path.is_dir():
        raise InputError(f"{path}: a folder, not a file")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise InputError(f"{path}: a link, a pipe or a device; give the name of a plain file")


def natural_order(name: str) -> tuple[list[str | int], str]:
    """Return a sort key that puts "frame_2" before "frame_10"."""
    parts: list[str | int] = []
    for part in re.split(r"(\d+)", name):
        parts.append(int(part) if part.isdecimal() else part)
    return parts, name


def repository_root() -> Path:
    """Return the folder of the repository.

    It is where this package was installed from with `pip install -e .`, or else the current folder or one
    above it.

    Raises:
        InputError: the package was installed without the repository, and the current folder is not in one.
    """
    here = Path.cwd()
    for folder in (Path(__file__).parents[2], here, *here.parents):
        if (folder / "data_samples").is_dir() and (folder / "environment.txt").is_file():
            return folder
    raise InputError(
        "this needs data_samples/ of the repository, which the installed package does not hold: "
        "clone the repository and run this command inside it"
    )


def command_line() -> str:
    """Return this process's command as it may be recorded.

    Only the last part of an absolute path is kept, because the rest belongs to one machine.
    """
    words = []
    for word in sys.argv[1:]:
        words.append(Path(word).name if Path(word).is_absolute() else word)
    return f"python -m dronekeypp {shlex.join(words)}"
