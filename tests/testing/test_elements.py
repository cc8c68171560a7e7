"""Conformance of elements: all that are shipped pass, broken ones fail by the right name."""

from dataclasses import KW_ONLY, dataclass, replace
from typing import Any

import pytest

from dynkit.systems import DryFriction, Element, HardStop, ImpactChain, Regime, SoftStop, Watch
from dynkit.testing import check_element, check_name, element_checks

MACHINE = ImpactChain(
    masses=2,
    frequency=0.9,
    damping=0.05,
    harmonic_forces=[0.6, 1.0],
    elements=[SoftStop(0, stiffness=1.0)],
)
SHIPPED = [
    HardStop(1, offset=-0.3, amplitude=0.1, restitution=0.7, name="table"),
    HardStop((0, 1), offset=0.4, restitution=0.9, side="below"),
    SoftStop((0, 1), offset=-0.1, stiffness=5.0),
    SoftStop(0, offset=0.2, amplitude=0.1, phase=0.3, stiffness=9.0, damping=0.8, side="below"),
    SoftStop([0.6, -0.8], stiffness=2.0, damping=0.2),
    DryFriction(0, force=0.3),
    DryFriction((0, 1), force=0.2, static=0.35, slope=0.1, side="below"),
    DryFriction(1, force=0.2, static=0.3, velocity=0.2, amplitude=0.1, name="belt"),
]


@pytest.mark.parametrize("element", SHIPPED, ids=repr)
@pytest.mark.parametrize("check", element_checks, ids=check_name)
def test_shipped_elements_conform(check: Any, element: Element) -> None:
    check(element, MACHINE)


TOUCHED, LEFT = Watch(to=1, gap=1.0, order=1), Watch(to=0, gap=-5.0, order=1)


@dataclass(frozen=True)
class Broken(Element):
    """A soft stop some part of whose regimes is another one."""

    _: KW_ONLY
    stiffness: float = 5.0
    touched: Watch = TOUCHED
    left: Watch = LEFT
    pressing: float = 1.0
    also: tuple[Watch, ...] = ()

    @property
    def regimes(self) -> tuple[Regime, ...]:
        first = Regime((self.touched, *self.also))
        return first, Regime((self.left,), stiffness=self.pressing * self.stiffness)


def test_the_soft_stop_of_which_the_broken_ones_are_made_conforms() -> None:
    check_element(Broken(0), MACHINE)


@dataclass(frozen=True)
class Restless(Element):
    """Its regimes change from call to call."""

    @property
    def regimes(self) -> tuple[Regime, ...]:
        return (Regime((Watch(to=0, gap=float(id(object()) % 97)),), push=_count()),)


def _count(calls: list[float] = [0.0]) -> float:  # noqa: B006
    calls[0] += 1.0
    return calls[0]


@dataclass
class _Loose:
    regimes: tuple[Regime, ...] = ()


@dataclass(frozen=True)
class Engine(Element):
    """Friction that pushes the way it slips, up to some rate."""

    @property
    def regimes(self) -> tuple[Regime, ...]:
        forward = Watch(to=1, rate=-1.0)
        back = Watch(to=0, rate=1.0)
        return (
            Regime((replace(forward, order=1),), push=-0.3),
            Regime((replace(back, order=1),), push=0.3),
        )


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (_Loose(), "an element is a frozen dataclass: got _Loose"),
        (Restless(0), "has its regimes|regimes are the same at every call"),
        (
            Broken(0, touched=Watch(to=7, gap=1.0)),
            "guard 0 of regime 0 leads to another regime: it leads to 7 of 2",
        ),
        (
            Broken(0, also=(Watch(to=1, force=1.0),)),
            "guard 1 of regime 0 watches a force where the regime holds or sticks, and only there",
        ),
        (
            Broken(0, pressing=-1.0),
            r"the stiffness of regime 1 is not negative: got -5\.0",
        ),
        (
            Broken(0, left=Watch(to=0, gap=5.0, order=1)),
            "regime 1 lasts when it is entered by guard 0 of regime 0: one of its guards",
        ),
        (
            Broken(0, touched=Watch(to=1, gap=1.0, order=0)),
            "the order of guard 0 of regime 0 is 1: got 0: the first guard of regime 1 vanishes",
        ),
        (Engine(0), "an element creates no energy: it dissipated -"),
        (HardStop(1, offset=-100.0), "something happens to the element: no guard became zero"),
    ],
)
def test_broken_elements_fail_by_name(
    element: Any, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynkit.testing.elements._TRIES", 3)
    with pytest.raises(AssertionError, match=message):
        check_element(element, MACHINE)
