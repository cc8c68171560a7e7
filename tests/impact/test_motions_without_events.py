"""Motions without further events: where springs are not linear they go on as elsewhere."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

from dynkit.systems import DryFriction, Element, HardStop, MatrixOscillator, SoftStop
from tests.impact.disguised import disguised

STOP = HardStop(0, offset=-0.5)
MACHINES: dict[str, tuple[list[Element], dict[str, Any]]] = {
    "a stop that is hit no more": ([STOP], {}),
    "a soft stop that is met no more": ([SoftStop(0, offset=-0.5, stiffness=5.0)], {}),
    "friction that sticks": ([DryFriction(0, force=0.1)], {}),
    "friction that sticks beside a stop": (
        [STOP, DryFriction(0, force=0.5)],
        {"harmonic_forces": [0.3]},
    ),
    "a mass that rests on its stop": ([STOP], {"constant_forces": [-2.0]}),
}


def _records(elements: Sequence[Element], forces: dict[str, Any]) -> Any:
    machine = MatrixOscillator(
        M=[[1.0]], C=[[0.1]], K=[[1.0]], frequency=1.0, elements=elements, **forces
    )
    for system in (machine, disguised(machine)):
        yield system.simulate(impacts=2000, start=system.state([0.6]))


@pytest.mark.parametrize("name", MACHINES)
def test_samples_go_on_after_the_last_event(name: str) -> None:
    linear, curved = _records(*MACHINES[name])
    times = np.linspace(0.0, 500.0, 101)
    for one, other in zip(linear.sample(times), curved.sample(times), strict=True):
        assert abs(one - other).max() < 1e-13


def test_samples_end_where_events_were_not_searched() -> None:
    _, curved = _records(*MACHINES["a stop that is hit no more"])
    end = float(curved.time[-1]) + 2000.0 * np.pi
    assert np.isfinite(curved.sample([end - 1e-9])).all()
    with pytest.raises(ValueError, match=r"times\[0\] must lie in \[0, 628\d\."):
        curved.sample([end + 1.0])


def test_plots_go_on_after_the_last_event() -> None:
    ends = [record.plot().get_xlim()[1] for record in _records(*MACHINES["friction that sticks"])]
    plt.close("all")
    assert ends[0] == ends[1]
