"""Writing where there is no room, or no right to: what is said, and what is left.

Run as a program of its own, whose descendants confine themselves: ``python -m tests.confined DISK
LIMIT FORBIDDEN``, with three folders, writes what happened in each as JSON.
"""

import contextlib
import ctypes
import io
import json
import os
import resource
import sys
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import dynkit.data.store
from dynkit import BifurcationCurve, Branch, sweep
from dynkit.cli import main
from dynkit.cli.output import output_file, write
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.curves import continue_curve
from dynkit.data.dataset import Dataset
from dynkit.engine import collecting
from dynkit.plotting.figures import new_figure, save_figure, write_figure
from dynkit.systems import Logistic
from tests.continuation.starts import henon
from tutorials.cusumano_bai_1993.page import write_text

ROOM = 32 * 1024
"""Bytes of the small disk; files may be half of it."""

RATES = np.linspace(3.4, 3.9, 60)
SIMULATE = ["simulate", "--masses", "2", "--frequency", "0.9", "--impacts", "3000"]
FREQUENCIES = ",".join(map(str, np.linspace(0.8, 1.0, 100)))
SWEEP = ["sweep", "--masses", "2", "--values", FREQUENCIES, "--transient", "0", "--keep", "50"]
SWEEP += ["--no-labels", "--no-progress"]


def swept(store: Path | None, keep: int = 90) -> None:
    sweep(
        Logistic(3.5),
        "rate",
        RATES,
        start=[0.3],
        transient=0,
        keep=keep,
        store=store,
        progress=False,
    )


@cache
def followed() -> tuple[Branch, BifurcationCurve]:
    """A branch and a curve, larger than the room."""
    branch = continue_orbit(henon(), "a", bounds=(-0.2, 1.4), points=400)
    doubling = next(found for found in branch.bifurcations if found.kind == "PD")
    bounds = ((-2.0, 3.0), (-0.9, 0.9))
    return branch, continue_curve(doubling, ("a", "b"), bounds=bounds, largest_step=0.01)


def plain_writers(folder: Path) -> dict[str, Callable[[], object]]:
    """What writes numbers, by the name of the file that it writes."""
    branch, curve = followed()
    data = Dataset({}, {"x": ("row", np.random.default_rng(0).random(9000))}, {})
    return {
        "sweep.h5": partial(swept, folder / "sweep.h5"),
        "branch.h5": partial(branch.save, folder / "branch.h5"),
        "curve.h5": partial(curve.save, folder / "curve.h5"),
        **{
            name: partial(write, folder / name, Figure, data)
            for name in ("table.csv", "arrays.npz", "arrays.h5")
        },
    }


def writers(folder: Path) -> dict[str, Callable[[], object]]:
    """All that writes: pictures, reports and the command too."""
    figure, (axes,) = new_figure(2.0, 1.5)
    axes.plot(np.random.default_rng(0).random(2000))
    return plain_writers(folder) | {
        **{
            name: partial(write_figure, "out", folder / name, figure)
            for name in ("picture.png", "picture.svg")
        },
        "figure.png": partial(save_figure, figure, folder / "figure", 600.0),
        "report.md": partial(write_text, folder / "report.md", "x" * 2 * ROOM),
        "command.csv": partial(_command, [*SIMULATE, "--out", str(folder / "command.csv")]),
        "command.h5": partial(_command, [*SWEEP, "--store", str(folder / "command.h5")]),
    }


def _command(arguments: list[str]) -> None:
    """The command; what it says and its exit code as an error."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(arguments)
    if code:
        raise SystemExit(f"{code}: {said.getvalue()}")


def said_by(work: Callable[[], object]) -> str:
    """The class and the text of the error of some work."""
    try:
        work()
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}: {error}"
    return "done"


def limited(folder: Path) -> str:
    """Let no file grow beyond half of the room, as a quota does: this binds everybody."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM // 2, ROOM // 2))
    return "limit"


def small_disk(folder: Path) -> str:
    """Make the folder a disk of its own that is small; where that is not allowed, limit files."""
    trial = os.fork()  # what is half allowed must not be left half done
    if trial == 0:
        allowed = False
        with contextlib.suppress(Exception):
            _mount(folder)
            allowed = True
        os._exit(0 if allowed else 1)
    if os.waitpid(trial, 0)[1]:
        return limited(folder)
    _mount(folder)
    return "disk"


