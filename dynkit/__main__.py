"""``python -m dynkit``: the same as the `dynkit` command."""

import sys

from dynkit.cli import main

if __name__ == "__main__":
    sys.exit(main())
