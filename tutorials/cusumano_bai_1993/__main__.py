"""The reproduction as a program."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence

from tutorials.cusumano_bai_1993 import checked, reproduce
from tutorials.cusumano_bai_1993.paper import ITEMS

_DESCRIPTION = """\
The table and the figures of Cusumano & Bai (1993), as PNG and SVG, and report.html, which sets what
the paper says and what was found side by side.
"""

_EXAMPLES = f"""\
examples:
  python -m tutorials.cusumano_bai_1993 --out results
  python -m tutorials.cusumano_bai_1993 --out results --only table-a1,figure-3

items: {", ".join(ITEMS)}
"""


def main(argv: Sequence[str] | None = None) -> None:
    """Run the program; it exits with code 2, and one line on stderr, when an argument is bad."""
    parser = ArgumentParser(
        prog="cusumano_bai_1993",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--out", metavar="FOLDER", required=True, help="where the files go; made when missing"
    )
    parser.add_argument(
        "--only", metavar="ITEMS", help="some of the items, separated by commas; by default all"
    )
    arguments = parser.parse_args(argv)
    only = None if arguments.only is None else arguments.only.split(",")
    try:
        checked(arguments.out, only)
    except ValueError as refusal:
        parser.exit(2, f"{parser.prog}: error: {refusal}\n")
    reproduce(arguments.out, only, log=sys.stdout)


if __name__ == "__main__":
    main()
