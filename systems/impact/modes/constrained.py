"""Linear modes of a structure with held coordinates, and the exponential sums of their guards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dynkit.core.no_motion import CannotFollow, NoMotion
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element, Watch
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.modes.steady_response import HIDDEN, Forced, Load
from dynkit.systems.impact.modes.sticking import stuck
from dynkit.systems.impact.modes.structure import ROUNDING, Excitation, Held, Structure


class ContactParadox(NoMotion):
    """Friction so large that no contact force, or more than one, fits the motion (Painleve)."""


class Slip(NamedTuple):
    """Slipping friction at a contact, its stop, and the ratio of friction to contact force.

    Each force is positive along the row of its own element.
    """

    friction: Element
    stop: Element
    traction: float


class Slider(NamedTuple):
    """A slider: its element, its coordinate, and the spring's stretch while it slides, or None."""

    element: Element
    place: int
    stretch: float | None


def mode_of(
    structure: Structure,
    excitation: Excitation,
    held: Sequence[Element],
    sticking: Sequence[Element],
    watched: Sequence[Array],
    hit: Sequence[Array],
    sliders: Sequence[Slider] = (),
    slips: Sequence[Slip] = (),
) -> Mode:
    """The mode in which some elements hold their gap, and others (`sticking`) hold its rate.

    Guards depend on the rows `watched`, (N,), of all coordinates; impulses act along the rows
    `hit`. Sliders stick to their surfaces, or follow the rows of their elements.

    Raises
    ------
    ContactParadox
        When, with slipping friction, the contact forces have no unique value.
    """
    w, s = excitation.frequency, structure
    others, pivots, ties = np.arange(s.size), None, None
    shape, rest = np.zeros(s.size, complex), np.zeros(s.size)
    inner: Structure | None = s
    if slips:
        along, weights = _tractions(s, held, sticking, slips)
        s = s.dragged(along, weights)
    grip = _grip(s, held) if held else None
    if grip is not None:
        others, pivots, ties, inner = grip.others, grip.pivots, grip.ties, grip.structure
        shape[pivots] = grip.by_sums @ [element.phasor for element in held]
        rest[pivots] = grip.by_sums @ [element.offset for element in held]
    loose = [slider for slider in sliders if slider.stretch is not None]
    if loose:
        away = np.isin(others, [slider.place for slider in loose])
        inner = inner and inner.without(np.flatnonzero(away))
        others = others[~away]
    if sticking:
        # Sticking rows follow the harmonic motion of their surfaces; `stuck` adds constant rates.
        both = _grip(s, [*held, *sticking])
        phasors = [element.phasor for element in (*held, *sticking)]
        shape[both.pivots] = both.by_sums @ phasors
    anchored = [slider for slider in sliders if slider.stretch is None]
    if anchored or sticking:
        places = [slider.place for slider in anchored]
        shape[places] = [slider.element.phasor for slider in anchored]
        rows = np.concatenate([np.eye(s.size)[places], _rows(s, sticking)])
        if grip is not None:
            rows = np.array([grip.leaves(row) for row in rows])
        if loose:
            rows = rows[:, ~away]
        assert inner is not None
        rests = [slider.element.drift == 0.0 for slider in anchored]
        inner = stuck(inner, rows, np.array(rests + [False] * len(sticking)))
    harmonic, constant = _loads(structure, excitation, shape, rest)
    if slips:
        harmonic, constant = (part + along @ (weights @ part) for part in (harmonic, constant))
    turning, still = harmonic[others], constant[others]
    if loose and ties is not None:
        ties = ties[:, ~away]
    if ties is not None:
        turning = turning + ties.T @ harmonic[pivots]
        still = still + ties.T @ constant[pivots]
    if loose:
        follow = _rows(s, [slider.element for slider in loose])
        behind = follow[:, others]
        if pivots is not None:
            ties = np.zeros((len(pivots), len(others))) if ties is None else ties
            behind = np.concatenate([ties, behind + follow[:, pivots] @ ties])
        places = [slider.place for slider in loose]
        shape[places] = follow @ shape
        rest[places] = follow @ rest - [slider.stretch or 0.0 for slider in loose]
        pivots, ties = np.append(pivots if pivots is not None else [], places).astype(int), behind
    load = Load(w, turning, still, shape, rest)
    forced = Forced(None if inner is None else inner.free, others, load, pivots, ties)
    pulls = _pulls(structure, [*held, *sticking], slips)
    mode = _mode(inner, forced, excitation, [*pulls, *watched], hit)
    drifts = np.array([slider.element.drift for slider in anchored])
    places = [slider.place for slider in anchored]
    mode.anchor(len(anchored) + len(sticking), places, drifts, s.size - s.sliders)
    return mode


