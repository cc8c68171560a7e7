"""Checks of elements against the contract of `Element`, and against a slow integration."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from dynkit.testing.element_reference import SlowMotion
from dynkit.testing.requirements import require

ElementCheck: TypeAlias = Callable[[Any, Any], None]
"""Check of an element, with a machine on which it may act."""

# Number of random states of a regime, and seed of random numbers.
_POINTS, _SEED = 200, 1
# Largest number of random starts for the comparison with the slow integration.
_TRIES = 30
# Largest error of the slow integration, relative to one plus the largest displacement; largest
# relative rounding error of an energy balance.
_CLOSE, _ROUNDING = 1e-7, 1e-9


def element_is_a_frozen_value(element: Any, machine: Any) -> None:  # noqa: ARG001
    """1. An element is a frozen dataclass, and equals its copies by `replace` and by pickle.

    Its regimes are the same at every call, and in a copy.
    """
    options = getattr(type(element), "__dataclass_params__", None)
    kept = options is not None and options.frozen
    require(kept, "an element is a frozen dataclass", f"got {type(element).__name__}")
    same: tuple[tuple[str, Callable[[], Any]], ...] = (
        ("replace", lambda: dataclasses.replace(element)),
        ("pickle", lambda: pickle.loads(pickle.dumps(element))),
    )
    for name, copy in same:
        try:
            found = copy()
        except (TypeError, AttributeError, pickle.PicklingError) as fault:
            raise AssertionError(f"an element can be copied by {name}: {fault}") from fault
        require(found == element, f"an element equals its copy by {name}", f"got {found!r}")
        require(found.regimes == element.regimes, f"a copy by {name} has its regimes", f"{found!r}")
    require(element.regimes == element.regimes, "regimes are the same at every call", "they differ")


def guards_lead_somewhere(element: Any, machine: Any) -> None:  # noqa: ARG001
    """2. Each regime has guards, and each guard watches a quantity and leads to another regime."""
    regimes = element.regimes
    require(len(regimes) > 0, "an element has regimes", "got none")
    for here, regime in enumerate(regimes):
        require(len(regime.guards) > 0, f"regime {here} has guards", "got none")
        numbers = (regime.push, regime.stiffness, regime.damping)
        require(bool(np.isfinite(numbers).all()), f"regime {here} is finite", f"got {numbers}")
        for k, watch in enumerate(regime.guards):
            name = f"guard {k} of regime {here}"
            known = 0 <= watch.to < len(regimes)
            detail = f"it leads to {watch.to} of {len(regimes)}"
            require(known and watch.to != here, f"{name} leads to another regime", detail)
            watched = (watch.gap, watch.rate, watch.force, watch.level)
            require(bool(np.isfinite(watched).all()), f"{name} is finite", f"got {watched}")
            require(any(watched[:3]), f"{name} watches a gap, a rate or a force", f"got {watch}")
            fixed = regime.holds or regime.sticks
            require(
                bool(watch.force) == fixed and not (fixed and (watch.gap or watch.rate)),
                f"{name} watches a force where the regime holds or sticks, and only there",
                f"got {watch}",
            )


def springs_push_back(element: Any, machine: Any) -> None:  # noqa: ARG001
    """3. No stiffness is negative, and a regime that holds or sticks has no other force."""
    for here, regime in enumerate(element.regimes):
        stiffness = f"the stiffness of regime {here} is not negative"
        require(regime.stiffness >= 0.0, stiffness, f"got {regime.stiffness}")
        if regime.holds or regime.sticks:
            alone = f"regime {here}, which holds or sticks, has no push, spring or dashpot"
            require(not regime.acts, alone, f"got {regime}")


def regimes_last_when_entered(element: Any, machine: Any) -> None:  # noqa: ARG001
    """4. The regime to which a guard leads does not end at once, and the guard's `order` is right.

    In regimes that do not hold or stick a guard is a function of the gap and its rate. At some gaps
    and rates at which a guard falls to zero, the guards of the next regime must be positive, or
    zero and rising.
    """
    random = np.random.default_rng(_SEED)
    for here, regime in enumerate(element.regimes):
        for k, watch in enumerate(regime.guards):
            after = element.regimes[watch.to]
            if watch.at_once or watch.hits or any(r.holds or r.sticks for r in (regime, after)):
                continue
            reached = [s for s in _reached(regime, watch, random) if _negative(after, s) is None]
            left = f"regime {watch.to} lasts when it is entered by guard {k} of regime {here}"
            require(bool(reached), left, "one of its guards is negative at once, everywhere")
            first = after.guards[0]
            along = first.gap * watch.rate - first.rate * watch.gap
            levels = first.gap * watch.level - watch.gap * first.level
            rates = first.rate * watch.level - watch.rate * first.level
            vanishes = int(along == levels == rates == 0.0)
            require(
                watch.order == vanishes,
                f"the order of guard {k} of regime {here} is {vanishes}",
                f"got {watch.order}: the first guard of regime {watch.to} "
                f"{'vanishes' if vanishes else 'does not vanish'} there",
            )


def _reached(regime: Any, watch: Any, random: Any) -> list[Any]:
    """Return gaps, rates and accelerations where a guard falls to zero and no other is negative."""
    found = []
    for state in random.normal(size=(_POINTS, 3)):
        if watch.gap:
            state[0] = -(watch.rate * state[1] + watch.level) / watch.gap
        else:
            state[1] = -watch.level / watch.rate
        falls = watch.gap * state[1] + watch.rate * state[2] < 0.0
        others = [other for other in regime.guards if other is not watch and not other.at_once]
        if falls and all(_values(other, state)[0] >= 0.0 for other in others):
            found.append(state)
    return found


def _values(watch: Any, state: Any) -> tuple[float, float]:
    """Return the value of a guard and its rate; a value at rounding level is zero."""
    terms = watch.gap * state[0], watch.rate * state[1], watch.level
    value = sum(terms)
    if abs(value) < 1e-12 * max(map(abs, terms)):
        value = 0.0
    return value, watch.gap * state[1] + watch.rate * state[2]


def _negative(regime: Any, state: Any) -> int | None:
    """Return the first guard that is negative, or zero and falling; None if there is none."""
    for k, watch in enumerate(regime.guards):
        value, rate = _values(watch, state)
        if not watch.at_once and (value < 0.0 or (value == 0.0 and rate < 0.0)):
            return k
    return None


def numbers_are_parameters(element: Any, machine: Any) -> None:
    """5. The numbers of an element are parameters of the machine; `replace` changes only these."""
    own = machine.replace(elements=[element])
    name = element.name or "elements[0]"
    fields = {f.name for f in dataclasses.fields(element)}
    for known, value in own.parameters.items():
        if not known.startswith(f"{name}."):
            continue
        field = known.removeprefix(f"{name}.")
        require(field in fields, "parameters are fields of the element", f"got {known}")
        for other in (value, value + 0.01 * abs(value)):
            changed = own.replace(**{known: other}).elements[0]
            expected = dataclasses.replace(own.elements[0], **{field: other})
            require(changed == expected, f"replace changes {known} alone", f"got {changed!r}")


def motions_are_those_of_a_slow_integration(element: Any, machine: Any) -> None:
    """6. The machine with the element moves as in an integration with small tolerances.

    The motions are compared from several starts, up to the first lasting contact or 20 events.
    """
    own = machine.replace(elements=[element])
    random = np.random.default_rng(_SEED)
    switched = 0
    for _ in range(_TRIES):
        start = _start(own, random)
        if start is None:
            continue
        slow = SlowMotion(own).run(start)
        record = own.simulate(impacts=30, start=start)
        last = float(record.time[-1]) if len(record) else 0.0
        times = slow.times[slow.times <= last]
        if not len(times):
            continue
        found, expected = record.sample(times)[0], slow.positions[: len(times)]
        off = float(abs(found - expected).max())
        size = 1.0 + float(abs(expected).max())
        require(
            off <= _CLOSE * size,
            "the machine moves as in a slow integration",
            f"positions are {off} apart, from {start!r}",
        )
        switched += len(slow.events)
        if switched >= _POINTS // 4:
            break
    require(switched > 0, "something happens to the element", "no guard became zero")


def energy_is_not_created(element: Any, machine: Any) -> None:
    """7. An element does not dissipate negative energy, and the energy of the machine balances."""
    own = machine.replace(elements=[element])
    name = element.name or "elements[0]"
    random = np.random.default_rng(_SEED)
    for start in filter(None, [_start(own, random) for _ in range(3)]):
        record = own.simulate(impacts=30, start=start)
        if not (len(record) and record.time[-1] > 0.0):
            continue
        balance = record.energy_balance()
        size = sum(map(abs, balance.work.values())) + abs(balance.change)
        require(balance.error <= _ROUNDING * size, "the energy balances", f"{balance!r}")
        lost = balance.dissipated[name]
        detail = f"it dissipated {lost}, from {start!r}"
        require(lost >= -_ROUNDING * size, "an element creates no energy", detail)


def _start(machine: Any, random: Any) -> Any:
    """Return a random state of the machine; None for a state beyond a stop."""
    n = machine.degrees_of_freedom
    x, v = random.normal(size=(2, n))
    try:
        return machine.state(x, v)
    except ValueError:
        return None


element_checks: tuple[ElementCheck, ...] = (
    element_is_a_frozen_value,
    guards_lead_somewhere,
    springs_push_back,
    regimes_last_when_entered,
    numbers_are_parameters,
    motions_are_those_of_a_slow_integration,
    energy_is_not_created,
)


def check_element(element: Any, machine: Any) -> None:
    """Check that an element satisfies its contract, on a machine of your choice.

    The checks require, in this order, that the element is a frozen value; that its guards lead to
    regimes that exist; that no stiffness is negative; that a regime does not end when it begins;
    that the numbers of the element are parameters of the machine; that the machine moves as in a
    slow integration by SciPy's DOP853; and that the element creates no energy.

    Parameters
    ----------
    element : Element
    machine : ImpactOscillator
        A machine with forcing, so that its section contains the states at the beginning of periods,
        or just after impacts. Its own elements are left out.

    Raises
    ------
    AssertionError
        The message names the requirement and the finding.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain, SoftStop
    >>> from dynkit.testing import check_element
    >>> machine = ImpactChain(masses=2, frequency=0.9, damping=0.05, harmonic_forces=[0.5, 1.0],
    ...     elements=[SoftStop(0, stiffness=1.0)])
    >>> check_element(SoftStop((0, 1), offset=-0.1, stiffness=5.0, damping=0.3), machine)
    """
    for check in element_checks:
        check(element, machine)
