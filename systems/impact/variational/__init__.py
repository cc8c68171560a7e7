"""Derivatives of the motion by its start: saltation, tangent vectors, the derivative of the map."""