def _pulls(structure: Structure, fixed: Sequence[Element], slips: Sequence[Slip]) -> list[Array]:
    """Rows (N,) on which the forces of holding and sticking elements depend."""
    matrices = structure.stiffness, structure.damping, structure.mass
    weights: Any = forces_along(structure, fixed, slips) if fixed else ()
    return [row @ part for row in weights for part in matrices]


def _loads(
    structure: Structure, excitation: Excitation, shape: Any, rest: Array
) -> tuple[Any, Array]:
    """Harmonic and constant forces (N,), minus those that a prescribed motion requires."""
    harmonic, constant, w = excitation.harmonic, excitation.constant, excitation.frequency
    s = structure
    for p in np.flatnonzero(shape).tolist():
        dynamic = s.stiffness[:, p] + 1j * w * s.damping[:, p] - w * w * s.mass[:, p]
        harmonic = harmonic - dynamic * shape[p]
    for p in np.flatnonzero(rest).tolist():
        constant = constant - s.stiffness[:, p] * rest[p]
    return harmonic, constant


def forces_along(structure: Structure, fixed: Sequence[Element], slips: Sequence[Slip]) -> Array:
    """Weights (h, N) of forces on coordinates in the forces of holding or sticking elements."""
    if not slips:
        return _grip(structure, fixed).weights
    rows, own = _rows(structure, fixed), list(fixed)
    push = pushes(rows, [(own.index(s), f.row(structure.size), t) for f, s, t in slips])
    inertia: Array = np.asarray(np.linalg.solve(structure.mass, rows.T).T, dtype=float)
    check_unique(inertia, rows, push, slips[0].friction)
    return np.asarray(np.linalg.solve(inertia @ push, inertia))


def pushes(rows: Array, slips: Sequence[tuple[int, Array, Any]]) -> Any:
    """Forces (N, h) on the coordinates by unit forces along rows (h, N), with their friction.

    For each slipping friction, `slips` has the number of its normal force, its row (N,), and its
    traction.
    """
    kinds = (along * traction for _, along, traction in slips)
    push: Any = rows.T.astype(np.result_type(rows, *kinds), order="C")
    for number, row, traction in slips:
        push[:, number] += traction * row
    return push


def along_stops(friction: Element) -> CannotFollow:
    """Make the error for friction with a coefficient along coordinates that stops hold."""
    return CannotFollow(
        f"friction with a coefficient must not act along what stops hold together; got {friction!r}"
    )


def along_others(friction: Element) -> CannotFollow:
    """Make the error for friction along coordinates that other friction, or a stop, holds."""
    return CannotFollow(
        "friction must not act along what other friction, or a stop, holds at that moment, which "
        f"leaves its force open; got {friction!r}"
    )


def check_unique(inertia: Array, rows: Array, push: Array, friction: Element) -> None:
    """Check that the accelerations determine the contact forces; `inertia` (h, N) is rows M^-1.

    Raises
    ------
    ContactParadox
        When they do not determine them.
    """
    size = np.sqrt(np.diag(inertia @ rows.T))
    scaled = inertia @ push / np.outer(size, size)
    with np.errstate(divide="ignore"):
        inverse = np.linalg.inv(scaled) if np.linalg.det(scaled) > ROUNDING else -np.eye(len(rows))
    if not (np.diag(scaled) > ROUNDING).all() or not (np.diag(inverse) > 0.0).all():
        raise ContactParadox(
            "friction at a contact is so large that the contact force has no unique value; "
            f"got {friction!r}"
        )


