"""Fixed small steps agree with the reference chain."""

import numpy as np
import pytest

from tests.reference.brute_force import BruteForceChain
from tests.reference.impact_chain import ReferenceChain


class Peers:
    """Five impacts of a four-mass chain, by the reference and by what is compared with it."""

    def __init__(self) -> None:
        self.chain = ReferenceChain(4, frequency=0.87)
        self.impacts = self.chain.simulate(5).impacts
        position, velocity = self.chain.paper_start()
        self.position = np.array([float(x) for x in position])
        self.velocity = np.array([float(x) for x in velocity])

    def brute_force_error(self, step: float) -> float:
        run = BruteForceChain(
            np.ones(4),
            np.ones(4),
            damping=0.1,
            restitution=0.85,
            amplitude=0.1,
            offset=0.0,
            frequency=0.87,
            step=step,
        ).run(self.position, self.velocity, impacts=5, limit=200.0)
        last = self.impacts[-1]
        return float(np.abs(run.velocity[-1] - np.array([float(v) for v in last.velocity])).max())


@pytest.fixture(scope="module")
def peers() -> Peers:
    return Peers()


def test_brute_force_converges_with_order_four(peers: Peers) -> None:
    steps = np.array([0.08, 0.04, 0.02, 0.01])
    errors = np.array([peers.brute_force_error(h) for h in steps])
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.3)


def test_brute_force_finds_the_contact_of_the_reference() -> None:
    chain = ReferenceChain(2, frequency=0.408, restitution=0.3)
    start, end = chain.simulate(60).contacts[0]
    position, velocity = chain.paper_start()
    run = BruteForceChain(
        np.ones(2),
        np.ones(2),
        damping=0.1,
        restitution=0.3,
        amplitude=0.1,
        offset=0.0,
        frequency=0.408,
        step=1e-3,
    ).run(
        np.array([float(x) for x in position]),
        np.array([float(x) for x in velocity]),
        impacts=40,
        limit=float(end) + 0.1,
    )
    np.testing.assert_allclose(run.contact[0], [float(start), float(end)], atol=5e-3)
