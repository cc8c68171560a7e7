"""Impact oscillators: structures with their excitation and their elements."""
