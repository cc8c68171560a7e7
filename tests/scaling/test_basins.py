"""Basins of attraction, where they are known."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit import Basins, PoincareMap, Stroboscope, basins
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.labels.label import OrbitKind
from dynkit.systems import Duffing, Henon, ImpactChain, Logistic, PlayOscillator, SymbolicMap
from tests.scaling.cases import SHORT, STARTS, attracted, bits

BRIEF: dict[str, Any] = {"transient": 40, "keep": 20, "progress": False}


def square(low: float, high: float, count: int) -> Array:
    return np.stack(np.meshgrid(*2 * [np.linspace(low, high, count)], indexing="ij"), axis=-1)


def same_partition(numbers: Any, expected: Any) -> bool:
    """Whether starts are together in the one exactly when they are in the other."""
    pairs = set(zip(numbers.ravel().tolist(), expected.ravel().tolist(), strict=True))
    return len(pairs) == len(np.unique(numbers)) == len(np.unique(expected))


@dataclass(frozen=True)
class CubeRoots(Map):
    """Newton's method for z^3 = 1: three superstable fixed points, a fractal between them."""

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        z = complex(*finite_array("state", state, (2,)))
        if z == 0.0:
            raise Refused("state must not be zero; got 0")
        z = (2.0 * z + 1.0 / z**2) / 3.0
        return np.array([z.real, z.imag])

    def jacobian(self, state: Array) -> Array:
        z = complex(*finite_array("state", state, (2,)))
        d = (2.0 - 2.0 / z**3) / 3.0
        return np.array([[d.real, -d.imag], [d.imag, d.real]])


def test_newtons_method_comes_to_the_root_that_plain_iteration_comes_to() -> None:
    starts = square(-1.5, 1.5, 14)
    found = basins(CubeRoots(), starts, **BRIEF)
    z = starts[..., 0] + 1j * starts[..., 1]
    for _ in range(100):
        z = (2.0 * z + 1.0 / z**2) / 3.0
    roots = np.exp(2j * np.pi * np.arange(3) / 3.0)
    expected = abs(z[..., None] - roots).argmin(axis=-1)
    assert len(found) == 3
    assert same_partition(found.numbers, expected)
    for basin in found.basins:
        i = expected[basin.start]
        assert abs(complex(*basin.states[0]) - roots[i]) < 1e-14


def test_basins_of_a_symmetric_map_are_images_of_one_another() -> None:
    found = basins(CubeRoots(), square(-1.5, 1.5, 14), **BRIEF)
    mirrored = found.numbers[:, ::-1]  # the conjugate
    assert same_partition(found.numbers, mirrored)
    real = next(b for b in found.basins if abs(b.states[0, 1]) < 1e-9)
    assert np.array_equal(found.numbers == real.number, mirrored == real.number)


@dataclass(frozen=True)
class TwoWells(Map):
    """x' = 3 x / 2 - x^3 / 2: stable at 1 and -1, and 0 between them; beyond sqrt 5 it runs away.

    The basin of 1 on the line is all x in (0, sqrt 3), (-2, -sqrt 3), and more of them beyond.
    """

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return 1.5 * x - 0.5 * x**3

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[1.5 - 1.5 * x * x]])


def test_boundaries_of_a_map_of_the_line_are_where_they_are_known() -> None:
    tiny, root = 1e-6, np.sqrt(3.0)
    x = np.array([tiny, 1.0, root - tiny, root + tiny, 2.0 - tiny, np.sqrt(5.0) + tiny])
    starts = np.concatenate([x, -x])[:, None]
    found = basins(TwoWells(), starts, **{**BRIEF, "transient": 200})
    (one,) = (b.number for b in found.basins if b.states[0, 0] > 0.0)
    (other,) = (b.number for b in found.basins if b.states[0, 0] < 0.0)
    right = [one, one, one, other, other, -2]
    assert found.numbers.tolist() == right + [{one: other, other: one, -2: -2}[n] for n in right]


