"""Stores: results on disk that survive whatever ends the process, and are never read wrongly.

A store is one HDF5 file with a block of plain text before it. HDF5 files that are changed in place
are lost when the process dies, so a store is always written anew, beside the old one, and then
takes its place. The text holds a checksum of all that follows: a damaged store is refused before
any of it is interpreted.
"""

import hashlib
import io
import os
from collections.abc import Generator, Iterable, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from dynkit.data import atomic_files as files

FORMAT = 1
"""Version of the layout; other versions are refused."""

# Longer texts are cut, and told apart by their hash: HDF5 attributes are limited.
_LONGEST = 1000
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
    return files.place("store", store)


def read(path: Path) -> Archive:
    """Return what a store holds; nothing is written.

    Raises
    ------
    ValueError
        When the file cannot be read, is no store, is of another format, truncated or damaged, or
        was made by something else.
    """
    try:
        with path.open("rb") as file:
            block = file.read(_BLOCK)
            if not block.startswith(_TITLE):
                raise ValueError(
                    "store must be a store of dynkit, as store=, --store and save() write; "
                    f"got {path}"
                )
            version = block[len(_TITLE) :].split(b"\n")[0].decode("ascii", "replace")
            if len(block) == _BLOCK and version != str(FORMAT):
                raise ValueError(f"store must have format {FORMAT}; got format {version} of {path}")
            data = file.read()
    except OSError as failure:
        raise ValueError(
            f"store must be a file that can be read; got {path} ({files.reason(failure)})"
        ) from failure
    if block != _heading(data):
        raise ValueError(f"store must be whole; got {path}, which is truncated or damaged")
    return _parsed(path, data)


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
    data = buffer.getbuffer()[_BLOCK:]
    with files.replaced("store", path) as target:
        target.write(_heading(data))
        target.write(data)


def locked(path: Path) -> AbstractContextManager[None]:
    """Keep other processes from writing the same store, as `dynkit.data.atomic_files.locked` says.

    Raises
    ------
    ValueError
        When it is being written elsewhere, or the folder cannot be written, or not be locked.
    """
    return files.locked("store", path)


def _heading(data: bytes | memoryview) -> bytes:
    text = (
        f"{_TITLE.decode()}{FORMAT}\n"
        f"sha256 {hashlib.sha256(data).hexdigest()} of the {len(data)} bytes after these {_BLOCK}\n"
        "The rest is HDF5: h5py and other HDF5 tools open this file as it is.\n"
    )
    return text.encode().ljust(_BLOCK, b"\0")


def _parsed(path: Path, data: bytes) -> Archive:
    """What the data hold; a whole file that `write` did not make may hold anything."""
    import h5py

    try:
        with h5py.File(io.BytesIO(bytes(_BLOCK) + data), "r") as file:
            entries = {name: str(text) for name, text in file.attrs.items()}
            arrays: dict[str, NDArray[Any]] = {}

            def collect(name: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset):
                    if item.external or item.is_virtual:  # would have other files read
                        raise ValueError(f"the data of {name!r} are elsewhere")
                    if item.id.get_storage_size() != item.size * item.dtype.itemsize:
                        raise ValueError(f"{name!r} is {item.shape}, and holds less")
                    arrays[name] = np.asarray(item)

            file.visititems(collect)
    except (LookupError, OSError, RuntimeError, TypeError, ValueError) as fault:  # as h5py raises
        raise ValueError(f"store must hold plain arrays and texts; got {path} ({fault})") from fault
    return Archive(entries, arrays)


def arrays_of(archive: Archive, kinds: Mapping[str, tuple[str, int]]) -> dict[str, NDArray[Any]]:
    """Return arrays by name, each of its kind of numbers (NumPy's letter) and dimensions.

    Raises
    ------
    LookupError, ValueError
        When one is missing, or of another kind; for `understood` to name the store.
    """
    found = {name: archive.arrays[name] for name in kinds}
    for name, (kind, dimensions) in kinds.items():
        if found[name].dtype.kind != kind or found[name].ndim != dimensions:
            raise ValueError(f"{name} is {found[name].dtype} {found[name].shape}")
    return found


def same(made: str, asked: str) -> bool:
    """Whether two entries are the same text, or the same number: 1 and 1.0 are.

    Examples
    --------
    >>> same("1", "1.0"), same("1", "True"), same("nan", "nan")
    (True, False, True)
    """
    if made == asked:
        return True
    try:
        return float(made) == float(asked)
    except ValueError:
        return False


# --- what a result was made with ------------------------------------------------------------------


class HasIdentity(Protocol):
    """A system that says everything that its motion depends on, by name."""

    @property
    def identity(self) -> Mapping[str, object]:
        """Numbers, strings, arrays, and tuples of them."""
        ...


def kind_of(system: object) -> str:
    """Return the full name of the system's class."""
    return f"{type(system).__module__}.{type(system).__qualname__}"


def identity_of(system: HasIdentity) -> dict[str, str]:
    """Return everything that the system's motion depends on, as plain text by name.

    Raises
    ------
    ValueError
        When something is neither a number, a string, an array, nor a tuple of them.
    """
    return {f"system.{name}": _text(name, value) for name, value in system.identity.items()}


def refuse_other_system(path: Path, archive: Archive, system: HasIdentity) -> None:
    """Refuse a system that is not the one of an archive.

    Raises
    ------
    ValueError
        Naming the first thing that differs.
    """
    asked = identity_of(system)
    made = [key for key in archive.entries if key.startswith("system.")]
    refuse_other_entries(path, archive, asked, sorted({*made, *asked}))


def refuse_other_entries(
    path: Path, archive: Archive, asked: Mapping[str, str], names: Iterable[str]
) -> None:
    """Refuse an archive whose entries of some names are not those asked for.

    Raises
    ------
    ValueError
        Naming the first that differs.
    """
    for name in names:
        was, now = archive.entries.get(name, "none"), asked.get(name, "none")
        if not same(was, now):
            short = name.removeprefix("system.")
            raise ValueError(f"store {path} was made with {short} {was}; got {now}")


def _text(name: str, value: object) -> str:
    text = _plain(name, value)
    if len(text) <= _LONGEST:
        return text
    return f"{text[:40]}... (sha256 {hashlib.sha256(text.encode()).hexdigest()})"


def _plain(name: str, value: object) -> str:
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"{value.dtype} array {value.shape} (sha256 {digest})"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, tuple | list):
        return f"({', '.join(_plain(name, part) for part in value)})"
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, bool | int | float | complex | str):
        return repr(value)
    raise ValueError(
        f"store must be None for a system whose {name} is no number, string or array; got {value!r}"
    )


@contextmanager
def understood(path: Path, kind: str) -> Generator[None]:
    """Name the store when it is whole but does not hold what one of its kind should.

    What stands inside of this context turns entries and arrays into what they mean, no more. No
    method of a user's class runs inside: a fault there is none of the store.

    Raises
    ------
    ValueError
        Naming the store, in place of whatever was raised.
    """
    try:
        yield
    except (
        AttributeError,
        LookupError,
        OverflowError,
        RecursionError,
        TypeError,
        ValueError,
    ) as fault:
        missing = "there is no " if isinstance(fault, KeyError) else ""
        raise ValueError(
            f"store must hold all of a {kind}; got {path} ({missing}{fault})"
        ) from fault
