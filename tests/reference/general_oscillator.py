"""Any impact oscillator to 50 digits: matrices, forces, one stop or two, by matrix exponentials.

    M x'' + C x' + K x = g + Im(F exp(i phase)) + contact,   phase' = frequency
    stop: offset + amplitude sin(phase),   gap = +-(x_c - stop) >= 0,   u+ = -restitution u-

Flight is a `LinearMotion` of all coordinates. Contact is another one: without coordinate c, which
follows the stop, and with the contact force as one of its rows. `first_root` proves every impact
and release.

Chatter is simulated bounce by bounce until u is a small part of the fastest approach so far; then
the relative velocity is taken away by an impulse, and contact begins. With contact acceleration a
that leaves an error of the order u^2 / (a (1 - restitution)) in the state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, Final, Literal, ParamSpec, TypeVar

import mpmath
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf

from tests.reference.general_roots import first_root
from tests.reference.linear_motion import LinearMotion, Row
from tests.reference.mode_bounds import INFINITE, Real, to_mpf
from tests.reference.stops import Side, Stop

BITS: Final = 768
STICK_BELOW: Final = "1e-30"
COMPLETES: Final = "1e-6"
"""Largest relative change of a chatter's acceleration, over 1 - restitution, in its rest."""

P = ParamSpec("P")
R = TypeVar("R")


def _precisely(function: Callable[P, R]) -> Callable[P, R]:
    """Run a method in the oscillator's working precision."""

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        owner = args[0]
        assert isinstance(owner, GeneralOscillator)
        with ctx.workprec(owner.bits), mp.workprec(owner.bits):
            return function(*args, **kwargs)

    return wrapped


@dataclass(frozen=True)
class Impact:
    """State just after an impact; the relative velocity u >= 0 is the rate of its gap."""

    time: Real
    phase: Real
    relative_velocity: Real
    position: tuple[Real, ...]
    velocity: tuple[Real, ...]
    side: Side


@dataclass(frozen=True)
class Contact:
    """From ``start``, where the bounces accumulate, to ``release``; infinite for ever."""

    start: Real
    release: Real
    side: Side


@dataclass(frozen=True)
class _Segment:
    """From ``time`` on: a state of the flight, or of the contact with a stop."""

    time: arb
    stop: Stop | None
    state: arb_mat


@dataclass
class History:
    """Impacts and contacts in order, and how the motion ended.

    ``chatter_error`` sums up u^2 / (a (1 - restitution)) over the chatters that were cut; ``steps``
    are those of the searches.
    """

    impacts: list[Impact] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)
    ending: Literal["count", "no further contact", "contact for ever"] = "count"
    chatter_error: Real = 0
    steps: int = 0
    segments: list[_Segment] = field(default_factory=list)


@dataclass
class _Run:
    """Where a simulation is: on ``stop`` with relative velocity ``u``, or in flight."""

    history: History
    time: arb
    phase: arb
    z: arb_mat
    stop: Stop | None = None
    u: arb = field(default_factory=lambda: arb(0))
    released: bool = False
    fastest: arb = field(default_factory=lambda: arb(0))


