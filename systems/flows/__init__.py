"""Textbook flows, and what they share: integration and the search for crossings."""
