"""What all rests on: validation, parameters, costs, the kinds of "no motion here"."""
