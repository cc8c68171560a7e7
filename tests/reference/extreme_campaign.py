"""The campaign of extreme cases: its cases, by group, and their exact motions.

Chains of `extremes`, of which some are taken, and some more with forces, merging modes and long
times. Sources: `general_oscillator` and `uniform_chain`, every impact proved in interval
arithmetic; `periodic_orbits` where the impacts are too many.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from typing import Any, Final, NamedTuple

import mpmath
from mpmath import mp, mpf

from tests.reference.extremes import ExtremeCase, base, extreme_cases, large_cases
from tests.reference.general_oscillator import BITS, GeneralOscillator, History
from tests.reference.periodic_orbits import periodic_orbit, settling

NEAR: Final = (-1e-9, 0.0, 1e-9)
LONG: Final = 10_000_000
KEPT: Final = 100


class Extreme(NamedTuple):
    """A case as it is written, and its exact motion."""

    entry: dict[str, Any]
    simulate: Callable[[], History]


def extremes() -> Iterator[Extreme]:
    """All cases, by group."""
    for group, cases in _chains().items():
        for name, case in cases:
            yield _of_chain(group, name, case)
        if group == "resonance":
            yield from _forced()
            yield from _merging()
    yield from _long_times()


# --- names ----------------------------------------------------------------------------------------


def _text(x: float) -> str:
    """A number as one writes it."""
    if x == 1.0 - 1e-12:
        return "1 - 1e-12"
    mantissa, _, exponent = f"{x:g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa


def _damped(c: float) -> str:
    return f"damping {_text(c)}" if c else "undamped"


def _beside(what: str, off: float) -> str:
    return what + ("" if off == 0.0 else f" {'-+'[off > 0.0]} {_text(abs(off))}")


# --- chains ---------------------------------------------------------------------------------------

Named = tuple[str, ExtremeCase]


def _chains() -> dict[str, list[Named]]:
    known = {**extreme_cases(), **large_cases()}
    return {
        "restitution": list(_restitution(known)),
        "damping": list(_damping(known)),
        "ratios": list(_ratios(known)),
        "size": list(_size(known)),
        "frequency": list(_frequency(known)),
        "resonance": list(_resonance(known)),
        "table": list(_table(known)),
        "start": list(_start(known)),
    }


def _restitution(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n, r in product((1, 10), (0.0, 1e-12, 0.85, 1.0 - 1e-12, 1.0)):
        yield f"r = {_text(r)}, N = {n}", known[f"N={n} restitution={r!r} damping=0.1"]


def _damping(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n, c, r in product((1, 3, 10), (0.0, 1e-12, 1e3, 1e8), (0.0, 0.85)):
        case = replace(known[f"N={n} restitution={r!r} damping={c:g}"], impacts=6)
        yield f"{_damped(c)}, r = {r:g}, N = {n}", case
    for n, off in product((1, 3, 10), NEAR):
        case = replace(known[f"N={n} restitution=0.85 critical{off:+g}"], impacts=6)
        yield f"{_beside('critical damping of mode 1', off)}, N = {n}", case
    for off in NEAR:
        name = f"{_beside('critical damping of mode 2', off)}, N = 2"
        yield name, known[f"upper of two critical{off:+g}"]
    for n in (1, 3):
        away = replace(base("", n), damping=1e8, position=(1e6,) * n, impacts=6)
        yield f"damping 1e8, let go 1e6 above, N = {n}", away


def _ratios(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    words = {"mass": ("lighter", "heavier"), "spring": ("softer", "stiffer")}
    for n, k in ((2, 1), (2, 2), (10, 6), (10, 10)):
        for kind, c, x in product(words, (0.0, 0.1), (1e-12, 1e12)):
            case = known[f"{kind} N={n} damping={c:g} number {k} {x:g}"]
            yield f"{kind} {k} of {n} {words[kind][x > 1.0]} by 1e12, {_damped(c)}", case
    for what in ("masses", "springs", "masses and springs"):
        yield f"{what} 1, 1e12, 1e-12", known[f"{what} 1e-12 to 1e12"]


def _size(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n in (1, 2, 3, 10):
        yield f"N = {n}, damping 0.1, r = 0.85", known[f"N={n} restitution=0.85 damping=0.1"]
    for n, impacts in ((100, 3), (1000, 1)):
        for c, r in ((0.0, 1.0), (0.1, 0.85)):
            case = replace(known[f"N={n} damping={c:g} restitution={r:g}"], impacts=impacts)
            yield f"N = {n}, {_damped(c)}, r = {r:g}", case


def _frequency(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n, w, r in product((1, 3), (1e-6, 1e-3, 1e3, 1e6), (0.0, 0.85)):
        case = known[f"N={n} frequency={w:g} restitution={r:g}"]
        yield f"frequency {_text(w)}, r = {r:g}, N = {n}", case
    far = replace(base("", 1), frequency=1e6, offset=-1e3, velocity=(-1e4,), damping=0.0)
    yield "frequency 1e6, table 1e3 below, undamped, N = 1", replace(far, impacts=1)


def _resonance(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n, r in product((1, 3, 10), (0.0, 0.85)):
        case = known[f"N={n} undamped at its own frequency restitution={r:g}"]
        yield f"table at natural frequency, undamped, r = {r:g}, N = {n}", case
    for r, a in product((0.0, 0.3), (0.05, 2.0)):
        case = known[f"held mass at its own frequency restitution={r:g} offset={a:g}"]
        yield f"table at frequency of held mass, r = {r:g}, offset {a:g}", case


def _table(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n, a, r in product((1, 3), (0.0, 1e-300, 1e6), (0.0, 0.85)):
        case = known[f"N={n} amplitude={a:g} restitution={r:g}"]
        yield f"amplitude {_text(a)}, r = {r:g}, N = {n}", case
    for side, n, c in product(("below", "above"), (1, 3), (0.0, 0.1)):
        case = known[f"table far {side} N={n} damping={c:g} restitution=0.85"]
        yield f"table 1e3 {side} reach, {_damped(c)}, N = {n}", case
    for miss in (1e-3, -1e-3, 1e-9, -1e-9):
        words = "misses" if miss > 0.0 else "dips into"
        case = known[f"table at rest missed by {miss:g}"]
        yield f"{words} a table at rest by {_text(abs(miss))}", case


def _start(known: dict[str, ExtremeCase]) -> Iterator[Named]:
    for n, v, r in product((1, 3), (-1.0, 0.0, 1.0), (0.0, 0.85)):
        case = known[f"N={n} 1e-15 above the table velocity={v:g} restitution={r:g}"]
        yield f"1e-15 above the table, velocity {v:g}, r = {r:g}, N = {n}", case
    for n, p, u in product((1, 3), (0.0, 4.0), (0.0, 1e-15)):
        case = known[f"N={n} on the table phase={p:g} u={u:g} restitution=0.3"]
        yield f"on the table, u = {_text(u)}, phase {p:g}, r = 0.3, N = {n}", case


def _of_chain(
    group: str,
    name: str,
    case: ExtremeCase,
    simulate: Callable[[], History] | None = None,
    transient: int = 0,
) -> Extreme:
    def short(values: tuple[float, ...], unit: float) -> Any:
        return unit if set(values) == {1.0} else list(values)

    damping = case.damping if isinstance(case.damping, float) else list(case.damping)
    start: dict[str, Any] = {
        "position": list(case.position),
        "velocity": list(case.velocity),
        "phase": case.phase,
    }
    if case.on_table is not None:
        numbers = [*case.position[:-1], *case.velocity[:-1], case.on_table, case.phase]
        start = {"section": numbers}
    arguments = {
        "masses": short(case.masses, len(case.masses)),
        "springs": short(case.springs, 1.0),
        "damping": damping,
        "restitution": case.restitution,
        "amplitude": case.amplitude,
        "offset": case.offset,
        "frequency": case.frequency,
    }
    entry = {
        "group": group,
        "name": name,
        "system": {"kind": "ImpactChain", "arguments": arguments},
        "start": start,
        **({"transient": transient} if transient else {}),
        "impacts": case.impacts,
    }
    return Extreme(entry, simulate or case.simulate)


# --- other structures -----------------------------------------------------------------------------

IDENTITY: Final = [[1.0, 0.0], [0.0, 1.0]]
JOINT: Final = [[1.0, -1.0], [-1.0, 1.0]]
# Springs 6, 5, 3: frequency 1 exactly, in the shape 1, 2, 3.
THREE: Final = [[11.0, -5.0, 0.0], [-5.0, 8.0, -3.0], [0.0, -3.0, 3.0]]
UNITS: Final = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
ZEROS: Final = [[0.0] * 3] * 3


def _forced() -> Iterator[Extreme]:
    """Harmonic forces at resonance."""
    driven = {"amplitude": 0.0, "offset": -1.5, "frequency": 1.0}
    one = {"M": [[1.0]], "C": [[0.0]], "K": [[1.0]], **driven, "harmonic_forces": [[0.3, 0.1]]}
    name = "force at natural frequency, undamped"
    yield _of_matrices("resonance", f"{name}, N = 1", one, [0.0], 8)
    three = {"M": UNITS, "C": ZEROS, "K": THREE, **driven}
    three["harmonic_forces"] = [[0.0, 0.0], [0.0, 0.0], [0.3, 0.1]]
    yield _of_matrices("resonance", f"{name}, N = 3", three, [0.0] * 3, 8)


def _merging() -> Iterator[Extreme]:
    """State matrices that are defective, or nearly so.

    det(s^2 M + s C + K) is (s + 1)^2 (s^2 + 1), (s^2 + s/8 + 1)^2 and (s + 1)^4; beside them the
    first stiffness is another one.
    """
    defective = {
        "one mode twice": (IDENTITY, JOINT, IDENTITY),
        "an oscillating mode twice": (
            IDENTITY,
            [[0.25, 0.0], [0.0, 0.0]],
            [[65 / 64, 0.125], [0.125, 1.0]],
        ),
        "one mode four times": (IDENTITY, [[3.0, 0.0], [0.0, 1.0]], [[2.5, 0.5], [0.5, 0.5]]),
    }
    for (name, (m, c, k)), off in product(defective.items(), (0.0, 1e-12, 1e-9, 1e-6)):
        stiffness = [row.copy() for row in k]
        stiffness[0][0] *= 1.0 + off
        system = {"M": m, "C": c, "K": stiffness, "frequency": 0.87}
        title = f"defective, {name}" if off == 0.0 else f"{_text(off)} beside defective, {name}"
        yield _of_matrices("merging", title, system, [0.6, 0.9], 6)


def _of_matrices(
    group: str, name: str, arguments: dict[str, Any], position: list[float], impacts: int
) -> Extreme:
    n = len(position)
    entry = {
        "group": group,
        "name": name,
        "system": {"kind": "MatrixOscillator", "arguments": arguments},
        "start": {"position": position, "velocity": [0.0] * n, "phase": 0.0},
        "impacts": impacts,
    }

    def simulate() -> History:
        forces = [complex(*f) for f in arguments.get("harmonic_forces", ())]
        return GeneralOscillator(
            arguments["M"],
            arguments["C"],
            arguments["K"],
            arguments["frequency"],
            0.85,
            arguments.get("amplitude", 0.1),
            arguments.get("offset", 0.0),
            harmonic_forces=forces,
        ).simulate(position, [0.0] * n, 0.0, impacts)

    return Extreme(entry, simulate)


# --- long times -----------------------------------------------------------------------------------


def _long_times() -> Iterator[Extreme]:
    """Flights of 1e9, a time of 1e9 by thousands of impacts, ten million impacts."""
    rising = replace(base("", 1), frequency=5e-10, offset=-0.05, impacts=8)
    rest = replace(rising, position=(0.9,), restitution=0.0)
    yield _of_chain("time", "table rises for 1e9 to a mass at rest", rest)
    swinging = replace(rising, damping=0.0, position=(1e-3,))
    name = "table rises for 1e9 to a swinging mass, undamped"
    yield _of_chain("time", name, swinging, lambda: _meets_the_swing(swinging))

    three = replace(base("", 3), springs=(4e-10,) * 3, damping=1.5e4, frequency=5e-5)
    orbit = replace(three, restitution=0.5, impacts=2700)
    yield _on_orbit("P(1,3) for a time of 1e9, frequency 5e-5, N = 3", orbit, 3)
    soft = replace(base("", 1), springs=(1e-10,), damping=1e3, frequency=1.000006)
    orbit = replace(soft, restitution=0.5, impacts=3200)
    yield _on_orbit("P(1,50001) for a time of 1e9, frequency 1, N = 1", orbit, 50001)

    quick = replace(base("", 1), position=(1.0,), restitution=0.5, frequency=2.5)
    many = replace(quick, impacts=KEPT)

    def last() -> History:
        return History(settling(replace(many, impacts=400), 1, 400 + KEPT).impacts[-KEPT:])

    yield _of_chain("long", "1e7 impacts on P(1,1), N = 1", many, last, LONG - KEPT)


def _on_orbit(name: str, case: ExtremeCase, turns: int) -> Extreme:
    """From a state that is the periodic orbit's, but for its rounding."""
    orbit = periodic_orbit(case, turns)
    start = replace(
        case,
        position=tuple(map(float, orbit.position)),
        velocity=tuple(map(float, orbit.velocity)),
        phase=float(orbit.phase),
        on_table=float(orbit.relative_velocity),
    )
    first = replace(start, impacts=400)
    return _of_chain("time", name, start, lambda: settling(first, turns, case.impacts))


def _meets_the_swing(case: ExtremeCase) -> History:
    """From just before the table has risen to the swing of an undamped mass of spring 1.

    Before it cannot be met, and after it is by the next swing but a few.
    """
    with mp.workprec(BITS):
        swing, w = mpf(case.position[0]), mpf(case.frequency)
        begin = mpmath.asin((-swing - mpf(case.offset)) / mpf(case.amplitude)) / w
        begin -= mpf("1e-3")
        x, v = swing * mpmath.cos(begin), -swing * mpmath.sin(begin)
        history = case.oscillator().simulate([x], [v], w * begin, case.impacts)
        impacts = [replace(impact, time=impact.time + begin) for impact in history.impacts]
    return replace(history, impacts=impacts)
