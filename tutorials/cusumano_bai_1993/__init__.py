"""The table and the figures of Cusumano & Bai (1993), and a report on them.

``python -m tutorials.cusumano_bai_1993 --out results``, from the folder of the repository.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, TextIO

from tutorials.cusumano_bai_1993.paper import FREQUENCIES, ITEMS

if TYPE_CHECKING:
    from tutorials.cusumano_bai_1993.section import Section
    from tutorials.cusumano_bai_1993.workshop import Workshop

BESIDE = ("figure-4-branches", "resonances")
"""They take as long as all others together: a process of its own makes them meanwhile."""


def reproduce(out: str, only: Sequence[str] | None = None, *, log: TextIO) -> Path:
    """Make the items, their figures as PNG and SVG, ``report.md``, and all in ``report.html``.

    Parameters
    ----------
    out : str
        Folder to write to, made when it is missing.
    only : sequence of str, optional
        Some of the items, by name; by default all.
    log : TextIO
        Where a line goes for each item that is done.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        When an item is unknown or the folder cannot be written to.
    """
    folder, names = checked(out, only)

    import time
    from multiprocessing import get_context

    from tutorials.cusumano_bai_1993.report import write_report
    from tutorials.cusumano_bai_1993.workshop import Workshop

    began = time.perf_counter()
    workshop = Workshop(folder)
    sections: dict[str, Section] = {}
    with ExitStack() as stack:
        beside = [name for name in names if name in BESIDE and len(names) > 1]
        if beside:
            pool = stack.enter_context(get_context("spawn").Pool(1, _leave_interrupts))
            prepared = pool.apply_async(_prepare)
        print("compiling or loading the kernels: ", end="", file=log, flush=True)
        print(f"{workshop.warm_up():.1f} s", file=log, flush=True)
        waiting = {name: pool.apply_async(_made, (folder, name)) for name in beside}
        for name in sorted(names, key=waiting.__contains__):
            print(f"{name}: ", end="", file=log, flush=True)
            sections[name] = waiting[name].get() if name in waiting else _make(workshop, name)
            note = ", meanwhile" if name in waiting else ""
            print(f"{sections[name].total:.1f} s{note}", file=log, flush=True)
        if beside:  # the other process ends by itself
            prepared.get()
            pool.close()
            pool.join()
    seconds = time.perf_counter() - began
    chain, made = workshop.chain(FREQUENCIES[0]), [sections[name] for name in names]
    report = write_report(folder, chain, made, workshop.warm_up(), seconds)
    print(f"written: {report} ({seconds:.1f} s in all)", file=log)
    return report


def checked(out: str, only: Sequence[str] | None) -> tuple[Path, list[str]]:
    """Return the folder to write to, made when it is missing, and the items to make.

    Raises
    ------
    ValueError
        As `reproduce`.
    """
    for name in only or ():
        if name not in ITEMS:
            raise ValueError(f"only must hold items among {', '.join(ITEMS)}; got {name!r}")
    path = Path(out)
    if not out:
        raise ValueError("out must be a folder; got ''")
    try:
        path.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path):
            pass
    except OSError as failure:
        raise ValueError(f"out must be writable; got {out!r} ({failure.strerror})") from failure
    return path, [name for name in ITEMS if only is None or name in only]


def _make(workshop: Workshop, name: str) -> Section:
    from tutorials.cusumano_bai_1993.items import MAKERS

    return MAKERS[name](workshop)


def _prepare() -> None:
    """Compile the kernels of orbits while the first process compiles those of motions."""
    from dynkit import continue_orbit
    from tutorials.cusumano_bai_1993.workshop import Workshop

    chain = Workshop(Path()).chain(0.4)
    orbit = chain.periodic_orbits(periods=1)[0]
    continue_orbit(orbit, "frequency", bounds=(0.399, 0.401))


@cache
def _beside(folder: Path) -> Workshop:
    from tutorials.cusumano_bai_1993.workshop import Workshop

    return Workshop(folder)


def _made(folder: Path, name: str) -> Section:
    """An item from the workshop of the other process."""
    return _make(_beside(folder), name)


def _leave_interrupts() -> None:
    """Ctrl-C is for the process that waits, which then ends this one."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
