"""Results as xarray datasets: named dimensions, attributes, and netCDF files that keep them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import dynkit
from dynkit import Branch, basins, sweep
from dynkit.data.dataset import Dataset, Variables
from dynkit.systems import BouncingBall, ImpactChain, Logistic
from tests.project.test_costs_and_errors import RESULTS

CHAIN = ImpactChain(masses=2, frequency=0.9)

MADE: dict[str, Callable[[], Any]] = {
    name: RESULTS[name] for name in ("Basins", "BifurcationCurve", "Branch", "ParameterMap")
}
MADE |= {
    "record": lambda: CHAIN.simulate(impacts=5),
    "contacts": lambda: BouncingBall(amplitude=0.16, frequency=3.0, restitution=0.5).simulate(
        impacts=100
    ),
    "no impacts": lambda: ImpactChain(masses=1, frequency=0.9, offset=-9.0).simulate(impacts=3),
    "sweep": lambda: sweep(CHAIN, "frequency", [0.9, 0.91], transient=9, keep=4, progress=False),
}


@pytest.mark.parametrize("name", MADE)
def test_datasets_carry_what_they_are_and_survive_netcdf(name: str, tmp_path: Path) -> None:
    found = MADE[name]().to_xarray()
    assert found.attrs["dynkit_version"] == dynkit.__version__
    assert found.attrs["cost_seconds"] > 0.0
    assert len(found.attrs["error_meaning"]) > 20
    assert found.attrs["system"].endswith(")")
    found.to_netcdf(tmp_path / "x.nc", engine="scipy")
    with xr.open_dataset(tmp_path / "x.nc", engine="scipy", mmap=False) as loaded:
        xr.testing.assert_equal(loaded.load(), found)
        assert loaded.attrs == found.attrs


def test_a_record_has_impacts_masses_and_contacts() -> None:
    record = MADE["contacts"]()
    found = record.to_xarray()
    assert found.position.dims == ("impact", "mass")
    assert len(record.sticking) > 0
    np.testing.assert_array_equal(found.contact_begin, record.sticking[:, 0])
    np.testing.assert_array_equal(found.time, record.time)
    np.testing.assert_array_equal(found.relative_velocity, record.relative_velocity)
    assert found.attrs["ending"] == record.ending.value
    assert found.attrs["parameter_gravity"] == 1.0


def test_what_must_be_simulated_is_there_once_it_is_known() -> None:
    record, found = MADE["record"](), MADE["sweep"]()
    assert "error" not in record.to_xarray()
    assert not {"error", "label"} & set(found.to_xarray())
    np.testing.assert_array_equal(record.error, record.to_xarray().error)
    assert "largest error" in record.to_xarray().error.attrs["long_name"]
    labels = [str(label) for label in found.labels]
    assert found.to_xarray().label.values.tolist() == labels


def test_a_sweep_is_chosen_from_by_its_parameter() -> None:
    found = MADE["sweep"]().to_xarray()
    assert found.relative_velocity.dims == ("frequency", "state")
    there = found.sel(frequency=0.91).relative_velocity
    np.testing.assert_array_equal(there, MADE["sweep"]().observable("relative_velocity")[1])
    # what was swept is a coordinate, and no attribute of one of its values
    assert "parameter_frequency" not in found.attrs
    assert found.attrs["system"] == "ImpactChain(masses=2)"


def test_a_branch_has_its_multipliers_and_bifurcations(tmp_path: Path) -> None:
    branch = RESULTS["Branch"]()
    found = branch.to_xarray()
    multipliers = found.multiplier_real.values + 1j * found.multiplier_imaginary.values
    np.testing.assert_array_equal(multipliers, branch.multipliers)
    np.testing.assert_array_equal(found.a, branch.parameter)
    np.testing.assert_array_equal(found["state[0]"], branch.observable("state[0]"))
    assert found.bifurcation_kind.values.tolist() == ["PD"]
    branch.save(tmp_path / "x.h5")
    loaded = Branch.load(tmp_path / "x.h5").to_xarray()
    assert "state[0]" not in loaded
    xr.testing.assert_equal(loaded.unknowns, found.unknowns)


def test_a_map_of_two_parameters_is_chosen_from_by_both() -> None:
    result = RESULTS["ParameterMap"]()
    found = result.to_xarray()
    assert found.label.dims == ("a", "b")
    assert found.label.sel(a=0.2, b=0.3).item() == result.names[0, 1]
    assert found.exponent.sel(a=1.2, b=0.0).item() == result.exponents[1, 0]


@pytest.mark.parametrize("shape", [(4,), (2, 2)])
def test_basins_have_the_dimensions_of_their_starts(shape: tuple[int, ...]) -> None:
    starts = np.array([-0.1, 0.3, 0.5, 0.7]).reshape(*shape, 1)
    found = basins(Logistic(rate=3.2), starts, progress=False).to_xarray()
    assert found.number.dims == (("start",) if len(shape) == 1 else ("row", "column"))
    assert found.number.values.ravel().tolist() == [-2, 0, 0, 0]
    assert found.fraction.sel(attractor=0).item() == 0.75
    assert found.attrs["number_-2"] == "runs away"


def test_a_dataset_can_be_written_to_and_the_result_stays() -> None:
    record = MADE["record"]()
    found = record.to_xarray()
    found.phase[0] = -1.0
    assert record.phase[0] >= 0.0


def test_without_xarray_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match="pip install xarray"):
        CHAIN.simulate(impacts=1).to_xarray()


def test_complex_arrays_become_two_and_those_of_nothing_are_left_out() -> None:
    given: Variables = {"z": ("k", [1j]), "own": (("k", "unknown"), np.empty((1, 0)))}
    made = Dataset({}, given, {}).to_xarray()
    assert set(made) == {"z_real", "z_imaginary"}
    assert (made.z_real.item(), made.z_imaginary.item()) == (0.0, 1.0)