def _tractions(
    structure: Structure,
    held: Sequence[Element],
    sticking: Sequence[Element],
    slips: Sequence[Slip],
) -> tuple[Array, Array]:
    """Directions (N, p) of slipping friction, and weights (p, N) of its contact forces.

    The forces on the other coordinates are those without contact, f, plus ``along @ weights @ f``.
    """
    stops = list(dict.fromkeys(slip.stop for slip in slips))
    weights = forces_along(structure, held, slips)[[list(held).index(stop) for stop in stops]]
    along = np.zeros((structure.size, len(stops)))
    for friction, stop, traction in slips:
        along[:, stops.index(stop)] -= traction * friction.row(structure.size)
    for element in sticking:
        row = element.row(structure.size)
        if (abs(weights @ row) > ROUNDING * (abs(weights) @ abs(row))).any():
            raise NotImplementedError(
                "friction that slips at a contact must not share masses with other friction that "
                f"sticks; got {element!r}"
            )
    return along, weights


def _rows(structure: Structure, elements: Sequence[Element]) -> Array:
    return np.array([element.row(structure.size) for element in elements]).reshape(
        -1, structure.size
    )


def _grip(structure: Structure, held: Sequence[Element]) -> Held:
    return structure.holding(_rows(structure, held))


def _mode(
    structure: Structure | None,
    forced: Forced,
    excitation: Excitation,
    watched: Sequence[Array],
    hit: Sequence[Array],
) -> Mode:
    """The mode; its searches use only coordinates with a share in the guards or impulses."""
    if structure is None:
        return Mode(None, forced, excitation, np.ones(0, dtype=bool))
    rows, along = ([forced.gathered(row) for row in part] for part in (watched, hit))
    key = tuple(frozenset(row.tobytes() for row in part) for part in (rows, along))
    if key not in structure.seen:
        shares = [structure.free.position_row(row) for row in rows]
        shares += [structure.contact(row).kick[:2] for row in along]
        share = abs(np.concatenate(shares))
        largest = share.max(axis=1, keepdims=True, initial=0.0)
        structure.seen[key] = (share > HIDDEN * largest).any(axis=0)
    return Mode(structure, forced, excitation, structure.seen[key])


def rides(structure: Structure, held: Sequence[Element], element: Element) -> bool | None:
    """Whether an element's gap is constant while others hold; None if the held ones change it.

    False means that the gap depends on coordinates that are not held.
    """
    row = element.row(structure.size)
    if not held or (grip := _grip(structure, held)).leaves(row).any():
        return False
    shares = row[grip.pivots] @ grip.by_sums
    for own, prescribed in (
        (element.phasor, [other.phasor for other in held]),
        (element.drift, [other.drift for other in held]),
    ):
        if abs(own - shares @ prescribed) > ROUNDING * max(abs(own), *map(abs, prescribed)):
            return None
    return True


def pushed(mass: Array, rows: Array) -> tuple[int, bool]:
    """The closed stop that an impact opens, or -1, and whether another closed stop has an impulse.

    The last one of the rows (k, N) is that of the impact, the others are those of the closed stops;
    each points to the side of its stop.

    Newton's law with complementarity: after the impact, the closed stops have impulses p >= 0 and
    rates u >= 0 with p u = 0, independent of the size of the impact. If several stops open, the
    fastest one is returned.

    References
    ----------
    J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in Nonsmooth
    Mechanics and Applications, Springer 1988, 1-82.
    """
    from scipy.optimize import nnls

    effect = rows @ np.linalg.solve(mass, rows.T)
    effect /= np.sqrt(np.outer(np.diag(effect), np.diag(effect)))
    own, by_hit = effect[:-1, :-1], effect[:-1, -1]
    root = np.linalg.cholesky(own)
    impulse, _ = nnls(root.T, -np.linalg.solve(root, by_hit))
    rates = by_hit + own @ impulse
    rates[impulse > ROUNDING] = 0.0
    fastest = int(np.argmax(rates))
    return (fastest if rates[fastest] > ROUNDING else -1), bool((impulse > ROUNDING).any())


