import numpy as np

from dynkit import sweep
from dynkit.systems import Henon
from tests.sweeps.cases import (
    CHAIN,
    FREQUENCIES,
    RATES,
    SHORT,
    Counted,
    sweep_rates,
)


def test_each_value_starts_from_the_last_state_before() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES, **SHORT)
    start = None
    for row, frequency in zip(found.observable("relative_velocity"), FREQUENCIES, strict=True):
        chain = CHAIN.replace(frequency=float(frequency))
        attractor = chain.attractor(transient=30, impacts=20, start=start)
        start = attractor.final
        assert row.tobytes() == attractor.record.relative_velocity.tobytes()


def test_a_map_follows_from_its_start() -> None:
    found = sweep(Henon(), "a", [1.2, 1.3], transient=3, keep=4, start=[0.1, 0.2], progress=False)
    last = Henon(a=1.2).iterate(np.array([0.1, 0.2]), 6)
    expected = Henon(a=1.3).iterate(last[-1], 6)[3:]
    assert found.observable("state[0]")[1].tobytes() == expected[:, 0].tobytes()


def test_values_may_go_up_and_down() -> None:
    found = sweep(CHAIN, "frequency", [0.9, 0.7, 0.9], **SHORT)
    assert found.values.tolist() == [0.9, 0.7, 0.9]


def test_a_sweep_starts_where_it_is_told() -> None:
    start = CHAIN.state(position=[0.1, 0.2, 0.9], velocity=[0.0, 0.1, 0.2], phase=0.3)
    found = sweep(CHAIN, "restitution", [0.7], start=start, **SHORT)
    expected = CHAIN.replace(restitution=0.7).attractor(transient=30, impacts=20, start=start)
    row = found.observable("relative_velocity")[0]
    assert row.tobytes() == expected.record.relative_velocity.tobytes()


def test_all_observables_of_impacts_can_be_kept() -> None:
    found = sweep(CHAIN, "frequency", [0.7], observables=CHAIN.observables, **SHORT)
    record = CHAIN.replace(frequency=0.7).attractor(transient=30, impacts=20).record
    for name in ("relative_velocity", "phase", "energy", "time"):
        assert found.observable(name)[0].tobytes() == getattr(record, name).tobytes()


def test_attractors_are_the_ones_that_were_swept() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES, **SHORT)
    for place in (0, 5, 11):
        states = found.attractor(place).states
        assert states[:, -2].tobytes() == found.observable("relative_velocity")[place].tobytes()


def test_labels_are_those_of_the_attractors() -> None:
    found = sweep_rates()
    assert str(found.label(0)) == "P(2)"
    assert found.labels[-1] == found.attractor(len(RATES) - 1).label


def test_labels_are_worked_out_once() -> None:
    found = sweep_rates()
    assert found.labels[0] is found.labels[0]


def test_nothing_is_simulated_for_labels_nobody_asks_for() -> None:
    sweep_rates()
    assert Counted.calls == len(RATES) * 69


def test_errors_are_those_of_the_attractors() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES[:3], **SHORT)
    expected = [found.attractor(place).error for place in range(3)]
    assert found.error.tolist() == expected


def test_costs_add_up() -> None:
    assert sweep_rates().cost.counts == {"iterates": len(RATES) * 69}


def test_what_a_motion_that_ended_has_not_got_is_nan() -> None:
    chain = CHAIN.replace(amplitude=0.02, restitution=0.5)
    found = sweep(chain, "offset", [-0.3, -0.2, 0.0], transient=0, keep=50, progress=False)
    assert found.counts.tolist() == [1, 3, 50]
    missing = np.isnan(found.observable("relative_velocity"))
    assert missing.tolist() == [[j >= n for j in range(50)] for n in found.counts.tolist()]


def test_endings_say_why_a_motion_ended() -> None:
    chain = CHAIN.replace(amplitude=0.0, offset=-2.0)
    found = sweep(chain, "frequency", [0.5, 0.6], **SHORT)
    assert found.endings == ("no mass can reach a stop any more",) * 2
