"""Springs and dashpots too soft for matrices that are rounded to doubles, against 50 digits.

1 + 1e-17 is 1 in doubles: the matrices of a chain with such a spring at the wall are those of a
chain that nothing holds, but its energies are not. The frequencies and the motion, also where
damping couples the modes or the contact is held, are those of the energies.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.impact.exact import BITS, ExactMotion, chain_matrices
from tests.structure.reference import links_matrix

SOFT = [1e-6, 1e-10, 1e-14, 1e-17, 1e-20]
PROPORTIONAL, COUPLED = 0.1, (0.0, 0.3, 0.1)
Damping = float | tuple[float, ...]


def soft_chain(soft: float, damping: Damping, **arguments: Any) -> ImpactChain:
    """Three unit masses, held by a soft spring; dashpots, the first one at the wall."""
    springs = (soft, 1.0, 1.0)
    return ImpactChain(
        masses=3, springs=springs, damping=damping, **{"frequency": 0.9, **arguments}
    )


def rates_of(pairs: Pairs) -> list[Any]:
    """The eigenvalues of all pairs, which nothing may link."""
    assert not pairs.links.size
    rates = []
    for parts in zip(pairs.generator.T.tolist(), pairs.generator_low.T.tolist(), strict=True):
        g = [mpf(high) + mpf(low) for high, low in zip(*parts, strict=True)]
        middle, product = (g[0] + g[3]) / 2, g[0] * g[3] - g[1] * g[2]
        apart = mpmath.sqrt(middle**2 - product)
        rates += [middle + apart, middle - apart]
    return rates


def exact_rates(springs: tuple[float, ...], damping: Damping) -> list[Any]:
    """The eigenvalues of a chain of unit masses."""
    n = len(springs)
    dashpots: Any = damping
    if isinstance(damping, float):
        dashpots = [mpf(damping) * mpf(k) for k in springs]
    matrix = mpmath.zeros(2 * n)
    matrix[:n, n:] = mpmath.eye(n)
    matrix[n:, :n] = -links_matrix(springs)
    matrix[n:, n:] = -links_matrix(dashpots)
    rates, _ = mpmath.eig(matrix)
    return list(rates)


def moved(matrix: arb_mat, duration: arb, position: Array) -> list[float]:
    """Positions after a time, of masses that start at rest."""
    n = len(position)
    rest = [0.0] * (matrix.nrows() - n)
    state = (matrix * duration).exp() * arb_mat(matrix.nrows(), 1, [*position.tolist(), *rest])
    return [float(state[i, 0].mid()) for i in range(n)]


def largest_distance(found: list[Any], exact: list[Any]) -> float:
    """Of a rate from the nearest exact one, relative to it, both ways."""
    pairs = [(rate, exact) for rate in found] + [(rate, found) for rate in exact]
    return max(float(min(abs(a - b) for b in others) / abs(a)) for a, others in pairs)


@pytest.mark.parametrize("damping", [PROPORTIONAL, COUPLED], ids=["proportional", "coupled"])
@pytest.mark.parametrize("soft", SOFT)
def test_what_is_held_by_a_soft_spring_moves_at_its_natural_frequency(
    soft: float, damping: Damping
) -> None:
    chain = soft_chain(soft, damping)
    with mp.workdps(60):
        exact = exact_rates((soft, 1.0, 1.0), damping)
        slowest = min(map(abs, exact))
        found = rates_of(chain._structure.free.pairs)
        # Beside stiffnesses of 1, double-double arithmetic leaves about 1e-31 / soft.
        assert largest_distance(found, exact) < 1e-27 + 1e-30 / soft
        assert float(abs(chain.natural_frequencies[0] / slowest - 1)) < soft + 1e-15


@pytest.mark.parametrize("soft", SOFT)
def test_a_body_on_a_soft_spring_returns_after_half_a_period(soft: float) -> None:
    chain = soft_chain(soft, COUPLED)
    start = chain.state([1.0, 1.0, 1.0], [1.0, 1.0, 1.0])
    record = chain.simulate(impacts=1, start=start)
    assert record.ending is Ending.COUNT_REACHED
    with mp.workdps(60):
        frequency = min(map(abs, exact_rates((soft, 1.0, 1.0), COUPLED)))
        assert float(frequency) * record.time[0] == pytest.approx(np.pi, abs=3.0 * float(frequency))


@pytest.mark.parametrize("turn", [0.0, 1e-3, 0.3, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("soft", SOFT)
def test_motion_on_a_soft_spring_is_exact_to_rounding(soft: float, turn: float) -> None:
    chain = soft_chain(soft, COUPLED)
    start, motion = np.array([0.6, 0.7, 0.8]), chain._free
    matrices = chain_matrices((1.0,) * 3, COUPLED, (soft, 1.0, 1.0))
    duration = turn / float(chain.natural_frequencies[0])
    state = motion.states(chain.state(start)._coordinates, 0.0, 1.0)
    found = motion.after(state[None], np.array([0]), np.array([duration]))
    with ctx.workprec(BITS):
        exact = moved(ExactMotion(chain, matrices).free, arb(duration), start)
    np.testing.assert_allclose(motion.motion(found)[0][0], exact, rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("soft", SOFT)
def test_what_is_held_by_a_soft_spring_moves_at_its_frequency_in_contact(soft: float) -> None:
    # The mass at the contact is tied to the others by a dashpot alone: held, it leaves them to the
    # soft spring.
    chain = ImpactChain(masses=3, springs=(soft, 1.0, 0.0), damping=(0.0, 0.3, 1e-3), frequency=0.9)
    held = chain._structure.holding(np.eye(3)[2:]).structure
    assert held is not None
    with mp.workdps(60):
        matrix = mpmath.zeros(4)
        matrix[:2, 2:] = mpmath.eye(2)
        for i in range(2):
            for j in range(2):
                matrix[2 + i, j] = -links_matrix((soft, 1.0, 0.0))[i, j]
                matrix[2 + i, 2 + j] = -links_matrix((0.0, 0.3, 1e-3))[i, j]
        exact = list(mpmath.eig(matrix)[0])
        assert largest_distance(rates_of(held.free.pairs), exact) < 1e-27 + 1e-30 / soft


@pytest.mark.parametrize("drag", [1e-10, 1e-14, 1e-17, 1e-20])
def test_a_soft_dashpot_stops_what_no_spring_holds(drag: float) -> None:
    chain = soft_chain(0.0, (drag, 0.3, 0.1))
    with mp.workdps(60):
        exact = exact_rates((0.0, 1.0, 1.0), (drag, 0.3, 0.1))
        found = rates_of(chain._structure.free.pairs)
        assert chain.natural_frequencies[0] == 0.0
        assert sum(rate == 0 for rate in found) == 1
        slow = min(abs(rate) for rate in found if rate)
        assert float(abs(slow / sorted(map(abs, exact))[1] - 1)) < 1e-27 + 1e-30 / drag


@pytest.mark.parametrize("damping", [PROPORTIONAL, COUPLED], ids=["proportional", "coupled"])
@pytest.mark.parametrize("soft", [0.0, *SOFT])
def test_a_soft_spring_stores_the_energy_that_stretches_it(soft: float, damping: Damping) -> None:
    basis = soft_chain(soft, damping)._structure.free
    found = basis.energies(basis.coordinates(np.ones(3), np.zeros(3)))
    # The other springs, stretched by rounding, store 1e-32.
    assert found == pytest.approx(0.5 * soft, rel=1e-11, abs=1e-31)
