"""Tests of dynkit."""
