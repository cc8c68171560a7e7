"""Textbook flows, with the integration and the search for crossings that they share."""
