"""The impact chain of Cusumano & Bai (1993) to 50 digits: exact flights, proved first roots.

Modes come from mpmath's ``eigsy``; every flight, contact force and table motion is a sum of damped
oscillators whose first root `first_root.find_root` proves. Each root is checked by one Newton step
in mpmath, which evaluates the sum by other code. Damping is proportional to stiffness.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from typing import Any, Final, Literal, ParamSpec, TypeAlias, TypeVar

import mpmath
from flint import arb, ctx
from mpmath import mp, mpf

from tests.reference.first_root import find_root
from tests.reference.oscillators import OscillatorSum

DIGITS: Final = 50
GUARD: Final = 40
BITS: Final = 384

Real: TypeAlias = Any
"""An mpf: mpmath makes its number class at run time, which no type checker can name."""

Matrix: TypeAlias = Any
"""An mpmath matrix, likewise."""

P = ParamSpec("P")
R = TypeVar("R")


def to_mpf(x: arb) -> Real:
    """The midpoint, to the precision of mpmath."""
    mantissa, exponent = x.mid().man_exp()
    return mpmath.ldexp(mpf(int(mantissa)), int(exponent))


def _precisely(function: Callable[P, R]) -> Callable[P, R]:
    """Run with guard digits in both arithmetic."""

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        with mp.workdps(DIGITS + GUARD), ctx.workprec(BITS):
            return function(*args, **kwargs)

    return wrapped


@dataclass(frozen=True)
class Impact:
    """State just after an impact; the relative velocity u >= 0 is that of tip and table."""

    time: Real
    phase: Real
    relative_velocity: Real
    position: tuple[Real, ...]
    velocity: tuple[Real, ...]
    flight: Real


@dataclass
class History:
    """Impacts in order, contact intervals (start, release), and how the motion ended.

    ``worst_newton_step`` is the largest correction that mpmath would make to a proved root; in
    chatter it grows like 1e-88 / u.
    """

    impacts: list[Impact] = field(default_factory=list)
    contacts: list[tuple[Real, Real]] = field(default_factory=list)
    ending: Literal["count", "no further contact", "contact for ever"] = "count"
    worst_newton_step: Real = field(default_factory=lambda: mpf(0))


@dataclass
class _State:
    time: Real
    phase: Real
    position: list[Real]
    velocity: list[Real]
    leading: list[Real]


@dataclass(frozen=True)
class _Modes:
    """x = shape q, q = inverse x, and q'' + 2 sigma q' + w^2 q = 0."""

    w: list[Real]
    sigma: list[Real]
    shape: Matrix
    inverse: Matrix


def _modes(masses: Sequence[Real], stiffness: Matrix, damping: Real) -> _Modes:
    n = len(masses)
    if n == 0:
        return _Modes([], [], mpmath.matrix(0, 0), mpmath.matrix(0, 0))
    root = [mpmath.sqrt(m) for m in masses]
    scaled = mpmath.matrix(n, n)
    for i in range(n):
        for j in range(n):
            scaled[i, j] = stiffness[i, j] / (root[i] * root[j])
    values, vectors = mpmath.eigsy(scaled)
    shape, inverse = mpmath.matrix(n, n), mpmath.matrix(n, n)
    for i in range(n):
        for k in range(n):
            shape[i, k] = vectors[i, k] / root[i]
            inverse[k, i] = vectors[i, k] * root[i]
    return _Modes(
        [mpmath.sqrt(x) for x in values], [damping * x / 2 for x in values], shape, inverse
    )


def _oscillate(value: Real, rate: Real, w: Real, sigma: Real, s: Real) -> tuple[Real, Real]:
    """Value and rate at s of y'' + 2 sigma y' + w^2 y = 0."""
    cosine, sine = _waves(w, sigma, s)
    return (
        value * cosine + (rate + sigma * value) * sine,
        rate * cosine - (w * w * value + sigma * rate) * sine,
    )