def test_wells_of_duffings_oscillator_are_those_of_its_motion() -> None:
    """Without a force; against the sign of x where the energy is too low to cross x = 0."""
    duffing = PoincareMap(Duffing(force=0.0, damping=0.5), Stroboscope(3), time_limit=10.0)
    starts = square(-1.4, 1.4, 4)[[0, 3]]
    found = basins(duffing, starts, transient=12, keep=12, progress=False)
    state = starts.reshape(-1, 2)
    for _ in range(14):
        state = np.array([duffing(row) for row in state])
    assert len(found) == 2
    assert same_partition(found.numbers, (state[:, 0] > 0.0).reshape(2, 4))
    assert same_partition(found.numbers, found.numbers[::-1, ::-1])
    for basin in found.basins:
        assert abs(abs(basin.states[0, 0]) - 1.0) < 1e-7


def test_two_orbits_of_one_label_are_two_attractors() -> None:
    """Of the chain at 0.80 a sweep finds one of two stable P(2,3)."""
    chain = ImpactChain(frequency=0.8)
    state = chain.state()
    starts = np.tile([*state.position, *state.velocity, 0.0], (6, 1))
    starts[:, -1] = np.arange(6)
    found = basins(chain, starts, progress=False)
    orbits = [b for b in found.basins if str(b.label) == "P(2,3)"]
    assert len(orbits) == 2
    a, b = (orbit.states for orbit in orbits)
    assert abs(chain.difference(a[:, None], b)).max(axis=-1).min() > 1e-3
    stable = chain.periodic_orbits(impacts=2, periods=3)
    for orbit in orbits:
        gaps = [
            abs(chain.difference(known.states[:, None], orbit.states)).max(axis=-1).min()
            for known in stable
            if known.stable and known.admissible
        ]
        assert min(gaps) < 1e-9


def test_one_orbit_is_one_attractor_wherever_it_is_arrived_at() -> None:
    """P(4), from starts that arrive at all four of its states."""
    found = basins(Logistic(rate=3.5), np.linspace(0.01, 0.98, 30)[:, None], **BRIEF)
    assert [(str(b.label), b.count) for b in found.basins] == [("P(4)", 30)]
    finals = {round(float(found.attractor(i).states[-1, 0]), 6) for i in range(30)}
    assert len(finals) == 4


def test_mirror_images_of_an_oscillator_with_two_stops_are_two_attractors() -> None:
    """-x half a period later is a motion too; here the P(2,1) is no image of itself."""
    play = PlayOscillator(
        frequency=1.38, play=1.0, spring=1.0, damping=0.1, force=1.0, amplitude=0.0, restitution=0.7
    )
    starts = np.array([[x, 0.2, phase] for x in (-0.4, 0.3) for phase in (0.5, 2.5, 4.5)])
    mirrored = starts * [-1.0, -1.0, 1.0] + [0.0, 0.0, np.pi]
    found = basins(play, np.stack([starts, mirrored]), progress=False)
    assert [str(b.label) for b in found.basins] == ["P(2,1)", "P(2,1)"]
    assert found.numbers[0].tolist() == (1 - found.numbers[1]).tolist()


def test_a_chaotic_attractor_is_one() -> None:
    found = basins(Henon(), square(-0.2, 0.2, 3), **BRIEF)
    assert [(str(b.label), b.count) for b in found.basins] == [("chaotic", 9)]


@pytest.mark.parametrize("rate", [3.6, 3.68, 3.8283])
def test_chaos_in_bands_and_intermittent_chaos_are_one_attractor(rate: float) -> None:
    # A quadratic map has one attractor. At 3.8283 motions are near a ghost of an orbit of period 3
    # for a hundred iterates and more (Pomeau and Manneville, Commun. Math. Phys. 74 (1980) 189).
    starts = np.random.default_rng(7).random((300, 1))
    found = basins(Logistic(rate=rate), starts, progress=False)
    assert [basin.count for basin in found.basins] == [300]


@dataclass(frozen=True)
class TwoBands(Map):
    """Two copies of the logistic map at rate 4, on [0, 1] and on [-1, 0]."""

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return np.sign(x) * 3.9 * abs(x) * (1.0 - abs(x))

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[3.9 * (1.0 - 2.0 * abs(x))]])


def test_two_chaotic_attractors_are_two() -> None:
    starts = np.array([0.1, -0.2, 0.3, -0.4, 0.6, -0.7])[:, None]
    found = basins(TwoBands(), starts, **BRIEF)
    assert found.numbers.tolist() == [0, 1, 0, 1, 0, 1]


class Cubic(SymbolicMap):
    """x' = a x - x^3: odd; to a = 3 sqrt(3)/2 the attractors of x > 0 and x < 0 are two."""

    a: float

    def next_state(self, x: Any) -> tuple[Any, ...]:
        return (self.a * x - x**3,)


