"""The exceptions that mean: here is no motion, or no next state.

The toolkit turns these into results (a kind of motion, a region of a picture), and nothing else.
Every other exception means a wrong argument or a fault in a program, and reaches the user with its
own type, message and traceback.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, Self, TypeVar


class NoMotion(RuntimeError):
    """A motion has no next state. Its kinds say why; the message says where.

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> Logistic(rate=4.0).iterate([1.5], 20)
    Traceback (most recent call last):
    ...
    dynkit.core.no_motion.Diverged: the motion runs away: state[0] is -inf after 10 iterates
    """


class NoCrossing(NoMotion):
    """The motion comes to no next crossing of a section, or to no next impact."""


class TangentCrossing(NoMotion):
    """The flow touches the section without passing through: the map has no derivative there."""


class NoDerivative(NoMotion):
    """The map has no derivative at a state: what is next depends on a choice."""


class Diverged(NoMotion):
    """The motion runs away: a coordinate is infinite, or not a number."""


class CannotFollow(NoMotion):
    """The integrator cannot follow the motion any further, or not within its number of steps."""


class Refused(NoMotion, ValueError):
    """The system refuses a value: no state or no system has it.

    Such as a position beyond a stop, or a restitution above one. It is a ValueError too, for the
    value may be an argument of the user.
    """


class _Replaceable(Protocol):
    def replace(self, **parameters: float) -> Self: ...


_System = TypeVar("_System", bound=_Replaceable)


def replaced(system: _System, **parameters: float) -> _System:
    """Return ``system.replace(**parameters)``, where a value may be outside of its range.

    Raises
    ------
    Refused
        When `replace` refuses a value with ValueError.
    """
    try:
        return system.replace(**parameters)
    except ValueError as refusal:
        raise Refused(str(refusal)) from refusal


@contextmanager
def located(where: str) -> Iterator[None]:
    """Add to any exception, as a note, where it was raised."""
    try:
        yield
    except Exception as error:
        error.add_note(where)
        raise
