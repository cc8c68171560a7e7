"""What the programs of the benchmarks share."""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from typing import NoReturn

from dynkit.cli.output import output_file
from dynkit.data.atomic_files import whole


class Program(ArgumentParser):
    """Arguments of a program, which are refused on one line, with exit code 2."""

    def __init__(self, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


def names(text: str | None) -> list[str] | None:
    """Return names that commas separate; None for none given."""
    return None if text is None else text.split(",")


def output(out: str, endings: tuple[str, ...]) -> Path:
    """Return the path of a file to write.

    Raises
    ------
    ValueError
        When its ending is another, or it cannot be written.
    """
    return output_file("out", out, endings)


def write_text(path: Path, text: str) -> None:
    """Write a text: the file is the new one, or after any failure the old one."""
    with whole("out", path) as stream:
        stream.write(text.encode())
