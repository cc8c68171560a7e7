"""Error against run time as a program."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from tests.benchmarks.peers import NAMES
from tests.benchmarks.programs import Program, names
from tests.benchmarks.work_precision import checked, work_precision
from tests.benchmarks.work_precision.jobs import JOBS

_DESCRIPTION = """\
Error against run time, beside other methods: dynkit's exact maps, the algorithm of the paper,
SciPy's solve_ivp with events, Moreau's time stepping, and heyoka and Siconos when they are
installed; each over its own tolerances. Errors are those against exact impacts to 30 digits. Missed
and invented impacts are counted.
"""

_EXAMPLES = f"""\
examples:
  python -m tests.benchmarks.work_precision --only chaos --methods dynkit,paper,DOP853
  python -m tests.benchmarks.work_precision --only chatter --methods dynkit,Moreau --out found.png

jobs: {", ".join(JOBS)}
methods: {", ".join(NAMES)}
"""


def main(argv: Sequence[str] | None = None) -> None:
    """Run the program; it exits with code 2 for bad arguments."""
    program = Program("work_precision", _DESCRIPTION, _EXAMPLES)
    program.add_argument("--out", metavar="FILE", help="file to write: .csv, .md, .png or .svg")
    program.add_argument(
        "--only", metavar="JOBS", help="some of the jobs, separated by commas; by default all"
    )
    program.add_argument(
        "--methods", metavar="NAMES", help="some of the methods, likewise; by default all"
    )
    arguments = program.parse_args(argv)
    only, methods = names(arguments.only), names(arguments.methods)
    try:
        checked(arguments.out, only, methods)
    except ValueError as refusal:
        program.error(str(refusal))
    work_precision(arguments.out, only, methods, log=sys.stdout)


if __name__ == "__main__":
    main()
