"""Checks of attractors against the contract of `Attractor`."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.section import Hyperplane
from dynkit.testing.requirements import require, require_shape, same_bits

MakeAttractor: TypeAlias = Callable[[int, int], Attractor]
AttractorCheck: TypeAlias = Callable[[MakeAttractor], None]


def attractor_states_have_the_shape(make: MakeAttractor) -> None:
    """The numbers of kept and skipped states are as requested; states are finite and read-only."""
    attractor = make(7, 20)
    require_shape("the states", attractor.states, (20, attractor.system.dimension))
    require(attractor.transient == 7, "the transient is kept", f"got {attractor.transient}")
    require(not attractor.states.flags.writeable, "the states are read-only", "they are not")


def attractor_is_deterministic(make: MakeAttractor) -> None:
    """The same attractor has the same states, label and error, bit for bit."""
    one, other = make(7, 100), make(7, 100)
    require(same_bits(one.states, other.states), "the states are deterministic", "they differ")
    for name in ("label", "error"):
        values = getattr(one, name), getattr(other, name)
        require(values[0] == values[1], f"the {name} is deterministic", f"got {values}")


def transient_skips_states(make: MakeAttractor) -> None:
    """A longer transient gives, bit for bit, the later states."""
    later, all_states = make(7, 20).states, make(0, 27).states
    require(same_bits(later, all_states[7:]), "the transient skips states", "others are left")


def attractor_goes_on(make: MakeAttractor) -> None:
    """The states that follow the final one are, bit for bit, those of a longer attractor."""
    first, whole = make(7, 5), make(7, 20)
    system: Any = first.system
    later = system.following(first.final, 15)
    require(same_bits(later.states, whole.states[5:]), "the attractor goes on", "states differ")
    both = first.duration + later.duration
    lasts = abs(both - whole.duration) <= 1e-12 * whole.duration
    require(lasts, "the durations add up", f"got {both} and {whole.duration}")


def time_series_does_not_depend_on_company(make: MakeAttractor) -> None:
    """Times give the same bits together and one by one, in any order."""
    attractor, times = make(7, 20), np.array([30.0, 0.0, 5.0])
    together = attractor.time_series(times)
    for i, time in enumerate(times):
        alone = make(7, 20).time_series(np.array([time]))[0]
        require(same_bits(together[i], alone), "times give the same bits alone", f"at {time}")


def attractor_has_sections(make: MakeAttractor) -> None:
    """The points on a section through the middle of the states are finite and (k, d)."""
    attractor = make(7, 100)
    d = attractor.system.dimension
    if d > 1:  # on a line the section is a point, without coordinates
        middle = float(attractor.states[:, 0].mean())
        points = attractor.section(Hyperplane(np.eye(d)[0], middle))
        require_shape("the section", points, (len(points), d))


def attractor_says_cost_and_error(make: MakeAttractor) -> None:
    """The cost's seconds and the error are not negative, and the error is not NaN."""
    attractor = make(7, 20)
    require(attractor.cost.seconds >= 0.0, "the cost is not negative", f"{attractor.cost}")
    require(attractor.error >= 0.0, "the error is not negative", f"got {attractor.error}")


attractor_checks: tuple[AttractorCheck, ...] = (
    attractor_states_have_the_shape,
    attractor_is_deterministic,
    transient_skips_states,
    attractor_goes_on,
    time_series_does_not_depend_on_company,
    attractor_has_sections,
    attractor_says_cost_and_error,
)


def check_attractor(make: MakeAttractor) -> None:
    """Run all `attractor_checks` on an attractor.

    Parameters
    ----------
    make : callable
        Function ``make(transient, states)`` that returns the attractor of one motion.
    """
    for check in attractor_checks:
        check(make)
