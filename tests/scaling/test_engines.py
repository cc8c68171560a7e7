"""The same bits by any executor with any number of workers, and by none."""

import json
import os
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.scaling.cases import ALL, Backwards, Deadly, bits, mapped, processes

ROOT = Path(__file__).parents[2]


@cache
def serial(name: str) -> str:
    return bits(ALL[name](None))


@pytest.fixture(scope="module", params=["threads", "processes", "backwards"])
def executor(request: pytest.FixtureRequest) -> Iterator[Executor]:
    if request.param == "processes":
        with processes(2) as pool:
            yield pool
    elif request.param == "backwards":
        with Backwards() as pool:
            yield pool
    else:
        with ThreadPoolExecutor(3) as pool:
            yield pool


@pytest.mark.parametrize("name", ALL)
def test_the_bits_are_those_of_no_executor(name: str, executor: Executor) -> None:
    assert bits(ALL[name](executor)) == serial(name)


def test_dask_gives_the_same_bits_also_when_a_worker_is_killed(tmp_path: Path) -> None:
    import distributed

    dask: Any = distributed  # it has types for some of its functions only
    file = tmp_path / "deadly"
    system = Deadly(file=str(file))
    with (
        dask.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            memory_limit=0,
            silence_logs=50,
        ) as cluster,
        dask.Client(cluster) as client,
    ):
        before = set(client.run(os.getpid).values())
        file.touch()
        found = mapped(client.get_executor(), system)
        assert not file.exists()
        assert set(client.run(os.getpid).values()) != before
    assert bits(found) == bits(mapped(system=system))


def test_mpi_gives_the_same_bits() -> None:
    scripts = Path(sysconfig.get_path("scripts"))
    command = [
        *(str(scripts / "mpiexec"), "-n", "3"),
        *(sys.executable, "-m", "mpi4py.futures", str(Path(__file__).with_name("mpi.py"))),
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {name: serial(name) for name in ALL}
