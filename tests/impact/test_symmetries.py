"""What changes nothing: units, names, mirrors, and when time begins."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from tests.effort import share
from tests.impact.any_oscillator import Begin, alive, balls, begins, certain, plays, singles

IMPACTS = 12
POWERS = st.integers(-40, 40)


def scaled(forces: tuple[Any, ...], factor: float) -> tuple[Any, ...]:
    return tuple(factor * f for f in forces)


def apart(one: Array, other: Array) -> Array:
    """Largest difference of section coordinates, (n,), phases modulo a turn."""
    off = np.asarray(one) - np.asarray(other)
    off[:, -1] -= 2.0 * math.pi * np.rint(off[:, -1] / (2.0 * math.pi))
    return np.asarray(abs(off).max(axis=1, initial=0.0))


def same_motion(one: ImpactRecord, other: ImpactRecord, image: Array) -> None:
    """Assert that a record's states are the image of another's, as far as both are certain."""
    error, twin = certain(one), certain(other)
    assert len(one) == len(other)
    rounding = 1e-14 * (1.0 + abs(one.states).max() + one.system.frequency * one.time)
    assert (apart(other.states, image) <= error + twin + rounding).all()


# --- units ----------------------------------------------------------------------------------------


@share(0.2)
@given(begins(chatter_tolerance=0.0), POWERS)
def test_the_unit_of_length_changes_no_bit(begin: Begin, power: int) -> None:
    c, system = 2.0**power, begin.system
    other = Begin(
        system.replace(
            amplitude=c * system.amplitude,
            offset=c * system.offset,
            play=c * system.play,
            constant_forces=scaled(system.constant_forces, c),
            harmonic_forces=scaled(system.harmonic_forces, c),
        ),
        c * begin.position,
        c * begin.velocity,
        begin.phase,
    )
    one, two = alive(begin.simulate(IMPACTS)), other.simulate(IMPACTS)
    assert two.ending is one.ending
    assert two.time.tobytes() == one.time.tobytes()
    assert two.sticking.tobytes() == one.sticking.tobytes()
    assert (two.relative_velocity / c).tobytes() == one.relative_velocity.tobytes()
    assert (two.position / c).tobytes() == one.position.tobytes()
    assert (two.velocity / c).tobytes() == one.velocity.tobytes()


@share(0.2)
@given(begins(), POWERS)
def test_the_unit_of_mass_does_not_matter(begin: Begin, power: int) -> None:
    c, system = 2.0**power, begin.system
    other = begin.changed(
        M=c * np.array(system.M),
        C=c * np.array(system.C),
        K=c * np.array(system.K),
        constant_forces=scaled(system.constant_forces, c),
        harmonic_forces=scaled(system.harmonic_forces, c),
    )
    one = begin.simulate(IMPACTS)
    same_motion(one, other.simulate(IMPACTS), one.states)


@share(0.2)
@given(begins(chatter_tolerance=0.0), st.integers(-8, 8))
def test_the_unit_of_time_does_not_matter(begin: Begin, power: int) -> None:
    c, system = 2.0**power, begin.system
    other = Begin(
        system.replace(
            C=c * np.array(system.C),
            K=c * c * np.array(system.K),
            frequency=c * system.frequency,
            constant_forces=scaled(system.constant_forces, c * c),
            harmonic_forces=scaled(system.harmonic_forces, c * c),
        ),
        begin.position,
        c * begin.velocity,
        begin.phase,
    )
    n = system.degrees_of_freedom
    one, two = begin.simulate(IMPACTS), other.simulate(IMPACTS)
    certain(two)  # in units of its own
    image = one.states
    image[:, n - 1 : -1] *= c
    error = certain(one) * max(c, 1.0) + two.error + 1e-14 * (1.0 + abs(image).max())
    assert len(one) == len(two)
    assert (apart(two.states, image) <= error).all()
    assert (abs(c * two.time - one.time) * system.frequency <= error * (1.0 + one.time)).all()


# --- mirrors and names ----------------------------------------------------------------------------


@share(0.2)
@given(begins())
def test_from_the_other_side_everything_is_mirrored(begin: Begin) -> None:
    # Half a turn of the phase mirrors the table, and the harmonic forces with it.
    system = begin.system
    other = Begin(
        system.replace(
            side={"above": "below", "below": "above"}[system.side],
            offset=-system.offset,
            constant_forces=scaled(system.constant_forces, -1.0),
        ),
        -begin.position,
        -begin.velocity,
        begin.phase + math.pi,
    )
    one = begin.simulate(IMPACTS)
    image = -one.states
    image[:, -2:] = one.states[:, -2:] + [0.0, math.pi]
    same_motion(one, other.simulate(IMPACTS), image)


@share(0.2)
@given(begins(), st.randoms(use_true_random=False))
def test_the_order_of_the_coordinates_does_not_matter(begin: Begin, random: Any) -> None:
    system, n = begin.system, begin.system.degrees_of_freedom
    order = list(range(n))
    random.shuffle(order)
    place = np.ix_(order, order)
    other = Begin(
        system.replace(
            M=np.array(system.M)[place],
            C=np.array(system.C)[place],
            K=np.array(system.K)[place],
            contact=order.index(system.contact),
            constant_forces=tuple(
                system.constant_forces[i] for i in order[: len(system.constant_forces)]
            ),
            harmonic_forces=tuple(
                system.harmonic_forces[i] for i in order[: len(system.harmonic_forces)]
            ),
        ),
        begin.position[order],
        begin.velocity[order],
        begin.phase,
    )
    one = begin.simulate(IMPACTS)
    free = [i for i in order if i != system.contact]
    image = np.concatenate(
        [one.position[:, free], one.velocity[:, free], one.states[:, -2:]], axis=1
    )
    same_motion(one, other.simulate(IMPACTS), image)


@share(0.2)
@given(begins(largest=6, chatter_tolerance=0.0), st.floats(0.2, 5.0), st.floats(1e-3, 5.0))
def test_a_mass_that_nothing_ties_to_the_others_changes_nothing(
    begin: Begin, mass: float, spring: float
) -> None:
    system, n = begin.system, begin.system.degrees_of_freedom
    parts: dict[str, Any] = {}
    for name, element in (("M", mass), ("C", 0.1 * spring), ("K", spring)):
        matrix = np.zeros((n + 1, n + 1))
        matrix[:n, :n] = getattr(system, name)
        matrix[n, n] = element
        parts[name] = matrix
    for name in ("constant_forces", "harmonic_forces"):
        given_ = getattr(system, name)
        parts[name] = (*given_, 0.5) if given_ else ()
    other = Begin(
        system.replace(**parts),
        np.append(begin.position, 0.3),
        np.append(begin.velocity, -0.2),
        begin.phase,
    )
    one, two = begin.simulate(IMPACTS), other.simulate(IMPACTS)
    error, twin = certain(one), certain(two)
    assert len(one) == len(two)
    allowed = error + twin + 1e-14 * (1.0 + abs(one.states).max())
    off = abs(two.position[:, :n] - one.position).max(axis=1)
    assert (off <= allowed * (1.0 + system.frequency)).all()
    assert (abs(two.relative_velocity - one.relative_velocity) <= allowed).all()


# --- time -----------------------------------------------------------------------------------------


@share(0.2)
@given(begins(), st.integers(-3, 3))
def test_table_periods_later_the_motion_is_the_same(begin: Begin, turns: int) -> None:
    later = Begin(begin.system, begin.position, begin.velocity, begin.phase + 2.0 * math.pi * turns)
    one = begin.simulate(IMPACTS)
    same_motion(one, later.simulate(IMPACTS), one.states)


@share(0.2)
@given(begins(), st.floats(0.1, 5.0), st.floats(0.0, 1.0))
def test_arguments_that_are_changed_and_changed_back_leave_the_same_oscillator(
    begin: Begin, frequency: float, restitution: float
) -> None:
    system = begin.system
    away = system.replace(
        frequency=frequency, restitution=restitution, M=2.0 * np.array(system.M), offset=0.5
    )
    again = away.replace(
        frequency=system.frequency, restitution=system.restitution, M=system.M, offset=system.offset
    )
    assert again == system
    fresh = MatrixOscillator(**{name: getattr(again, name) for name in again._arguments})
    one = begin.simulate(IMPACTS)
    two = Begin(fresh, begin.position, begin.velocity, begin.phase).simulate(IMPACTS)
    assert two.states.tobytes() == one.states.tobytes()


# --- the map --------------------------------------------------------------------------------------


@share(0.2)
@given(begins())
def test_the_map_goes_from_impact_to_impact(begin: Begin) -> None:
    # By section coordinates, which lose what a cut chatter leaves to the motion's own.
    record = begin.simulate(6)
    error = certain(record)
    assume(len(record) == 6)
    assume(not len(record.sticking))
    found = begin.system.iterate(record.states[0], 5)
    again = begin.system.simulate(impacts=5, start=begin.system.impact_state(record.states[0]))
    allowed = np.append(0.0, certain(again)) + error
    rounding = 1e-14 * (1.0 + abs(record.states).max())
    assert (apart(found, record.states) <= allowed + rounding).all()


@pytest.mark.parametrize("family", [begins, singles, balls, plays])
@share(0.2)
@given(st.data())
def test_the_map_shrinks_volumes_by_restitution_and_dashpots(
    family: Callable[[], st.SearchStrategy[Begin]], data: st.DataObject
) -> None:
    begin = data.draw(family())
    # u times the volume of the section coordinates, by r^2 exp(-trace(M^-1 C) t).
    record = begin.simulate(3)
    error = certain(record)
    assume(len(record) == 3)
    assume(not len(record.sticking))
    system, u = begin.system, abs(record.relative_velocity)
    assume(u.min() > 1e-3)
    jacobian = system.jacobian(record.states[1])
    wait = float(record.time[2] - record.time[1])
    trace = float(np.trace(np.linalg.solve(system.mass, system.damping_matrix)))
    expected = system.restitution**2 * math.exp(-trace * wait) * u[1] / u[2]
    singular = np.linalg.svd(jacobian, compute_uv=False)
    # A relative change of every element changes the determinant by the condition number.
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else math.inf
    assume(condition < 1e8)
    allowed = (1e-13 + 10.0 * error[-1] / u[2]) * len(jacobian) * condition * (1.0 + expected)
    assert abs(abs(np.linalg.det(jacobian)) - expected) <= allowed
