"""Tests of the programs among the tutorials."""
