import pickle
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
import sympy

from dynkit.systems.structure import lagrangian
from dynkit.systems.structure.chain import Chain
from dynkit.systems.structure.lagrangian import LagrangianStructure
from dynkit.systems.structure.modes import Modes


@dataclass(frozen=True)
class TaperedChain(LagrangianStructure):
    """Masses and springs that shrink by a factor from one to the next."""

    size: int
    taper: float
    colour: str = "grey"
    structure_independent: ClassVar[frozenset[str]] = frozenset({"colour"})

    @property
    def degrees_of_freedom(self) -> int:
        return self.size

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return sympy.Add(*(self.taper**i * v[i] ** 2 / 2 for i in range(self.size)))

    def potential(self, x: tuple[Any, ...]) -> Any:
        before = (0, *x[:-1])
        return sympy.Add(*(self.taper**i * (x[i] - before[i]) ** 2 / 2 for i in range(self.size)))

    def dissipation(self, v: tuple[Any, ...]) -> Any:
        return 0.1 * self.potential(v)


class Branching(LagrangianStructure):
    """A trunk on the ground with two equal branches."""

    @property
    def degrees_of_freedom(self) -> int:
        return 3

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return v[0] ** 2 + (v[1] ** 2 + v[2] ** 2) / 2

    def potential(self, x: tuple[Any, ...]) -> Any:
        trunk, left, right = x
        return 2 * trunk**2 + 0.3 * ((left - trunk) ** 2 + (right - trunk) ** 2) / 2


class GroundedPair(LagrangianStructure):
    """Two masses on a light bar: ground springs at the first one and half way between."""

    @property
    def degrees_of_freedom(self) -> int:
        return 2

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return (v[0] ** 2 + 3 * v[1] ** 2) / 2

    def potential(self, x: tuple[Any, ...]) -> Any:
        return 5 * x[0] ** 2 / 2 + 7 * ((x[0] + x[1]) / 2) ** 2 / 2

    def dissipation(self, v: tuple[Any, ...]) -> Any:
        return (v[1] - v[0]) ** 2 / 8


class Pendulum(LagrangianStructure):
    """A cart with a pendulum: coupled velocities."""

    @property
    def degrees_of_freedom(self) -> int:
        return 2

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return v[0] ** 2 / 2 + (v[0] + v[1]) ** 2 / 2

    def potential(self, x: tuple[Any, ...]) -> Any:
        return x[0] ** 2 / 2 + x[1] ** 2


class Bad(LagrangianStructure):
    """Two masses with energies of the test's choice."""

    @property
    def degrees_of_freedom(self) -> int:
        return 2

    def __init__(self, kinetic: Any = None, potential: Any = None, dissipation: Any = None) -> None:
        self.energies = kinetic, potential, dissipation

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return self.energies[0](*v) if self.energies[0] else v[0] ** 2 + v[1] ** 2

    def potential(self, x: tuple[Any, ...]) -> Any:
        return self.energies[1](*x) if self.energies[1] else x[0] ** 2

    def dissipation(self, v: tuple[Any, ...]) -> Any:
        return self.energies[2](*v) if self.energies[2] else 0


def test_a_tapered_chain_has_the_matrices_written_by_hand() -> None:
    chain = TaperedChain(3, 0.5)
    assert chain.mass.tolist() == np.diag([1.0, 0.5, 0.25]).tolist()
    assert chain.stiffness.tolist() == [[1.5, -0.5, 0.0], [-0.5, 0.75, -0.25], [0.0, -0.25, 0.25]]


def test_damping_comes_from_the_dissipation_function() -> None:
    chain = TaperedChain(3, 0.5)
    assert np.allclose(chain.damping_matrix, 0.1 * chain.stiffness, rtol=1e-15, atol=0.0)


def test_a_branching_structure_has_the_matrices_written_by_hand() -> None:
    structure = Branching()
    assert structure.mass.tolist() == np.diag([2.0, 1.0, 1.0]).tolist()
    assert structure.stiffness.tolist() == [[4.6, -0.3, -0.3], [-0.3, 0.3, 0.0], [-0.3, 0.0, 0.3]]


def test_there_is_no_damping_by_default() -> None:
    assert not Branching().damping_matrix.any()


def test_a_ground_spring_in_between_gives_the_matrices_written_by_hand() -> None:
    structure = GroundedPair()
    assert structure.mass.tolist() == [[1.0, 0.0], [0.0, 3.0]]
    assert structure.stiffness.tolist() == [[6.75, 1.75], [1.75, 1.75]]
    assert structure.damping_matrix.tolist() == [[0.25, -0.25], [-0.25, 0.25]]


def test_coupled_velocities_give_a_full_mass_matrix() -> None:
    structure = Pendulum()
    assert structure.mass.tolist() == [[2.0, 1.0], [1.0, 1.0]]
    # det(K - w^2 M) = w^4 - 5 w^2 + 2
    exact = np.sqrt((5 + np.array([-1, 1]) * np.sqrt(17)) / 2)
    assert np.allclose(structure.modes.frequencies, exact, rtol=4e-16, atol=0.0)


