import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.structure.chain import Chain

SIZES = st.floats(1e-12, 1e12)
LINKS = st.just(0.0) | SIZES


def assembled(strengths: tuple[float, ...]) -> Array:
    """The tridiagonal matrix of a chain of springs or dashpots."""
    k = np.array(strengths)
    following = np.append(k[1:], 0.0)
    return np.diag(k + following) - np.diag(k[1:], 1) - np.diag(k[1:], -1)


@given(st.integers(1, 6).flatmap(lambda n: st.tuples(*[st.tuples(SIZES, LINKS, LINKS)] * n)))
def test_matrices_are_bit_for_bit_those_assembled_directly(
    elements: tuple[tuple[float, float, float], ...],
) -> None:
    masses, springs, dashpots = zip(*elements, strict=True)
    chain = Chain(masses, springs, dashpots)
    assert np.array_equal(chain.mass, np.diag(masses))
    assert np.array_equal(chain.stiffness, assembled(springs))
    assert np.array_equal(chain.damping_matrix, assembled(dashpots))


class ByEnergies(ImpactChain):
    """Its matrices are read from its energies, as one of these is overridden."""

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return super().kinetic(v)


@given(
    st.integers(1, 5).flatmap(lambda n: st.tuples(*[st.tuples(SIZES, LINKS, LINKS)] * n)),
    st.none() | LINKS,
)
def test_matrices_are_to_the_last_digit_those_of_the_energies(
    elements: tuple[tuple[float, float, float], ...], ratio: float | None
) -> None:
    masses, springs, dashpots = zip(*elements, strict=True)
    own: Any = {"damping": dashpots if ratio is None else ratio}
    made = (
        kind(masses=masses, springs=springs, frequency=1.0, **own)
        for kind in (ImpactChain, ByEnergies)
    )
    for one, other in zip(*(chain._matrices() for chain in made), strict=True):
        assert one.dense.tobytes() == other.dense.tobytes()
        assert one.low.tobytes() == other.low.tobytes()


class WithOneMore(ImpactChain):
    """A chain with one mass more than it is given."""

    @property
    def degrees_of_freedom(self) -> int:
        assert isinstance(self.masses, int)
        return self.masses + 1


def test_a_count_of_masses_is_that_of_the_coordinates() -> None:
    found, known = WithOneMore(masses=2, frequency=1.0), ImpactChain(masses=3, frequency=1.0)
    assert np.array_equal(found.mass, known.mass)
    assert np.array_equal(found.stiffness, known.stiffness)


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        (ImpactChain, {"masses": 2, "springs": 1.25}),
        (
            MatrixOscillator,
            {"M": np.eye(2), "C": np.zeros((2, 2)), "K": [[2.5, -1.25], [-1.25, 1.25]]},
        ),
    ],
)
def test_an_energy_that_is_replaced_in_its_class_has_effect(
    kind: Any, arguments: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = kind.potential
    monkeypatch.setattr(kind, "potential", lambda self, x: 2 * plain(self, x))
    assert np.array_equal(kind(**arguments, frequency=1.0).stiffness, [[5.0, -2.5], [-2.5, 2.5]])


def test_a_chain_needs_no_computer_algebra() -> None:
    code = (
        "import sys; from dynkit.systems import ImpactChain;"
        "print(ImpactChain(masses=3, frequency=0.9).periodic_orbit().label);"
        "assert 'sympy' not in sys.modules"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "P(1,1)\n"


def test_a_sum_beyond_the_range_of_floats_is_refused_by_its_energy() -> None:
    for structure in (Chain(2, 1e308), ImpactChain(masses=2, springs=1e308, frequency=1.0)):
        with pytest.raises(
            ValueError, match="potential must be a quadratic form in x_1, x_2; a co"
        ):
            _ = structure.stiffness


@pytest.mark.parametrize("size", [1, 2, 10, 1000])
def test_the_uniform_chain_has_the_paper_matrix(size: int) -> None:
    chain = Chain(size, dashpots=0.1)
    assert np.array_equal(chain.stiffness, assembled((1.0,) * size))
    assert np.array_equal(chain.damping_matrix, 0.1 * assembled((1.0,) * size))


def test_a_count_means_unit_masses() -> None:
    assert Chain(3) == Chain([1.0, 1.0, 1.0], [1.0] * 3, 0)


def test_chains_are_hashable() -> None:
    assert len({Chain(3), Chain(3, 1.0), Chain(4)}) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"masses": 0}, "masses must be a positive integer; got 0"),
        ({"masses": 10.0}, r"masses must be a positive integer; got 10\.0"),
        ({"masses": True}, "masses must be a positive integer; got True"),
        ({"masses": []}, "masses must hold at least one number; got none"),
        ({"masses": [1.0, 0.0]}, r"masses\[1\] must be positive; got 0\.0"),
        ({"masses": [1.0, float("nan")]}, r"masses\[1\] must be a finite number; got nan"),
        ({"masses": "ten"}, "masses must be"),
        ({"masses": None}, "masses must be"),
        ({"masses": [[1.0]]}, r"masses must have 1 dimension; got shape \(1, 1\)"),
        ({"masses": 2, "springs": -1}, r"springs must not be negative; got -1\.0"),
        ({"masses": 2, "springs": [1, 1, 1]}, r"springs must have shape \(2,\)"),
        ({"masses": 2, "springs": float("inf")}, "springs must be a finite number; got inf"),
        ({"masses": 2, "dashpots": [0, -0.1]}, r"dashpots\[1\] must not be negative; got -0\.1"),
        ({"masses": 2, "dashpots": "0.1"}, "dashpots must be"),
        ({"masses": 2, "dashpots": True}, "dashpots must be an array of real numbers; got True"),
    ],
)
def test_impossible_chains_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Chain(**arguments)
