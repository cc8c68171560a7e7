"""Files that a run writes: refused before it begins, whole or not there when it ends."""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA = (".csv", ".npz", ".h5")
PICTURES = (".png", ".svg")


def output_file(name: str, text: str) -> Path:
    """Return the path of a file to write, checked but not touched.

    Raises
    ------
    ValueError
        When its ending is unknown, or it cannot be written.
    """
    path = Path(text)
    if path.suffix not in DATA + PICTURES:
        raise ValueError(f"{name} must end in {', '.join(DATA + PICTURES)}; got {text!r}")
    return writable_file(name, path)


def writable_file(name: str, path: Path) -> Path:
    """Return the path when a file can be written there.

    Raises
    ------
    ValueError
        When it cannot.
    """
    if path.is_dir():
        raise ValueError(f"{name} must be a file; got the folder {str(path)!r}")
    try:
        if path.exists():
            with path.open("rb+"):
                pass
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as failure:
        raise _unwritable(name, path, failure) from failure
    return path


def output_folder(name: str, text: str) -> Path:
    """Return the path of a folder to write to, made when it is missing.

    Raises
    ------
    ValueError
        When it cannot be made, or not be written to.
    """
    path = Path(text)
    if not text:
        raise ValueError(f"{name} must be a folder; got ''")
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as failure:
        raise _unwritable(name, path, failure) from failure
    return path


def _unwritable(name: str, path: Path, failure: OSError) -> ValueError:
    return ValueError(f"{name} must be writable; got {str(path)!r} ({failure.strerror})")


@contextmanager
def _whole(path: Path) -> Generator[Path]:
    """Give a file to write to that becomes the path's when all went well."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.chmod(0o666 & ~_umask())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_table(path: Path, columns: Mapping[str, Sequence[object]]) -> None:
    """Write columns of one length as CSV; floats in full, so that they read back bit for bit."""
    with _whole(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def write_arrays(path: Path, arrays: Mapping[str, Any], parameters: Mapping[str, object]) -> None:
    """Write arrays by name as .npz or .h5, and the parameters: as arrays, or as attributes."""
    import numpy as np

    with _whole(path) as part:
        if path.suffix == ".npz":
            everything: dict[str, Any] = {**arrays, **parameters}
            np.savez_compressed(part, **everything)
            return
        import h5py

        with h5py.File(part, "w") as file:
            for name, array in arrays.items():
                data = np.asarray(array)
                if data.dtype.kind == "U":
                    data = data.astype(h5py.string_dtype())
                file[name] = data
            for name, value in parameters.items():
                file.attrs[name] = value


def write_picture(path: Path, draw: Callable[[], Figure]) -> None:
    """Write a figure as .png or .svg."""
    with _whole(path) as part:
        draw().savefig(part, dpi=600)
