"""Tests of exponential sums and their first roots."""
