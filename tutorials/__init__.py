"""Worked examples: notebooks, and programs made of dynkit's public names."""
