"""Data of modes to the last digits where their computation cancels."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import ImpactChain, Jenkins, MatrixOscillator, SoftStop

ULP = 2.0**-52


def random_matrices(seed: int, n: int) -> tuple[Array, Array, Array]:
    """Mass, damping and stiffness; the damping couples modes, and one spring is soft."""
    random = np.random.default_rng(seed)
    factors = random.normal(size=(2, n, n)) / n**0.5
    soft = np.linalg.qr(random.normal(size=(n, n)))[0][:, 0]
    along = np.eye(n) - np.outer(soft, soft)
    stiffness = along @ (np.eye(n) + factors[0] @ factors[0].T) @ along + 1e-4 * np.outer(
        soft, soft
    )
    damping = 1e-3 * factors[1] @ factors[1].T
    return np.diag(random.uniform(0.5, 2.0, n)), *(0.5 * (p + p.T) for p in (damping, stiffness))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("off", [2e-3, 1e-2])
@pytest.mark.parametrize("coupled", [False, True])
def test_steady_responses_near_resonance_keep_their_digits(
    seed: int, off: float, coupled: bool
) -> None:
    m, c, k = random_matrices(seed, 3)
    if not coupled:
        c = 1e-3 * k
    random = np.random.default_rng(seed)
    forces = random.normal(size=3) + 1j * random.normal(size=3)
    free = MatrixOscillator(M=m, C=c, K=k, frequency=1.0)
    w = float(free.natural_frequencies[-1] * (1.0 + off))
    system = free.replace(frequency=w, harmonic_forces=tuple(forces.tolist()))
    with mp.workdps(50):
        dynamic = mp.matrix(k.tolist()) + 1j * mp.mpf(w) * mp.matrix(c.tolist())
        dynamic -= mp.mpf(w) ** 2 * mp.matrix(m.tolist())
        exact = mp.lu_solve(dynamic, mp.matrix(forces.tolist()))
        found = system._free.forced.shape
        apart = max(abs(found[i] - complex(exact[i])) for i in range(3))
        assert apart < 16.0 * ULP * max(abs(complex(x)) for x in exact)


@pytest.mark.parametrize("seed", range(6))
def test_what_follows_a_slider_statically_does_so_in_soft_structures(seed: int) -> None:
    m, c, k = random_matrices(seed, 4)
    joint = Jenkins((0.3, -1.1, 0.7, 0.2), stiffness=3.7, force=0.3)
    system = MatrixOscillator(M=m, C=c, K=k, frequency=1.0, elements=[joint])
    row = joint.row(4)
    # where the slider is at one: (K + k row row') x = k row
    exact_row = [Fraction(x) for x in row.tolist()]
    with mp.workdps(50):
        stiff = mp.matrix(k.tolist())
        for i in range(4):
            for j in range(4):
                stiff[i, j] += mp.mpf(joint.stiffness) * mp.mpf(row[i]) * mp.mpf(row[j])
        pull = mp.matrix([mp.mpf(joint.stiffness) * x.numerator / x.denominator for x in exact_row])
        exact = np.array([float(x) for x in mp.lu_solve(stiff, pull)])
    found = system._free.forced.basis._by_place[:4, 0]
    assert abs(found - exact).max() < 4.0 * ULP * abs(exact).max()


def test_springs_of_elements_are_added_without_rounding() -> None:
    row = np.array([0.3, -1.1, 0.7])
    stop = SoftStop(tuple(row.tolist()), offset=-1.0, stiffness=9.43, damping=1.3)
    chain = ImpactChain(masses=3, frequency=1.0, elements=[stop])
    pressed = chain._automaton.mode((1,)).structure._given
    springs = pressed.stiffness, chain.stiffness, 9.43
    for part, own, factor in (springs, (pressed.damping, chain.damping_matrix, 1.3)):
        for i, j, high, low in zip(part.rows, part.columns, part.high, part.low, strict=True):
            exact = Fraction(factor) * Fraction(float(row[i])) * Fraction(float(row[j]))
            exact += Fraction(float(own[i, j]))
            assert abs(Fraction(float(high)) + Fraction(float(low)) - exact) < abs(exact) * ULP**1.9
