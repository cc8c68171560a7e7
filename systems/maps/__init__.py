"""Textbook maps."""
