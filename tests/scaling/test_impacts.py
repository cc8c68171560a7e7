"""Impact oscillators by executors: threads share the process, processes start from nothing."""

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from dynkit import basins, explore, parameter_map, sweep
from dynkit.systems import ImpactChain
from tests.scaling.cases import bits, processes

CHAIN = ImpactChain(masses=2, frequency=0.9)


def all_bits(executor: Executor | None) -> list[str]:
    brief: dict[str, Any] = {"transient": 60, "keep": 40, "progress": False, "executor": executor}
    values: dict[str, Any] = {"frequency": np.linspace(0.3, 1.5, 8), "damping": [0.1, 0.2]}
    starts = np.zeros((6, 5))
    starts[:, 1], starts[:, -1] = 1.0, np.arange(6)
    found = (
        sweep(CHAIN, "frequency", values["frequency"], follow=False, **brief),
        parameter_map(CHAIN, values, **brief),
        basins(CHAIN, starts, **brief),
        explore(
            CHAIN, "frequency", (0.88, 0.92), iterates=1, periods=2, values=1, executor=executor
        ),
    )
    return [bits(each) for each in found]


@pytest.fixture(scope="module")
def serial() -> list[str]:
    return all_bits(None)


@pytest.fixture(params=["threads", "processes"])
def executor(request: pytest.FixtureRequest) -> Iterator[Executor]:
    if request.param == "processes":
        with processes(2) as pool:
            yield pool
    else:
        with ThreadPoolExecutor(3) as pool:
            yield pool


def test_the_bits_are_those_of_no_executor(serial: list[str], executor: Executor) -> None:
    assert all_bits(executor) == serial
