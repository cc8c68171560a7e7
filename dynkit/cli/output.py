"""Files that a run writes: refused before it begins, whole or not there when it ends."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit.data.atomic_files import locked, place, whole

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
    try:
        if path.is_dir():
            raise ValueError(f"{name} must be a file; got the folder {str(path)!r}")
        if path.is_file():
            with path.open("rb+"):
                pass
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as failure:
        raise _unwritable(name, path, failure) from failure
    with locked(name, place(name, path)):
        return path


def _unwritable(name: str, path: Path, failure: OSError) -> ValueError:
    return ValueError(f"{name} must be writable; got {str(path)!r} ({failure.strerror})")


def write_table(path: Path, columns: Mapping[str, Sequence[object]]) -> None:
    """Write columns of one length as CSV; floats in full, so that they read back bit for bit."""
    table = io.StringIO(newline="")
    writer = csv.writer(table)
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    with whole("out", path) as stream:
        stream.write(table.getvalue().encode())


def write_arrays(path: Path, arrays: Mapping[str, Any], parameters: Mapping[str, object]) -> None:
    """Write arrays by name as .npz or .h5, and the parameters: as arrays, or as attributes."""
    import numpy as np

    with whole("out", path) as stream:
        if path.suffix == ".npz":
            everything: dict[str, Any] = {**arrays, **parameters}
            np.savez_compressed(stream, **everything)
        else:
            stream.write(_hdf5(arrays, parameters))


def _hdf5(arrays: Mapping[str, Any], parameters: Mapping[str, object]) -> memoryview:
    import h5py
    import numpy as np

    # in memory: HDF5 locks and seeks in what it writes to, and says little when a disk is full
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, array in arrays.items():
            data = np.asarray(array)
            if data.dtype.kind == "U":
                data = data.astype(h5py.string_dtype())
            file[name] = data
        for name, value in parameters.items():
            file.attrs[name] = value
    return buffer.getbuffer()


def write_picture(path: Path, draw: Callable[[], Figure]) -> None:
    """Write a figure as .png or .svg."""
    figure = draw()
    with whole("out", path) as stream:
        figure.savefig(stream, format=path.suffix[1:], dpi=600)
