"""Orbits through several modes; the equations follow from flights from event to event."""
