"""Orbits through several modes: equations by passages from event to event."""
