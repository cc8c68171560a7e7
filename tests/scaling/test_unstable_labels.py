"""Planes of two parameters and basins name the unstable orbits that their states lie on."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes

from dynkit import Basins, ParameterMap, basins, parameter_map
from dynkit.data import store
from tests.example_systems import Cubic, Ricker

BRIEF: dict[str, Any] = {"transient": 40, "keep": 20, "progress": False}

GROWTH = np.linspace(1.5, 2.45, 20)


def plane(**more: Any) -> ParameterMap:
    """The start lies on the fixed point where the capacity is 1, and only there."""
    values: dict[str, Any] = {"growth": GROWTH, "capacity": [1.0, 1.25]}
    return parameter_map(
        Ricker(2.0, 1.0), values, start=[1.0], **{**BRIEF, "transient": 400}, **more
    )


def attracted(**more: Any) -> Basins:
    """Starts on zero, which is a saddle, beside it, and far from it."""
    starts = np.array([(x, 0.0) for x in (-0.5, -1e-12, 0.0, 1e-12, 0.5)])
    return basins(Cubic(0.85, 0.2), starts, **BRIEF, **more)


def texts(axes: Axes) -> set[str]:
    figure = axes.figure
    assert figure is not None
    return {text.get_text() for text in figure.findobj(mpl.text.Text)}


def test_a_plane_names_the_unstable_orbit_that_its_start_lies_on() -> None:
    found = plane()
    known = abs(GROWTH - 2.0) > 0.01
    on, beside = found.names[known].T
    doubled = GROWTH[known] > 2.0
    assert on.tolist() == ["P(1) unstable" if after else "P(1)" for after in doubled]
    assert beside.tolist() == ["P(2)" if after else "P(1)" for after in doubled]
    for i in np.flatnonzero(known).tolist():
        label = found.label(i, 0)
        assert label.multiplier == pytest.approx(abs(1.0 - GROWTH[i]), rel=1e-12)
        assert label.stable is bool(GROWTH[i] < 2.0)
        assert str(found.attractor(i, 0).label) == str(label)
    # 2.05 to 2.45 in steps of 0.05
    assert "P(1) unstable 9" in repr(found)
    assert "P(1) unstable" in found._repr_html_()
    assert "P(1) unstable" in texts(found.plot())
    assert "P(1) unstable" in found.to_xarray()["label"].values


@pytest.mark.parametrize("seed", range(20))
def test_every_pair_of_a_symmetric_map_on_zero_has_the_stability_of_zero(seed: int) -> None:
    random = np.random.default_rng(seed)
    values = {"a": random.uniform(-1.3, 1.3, 4), "b": random.uniform(-0.4, 0.4, 3)}
    found = parameter_map(Cubic(0.5, 0.1), values, start=[0.0, 0.0], **BRIEF)
    for i, a in enumerate(values["a"]):
        for j, b in enumerate(values["b"]):
            # the larger root of z^2 = a z + b
            largest = float(abs(np.roots([1.0, -a, -b])).max())
            assert found.names[i, j] == ("P(1) unstable" if largest > 1.0 else "P(1)")
            assert found.label(i, j).multiplier == pytest.approx(largest, rel=1e-9)


def test_basins_name_the_unstable_orbit_that_a_start_lies_on() -> None:
    found = attracted()
    assert [str(basin.label) for basin in found.basins] == ["P(1)", "P(1) unstable", "P(1)"]
    # what starts beside zero leaves it, if slowly: by 1.04 in each iterate
    assert found.numbers.tolist() == [0, 0, 1, 2, 2]
    place = np.sqrt(0.85 + 0.2 - 1.0)
    ends = [basin.states[0, 0] for basin in found.basins]
    assert np.allclose(ends, [-place, 0.0, place], rtol=0.0, atol=1e-8)
    assert found.basins[1].label.stable is False
    assert found.outcome(2) == "P(1) unstable"
    for number in range(5):
        assert str(found.attractor(number).label) == found.outcome(number)
    assert "P(1) unstable 1" in repr(found)
    assert "P(1) unstable" in found._repr_html_()
    assert "1: P(1) unstable" in texts(found.plot())


@pytest.mark.parametrize("seed", range(20))
def test_no_basin_of_a_stable_orbit_has_the_label_of_an_unstable_one(seed: int) -> None:
    random = np.random.default_rng(seed)
    b = float(random.uniform(-0.3, 0.3))
    system = Cubic(1.0 - b + float(random.uniform(0.01, 0.3)), b)
    near = 10.0 ** random.uniform(-14.0, -6.0, 4) * random.choice([-1.0, 1.0], 4)
    found = basins(system, [(x, 0.0) for x in (0.0, *near)], **BRIEF)
    assert found.outcome(0) == "P(1) unstable"
    assert not any("unstable" in found.outcome(place) for place in range(1, 5))
    assert (abs(found.basins[0].states) == 0.0).all()
    for basin in found.basins[1:]:
        assert abs(basin.states).min() > 0.01


def test_the_stability_of_labels_survives_a_store(tmp_path: Path) -> None:
    made, file = plane(store=tmp_path / "plane.h5"), tmp_path / "plane.h5"
    again, loaded = plane(store=file), ParameterMap.load(file)
    for i, j in np.ndindex(made.names.shape):
        for other in (again, loaded):
            assert other.names[i, j] == made.names[i, j]
            one, two = made.label(i, j), other.label(i, j)
            assert np.array_equal(
                (one.multiplier, one.multiplier_error),
                (two.multiplier, two.multiplier_error),
                equal_nan=True,
            )
    first = attracted(store=tmp_path / "basins.h5")
    second = attracted(store=tmp_path / "basins.h5")
    assert [repr(basin) for basin in first.basins] == [repr(basin) for basin in second.basins]
    assert [b.label.multiplier for b in first.basins] == [b.label.multiplier for b in second.basins]


def test_a_store_without_multipliers_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "plane.h5"
    plane(store=file)
    archive = store.read(file)
    archive.arrays["found/sizes"] = archive.arrays["found/sizes"][:, :3]  # type: ignore[index]
    store.write(file, replace(archive))
    with pytest.raises(ValueError, match=r"all of a map of two parameters.*sizes is float64"):
        ParameterMap.load(file)
