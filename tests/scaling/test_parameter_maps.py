"""Maps of two parameters."""

import re
from pathlib import Path

import numpy as np
import pytest

from dynkit import ParameterMap, Sweep, parameter_map
from dynkit.labels.label import OrbitKind
from dynkit.systems import Henon, ImpactChain, Logistic
from tests.scaling.cases import SHORT, START, VALUES, bits, mapped, swept

CHAIN = ImpactChain(masses=3, frequency=0.9)
PAIRS = {"frequency": [0.5, 0.9, 1.2], "damping": [0.1, 0.3]}


@pytest.fixture(scope="module")
def chain_map() -> ParameterMap:
    return parameter_map(CHAIN, PAIRS, transient=100, keep=60, exponents=40, progress=False)


def test_each_pair_starts_by_itself(chain_map: ParameterMap) -> None:
    for i, frequency in enumerate(PAIRS["frequency"]):
        for j, damping in enumerate(PAIRS["damping"]):
            alone = CHAIN.replace(frequency=frequency, damping=damping)
            attractor = alone.attractor(transient=100, impacts=60)
            assert chain_map.label(i, j) == attractor.label
            assert chain_map.largest()[i, j] == attractor.observable("relative_velocity").max()
            assert chain_map.error[i, j] == attractor.label.error
            assert chain_map.attractor(i, j).states.tobytes() == attractor.states.tobytes()


def test_arrays_tell_what_labels_tell(chain_map: ParameterMap) -> None:
    for i, j in np.ndindex(3, 2):
        label = chain_map.label(i, j)
        assert chain_map.names[i, j] == str(label)
        assert chain_map.iterates[i, j] == (label.iterates or 0)
        assert chain_map.periods[i, j] == (label.periods or 0)
        assert [kind for kind in OrbitKind if chain_map.where(kind)[i, j]] == [label.kind]


def test_labels_count_harmonics_when_they_are_asked(chain_map: ParameterMap) -> None:
    expected = CHAIN.replace(frequency=0.5, damping=0.1).attractor(transient=100, impacts=60)
    assert chain_map.label(0, 0).harmonics == expected.label.harmonics


def test_exponents_are_negative_on_periodic_motions(chain_map: ParameterMap) -> None:
    assert (chain_map.exponents[chain_map.where(OrbitKind.PERIODIC)] < 0.0).all()


def test_the_exponent_of_the_quadratic_map_at_2_is_log_2() -> None:
    found = parameter_map(
        Henon(), {"a": [1.9999999], "b": [0.0]}, start=[0.3, 0.0], exponents=4000, **SHORT
    )
    # with b = 0 it is the quadratic map, conjugate to the logistic one: log 2 at a = 2
    assert found.names[0, 0] == "chaotic"
    assert found.exponents[0, 0] == pytest.approx(np.log(2.0), abs=0.03)


def test_a_pair_whose_motion_runs_away_has_no_motion() -> None:
    found = parameter_map(Henon(), {"a": [1.0, 5.0], "b": [0.3]}, start=START, **SHORT)
    assert found.names[:, 0].tolist() == ["P(4)", "no motion"]
    assert np.isnan(found.error[1, 0])
    assert np.isnan(found.largest()[1, 0])
    ended = "no motion: the motion runs away: state[0] is -inf after 10 iterates"
    assert found.endings[1, 0] == ended
    message = f"i, j must be a pair with a motion; got (1, 0), {ended}"
    with pytest.raises(ValueError, match=re.escape(message)):
        found.label(1, 0)


def test_a_loaded_map_is_the_one_that_was_stored(tmp_path: Path) -> None:
    found = mapped(store=tmp_path / "x.h5")
    loaded = ParameterMap.load(tmp_path / "x.h5", Henon())
    assert bits(loaded) == bits(found)
    assert loaded.values["b"].tolist() == VALUES["b"].tolist()
    assert loaded.attractor(1, 2).states.tobytes() == found.attractor(1, 2).states.tobytes()


def test_a_system_without_the_parameters_of_a_store_is_refused(tmp_path: Path) -> None:
    mapped(store=tmp_path / "map.h5")
    swept(store=tmp_path / "sweep.h5")
    for kind, name in ((ParameterMap, "map.h5"), (Sweep, "sweep.h5")):
        with pytest.raises(ValueError, match="with parameter a; got a system without it"):
            kind.load(tmp_path / name, Logistic(3.2))


def test_a_map_loaded_without_its_system_says_so(tmp_path: Path) -> None:
    mapped(store=tmp_path / "x.h5")
    loaded = ParameterMap.load(tmp_path / "x.h5")
    assert str(loaded.label(0, 0)) == loaded.names[0, 0]
    with pytest.raises(ValueError, match="system must be given to load a map"):
        loaded.attractor(0, 0)


@pytest.mark.parametrize(("i", "j"), [(-1, 0), (7, 0), (0, 6)])
def test_a_place_beyond_the_map_is_refused(i: int, j: int) -> None:
    with pytest.raises(ValueError, match="must lie in"):
        mapped().label(i, j)


def test_progress_is_shown_by_points(capsys: pytest.CaptureFixture[str]) -> None:
    mapped(progress=True)
    assert "42/42" in capsys.readouterr().err
