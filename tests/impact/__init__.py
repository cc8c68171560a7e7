"""Tests of the impact oscillator."""