class GeneralOscillator:
    """An impact oscillator of arbitrary matrices.

    Parameters
    ----------
    mass, damping, stiffness : (N, N)
        Symmetric; positive definite, positive semi-definite, positive semi-definite. Doubles are
        taken exactly, and mpf numbers too.
    frequency, restitution, amplitude, offset
        Of the table; as for ``ImpactOscillator``.
    contact
        The coordinate that meets the stops.
    side
        ``above``: the gap is x_c - table; ``below``: table - x_c.
    harmonic_forces, constant_forces : (N,) or ()
        F, complex, and g.
    far_stop
        Offset of a second stop on the other side of the coordinate, that moves with the table.
    bits
        Working precision.
    stick_below
        Part of the fastest approach.
    """

    def __init__(
        self,
        mass: Sequence[Sequence[Any]],
        damping: Sequence[Sequence[Any]],
        stiffness: Sequence[Sequence[Any]],
        frequency: Any,
        restitution: Any,
        amplitude: Any = 0,
        offset: Any = 0,
        contact: int = -1,
        side: Literal["above", "below"] = "above",
        harmonic_forces: Sequence[complex] = (),
        constant_forces: Sequence[float] = (),
        far_stop: Any = None,
        bits: int = BITS,
        stick_below: Any = STICK_BELOW,
    ) -> None:
        self.bits, self.stick_below = bits, stick_below
        self.size = n = len(mass)
        self.contact = range(n)[contact]
        self.sign = {"above": 1, "below": -1}[side]
        with ctx.workprec(bits):
            self.mass, self.damping, self.stiffness = (
                arb_mat([[arb(x) for x in row] for row in part])
                for part in (mass, damping, stiffness)
            )
            for part in (self.mass, self.damping, self.stiffness):
                if part.entries() != part.transpose().entries():
                    raise ValueError(f"matrices must be symmetric; got {part}")
            self.frequency, self.restitution = arb(frequency), arb(restitution)
            self.amplitude, near = arb(amplitude), arb(offset)
            self.forcing = arb_mat(n, 3)
            for i, f in enumerate(harmonic_forces):
                self.forcing[i, 0], self.forcing[i, 1] = arb(f.real), arb(f.imag)
            for i, g in enumerate(constant_forces):
                self.forcing[i, 2] = arb(g)
            self.flight = LinearMotion(
                self.mass, self.damping, self.stiffness, self.forcing, self.frequency
            )
            column = self.flight.inverse_mass
            self.kick = [
                (column[i, self.contact] / column[self.contact, self.contact]).mid()
                for i in range(n)
            ]
            self.stops = [Stop(self, "near", near)]
            if far_stop is not None:
                if not self.sign * (arb(far_stop) - near) > 0:
                    raise ValueError(f"far_stop must lie beyond offset {offset}; got {far_stop}")
                self.stops.append(Stop(self, "far", arb(far_stop)))

    # --- simulation -------------------------------------------------------------------------------

    @_precisely
    def simulate(
        self,
        position: Sequence[Any],
        velocity: Sequence[Any],
        phase: Any = 0,
        impacts: int = 1,
        *,
        relative_velocity: Any = None,
    ) -> History:
        """Simulate until so many impacts, or until there are no more.

        Where ``relative_velocity`` is given the start is just after an impact with the near stop:
        the entries of coordinate c are replaced by what follows from it.

        Raises
        ------
        ValueError
            When the start is beyond a stop.
        ArithmeticError
            When an event cannot be decided: a grazing, or a chatter that ends as contact is lost.
        """
        angle = arb(phase)
        state = [arb(x) for x in [*position, *velocity]]
        z = arb_mat([[x] for x in [*state, angle.sin(), angle.cos(), arb(1)]]).mid()
        run = _Run(History(), arb(0), angle, z)
        if relative_velocity is not None:
            self._put(run, self.stops[0], arb(relative_velocity))
        for stop in self.stops:
            gap, rate = stop.gap.value_and_rate(run.z)
            if run.stop is None and gap == 0 and rate >= 0:
                run.stop, run.u = stop, rate
            elif run.stop is not stop and not gap > 0:
                raise ValueError(f"the start must not be beyond the {stop.name} stop; gap {gap}")
        while len(run.history.impacts) < impacts:
            if run.stop is not None and self._sticks(run, run.stop) and not self._hold(run):
                run.history.ending = "contact for ever"
                break
            if not self._fly(run):
                run.history.ending = "no further contact"
                break
        else:
            run.history.segments.append(_Segment(run.time, None, run.z))
        return run.history

    def _put(self, run: _Run, stop: Stop, u: arb) -> None:
        """Coordinate c onto the stop, with relative velocity u."""
        n, c = self.size, self.contact
        turn = arb_mat([[x] for x in run.z.entries()[2 * n :]])
        run.z[c, 0] = (stop.follow[0] * turn)[0, 0].mid()
        run.z[n + c, 0] = ((stop.follow[1] * turn)[0, 0] + stop.sign * u).mid()
        run.stop, run.u = stop, u

    def _advance(self, run: _Run, z: arb_mat, duration: arb) -> None:
        n = self.size
        run.time = (run.time + duration).mid()
        run.phase = (run.phase + self.frequency * duration).mid()
        run.z = z
        run.z[2 * n, 0], run.z[2 * n + 1, 0] = (x.mid() for x in run.phase.sin_cos())

    def _fly(self, run: _Run) -> bool:
        run.history.segments.append(_Segment(run.time, None, run.z))
        orders = [0 if stop is not run.stop else self._order(run, stop) for stop in self.stops]
        found = first_root(self.flight, [stop.gap for stop in self.stops], run.z, orders)
        if found is None:
            return False
        run.history.steps += found.steps
        n, stop = self.size, self.stops[found.which]
        self._advance(run, found.state, found.elapsed)
        approach = -stop.gap.value_and_rate(run.z)[1]
        u = (self.restitution * approach).mid()
        for i, kick in enumerate(self.kick):
            run.z[n + i, 0] = (run.z[n + i, 0] + kick * (stop.sign * (approach + u))).mid()
        self._put(run, stop, u)
        run.fastest, run.released = run.fastest.max(approach), False
        run.history.impacts.append(self._impact(run, stop))
        return True

    def _impact(self, run: _Run, stop: Stop) -> Impact:
        n = self.size
        numbers = [to_mpf(x) for x in run.z.entries()]
        return Impact(
            to_mpf(run.time),
            mpmath.fmod(to_mpf(run.phase), 2 * mp.pi),
            to_mpf(run.u),
            tuple(numbers[:n]),
            tuple(numbers[n : 2 * n]),
            stop.name,
        )

    def _order(self, run: _Run, stop: Stop) -> int:
        """First derivative of the gap that is not zero, negative where the gap would close.

        0 where there is none: the coordinate stays on the stop without any force.
        """
        if run.released:
            return 3
        if run.u > 0:
            return 1
        jets = stop.gap.derivatives(run.z)
        rows = stop.gap.jets.table()
        for order in range(2, len(jets)):
            rounding = Row.size(rows[order], run.z) * arb((1, 100 - self.bits))
            if abs(jets[order]) > rounding:
                return order if jets[order] > 0 else -order
        return 0

    def _sticks(self, run: _Run, stop: Stop) -> bool:
        """Whether contact begins; if so the relative velocity and its time are taken away."""
        if run.u == 0:
            return self._order(run, stop) <= 0
        acceleration = -stop.gap.derivatives(run.z)[2]
        lost = acceleration * (1 - self.restitution)
        if not lost > 0 or run.u > run.fastest * arb(self.stick_below):
            return False
        rest = 2 * run.u / lost
        bounds = self.flight.bounds(stop.gap, run.z, 3)
        third = min((x.value for x in bounds if x.window > rest), default=INFINITE)
        third += stop.gap.harmonic * self.frequency**3
        if third * rest > lost * arb(COMPLETES):
            if run.u < run.fastest * arb((1, -self.bits // 4)):
                raise ArithmeticError("a chatter ends where contact is lost")
            return False
        run.history.chatter_error += to_mpf(run.u * rest)
        for i, kick in enumerate(self.kick):
            z = run.z[self.size + i, 0]
            run.z[self.size + i, 0] = (z - kick * stop.sign * run.u).mid()
        self._put(run, stop, arb(0))
        run.history.contacts.append(Contact(to_mpf(run.time + rest), mpmath.inf, stop.name))
        return True

    def _hold(self, run: _Run) -> bool:
        """Contact until the force falls through zero; False where it never does."""
        stop, history = run.stop, run.history
        assert stop is not None
        held = stop.hold(run.z)
        history.segments.append(_Segment(run.time, stop, held))
        if not history.contacts or history.contacts[-1].release != mpmath.inf:
            history.contacts.append(Contact(to_mpf(run.time), mpmath.inf, stop.name))
        order = self._force_order(stop, held)
        found = None if order is None else first_root(stop.held, [stop.force], held, [order])
        if found is None:
            return False
        history.steps += found.steps
        history.contacts[-1] = Contact(
            history.contacts[-1].start, to_mpf(run.time + found.elapsed), stop.name
        )
        self._advance(run, stop.let_go(found.state), found.elapsed)
        self._put(run, stop, arb(0))
        run.released = True
        return True

    def _force_order(self, stop: Stop, held: arb_mat) -> int | None:
        """First derivative of the contact force that is not zero; None where all are."""
        jets, rows = stop.force.derivatives(held), stop.force.jets.table()
        for order, (value, row) in enumerate(zip(jets, rows, strict=True)):
            if abs(value) > Row.size(row, held) * arb((1, 100 - self.bits)):
                return order
        return None

    # --- motion -----------------------------------------------------------------------------------

    @_precisely
    def state_at(self, history: History, time: Any) -> tuple[tuple[Real, ...], tuple[Real, ...]]:
        """Positions and velocities at a time, just after an impact that happens then.

        Raises
        ------
        ValueError
            When the time is after the last impact that was asked for.
        """
        at = arb(time)
        last = history.segments[-1].time
        if history.ending == "count" and at > last:
            raise ValueError(f"time must not be after the last impact at {last}; got {time}")
        segment = [part for part in history.segments if not part.time > at][-1]
        stop = segment.stop
        motion = self.flight if stop is None else stop.held
        z = motion.move(segment.state, (at - segment.time).mid())
        numbers = [to_mpf(x) for x in (z if stop is None else stop.let_go(z)).entries()]
        return tuple(numbers[: self.size]), tuple(numbers[self.size : 2 * self.size])


def chain_of(
    masses: Sequence[float],
    springs: Sequence[float],
    damping: float | Sequence[float],
    **parameters: Any,
) -> GeneralOscillator:
    """A chain tied to a wall at its first mass; arguments as for ``ImpactChain``, matrices exact.

    One number of damping makes it exactly proportional to the stiffness.
    """
    with mp.workprec(BITS):
        rigidity = [mpf(k) for k in springs]
        if isinstance(damping, (int, float)):
            dashpots = [mpf(damping) * k for k in rigidity]
        else:
            dashpots = [mpf(c) for c in damping]
        damper, stiffness = _links(dashpots), _links(rigidity)
    mass = [[m if i == j else 0.0 for j in range(len(masses))] for i, m in enumerate(masses)]
    return GeneralOscillator(mass, damper, stiffness, **parameters)


def _links(values: Sequence[Real]) -> list[list[Real]]:
    n = len(values)
    matrix = [[mpf(0)] * n for _ in range(n)]
    for i, k in enumerate(values):
        matrix[i][i] += k
        if i:
            matrix[i - 1][i - 1] += k
            matrix[i][i - 1] -= k
            matrix[i - 1][i] -= k
    return matrix
