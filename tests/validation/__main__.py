"""All cases: python -m tests.validation.

One line for each claim: cases, exceedances, median and largest ratio of true to claimed, lost ones.
One line for random machines: those compared to the end, those whose error grew to nothing that is
known, those that are refused, those that the reference gives up; events, and machines with others.
One line for each standard error: runs, those that two errors cover, those that are said to have no
plateau, and those without a scaling region. One line for each chaotic system: runs, those that are
said to change their regime, and how many may be.
"""

import sys

from tests.validation import machines
from tests.validation.quantities import QUANTITIES, STATISTICS
from tests.validation.ratios import Ratios
from tests.validation.regimes import SYSTEMS, false_alarms

sys.stdout.write("| error | cases | exceeded | median | largest | lost |\n")
sys.stdout.write("| --- | --- | --- | --- | --- | --- |\n")
for name, quantity in QUANTITIES.items():
    sys.stdout.write(f"| {name} | {Ratios.of(quantity.pairs(1))} |\n")
    sys.stdout.flush()

sys.stdout.write("\n| machines | lost | refused | given up | events | with other events |\n")
sys.stdout.write("| --- | --- | --- | --- | --- | --- |\n")
sys.stdout.write(f"| {machines.summary(1)} |\n")
for number, event in machines.different(1).items():
    sys.stdout.write(f"machine {number}: {event}\n")

sys.stdout.write("\n| standard error | runs | covered by two | no plateau | no region |\n")
sys.stdout.write("| --- | --- | --- | --- | --- |\n")
for name, measured in STATISTICS.items():
    sys.stdout.write(f"| {name} | {measured(100)} |\n")
    sys.stdout.flush()

sys.stdout.write("\n| stationary chaos | runs | said to change | most |\n")
sys.stdout.write("| --- | --- | --- | --- |\n")
for name in SYSTEMS:
    sys.stdout.write(f"| {name} | {false_alarms(name, 20_000)} |\n")
    sys.stdout.flush()
