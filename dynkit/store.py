"""Stores: results on disk that survive whatever ends the process, and are never read wrongly.

A store is one HDF5 file with a block of plain text before it. HDF5 files that are changed in place
are lost when the process dies, so a store is always written anew, beside the old one, and then
takes its place. The text holds a checksum of all that follows: a damaged store is refused before
any of it is interpreted.
"""

import hashlib
import io
import os
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

FORMAT = 1
"""Version of the layout; other versions are refused."""

# The least size of a user block, which HDF5 leaves to the application.
_BLOCK = 512
_TITLE = b"dynkit store, format "


@final
@dataclass(frozen=True, eq=False)
class Archive:
    """What a store holds.

    Parameters
    ----------
    entries : mapping of str to str
        Plain text by name: the attributes of the HDF5 file, each below 64 KiB.
    arrays : mapping of str to array
        The data sets of the HDF5 file; a slash in a name stands for a group.
    """

    entries: Mapping[str, str]
    arrays: Mapping[str, NDArray[Any]]


def place(store: str | os.PathLike[str]) -> Path:
    """Return the file that a store is, links resolved; it need not exist yet.

    Raises
    ------
    ValueError
        When it is no file, or its folder does not exist.

    Examples
    --------
    >>> place("no/such/folder/x.h5")
    Traceback (most recent call last):
    ...
    ValueError: store must be in a folder that exists; got 'no/such/folder/x.h5'
    """
    given = os.fspath(store)
    try:
        path = Path(given).resolve()
        is_file, exists, in_folder = path.is_file(), path.exists(), path.parent.is_dir()
    except (OSError, RuntimeError, ValueError) as failure:  # too long, a loop of links, a null byte
        raise ValueError(f"store must be a file; got {given!r} ({_reason(failure)})") from failure
    if exists and not is_file:
        raise ValueError(f"store must be a file; got {given!r}")
    if not in_folder:
        raise ValueError(f"store must be in a folder that exists; got {given!r}")
    return path


def read(path: Path) -> Archive:
    """Return what a store holds; nothing is written.

    Raises
    ------
    ValueError
        When the file cannot be read, is no store, is of another format, truncated or damaged.
    """
    try:
        with path.open("rb") as file:
            block = file.read(_BLOCK)
            if not block.startswith(_TITLE):
                raise ValueError(f"store must be a file that dynkit wrote; got {path}")
            version = block[len(_TITLE) :].split(b"\n")[0].decode("ascii", "replace")
            if len(block) == _BLOCK and version != str(FORMAT):
                raise ValueError(f"store must have format {FORMAT}; got format {version} of {path}")
            data = file.read()
    except OSError as failure:
        raise ValueError(
            f"store must be a file that can be read; got {path} ({_reason(failure)})"
        ) from failure
    if block != _heading(data):
        raise ValueError(f"store must be whole; got {path}, which is truncated or damaged")
    return _parsed(data)


def write(path: Path, archive: Archive) -> None:
    """Write a store: afterwards the file is the new one, or, after any failure, the old one.

    Raises
    ------
    OSError
        When it cannot be written.
    """
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=_BLOCK) as file:
        for name, text in archive.entries.items():
            file.attrs[name] = text
        for name, array in archive.arrays.items():
            file.create_dataset(name, data=array)
    data = buffer.getbuffer()
    temporary = path.with_name(f".{path.name}.new")
    try:
        with temporary.open("wb") as target:
            target.write(_heading(data[_BLOCK:]))
            target.write(data[_BLOCK:])
            target.flush()
            os.fsync(target.fileno())
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    _make_rename_durable(path.parent)


@contextmanager
def locked(path: Path) -> Generator[None, None, None]:
    """Keep other processes from writing the same store; a process that dies leaves no lock behind.

    Raises
    ------
    ValueError
        When it is being written elsewhere, or the folder cannot be written.
    """
    lock = path.with_name(f".{path.name}.lock")
    handle = _open_lock(lock, path)
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()
        os.close(handle)


def _open_lock(lock: Path, path: Path) -> int:
    while True:
        try:
            handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as failure:
            raise ValueError(
                f"store must be in a folder that can be written; got {path} ({_reason(failure)})"
            ) from failure
        try:
            if not _take(handle):
                raise ValueError(f"store must not be in use by another writer; got {path}")
            # who held the lock before may have removed the file that is open here
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), lock.stat()):
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


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
        handle = os.open(folder, os.O_RDONLY)
        try:
            # not every file system can flush a folder; the file itself is safe
            with suppress(OSError):
                os.fsync(handle)
        finally:
            os.close(handle)


def _heading(data: bytes | memoryview) -> bytes:
    text = (
        f"{_TITLE.decode()}{FORMAT}\n"
        f"sha256 {hashlib.sha256(data).hexdigest()} of the {len(data)} bytes after these {_BLOCK}\n"
        "The rest is HDF5: h5py and other HDF5 tools open this file as it is.\n"
    )
    return text.encode().ljust(_BLOCK, b"\0")


def _parsed(data: bytes) -> Archive:
    import h5py

    with h5py.File(io.BytesIO(bytes(_BLOCK) + data), "r") as file:
        entries = {name: str(text) for name, text in file.attrs.items()}
        arrays: dict[str, NDArray[Any]] = {}

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                arrays[name] = np.asarray(item)

        file.visititems(collect)
    return Archive(entries, arrays)


def _reason(failure: BaseException) -> str:
    return getattr(failure, "strerror", None) or str(failure)
