"""Files that are written whole: whatever ends the process, the file is the new one or the old one.

What is written stands beside the file, under a hidden name, until it is complete and on the disk;
then it takes the file's place. What a process that was killed left there, the next one writes over.
"""

import os
import stat
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

__all__ = ["whole"]


def place(name: str, path: str | os.PathLike[str]) -> Path:
    """Return the file that a path stands for, links resolved; it need not exist yet.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : path

    Raises
    ------
    ValueError
        When it is no file, or its folder does not exist.

    Examples
    --------
    >>> place("out", "no/such/folder/x.csv")
    Traceback (most recent call last):
    ...
    ValueError: out must be in a folder that exists; got 'no/such/folder/x.csv'
    """
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"{name} must be a path; got {path!r}")
    given = os.fspath(path)
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
    """Give a file to write to that takes the path's place when all went well: `replaced`, `locked`.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : path
        Where a link stands, the file that it leads to is written.

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
    """Give a file to write to that takes the path's place when all went well.

    One writer at a time: where there may be others, `locked` keeps them out. A file that was there
    leaves its permissions to the new one.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : Path

    Raises
    ------
    OSError
        When it cannot be written; nothing has changed then.
    """
    temporary = path.with_name(f".{path.name}.new")
    try:
        # of a process that was killed; if it is a link, it is not followed
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
    """Keep other processes from writing the same file; a process that dies leaves no lock behind.

    The lock is the operating system's, on a hidden file beside. It binds processes of one machine,
    and those of several where their shared file system passes locks on, as NFS does when its lock
    service runs; a file system without locks is refused. Copies of the process made by fork hold
    the lock too.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : Path

    Raises
    ------
    ValueError
        When it is being written elsewhere, or the folder cannot be written, or not be locked.
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
            # who held the lock before may have removed the file that is open here
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
        """Nothing to do: folders cannot be flushed here."""

else:
    import fcntl

    def _take(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _make_rename_durable(folder: Path) -> None:
        # not every file system can open or flush a folder; the file itself is safe
        with suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def reason(failure: BaseException) -> str:
    """Return what went wrong, in the operating system's words."""
    return getattr(failure, "strerror", None) or str(failure)
