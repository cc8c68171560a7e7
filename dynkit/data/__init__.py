"""Results in files: written completely or not at all, and checked when read."""