def test_chaos_in_bands_and_its_mirror_image_are_two() -> None:
    starts = np.linspace(-1.5, 1.5, 200)[:, None] + 1e-3
    found = basins(Cubic(a=2.45), starts, progress=False)
    assert [basin.count for basin in found.basins] == [100, 100]


def test_chaos_that_dies_out_is_what_it_comes_to() -> None:
    """Henon's map at 1.3 has chaos for hundreds of iterates, and a stable P(7)."""
    found = basins(Henon(a=1.3), square(-0.7, 0.3, 5), transient=0, keep=30, progress=False)
    assert {str(b.label) for b in found.basins} == {"P(7)"}


def test_what_runs_away_is_told() -> None:
    found = attracted()
    x, y = STARTS[..., 0], STARTS[..., 1]
    for _ in range(40):
        x, y = np.clip(1.0 - x * x + y, -1e9, 1e9), 0.3 * x
    assert (found.numbers == -2).tolist() == (abs(x) > 10.0).tolist()
    place = tuple(np.argwhere(found.numbers == -2)[0].tolist())
    assert found.outcome(*place) == "runs away"


def test_starts_beyond_the_table_are_no_states() -> None:
    chain = ImpactChain(masses=1, frequency=1.0, offset=0.2)
    found = basins(chain, [[0.1, 0.0, 0.0], [0.5, 0.0, 0.0]], progress=False)
    assert found.numbers.tolist() == [-4, 0]
    assert found.outcome(0) == "no state of the system"


def test_motions_that_rest_are_told_by_their_ends() -> None:
    chain = ImpactChain(masses=1, frequency=1.0, offset=-2.0)
    found = basins(chain, [[0.1, 0.0, 0.0], [-0.5, 0.1, 0.0]], **BRIEF)
    (basin,) = found.basins
    assert basin.label.kind is OrbitKind.NO_IMPACTS
    assert basin.ending == "no mass can reach a stop any more"
    assert basin.count == 2


def test_fractions_of_random_starts_have_binomial_errors() -> None:
    starts = np.random.default_rng(1).uniform(-1.0, 1.0, (200, 1))
    found = basins(TwoWells(), starts, **BRIEF)
    for basin in found.basins:
        sign = np.sign(basin.states[0, 0])
        assert basin.fraction == float((np.sign(starts[:, 0]) == sign).mean())
        assert basin.error == pytest.approx(
            np.sqrt(basin.fraction * (1.0 - basin.fraction) / 200), rel=1e-12
        )
        assert abs(basin.fraction - 0.5) < 4.0 * basin.error
    assert found.error.tolist() == [basin.error for basin in found.basins]


def test_attractors_are_numbered_in_the_order_of_the_starts() -> None:
    starts = np.array([[-0.5], [0.5], [3.0], [0.7], [-0.2]])
    assert basins(TwoWells(), starts, **BRIEF).numbers.tolist() == [0, 1, -2, 1, 0]
    assert basins(TwoWells(), starts[::-1], **BRIEF).numbers.tolist() == [0, 1, -2, 1, 0]


def test_the_same_call_resumes_a_store(tmp_path: Path) -> None:
    first = attracted(store=tmp_path / "x.h5")
    lost = ThreadPoolExecutor(1)
    lost.shutdown()
    assert bits(attracted(lost, store=tmp_path / "x.h5")) == bits(first)
    with pytest.raises(ValueError, match=r"was made with starts\[0, 0\] -2\.0; got 2\.0"):
        basins(Henon(a=1.0), STARTS[::-1], **SHORT, store=tmp_path / "x.h5")


def test_starts_of_which_none_is_a_state_are_refused() -> None:
    chain = ImpactChain(masses=1, frequency=1.0, offset=0.2)
    with pytest.raises(ValueError, match="starts must hold a state of the system; got none"):
        basins(chain, [[0.1, 0.0, 0.0]], progress=False)


@pytest.fixture(scope="module")
def known() -> Basins:
    return attracted()


@pytest.mark.parametrize("place", [(0,), (0, 6), (-1, 0), (0, 0, 0)])
def test_a_place_beyond_the_starts_is_refused(known: Basins, place: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"place(\[\d\])? must "):
        known.outcome(*place)
