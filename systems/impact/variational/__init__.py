"""Derivatives of the motion by its start: saltation, tangent map, derivative of the impact map."""
