"""Cases at the edges of double precision: what they say, and that the reference decides them."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import pytest
from mpmath import mp, mpf

from tests.effort import is_thorough
from tests.reference.extremes import extreme_cases, integer_springs, large_cases
from tests.reference.impact_chain import ReferenceChain
from tests.reference.uniform_chain import UniformChain

FEW = [
    name
    for name, case in extreme_cases().items()
    if (len(case.masses) == 1 and case.impacts < 80)
    or name.startswith(("mass N=3", "spring N=3", "N=3 frequency"))
]


@pytest.mark.parametrize("n", [1, 2, 3, 10])
def test_integer_springs_carry_the_frequency_one(n: int) -> None:
    springs = [Fraction(k) for k in (*integer_springs(n), 0.0)]
    for i in range(n):
        inner, here, outer = i, i + 1, i + 2 if i + 1 < n else i + 1
        assert springs[i] * (here - inner) + springs[i + 1] * (here - outer) == here


# Half a minute in all: a plain run looks at every third.
@pytest.mark.parametrize("name", FEW if is_thorough() else FEW[::3])
def test_more_bits_change_nothing_in_fifty_digits(name: str) -> None:
    case = extreme_cases()[name]
    few, many = case.simulate(), case.simulate(1024)
    assert few.ending == many.ending
    assert len(few.impacts) == len(many.impacts)
    assert len(few.contacts) == len(many.contacts)
    with mp.workdps(100):
        for one, other in zip(few.impacts, many.impacts, strict=True):
            numbers = one.position + one.velocity
            exact = other.position + other.velocity
            scale = 1 + max(abs(x) for x in exact)
            assert abs(one.time - other.time) < mpf("1e-50") * (1 + other.time)
            off = max(abs(a - b) for a, b in zip(numbers, exact, strict=True))
            assert off < mpf("1e-50") * scale
        for contact, same in zip(few.contacts, many.contacts, strict=True):
            if same.release != mpmath.inf:
                assert abs(contact.release - same.release) < mpf("1e-50") * (1 + same.release)


@pytest.mark.parametrize("n", [1, 2, 3, 10])
def test_uniform_chains_are_those_of_computed_modes(n: int) -> None:
    uniform, modal = UniformChain(n, restitution=0.3), ReferenceChain(n, restitution=0.3)
    start = modal.paper_start()
    found, expected = uniform.simulate(60, *start), modal.simulate(60)
    assert found.ending == expected.ending
    with mp.workdps(100):
        assert len(found.impacts) == len(expected.impacts)
        for one, other in zip(found.impacts, expected.impacts, strict=True):
            assert abs(one.time - other.time) < mpf("1e-50")
            pairs = zip(one.velocity, other.velocity, strict=True)
            assert max(abs(a - b) for a, b in pairs) < mpf("1e-50")


def test_a_uniform_chain_is_that_of_the_matrix_exponential() -> None:
    case = extreme_cases()["N=10 restitution=0.85 damping=0.1"]
    uniform = UniformChain(10).simulate(12, case.position, case.velocity)
    with mp.workdps(100):
        for one, other in zip(uniform.impacts, case.simulate().impacts, strict=True):
            assert abs(one.time - other.time) < mpf("1e-50")


def test_a_long_chain_is_decided() -> None:
    history = large_cases()["N=100 damping=0.1 restitution=0.85"].simulate()
    assert len(history.impacts) == 12
