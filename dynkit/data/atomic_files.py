"""Atomic files: even if the process is killed, a file is either the new one or the old one.

New content is written beside the file, under a hidden name. Once it is complete and on the disk, it
replaces the file. A hidden file that a killed process left is overwritten by the next writer.
"""

import os
import stat
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from dynkit.core.validation import of_type

__all__ = ["whole"]


def checked_path(name: str, path: str | os.PathLike[str]) -> str:
    """Return the text of a path.

    Raises
    ------
    ValueError
        When it is not a path.
    """
    of_type(name, path, str | os.PathLike, "a path")
    return os.fsdecode(path)


def place(name: str, path: str | os.PathLike[str]) -> Path:
    """Return the path of a file, with links resolved; the file need not exist.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : path

    Raises
    ------
    ValueError
        When the path is not a file, or its folder does not exist.

    Examples
    --------
    >>> place("out", "no/such/folder/x.csv")
    Traceback (most recent call last):
    ...
    ValueError: out must be in a folder that exists; got 'no/such/folder/x.csv'
    """
    given = checked_path(name, path)
    try:
        file = Path(given).resolve()
        is_file, exists, in_folder = file.is_file(), file.exists(), file.parent.is_dir()
    except (OSError, RuntimeError, ValueError) as failure:  # too long, a loop of links, a null byte
        raise ValueError(f"{name} must be a file; got {given!r} ({reason(failure)})") from failure
    if exists and not is_file:
        raise ValueError(f"{name} must be a file; got {given!r}")
    if not in_folder:
        raise ValueError(f"{name} must be in a folder that exists; got {given!r}")
    return file


@contextmanager
def whole(name: str, path: str | os.PathLike[str]) -> Generator[BinaryIO]:
    """Yield a stream whose content replaces the file on success: `replaced` under `locked`.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : path
        If it is a link, the target of the link is written.

    Raises
    ------
    ValueError
        As `place` and `locked`.
    OSError
        As `replaced`.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "x.txt")
    ...     with whole("out", file) as stream:
    ...         _ = stream.write(b"all of it")
    ...         there_already = file.exists()
    ...     there_already, file.read_text(), len(os.listdir(folder))
    (False, 'all of it', 1)
    """
    file = place(name, path)
    with locked(name, file), replaced(name, file) as stream:
        yield stream


@contextmanager
def replaced(name: str, path: Path) -> Generator[BinaryIO]:
    """Yield a stream whose content replaces the file on success.

    Use `locked` where other processes may write the same file. The new file has the permissions of
    the old one.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : Path

    Raises
    ------
    OSError
        When it cannot be written; the old file is unchanged then.
    """
    temporary = path.with_name(f".{path.name}.new")
    try:
        # a killed process may have left it; a link is removed, not followed
        temporary.unlink(missing_ok=True)
        with temporary.open("xb") as target:
            yield target
            target.flush()
            os.fsync(target.fileno())
        with suppress(FileNotFoundError):
            temporary.chmod(stat.S_IMODE(path.stat().st_mode))
        temporary.replace(path)
    except BaseException as failure:
        with suppress(OSError):
            temporary.unlink()
        if isinstance(failure, OSError):
            raise OSError(
                failure.errno,
                f"{name} must be a file that can be written; got {path} ({reason(failure)})",
            ) from failure
        raise
    _make_rename_durable(path.parent)


@contextmanager
def locked(name: str, path: Path) -> Generator[None]:
    """Lock a file against writing by other processes; a process that dies releases its lock.

    The lock is the operating system's, on a hidden file beside the file. It works between processes
    of one machine, and between machines whose shared file system supports locks, such as NFS with
    its lock service; a file system without locks is refused. Forked copies of the process hold the
    lock, too.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : Path

    Raises
    ------
    ValueError
        When another process writes the file, or the folder cannot be written or locked.
    """
    lock = path.with_name(f".{path.name}.lock")
    handle = _open_lock(lock, name, path)
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()
        os.close(handle)


def _open_lock(lock: Path, name: str, path: Path) -> int:
    while True:
        try:
            handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as failure:
            raise _unwritable(name, "written", path, failure) from failure
        try:
            if not _take(handle):
                raise ValueError(f"{name} must not be in use by another writer; got {path}")
            # the previous holder of the lock may have removed the file that is open here
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), lock.stat()):
                    return handle
        except OSError as failure:  # a file system without locks
            os.close(handle)
            raise _unwritable(name, "locked", path, failure) from failure
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _unwritable(name: str, done: str, path: Path, failure: OSError) -> ValueError:
    return ValueError(
        f"{name} must be in a folder that can be {done}; got {path} ({reason(failure)})"
    )


if sys.platform == "win32":
    import msvcrt

    def _take(handle: int) -> bool:
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _make_rename_durable(folder: Path) -> None:
        """Do nothing: Windows cannot flush folders."""

else:
    import fcntl

    def _take(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _make_rename_durable(folder: Path) -> None:
        # some file systems cannot open or flush a folder; the file itself is on the disk
        with suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def reason(failure: BaseException) -> str:
    """Return the message of the operating system, or of the exception."""
    return getattr(failure, "strerror", None) or str(failure)