def _mount(folder: Path) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    new_mounts, new_user, private = 0x00020000, 0x10000000, 1 << 18 | 1 << 14
    user, group = os.geteuid(), os.getegid()
    if libc.unshare(new_mounts):  # who is not root may be it in a world of his own
        if libc.unshare(new_mounts | new_user):
            raise OSError(ctypes.get_errno(), "unshare")
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    options = f"size={ROOM}".encode()
    if libc.mount(None, b"/", None, private, None) or libc.mount(
        b"none", os.fsencode(folder), b"tmpfs", 0, options
    ):
        raise OSError(ctypes.get_errno(), "mount")
    (folder / "x").touch()
    (folder / "x").unlink()


def full(
    folder: Path,
    confine: Callable[[Path], str],
    writing: Callable[[Path], dict[str, Callable[[], object]]],
) -> dict[str, Any]:
    """Everything is written elsewhere, then over small old files where there is no room."""
    collecting._LEAST_INTERVAL, collecting._SHARE = 0.0, np.inf
    (folder / "free").mkdir()
    for work in writing(folder / "free").values():
        work()
    small = folder / "small"
    small.mkdir()
    work_there = writing(small)
    kind = confine(small)
    outcomes = {}
    for name, work in work_there.items():
        file, store = small / name, name in ("sweep.h5", "command.h5")
        if not store:
            file.write_text("the old one")
        said = said_by(work)
        kept = len(dynkit.data.store.read(file).arrays["done"]) if store else file.read_text()
        outcomes[name] = {
            "said": said.replace(str(small), "SMALL"),
            "left": sorted(path.name for path in small.iterdir()),
            "kept": kept,
        }
        if store:  # with room again it goes on
            (folder / "free" / name).write_bytes(file.read_bytes())
        file.unlink()
    return {"kind": kind, "outcomes": outcomes}


def forbidden(folder: Path) -> dict[str, Any]:
    """Nothing can be written in the folder, by somebody who is not root."""
    collecting._LEAST_INTERVAL, collecting._SHARE = 0.0, np.inf
    work_there = writers(folder)
    for work in work_there.values():
        work()
    half = dynkit.data.store.read(folder / "sweep.h5")
    rows = {
        name: rows if name.startswith("given/") else rows[:7] for name, rows in half.arrays.items()
    }
    swept(folder / "finished.h5")
    dynkit.data.store.write(folder / "sweep.h5", dynkit.data.store.Archive(half.entries, rows))
    (folder / "command.h5").unlink()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    for path in folder.iterdir():
        path.chmod(0o444)
    folder.chmod(0o555)
    if os.geteuid() == 0:
        os.seteuid(65534)
    outcomes = {name: {"said": said_by(work)} for name, work in work_there.items()}
    outcomes["new.csv"] = {"said": said_by(lambda: _checked(folder / "new.csv"))}
    outcomes["finished.h5"] = {"said": said_by(partial(swept, folder / "finished.h5"))}
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    for outcome in outcomes.values():
        outcome["said"] = outcome["said"].replace(str(folder), "FOLDER")
    return {"outcomes": outcomes, "unchanged": before == after}


def _checked(path: Path) -> None:
    output_file("out", str(path))


def apart(confined: Callable[[Path], dict[str, Any]], folder: Path) -> Any:
    """What happens in a process of its own, which inherits what was computed before."""
    told, tell = os.pipe()
    number = os.fork()
    if number == 0:
        with os.fdopen(tell, "w") as stream:
            json.dump(confined(folder), stream)
            stream.flush()
        os._exit(0)
    os.close(tell)
    with os.fdopen(told, "r") as stream:
        said = json.load(stream)
    os.waitpid(number, 0)
    return said


if __name__ == "__main__":
    with (
        tempfile.TemporaryDirectory() as unconfined
    ):  # what has to be made ready is for all of them
        for work in writers(Path(unconfined)).values():
            work()
    confinements: dict[str, Callable[[Path], dict[str, Any]]] = {
        "disk": partial(full, confine=small_disk, writing=writers),
        "limit": partial(full, confine=limited, writing=plain_writers),
        "forbidden": forbidden,
    }
    named = zip(confinements.items(), map(Path, sys.argv[1:]), strict=True)
    json.dump({name: apart(confined, folder) for (name, confined), folder in named}, sys.stdout)
