"""Benchmarks: run, never asserted."""
