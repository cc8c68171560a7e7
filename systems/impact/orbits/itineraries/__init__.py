"""Orbits of machines with elements, by itinerary: modes in their order, and what ends them."""
