import pytest

from tests.sweeps.cases import Counted


@pytest.fixture(autouse=True)
def _fresh_counter() -> None:
    Counted.calls, Counted.trap = 0, None
