"""Tasks on an executor: sent as plain bytes, a bounded number at a time, errors told apart."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Generic, TypeVar, cast, final

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")

IN_FLIGHT = 1024
"""So many tasks are with an executor at most: enough for many workers, little to hold."""


class WorkerLost(RuntimeError):
    """A worker died, or cannot be reached, and its executor does not start the work again."""


class NotSendable(ValueError):
    """A system that cannot be sent to the workers of an executor."""


@final
@dataclass(frozen=True, eq=False)
class Outcome(Generic[_Result]):
    """The result of a task, or the error that it raised."""

    result: _Result | None = None
    error: Exception | None = None

    def value(self) -> _Result:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return cast("_Result", self.result)


def finished(
    work: Callable[[_Task], _Result], tasks: Sequence[_Task], executor: Executor | None
) -> Iterator[tuple[int, _Result]]:
    """Yield the number of each task and its result, as they are finished.

    Parameters
    ----------
    work : callable
        Without an executor it is called here, in the order of the tasks; otherwise it must be
        picklable, and so must tasks and results.
    tasks : sequence
    executor : Executor or None

    Raises
    ------
    NotSendable
        When the work or a task cannot be pickled, or not be imported by the workers.
    WorkerLost
        When the executor has lost a worker for good, after what was finished.
    Exception
        What the work itself raised: by the first task, in their order, that does. Results of other
        tasks that are with the executor then are yielded before.
    """
    if executor is None:
        for number, task in enumerate(tasks):
            yield number, work(task)
        return
    packed = pack(work)
    waiting: dict[Future[Outcome[_Result]], int] = {}
    sent = 0
    errors: dict[int, Exception] = {}
    try:
        while True:
            while not errors and sent < len(tasks) and len(waiting) < IN_FLIGHT:
                waiting[submit(executor, packed, tasks[sent])] = sent
                sent += 1
            if not waiting:
                break
            ready, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for number, future in sorted((waiting.pop(future), future) for future in ready):
                outcome = outcome_of(future)
                if outcome.error is None:
                    yield number, outcome.value()
                else:
                    errors[number] = outcome.error
            if errors:  # those before the first that failed may fail too, and are then the first
                _cancel(waiting, min(errors))
    finally:
        _cancel(waiting, -1)
    if errors:
        lost = [error for error in errors.values() if isinstance(error, WorkerLost)]
        raise lost[0] if lost else errors[min(errors)]


def all_finished(
    work: Callable[[_Task], _Result], tasks: Sequence[_Task], executor: Executor | None
) -> list[_Result]:
    """Return the results of all tasks, in the order of the tasks; raises what `finished` raises."""
    results = dict(finished(work, tasks, executor))
    return [results[number] for number in range(len(tasks))]


def submit(executor: Executor, packed: bytes, task: Any) -> Future[Outcome[Any]]:
    """Hand a task on, for packed work; `outcome_of` tells what became of it.

    Raises
    ------
    ValueError
        When it is no executor.
    NotSendable
        When the task cannot be pickled.
    """
    if not callable(getattr(executor, "submit", None)):
        raise ValueError(f"executor must be a concurrent.futures.Executor; got {executor!r}")
    sent = pack(task)
    try:
        return executor.submit(perform, packed, sent)
    except RuntimeError as error:  # the pool is broken, or was shut down
        future: Future[Outcome[Any]] = Future()
        future.set_result(Outcome(error=_lost(error)))
        return future


def outcome_of(future: Future[Outcome[_Result]]) -> Outcome[_Result]:
    """Wait for a task, and return what became of it: `WorkerLost` when nothing did."""
    try:
        return future.result()
    except Exception as error:  # of whatever kind: what the work raises is in its outcome
        return Outcome(error=_lost(error))


def pack(work: object) -> bytes:
    """Return the bytes that stand for some work, or a task, in other processes.

    Raises
    ------
    NotSendable
        When there are none.
    """
    try:
        return pickle.dumps(work)
    except Exception as error:  # pickle raises its own, and whatever an object raises
        raise NotSendable(
            f"system must be picklable to be sent to an executor; got one for which {error}"
        ) from error


def perform(packed: bytes, sent: bytes) -> Outcome[Any]:
    """Do one packed task of packed work, in whatever process this is."""
    try:
        work, task = _unpacked(packed), pickle.loads(sent)
    except Exception as error:  # of whatever kind: the module may be another one here
        return Outcome(
            error=NotSendable(
                "system must be of a class that the workers of the executor can import, from a "
                f"file of its own; got one for which {type(error).__name__}: {error}"
            )
        )
    try:
        return Outcome(work(task))
    except Exception as error:
        return Outcome(error=_portable(error))


# The work is the same for all tasks of a run, and unpacked once.
@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Any:
    return pickle.loads(packed)


def _portable(error: Exception) -> Exception:
    """The error, or what can be sent of it, with where it was raised."""
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
