"""Stores: results on disk that survive killed processes, and are refused when damaged.

A store is an HDF5 file after a block of plain text. A process that dies while it changes an HDF5
file in place can destroy the file, so a store is always written completely, beside the old one, and
then replaces it. The text holds a checksum of all data: a damaged store is refused before its data
are interpreted.
"""

import hashlib
import io
import json
import os
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Protocol, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.overriding import Extensible
from dynkit.core.parameters import Family, without_cached
from dynkit.core.user_code import code_of
from dynkit.data import atomic_files as files

FORMAT = 1
"""Version of the layout; other versions are refused."""

# Longer texts are cut, and a hash distinguishes them: the size of HDF5 attributes is limited.
_LONGEST = 1000
# The smallest user block, which HDF5 reserves for the application.
_BLOCK = 512
_TITLE = b"dynkit store, format "


@final
@dataclass(frozen=True, eq=False)
class Archive:
    """Content of a store.

    Parameters
    ----------
    entries : mapping of str to str
        Plain text by name: the attributes of the HDF5 file, each below 64 KiB.
    arrays : mapping of str to array
        The data sets of the HDF5 file; a slash in a name denotes a group.
    """

    entries: Mapping[str, str]
    arrays: Mapping[str, NDArray[Any]]


def read(path: Path) -> Archive:
    """Return the content of a store, without writing.

    Raises
    ------
    ValueError
        When the file cannot be read, is not a store, has another format, is truncated or damaged,
        or was made by another program.
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
    """Write a store. After a failure the old file remains.

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


def save(store: str | os.PathLike[str], archive: Archive) -> None:
    """Write a store, while no other process writes it; ValueError where it cannot be written."""
    path = files.place("store", store)
    with files.locked("store", path):
        try:
            write(path, archive)
        except OSError as failure:
            raise ValueError(files.reason(failure)) from failure


def _heading(data: bytes | memoryview) -> bytes:
    text = (
        f"{_TITLE.decode()}{FORMAT}\n"
        f"sha256 {hashlib.sha256(data).hexdigest()} of the {len(data)} bytes after these {_BLOCK}\n"
        "The rest is HDF5: h5py and other HDF5 tools open this file as it is.\n"
    )
    return text.encode().ljust(_BLOCK, b"\0")


def _parsed(path: Path, data: bytes) -> Archive:
    """Return the content of the data, with checks: a valid checksum does not prove their form."""
    import h5py

    try:
        with h5py.File(io.BytesIO(bytes(_BLOCK) + data), "r") as file:
            entries = {name: str(text) for name, text in file.attrs.items()}
            arrays: dict[str, NDArray[Any]] = {}

            def collect(name: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset):
                    if item.external or item.is_virtual:  # h5py would read other files
                        raise ValueError(f"{name!r} has its data in another file")
                    if item.id.get_storage_size() != item.size * item.dtype.itemsize:
                        raise ValueError(f"{name!r} has shape {item.shape} but not all its data")
                    arrays[name] = np.asarray(item)

            file.visititems(collect)
    except (LookupError, OSError, RuntimeError, TypeError, ValueError) as fault:  # as h5py raises
        raise ValueError(f"store must hold plain arrays and texts; got {path} ({fault})") from fault
    return Archive(entries, arrays)


def arrays_of(archive: Archive, kinds: Mapping[str, tuple[str, int]]) -> dict[str, NDArray[Any]]:
    """Return arrays by name, after checks of their kinds (NumPy's letter) and dimensions.

    Raises
    ------
    LookupError, ValueError
        When an array is missing or of another kind; call it inside `understood`.
    """
    found = {name: archive.arrays[name] for name in kinds}
    for name, (kind, dimensions) in kinds.items():
        if found[name].dtype.kind != kind or found[name].ndim != dimensions:
            raise ValueError(f"{name} is {found[name].dtype} {found[name].shape}")
    return found


def same(made: str, asked: str) -> bool:
    """Whether two entries are the same text, or the same number, such as 1 and 1.0.

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


# --- the system of a result -----------------------------------------------------------------------


class HasIdentity(Protocol):
    """A system with a mapping of everything that its motion depends on."""

    @property
    def identity(self) -> Mapping[str, object]:
        """Numbers, strings, arrays, flows, sections, and tuples of them."""
        ...


_System = TypeVar("_System", bound=Family)


def kind_of(system: object) -> str:
    """Return the full name of the system's class."""
    return f"{type(system).__module__}.{type(system).__qualname__}"


