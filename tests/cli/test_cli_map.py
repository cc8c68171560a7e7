"""`dynkit map`."""

import csv
from pathlib import Path

import h5py
import numpy as np
import pytest

from dynkit import parameter_map
from dynkit.cli import main
from dynkit.systems import ImpactChain

AXES = ["--x", "frequency,0.5,0.9,3", "--y", "damping,0.1,0.2,2"]
SMALL = ["map", "--masses", "2", "--keep", "40", "--transient", "60", "--no-progress", *AXES]


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_map_is_that_of_python(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SMALL, "--out", "map.csv"]) == 0
    values = {"frequency": np.linspace(0.5, 0.9, 3), "damping": np.linspace(0.1, 0.2, 2)}
    chain = ImpactChain(masses=2, frequency=0.5)
    expected = parameter_map(chain, values, transient=60, keep=40, progress=False)
    with Path("map.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["label"] for row in rows] == expected.names.ravel().tolist()
    assert [float(row["frequency"]) for row in rows] == np.repeat(values["frequency"], 2).tolist()
    largest = [float(row["largest_relative_velocity"]) for row in rows]
    assert largest == expected.largest().ravel().tolist()
    assert "0.5 to 0.9, 3 values" in capsys.readouterr().out


def test_workers_and_a_store_give_the_same_map() -> None:
    assert main([*SMALL, "--out", "one.h5"]) == 0
    assert main([*SMALL, "--workers", "2", "--store", "store.h5", "--out", "two.h5"]) == 0
    assert main([*SMALL, "--store", "store.h5", "--out", "map.svg"]) == 0
    with h5py.File("one.h5") as one, h5py.File("two.h5") as two:
        assert sorted(one) == sorted(two)
        for name in one:
            assert one[name][()].tolist() == two[name][()].tolist()