@lru_cache(maxsize=64)
def _waves(w: Real, sigma: Real, s: Real) -> tuple[Real, Real]:
    """What decays from value 1 and rate -sigma, and from value 0 and rate 1; the same for all y."""
    square = w * w - sigma * sigma
    root = mpmath.sqrt(abs(square))
    if square > 0:
        cosine, sine = mpmath.cos_sin(root * s)
        sine /= root
    elif square < 0:
        cosine, sine = mpmath.cosh(root * s), mpmath.sinh(root * s) / root
    else:
        cosine, sine = mpf(1), s
    decay = mpmath.exp(-sigma * s)
    return decay * cosine, decay * sine


class ReferenceChain:
    """Chain of N masses, spring i between masses i - 1 and i (0: the wall), dashpot damping k_i.

    Parameters
    ----------
    masses, springs
        Number of unit masses, or one entry per element; doubles are taken exactly.
    damping, restitution, amplitude, offset, frequency
        As in the paper: g, r, A, A0, w.
    stick_below
        Chatter with a relative velocity below this is completed by contact; the state is then
        wrong by about its square, so 1e-23 leaves 45 digits.
    """

    @_precisely
    def __init__(
        self,
        masses: int | Sequence[float] = 10,
        springs: float | Sequence[float] = 1.0,
        *,
        damping: float = 0.1,
        restitution: float = 0.85,
        amplitude: float = 0.1,
        offset: float = 0.0,
        frequency: float = 0.87,
        stick_below: float = 1e-23,
    ) -> None:
        self.masses = [mpf(1)] * masses if isinstance(masses, int) else [mpf(m) for m in masses]
        n = len(self.masses)
        if isinstance(springs, (int, float)):
            self.springs = [mpf(springs)] * n
        else:
            self.springs = [mpf(k) for k in springs]
        self.damping, self.restitution = mpf(damping), mpf(restitution)
        self.amplitude, self.offset = mpf(amplitude), mpf(offset)
        self.frequency, self.stick_below = mpf(frequency), mpf(stick_below)
        stiffness = mpmath.matrix(n, n)
        for i, k in enumerate(self.springs):
            stiffness[i, i] += k
            if i:
                stiffness[i - 1, i - 1] += k
                stiffness[i, i - 1] -= k
                stiffness[i - 1, i] -= k
        self.free = _modes(self.masses, stiffness, self.damping)
        self.held = _modes(self.masses[:-1], stiffness[: n - 1, : n - 1], self.damping)

    @_precisely
    def paper_start(self) -> tuple[list[Real], list[Real]]:
        """Position and velocity: the first mode, q_1 = 1, at rest, tip away from the table."""
        column = [self.free.shape[i, 0] for i in range(len(self.masses))]
        sign = 1 if column[-1] > 0 else -1
        return [sign * x for x in column], [mpf(0)] * len(column)

    @_precisely
    def simulate(
        self,
        impacts: int,
        position: Sequence[Real | float] | None = None,
        velocity: Sequence[Real | float] | None = None,
        phase: Real | float = 0.0,
        relative_velocity: Real | float | None = None,
    ) -> History:
        """Simulate until the given number of impacts.

        The start (default: the paper's) is off the table; where ``relative_velocity`` is given it
        is just after an impact, and the tip's entries are replaced by what follows from it.
        """
        x, v = self.paper_start()
        x = x if position is None else [mpf(y) for y in position]
        v = v if velocity is None else [mpf(y) for y in velocity]
        state = _State(mpf(0), mpf(phase), x, v, [])
        if relative_velocity is not None:
            there, speed, _ = self.table(state.phase)
            x[-1], v[-1] = there, speed + mpf(relative_velocity)
            state.leading = [mpf(0), mpf(relative_velocity)]
        history = History()
        while len(history.impacts) < impacts:
            if not self._fly(state, history):
                history.ending = "no further contact"
                break
            if self._sticks(state) and not self._hold(state, history):
                history.ending = "contact for ever"
                break
        return history

    def table(self, phase: Real) -> tuple[Real, Real, Real]:
        """Position, velocity and acceleration of the table."""
        a, w = self.amplitude, self.frequency
        sine, cosine = mpmath.sin(phase), mpmath.cos(phase)
        return a * sine + self.offset, a * w * cosine, -a * w * w * sine

    def _fly(self, state: _State, history: History) -> bool:
        modes, n = self.free, len(self.masses)
        q = list(modes.inverse * mpmath.matrix(state.position))
        dq = list(modes.inverse * mpmath.matrix(state.velocity))
        tip = [modes.shape[n - 1, k] for k in range(n)]
        there, speed, _ = self.table(state.phase)
        flight = self._first_root(
            -self.offset,
            [a * b for a, b in zip(tip, q, strict=True)] + [self.offset - there],
            [a * b for a, b in zip(tip, dq, strict=True)] + [-speed],
            [*modes.w, self.frequency],
            [*modes.sigma, mpf(0)],
            state.leading,
            history,
        )
        if flight is None:
            return False
        moved = [
            _oscillate(*args, flight) for args in zip(q, dq, modes.w, modes.sigma, strict=True)
        ]
        state.position = list(modes.shape * mpmath.matrix([m[0] for m in moved]))
        state.velocity = list(modes.shape * mpmath.matrix([m[1] for m in moved]))
        self._pass(state, flight)
        there, speed, _ = self.table(state.phase)
        relative = self.restitution * (speed - state.velocity[-1])
        state.position[-1], state.velocity[-1] = there, speed + relative
        state.leading = [mpf(0), relative]
        history.impacts.append(
            Impact(
                state.time,
                state.phase,
                relative,
                tuple(state.position),
                tuple(state.velocity),
                flight,
            )
        )
        return True

    def _pass(self, state: _State, duration: Real) -> None:
        state.time += duration
        state.phase = mpmath.fmod(state.phase + self.frequency * duration, 2 * mp.pi)

    def contact_force(self, state: _State) -> Real:
        """Force of the table that keeps the tip on it, the tip moving with the table."""
        there, speed, acceleration = self.table(state.phase)
        return self.masses[-1] * acceleration + self._pull(there, speed, state)

    def _pull(self, there: Real, speed: Real, state: _State) -> Real:
        k = self.springs[-1]
        inner, inner_speed = (
            (state.position[-2], state.velocity[-2]) if len(self.masses) > 1 else (mpf(0), mpf(0))
        )
        return k * (there - inner) + k * self.damping * (speed - inner_speed)

    def _sticks(self, state: _State) -> bool:
        """Chatter below the cut that completes long before the contact force changes."""
        force = self.contact_force(state)
        if state.leading[1] > self.stick_below or not force > 0:
            return False
        return bool(self._chatter_left(state) < mpf("1e-6") * force)

    def _chatter_left(self, state: _State) -> Real:
        """Time until the impacts accumulate, to first order in u."""
        u = state.leading[1]
        if u == 0:
            return mpf(0)
        if self.restitution == 1:
            return mpf("inf")
        return 2 * u * self.masses[-1] / (self.contact_force(state) * (1 - self.restitution))

    def _hold(self, state: _State, history: History) -> bool:
        """Contact: masses 1..N-1 driven by the table until the contact force falls through 0."""
        modes, n = self.held, len(self.masses) - 1
        k, g, w = self.springs[-1], self.damping, self.frequency
        there, speed, acceleration = self.table(state.phase)
        started = state.time + self._chatter_left(state)
        rest, follow = self._forced(state.phase)
        free = [state.position[i] - rest[i] - follow[i][0] for i in range(n)]
        free_rate = [state.velocity[i] - follow[i][1] for i in range(n)]
        p = list(modes.inverse * mpmath.matrix(free)) if n else []
        dp = list(modes.inverse * mpmath.matrix(free_rate)) if n else []
        value, rate = [], []
        for j in range(n):
            share = -k * modes.shape[n - 1, j]
            square, decay = modes.w[j] ** 2, modes.sigma[j]
            second = -2 * decay * dp[j] - square * p[j]
            value.append(share * (p[j] + g * dp[j]))
            rate.append(share * (dp[j] + g * second))
        jerk = -w * w * speed
        inner = follow[n - 1] if n else (mpf(0),) * 3
        resting = rest[n - 1] if n else mpf(0)
        relative = there - self.offset - inner[0], speed - inner[1], acceleration - inner[2]
        value.append(self.masses[-1] * acceleration + k * (relative[0] + g * relative[1]))
        rate.append(self.masses[-1] * jerk + k * (relative[1] + g * relative[2]))
        duration = self._first_root(
            k * (self.offset - resting),
            value,
            rate,
            [*modes.w, w],
            [*modes.sigma, mpf(0)],
            [],
            history,
        )
        if duration is None:
            return False
        moved = [
            _oscillate(*args, duration) for args in zip(p, dp, modes.w, modes.sigma, strict=True)
        ]
        self._pass(state, duration)
        rest, follow = self._forced(state.phase)
        there, speed, _ = self.table(state.phase)
        free = list(modes.shape * mpmath.matrix([m[0] for m in moved])) if n else []
        free_rate = list(modes.shape * mpmath.matrix([m[1] for m in moved])) if n else []
        state.position = [free[i] + rest[i] + follow[i][0] for i in range(n)] + [there]
        state.velocity = [free_rate[i] + follow[i][1] for i in range(n)] + [speed]
        state.leading = [mpf(0)] * 3
        history.contacts.append((started, state.time))
        return True

    def _forced(self, phase: Real) -> tuple[list[Real], list[tuple[Real, Real, Real]]]:
        """Static positions, and the forced motion in contact with its first two derivatives."""
        modes, n = self.held, len(self.masses) - 1
        k, g, w = self.springs[-1], self.damping, self.frequency
        rest, response = [mpf(0)] * n, [mpmath.mpc(0)] * n
        for j in range(n):
            share = k * modes.shape[n - 1, j]
            square = modes.w[j] ** 2
            factor = share * (1 + 1j * w * g) / (square - w * w + 2j * w * modes.sigma[j])
            for i in range(n):
                rest[i] += modes.shape[i, j] * share / square * self.offset
                response[i] += modes.shape[i, j] * factor * self.amplitude
        turn = mpmath.expj(phase)
        return rest, [
            ((z * turn).imag, (1j * w * z * turn).imag, (-w * w * z * turn).imag) for z in response
        ]

    def _first_root(
        self,
        offset: Real,
        value: list[Real],
        rate: list[Real],
        w: list[Real],
        sigma: list[Real],
        leading: list[Real],
        history: History,
    ) -> Real | None:
        """Proved first root, polished and checked in mpmath; None where there never is one."""
        terms = ([arb(x) for x in row] for row in (value, rate, w, sigma, leading))
        values, rates, natural, decay, exact = terms
        total = OscillatorSum(arb(offset), values, rates, natural, decay, exact)
        horizon = 4 * float(2 * mp.pi / self.frequency)
        while (found := find_root(total, horizon)) is None:
            if _stays_positive(total, horizon):
                return None
            if horizon > 1e6:
                raise ArithmeticError("no root found, and none excluded")
            horizon *= 4
        if not found.crosses:
            raise ArithmeticError("grazing cannot be decided at this precision")
        s = to_mpf(found.at)
        moved = [_oscillate(*args, s) for args in zip(value, rate, w, sigma, strict=True)]
        step = (offset + sum(m[0] for m in moved)) / sum(m[1] for m in moved)
        history.worst_newton_step = max(history.worst_newton_step, abs(step))
        return s


def _stays_positive(total: OscillatorSum, s: float) -> bool:
    """Whether the bound on every oscillator keeps the sum positive from s on."""
    values, rates = total.states(arb(s))
    lowest = total.polynomial[0]
    for y, dy, w in zip(values, rates, total.w, strict=True):
        lowest -= (y.abs_upper() ** 2 + (dy.abs_upper() / w) ** 2).sqrt()
    return bool(lowest > 0)
