"""Impact oscillators: linear structures that hit a moving table."""
