"""What kernels take of a sum: one slot at a time as all of them, another table as a new one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.exponential import propagators
from dynkit.exponential.modes import Pairs
from dynkit.exponential.propagators import Propagators

TABLE = 4


def scene(decay: float, frequency: float = 0.7) -> Pairs:
    """Four oscillators, a table, and the number one."""
    rates, zeros = np.array([0.3, 1.0, 40.0, 1e-5]), np.zeros(4)
    modes, _ = Pairs.oscillators(rates, zeros, decay * rates, zeros)
    return Pairs.join(modes, Pairs.rotation(frequency), Pairs.constant())


def row_of(pairs: Pairs) -> Array:
    """A row that sees all pairs but one."""
    row = np.random.default_rng(3).normal(size=(2, pairs.count))
    row[:, 1] = 0.0
    return row


@pytest.mark.parametrize("decay", [0.0, 0.2, 1.0, 3.0])
def test_rows_of_independent_pairs_are_those_of_joint_ones(decay: float) -> None:
    steps = Propagators.of(scene(decay))
    assert steps.pairs.independent
    row, slow = row_of(steps.pairs), np.array([0, 0, 0, 1, 0, 0], dtype=bool)
    each = propagators._alone(row, slow, steps, TABLE)
    whole = propagators._joint(row, slow, steps, TABLE)
    for name, found in each.items():
        assert np.array_equal(found, whole[name]), name
    assert each["smooth"] < steps.rungs - 1  # on long cells a fast pair is left out
    assert whole["window"] == np.inf == steps.ladder.window


def linked(pairs: Pairs) -> Pairs:
    """The first oscillator driven by the second one."""
    return pairs.linked([[0], [1]], np.array([[0.0], [0.0], [0.1], [0.0]]))


@pytest.mark.parametrize("frequency", [0.9, 1e-3, 100.0, 1e-158, 1e-200])
@pytest.mark.parametrize("coupled", [False, True])
def test_steps_beside_another_table_are_those_made_anew(frequency: float, coupled: bool) -> None:
    before, after = (linked(p) if coupled else p for p in (scene(0.2), scene(0.2, frequency)))
    kept, anew = Propagators.of(before).turning(TABLE, frequency), Propagators.of(after)
    for name in ("smallest", "rungs", "step", "links", "link_step", "generator"):
        assert np.array_equal(getattr(kept, name), getattr(anew, name)), name
    for found, expected in ((kept, anew), (kept.responses, anew.responses)):
        assert np.array_equal(found.pairs.generator, expected.pairs.generator)
        assert np.array_equal(found.pairs.rates, expected.pairs.rates)
        assert found.pairs.grows == expected.pairs.grows
    assert before.generator[1, TABLE] == 0.7  # the pairs before are what they were
    assert replace(kept.pairs).independent == after.independent is (not coupled)


def test_another_table_is_refused_as_any_is() -> None:
    with pytest.raises(ValueError, match=r"must not exceed 1e\+60; got 1e\+200"):
        Propagators.of(scene(0.2)).turning(TABLE, 1e200)


def test_no_pairs_have_steps_without_slots() -> None:
    assert propagators.steps(Pairs.empty(), 0.5, 3).shape == (3, 8, 0)
