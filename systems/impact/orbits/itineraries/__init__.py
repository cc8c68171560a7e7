"""Periodic orbits with given itineraries: modes in their order, and the events that end them."""