def identity_of(system: HasIdentity) -> dict[str, str]:
    """Return everything that the system's motion depends on, as plain text by name.

    Raises
    ------
    ValueError
        When a value is neither a number, a string, an array, nor a tuple of them.
    """
    found = {}
    for name, value in system.identity.items():
        text = _plain(name, value)
        if len(text) > _LONGEST:
            text = f"{text[:40]}... (sha256 {hashlib.sha256(text.encode()).hexdigest()})"
        found[f"system.{name}"] = text
    return found


def entries_of(system: Family) -> dict[str, str]:
    """Return the entries of a store from which `at_parameters` restores the system of a result.

    Raises
    ------
    ValueError
        As `identity_of`.
    """
    values = json.dumps(dict(system.parameters))
    return {"system": kind_of(system), "parameters": values, **identity_of(system)}


def at_parameters(system: _System, path: Path, archive: Archive) -> _System:
    """Return a system with the values of its parameters that an archive holds.

    Raises
    ------
    ValueError
        When the archive holds no values, or the rest of the system differs from the archive's.
    """
    with understood(path, "system with its parameters"):
        made = {name: float(p) for name, p in json.loads(archive.entries["parameters"]).items()}
    _refuse_other_class(path, archive, system)
    known = system.parameters
    for name in made:
        if name not in known:
            raise ValueError(
                f"store {path} was made with parameter {name}; got a system without it"
            )
    changed = {name: p for name, p in made.items() if repr(p) != repr(known[name])}
    try:
        found = system.replace(**changed) if changed else system
    except ValueError as refusal:
        raise ValueError(f"store {path} must hold parameters of the system: {refusal}") from refusal
    refuse_other_system(path, archive, found)
    return found


def refuse_other_system(path: Path, archive: Archive, system: HasIdentity) -> None:
    """Raise when a system differs from that of an archive.

    Raises
    ------
    ValueError
        The message names the first difference.
    """
    if "system" in archive.entries:
        _refuse_other_class(path, archive, system)
    asked = identity_of(system)
    made = [key for key in archive.entries if key.startswith("system.")]
    refuse_other_entries(path, archive, asked, dict.fromkeys([*asked, *made]))


def _refuse_other_class(path: Path, archive: Archive, system: object) -> None:
    refuse_other_entries(path, archive, {"system": kind_of(system)}, ["system"])


def refuse_other_entries(
    path: Path, archive: Archive, asked: Mapping[str, str], names: Iterable[str]
) -> None:
    """Raise when entries of an archive, by name, differ from those asked for.

    Raises
    ------
    ValueError
        The message names the first difference.
    """
    for name in names:
        was, now = archive.entries.get(name, "none"), asked.get(name, "none")
        if not same(was, now):
            short = name.removeprefix("system.")
            raise ValueError(f"store {path} was made with {short} {was}; got {now}")


def _plain(name: str, value: object) -> str:
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"{value.dtype} array {value.shape} (sha256 {digest})"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, tuple | list):
        return f"({', '.join(_plain(name, part) for part in value)})"
    if isinstance(value, Extensible):  # a flow or a section, as part of a map
        code = {"code": code_of(type(value))} if code_of(type(value)) else {}
        own = getattr(value, "identity", None) or without_cached(value) | code
        parts = (f"{key}={_plain(f'{name}.{key}', part)}" for key, part in own.items())
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, bool | int | float | complex | str):
        return repr(value)
    raise ValueError(
        f"store must be None for a system whose {name} is no number, string or array; got {value!r}"
    )


@contextmanager
def understood(path: Path, kind: str) -> Generator[None]:
    """Convert exceptions from incomplete or impossible content of a store into one ValueError.

    Inside this context, entries and arrays are converted to objects, and nothing else happens. No
    method of a user's class runs inside, because its exceptions would be blamed on the store.

    Raises
    ------
    ValueError
        In place of the original exception; the message names the store.
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
