"""Orbits whose flights are all in one mode: equations by the periodic responses to impulses."""
