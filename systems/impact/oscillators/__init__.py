"""Oscillators made of a structure, its excitation and its elements."""
