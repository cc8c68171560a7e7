"""States of the paper's chain to 25 digits: N = 10, r = 0.85, A = 0.1, A0 = 0, g = 0.1.

Start of mode 1 (q_1 = 1, at rest, tip away from the table, phase 0). Source: `regenerate`, that is
`impact_chain.ReferenceChain` with 90 working digits, every impact proved in interval arithmetic.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import mpmath

from tests.reference.impact_chain import ReferenceChain

DIGITS: Final = 25


class ImpactValues(NamedTuple):
    """Just after an impact, as decimal strings of 25 digits."""

    time: str
    phase: str
    relative_velocity: str
    tip: str


def regenerate(frequency: float, impacts: int) -> ImpactValues:
    """The values after this many impacts from the start of mode 1, computed anew."""
    last = ReferenceChain(frequency=frequency).simulate(impacts).impacts[-1]
    entries = (last.time, last.phase, last.relative_velocity, last.position[-1])
    return ImpactValues(*(str(mpmath.nstr(x, DIGITS, strip_zeros=False)) for x in entries))


PAPER_CHAIN: Final = {
    (0.87, 10): ImpactValues(
        time="109.6414432869456601684536",
        phase="1.140276051948926705769489",
        relative_velocity="0.07602072966909493162673705",
        tip="0.09087487392700364771967844",
    ),
    (0.87, 50): ImpactValues(
        time="671.5231134942466372425458",
        phase="6.172060479472615541726789",
        relative_velocity="0.1474625317665117193061766",
        tip="-0.01108962605121101366133491",
    ),
    (0.35, 10): ImpactValues(
        time="19.33699155276354916567327",
        phase="0.4847617362876553016928920",
        relative_velocity="0.007777888569771045537252263",
        tip="0.04659975602798439906115493",
    ),
    (0.35, 30): ImpactValues(
        time="127.2615674770646864862649",
        phase="0.5592514667155321059412630",
        relative_velocity="0.02921600620219083208945348",
        tip="0.05305518505167198626748521",
    ),
}
"""Values by (frequency, number of impacts)."""
