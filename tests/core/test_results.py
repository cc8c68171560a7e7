import pickle
from collections.abc import MutableMapping
from typing import cast

import pytest

from dynkit.core.cost import Cost


def test_costs_add_name_by_name() -> None:
    total = Cost(1.0, {"impacts": 2}) + Cost(0.5, {"impacts": 3, "cells": 4})
    assert total == Cost(1.5, {"impacts": 5, "cells": 4})


def test_counts_cannot_be_changed() -> None:
    counts = cast("MutableMapping[str, int]", Cost(1.0, {"impacts": 2}).counts)
    with pytest.raises(TypeError):
        counts["impacts"] = 3


def test_counts_are_copied() -> None:
    counts = {"impacts": 2}
    cost = Cost(1.0, counts)
    counts["impacts"] = 3
    assert cost.counts["impacts"] == 2


def test_equal_costs_have_equal_hashes() -> None:
    assert hash(Cost(1.0, {"a": 1, "b": 2})) == hash(Cost(1.0, {"b": 2, "a": 1}))


def test_a_cost_survives_pickling() -> None:
    cost = Cost(1.0, {"impacts": 2})
    assert pickle.loads(pickle.dumps(cost)) == cost


def test_negative_seconds_are_refused() -> None:
    with pytest.raises(ValueError, match=r"seconds must not be negative; got -1\.0"):
        Cost(-1.0)


def test_negative_counts_are_refused() -> None:
    with pytest.raises(ValueError, match=r"counts\['impacts'\] must be zero or a positive integer"):
        Cost(1.0, {"impacts": -1})
