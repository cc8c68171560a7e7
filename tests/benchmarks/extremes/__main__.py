"""Extreme cases as a program."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from tests.benchmarks.extremes import WrongCases, checked, extremes
from tests.benchmarks.extremes.cases import GROUPS
from tests.benchmarks.programs import Program, names

_DESCRIPTION = """\
Impact oscillators at the edges of double precision: no damping and far too much, stiff and heavy
elements beside soft and light ones, resonance, long times, ten million impacts. For each case the
actual error, against exact impacts to 30 digits, beside the estimated error.
"""

_EXAMPLES = f"""\
examples:
  python -m tests.benchmarks.extremes --only restitution,resonance
  python -m tests.benchmarks.extremes --only size --out extremes.md

groups: {", ".join(GROUPS)}
"""


def main(argv: Sequence[str] | None = None) -> None:
    """Run the program; it exits with code 2 for bad arguments, and with 1 for wrong cases."""
    program = Program("extremes", _DESCRIPTION, _EXAMPLES)
    program.add_argument("--out", metavar="FILE.md", help="Markdown file to write as well")
    program.add_argument(
        "--only", metavar="GROUPS", help="some of the groups, separated by commas; by default all"
    )
    arguments = program.parse_args(argv)
    only = names(arguments.only)
    try:
        checked(arguments.out, only)
    except ValueError as refusal:
        program.error(str(refusal))
    try:
        extremes(arguments.out, only, log=sys.stdout)
    except WrongCases as failure:
        program.exit(1, f"{program.prog}: failed: {failure}\n")


if __name__ == "__main__":
    main()
