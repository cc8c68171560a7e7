"""The version of dynkit."""

__version__ = "0.1.0"
