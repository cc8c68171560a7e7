"""The table and the figures of Cusumano & Bai (1993), and a report on them.

``python -m tutorials.cusumano_bai_1993 --out results``, from the folder of the repository.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, TextIO

from tutorials.cusumano_bai_1993.paper import FREQUENCIES, ITEMS

if TYPE_CHECKING:
    from tutorials.cusumano_bai_1993.section import Section
    from tutorials.cusumano_bai_1993.workshop import Workshop

BESIDE = ("figure-4-branches", "resonances")
"""They take nearly half of the time: a second process makes the first one meanwhile, and then what
is left, these first. It goes on with the last item while the first process is at the others."""


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
    from tutorials.cusumano_bai_1993.summary import MACHINE, draw_machine
    from tutorials.cusumano_bai_1993.workshop import Workshop

    began = time.perf_counter()
    workshop = Workshop(folder)
    sections: dict[str, Section] = {}
    order = [name for name in names if name not in BESIDE]
    order += [name for name in reversed(BESIDE) if name in names]
    beside = len(order) > 1 and order[-1] in BESIDE
    context = get_context("spawn")
    left = context.Array("i", [0, len(order) - beside])
    with ExitStack() as stack:
        if beside:
            receiver, sender = context.Pipe(duplex=False)
            other = context.Process(target=_made, args=(folder, order, left, sender))
            other.start()
            stack.callback(other.join)
            stack.callback(other.terminate)
            sender.close()  # so that the end of the other process ends the pipe
        draw_machine(folder, workshop.chain(FREQUENCIES[0]))
        print(f"{MACHINE}: drawn", file=log, flush=True)
        print("compiling or loading the kernels: ", end="", file=log, flush=True)
        print(f"{workshop.warm_up():.1f} s", file=log, flush=True)
        while (place := _next(left, 0)) is not None:
            name = order[place]
            print(f"{name}: ", end="", file=log, flush=True)
            sections[name] = _make(workshop, name)
            print(f"{sections[name].total:.1f} s", file=log, flush=True)
        if beside:
            for name, section in _received(receiver).items():
                sections[name] = section
                print(f"{name}: {section.total:.1f} s, meanwhile", file=log, flush=True)
            other.join()  # its end, which is not to be cut short
    seconds = time.perf_counter() - began
    made = [sections[name] for name in names]
    report = write_report(folder, made, workshop.warm_up(), seconds)
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


def _made(folder: Path, order: Sequence[str], left: Any, sender: Any) -> None:
    """Send items from the workshop of the other process: the last one, and what is left after it.

    Ctrl-C is for the process that waits, which then ends this one.
    """
    import signal

    from tutorials.cusumano_bai_1993.workshop import Workshop

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _prepare()
    workshop, made = Workshop(folder), {}
    place: int | None = len(order) - 1
    while place is not None:
        made[order[place]] = _make(workshop, order[place])
        place = _next(left, 1)
    sender.send(made)


def _received(receiver: Any) -> dict[str, Section]:
    """The items of the other process; RuntimeError where it ended before it had made them."""
    try:
        return dict(receiver.recv())
    except EOFError:
        raise RuntimeError("the second process ended early; what it printed says why") from None


def _next(left: Any, end: int) -> int | None:
    """Take the place of the first item that is left, or the last one: which both processes do."""
    with left.get_lock():
        if left[0] == left[1]:
            return None
        left[end] += 1 - 2 * end
        return int(left[end]) - (1 - end)