@pytest.mark.parametrize("name", ["mass", "damping_matrix", "stiffness"])
def test_matrices_are_read_only(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(Branching(), name)[0, 0] = 1.0


def test_modes_are_derived_once_for_equal_structures() -> None:
    assert TaperedChain(4, 0.5).modes is TaperedChain(4, 0.5).modes


def test_fields_that_no_energy_uses_do_not_derive_anew() -> None:
    chain = TaperedChain(4, 0.5)
    assert replace(chain, colour="red").modes is chain.modes


def test_other_parameters_have_other_modes() -> None:
    assert TaperedChain(4, 0.5).modes is not TaperedChain(4, 0.25).modes


def test_other_classes_with_equal_fields_have_other_modes() -> None:
    class Stiffer(TaperedChain):
        def potential(self, x: tuple[Any, ...]) -> Any:
            return 2 * super().potential(x)

    factor = Stiffer(4, 0.5).modes.frequencies / TaperedChain(4, 0.5).modes.frequencies
    assert np.allclose(factor, np.sqrt(2.0), rtol=1e-15, atol=0.0)


def test_the_energies_are_asked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    plain = TaperedChain.kinetic

    def counted(self: TaperedChain, v: tuple[Any, ...]) -> Any:
        calls.append(self)
        return plain(self, v)

    monkeypatch.setattr(TaperedChain, "kinetic", counted)
    for _ in range(3):
        chain = TaperedChain(5, 0.5)
        assert chain.mass[4, 4] == chain.modes.matrix[0, 0] * 0 + 0.0625
    assert len(calls) == 1


def test_a_replaced_method_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    before = Branching().mass[0, 0]
    monkeypatch.setattr(Branching, "kinetic", lambda self, v: v[0] ** 2 + v[1] ** 2 + v[2] ** 2 / 2)
    assert (before, Branching().mass[1, 1]) == (2.0, 2.0)


def test_structures_that_hold_objects_are_derived_for_themselves() -> None:
    soft, stiff = (Bad(potential=lambda x, y, k=k: k * (x**2 + y**2)) for k in (1, 2))
    assert (soft.stiffness[0, 0], stiff.stiffness[0, 0]) == (2.0, 4.0)


def test_arrays_among_the_fields_distinguish_structures() -> None:
    class Diagonal(LagrangianStructure):
        @property
        def degrees_of_freedom(self) -> int:
            return 2

        def __init__(self, springs: list[float]) -> None:
            self.springs = np.array(springs)

        def kinetic(self, v: tuple[Any, ...]) -> Any:
            return v[0] ** 2 + v[1] ** 2

        def potential(self, x: tuple[Any, ...]) -> Any:
            return self.springs[0] * x[0] ** 2 / 2 + self.springs[1] * x[1] ** 2 / 2

    assert Diagonal([1.0, 2.0]).modes is Diagonal([1.0, 2.0]).modes
    assert Diagonal([1.0, 3.0]).stiffness[1, 1] == 3.0


def test_old_derivations_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lagrangian, "_MOST_KEPT", 40)
    kept = Chain(6, springs=3.0).modes
    assert Chain(6, springs=3.0).modes is kept
    assert Chain(5, springs=3.0).modes.frequencies.shape == (5,)
    assert Chain(6, springs=3.0).modes is not kept


def test_few_derivations_are_kept_however_small_they_are() -> None:
    kept = Chain(2, springs=3.5).modes
    for k in range(lagrangian._MOST - 1):
        assert Chain(2, springs=4.0 + k).modes.frequencies.shape == (2,)
    assert Chain(2, springs=3.5).modes is kept
    for k in range(lagrangian._MOST):
        assert Chain(2, springs=4.5 + k).modes.frequencies.shape == (2,)
    assert Chain(2, springs=3.5).modes is not kept


def test_pickles_are_small_and_come_back_equal() -> None:
    chain = TaperedChain(50, 0.9)
    assert chain.modes.error < 1e-15
    data = pickle.dumps(chain)
    assert len(data) < 1000
    assert pickle.loads(data).modes is chain.modes


def test_modes_of_the_structure_are_those_of_its_matrices() -> None:
    structure = GroundedPair()
    modes = Modes.from_matrices(structure.mass, structure.damping_matrix, structure.stiffness)
    assert modes.frequencies.tolist() == structure.modes.frequencies.tolist()
    assert modes.matrix.tolist() == structure.modes.matrix.tolist()


@pytest.mark.parametrize(
    ("energies", "message"),
    [
        ({"kinetic": lambda a, b: a**2}, r"the mass matrix of kinetic must be positive definite"),
        ({"kinetic": lambda a, b: (a + b) ** 2}, "got the eigenvalue"),
        ({"kinetic": lambda a, b: a**2 - b**2}, r"definite; got -2\.0 at \[1, 1\]"),
        ({"kinetic": lambda a, b: a**2 + b}, "kinetic must be a quadratic form in v_1, v_2"),
        ({"potential": lambda a, b: a**2 - b**2}, "the stiffness matrix of potential must be"),
        ({"potential": lambda a, b: a * b}, "semidefinite; got the eigenvalue -1"),
        ({"potential": lambda a, b: a**2 - 1e-9 * (a - b) ** 2}, "semidefinite; got -2e-09"),
        ({"potential": lambda a, b: a**4}, "potential must be a quadratic form in x_1, x_2"),
        ({"dissipation": lambda a, b: -(a**2)}, "the damping matrix of dissipation must be"),
        ({"dissipation": lambda a, b: b}, "dissipation must be a quadratic form in v_1, v_2"),
        ({"dissipation": lambda a, b: None if a else b}, "dissipation must return a SymPy"),
    ],
)
def test_impossible_energies_are_refused(energies: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _ = Bad(**energies).mass


@pytest.mark.parametrize("count", [0, -1, 2.0, True, None])
def test_impossible_numbers_of_coordinates_are_refused(count: Any) -> None:
    class Odd(Branching):
        @property
        def degrees_of_freedom(self) -> int:
            number: int = count
            return number

    with pytest.raises(ValueError, match="degrees_of_freedom must be a positive integer"):
        _ = Odd().mass


def test_sympy_and_scipy_are_not_imported_before_they_are_needed() -> None:
    code = (
        "import sys; from dynkit.systems.structure.chain import Chain; Chain(3);"
        "assert not {'sympy', 'scipy', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