def moves(mass: Array, rows: Array, row: Array) -> bool:
    """Whether an impact changes the rate of a row (N,).

    The other rows (k, N) are those of the closed stops and, as the last one, that of the impact.
    """
    effect = np.linalg.solve(mass, rows.T)
    impulse = np.linalg.solve(rows @ effect, np.eye(len(rows))[-1])  # the closed ones stay closed
    return carries(mass, row, np.asarray(effect @ impulse))


def carries(mass: Array, row: Array, change: Array) -> bool:
    """Whether velocity changes (N,) change the rate of a row (N,), to rounding.

    The reference is the largest change of this rate with the same kinetic energy. A sum of absolute
    terms is no reference: in some coordinates the terms cancel.
    """
    most = np.sqrt(row @ np.linalg.solve(mass, row) * (change @ mass @ change))
    return bool(abs(row @ change) > ROUNDING * most)


def depends(mass: Array, rows: Array) -> bool:
    """Whether the last row (N,) is a combination of the others, to rounding."""
    effect = rows @ np.linalg.solve(mass, rows.T)
    size = np.sqrt(np.diag(effect))
    effect = effect / np.outer(size, size)
    left = 1.0 - effect[-1, :-1] @ np.linalg.lstsq(effect[:-1, :-1], effect[:-1, -1])[0]
    return bool(left <= ROUNDING)


def sum_of(mode: Mode, element: Element, watch: Watch, slider: int) -> Any:
    """The exponential sum of a guard of a gap, its rate, or the stretch of a slider's spring."""
    along, sign = element.row(len(mode.forced.rest)), element.sign
    row = mode.row(along)
    if mode.layout.table >= 0:
        row[:, mode.layout.table] -= element.phasor.real, element.phasor.imag
    total, offset = watch.gap * row, watch.gap * (along @ mode.forced.rest - element.offset)
    if watch.rate:
        total = total + watch.rate * mode.pairs.derivative_rows(row, 1)
        offset -= watch.rate * element.drift
    if watch.stretch:
        along[slider] = -1.0
        total, offset = watch.stretch * mode.row(along), watch.stretch * (along @ mode.forced.rest)
    return mode.sum(sign * total, sign * offset + watch.level)


def force_of(
    mode: Mode,
    structure: Structure,
    excitation: Excitation,
    held: Sequence[Element],
    element: Element,
    watch: Watch,
    slips: Sequence[Slip] = (),
    normal: Element | None = None,
) -> Any:
    """The exponential sum of a guard that depends on the force of a holding or sticking element.

    The force is positive towards the element's side. `held` are all holding and sticking elements.
    For friction at a contact, `normal` is the stop there.
    """
    s, weights = structure, forces_along(structure, held, slips)
    sign, own = element.sign * watch.force, list(held).index(element)
    if normal is None:
        weights = weights[own]
    else:
        closed = weights[list(held).index(normal)]
        sign, weights = 1.0, sign * weights[own] + watch.normal * normal.sign * closed
    row = mode.row(weights @ s.stiffness)
    row = row + mode.pairs.derivative_rows(mode.row(weights @ s.damping), 1)
    row = row + mode.pairs.derivative_rows(mode.row(weights @ s.mass), 2)
    if mode.layout.table >= 0:
        own = weights @ excitation.harmonic
        row[:, mode.layout.table] -= own.real, own.imag
    offset = weights @ s.stiffness @ mode.forced.rest - weights @ excitation.constant
    if mode.layout.constant >= 0:
        # The part of the accelerations that the constant slot drives is constant.
        offset += row[0, mode.layout.constant]
        row[0, mode.layout.constant] = 0.0
    return mode.sum(sign * row, sign * float(offset) + watch.level)
