"""The exceptions of motions that end or do not exist.

The toolkit turns only these exceptions into results (a kind of motion, a region of a plane). Every
other exception means a wrong argument or a fault in a program, and reaches the user with its own
type, message and traceback.
"""

from typing import Protocol, Self, TypeVar


class NoMotion(RuntimeError):
    """A motion has no next state. The subclass says why; the message says where.

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> Logistic(rate=4.0).iterate([1.5], 20)
    Traceback (most recent call last):
    ...
    dynkit.core.no_motion.Diverged: the motion runs away: state[0] is -inf after 10 iterates
    """


class NoCrossing(NoMotion):
    """The motion reaches no further crossing of a section, or no further impact."""


class TangentCrossing(NoMotion):
    """The flow is tangent to the section: the Poincare map has no derivative there."""


class NoDerivative(NoMotion):
    """The map has no derivative at a state: it jumps or bends there."""


class Diverged(NoMotion):
    """The motion diverges: a coordinate is infinite or NaN."""


class CannotFollow(NoMotion):
    """The integrator fails or exceeds its number of steps, or friction leaves a force unknown."""


class Refused(NoMotion, ValueError):
    """The system refuses a value that no state or no system can have.

    Examples are a position beyond a stop, or a restitution above one. It is also a ValueError,
    because the value may be an argument of the user.
    """


class _Replaceable(Protocol):
    def replace(self, **parameters: float) -> Self: ...

    def _examine(self) -> None: ...


_System = TypeVar("_System", bound=_Replaceable)


def replaced(system: _System, **parameters: float) -> _System:
    """Return ``system.replace(**parameters)``; a value outside its range raises `Refused`.

    Raises
    ------
    Refused
        When `replace` refuses a value with ValueError, or derived quantities show it to be invalid.
    """
    try:
        made = system.replace(**parameters)
        made._examine()
        return made
    except ValueError as refusal:
        raise Refused(str(refusal)) from refusal
