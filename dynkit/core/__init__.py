"""Foundations: validation, parameters, costs, and the exceptions of motions that end."""
