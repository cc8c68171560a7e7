import subprocess
import sys

import pytest

from dynkit import sweep
from dynkit.systems import Logistic
from tests.sweeps.cases import (
    RATES,
    START,
    Counted,
    sweep_rates,
)


def test_progress_shows_parameter_and_label(capsys: pytest.CaptureFixture[str]) -> None:
    sweep_rates(progress=True, keep=64)
    shown = capsys.readouterr()
    assert "40/40" in shown.err
    assert "rate 3.9: ..." in shown.err
    assert shown.out == ""


def test_progress_tells_the_label_of_a_period(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sweep(Logistic(3.0), "rate", [3.2], start=START, transient=200, keep=50)
    assert "rate 3.2: P(2)" in capsys.readouterr().err


def test_progress_simulates_nothing_for_labels() -> None:
    sweep_rates(progress=True)
    assert Counted.calls == len(RATES) * 69


def test_without_progress_a_sweep_is_silent(capfd: pytest.CaptureFixture[str]) -> None:
    sweep_rates()
    assert capfd.readouterr() == ("", "")


def test_libraries_are_imported_only_when_used() -> None:
    code = """
import sys
from dynkit import sweep
from dynkit.systems import Logistic
sweep(Logistic(3.0), "rate", [3.2], start=[0.3], progress=False)
print(sorted({"h5py", "tqdm"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
