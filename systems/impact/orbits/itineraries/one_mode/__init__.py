"""Orbits in one mode; the equations follow from the periodic responses to all impulses."""
