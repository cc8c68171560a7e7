"""All cases: python -m tests.errors.

One line for each claim: cases, exceedances, median and largest ratio of true to claimed, lost ones.
"""

import sys

from tests.errors.quantities import QUANTITIES
from tests.errors.ratios import Ratios

sys.stdout.write("| error | cases | exceeded | median | largest | lost |\n")
sys.stdout.write("| --- | --- | --- | --- | --- | --- |\n")
for name, quantity in QUANTITIES.items():
    sys.stdout.write(f"| {name} | {Ratios.of(quantity.pairs(1))} |\n")
    sys.stdout.flush()
