"""Tasks on an executor: pickled, a bounded number at a time, with their errors."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from functools import lru_cache
from io import BytesIO
from itertools import islice
from queue import SimpleQueue
from typing import Any, TypeVar

from dynkit.core.overriding import Extensible
from dynkit.core.progress import late_bar
from dynkit.core.user_code import code_of

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")

IN_FLIGHT = 1024
"""Largest number of tasks that an executor has at a time: enough for many workers, in little
memory."""


class WorkerLost(RuntimeError):
    """A worker died or cannot be reached, and its executor does not repeat the work."""


class NotSendable(ValueError):
    """The system cannot be sent to the workers of an executor."""


def finished(
    work: Callable[[_Task], _Result], tasks: Iterable[_Task], executor: Executor | None
) -> Iterator[tuple[int, _Result]]:
    """Yield the number of each task and its result, in the order in which they finish.

    Parameters
    ----------
    work : callable
        Without an executor it is called in this process, in the order of the tasks. With one, the
        callable, the tasks and the results must be picklable.
    tasks : iterable
        A task is taken from it only when the task is about to begin.
    executor : Executor or None

    Raises
    ------
    NotSendable
        When the work or a task cannot be pickled, or cannot be imported by the workers.
    WorkerLost
        When the executor has lost a worker; finished results are yielded first.
    Exception
        The exception of the first task, in their order, whose work raises one. Results of other
        tasks that have been submitted are yielded first.
    """
    if executor is None:
        for number, task in enumerate(tasks):
            yield number, work(task)
        return
    packed = pack(work)
    waiting: dict[Future[tuple[Any, Exception | None]], int] = {}
    ended: SimpleQueue[Future[tuple[Any, Exception | None]]] = SimpleQueue()
    coming = enumerate(tasks)
    errors: dict[int, Exception] = {}
    try:
        while True:
            for number, task in islice(coming, 0 if errors else IN_FLIGHT - len(waiting)):
                if not callable(getattr(executor, "submit", None)):
                    raise ValueError(
                        f"executor must be a concurrent.futures.Executor; got {executor!r}"
                    )
                sent = pack(task)
                try:
                    future = executor.submit(perform, packed, sent)
                except RuntimeError as failure:  # the pool is broken, or was shut down
                    future = Future()
                    future.set_result((None, _lost(failure)))
                waiting[future] = number
                future.add_done_callback(ended.put)
            if not waiting:
                break
            ready = [ended.get()]
            while not ended.empty():
                ready.append(ended.get())
            ready = [future for future in ready if future in waiting]  # without cancelled ones
            for number, future in sorted((waiting.pop(future), future) for future in ready):
                try:
                    result, error = future.result()
                except Exception as failure:  # of any kind: errors of the work are in its outcome
                    result, error = None, _lost(failure)
                if error is None:
                    yield number, result
                else:
                    errors[number] = error
            if errors:  # an earlier task may still fail, and its error then comes first
                _cancel(waiting, min(errors))
    finally:
        _cancel(waiting, -1)
    if errors:
        lost = [error for error in errors.values() if isinstance(error, WorkerLost)]
        raise lost[0] if lost else errors[min(errors)]


def all_finished(
    work: Callable[[_Task], _Result],
    tasks: Sequence[_Task],
    executor: Executor | None,
    bar: str = "",
) -> list[_Result]:
    """Return the results of all tasks, in their order; raises what `finished` raises.

    A late bar of this name counts them.
    """
    found = finished(work, tasks, executor)
    results = dict(late_bar(bar, "chunk", len(tasks), found) if bar else found)
    return [results[number] for number in range(len(tasks))]


def pack(work: object) -> bytes:
    """Return the pickled work, or task, for other processes.

    Raises
    ------
    NotSendable
        When it cannot be pickled.
    """
    packed = BytesIO()
    try:
        _Pickler(packed).dump(work)
        return packed.getvalue()
    except Exception as error:  # errors of pickle, and any that an object's methods raise
        raise NotSendable(
            f"system must be picklable to be sent to an executor; got one for which {error}"
        ) from error


class _Pickler(pickle.Pickler):
    """Sends a user's class with the digest of its code: a worker may know an earlier definition."""

    def reducer_override(self, sent: Any) -> Any:
        code = code_of(sent) if isinstance(sent, type) and issubclass(sent, Extensible) else ""
        if not code:
            return NotImplemented
        return _same_class, (pickle.dumps(sent), code)


def _same_class(sent: bytes, code: str) -> Any:
    """Return the class of a pickled name; TypeError when its code differs from the sender's."""
    found = pickle.loads(sent)
    if code_of(found) != code:
        raise TypeError(
            f"the worker knows another definition of {found.__qualname__}: start the executor "
            "after the class is defined, or keep the class in a file"
        )
    return found


def perform(packed: bytes, sent: bytes) -> tuple[Any, Exception | None]:
    """Run a packed task of packed work in a worker; return its result, and its error or None."""
    try:
        work, task = _unpacked(packed), pickle.loads(sent)
    except Exception as error:  # of any kind: a worker may import another version of the module
        return None, NotSendable(
            "system must be of a class that the workers of the executor can import, from a "
            f"file of its own; got one for which {type(error).__name__}: {error}"
        )
    try:
        return work(task), None
    except Exception as error:
        return None, _portable(error)


# All tasks of a run share one work, which is unpickled once.
@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Any:
    return pickle.loads(packed)


def _portable(error: Exception) -> Exception:
    """Return the error, or a RuntimeError where it cannot be pickled, with the traceback."""
    where = "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(f"raised by a worker:\n{where}")
    return error


def _lost(error: BaseException) -> WorkerLost:
    lost = WorkerLost(
        "a worker of the executor died or cannot be reached, and the rest was not done "
        f"({type(error).__name__}: {str(error) or 'no reason given'})"
    )
    lost.__cause__ = error
    return lost


def _cancel(waiting: dict[Future[Any], int], after: int) -> None:
    for future, number in list(waiting.items()):
        if number > after and future.cancel():
            del waiting[future]
