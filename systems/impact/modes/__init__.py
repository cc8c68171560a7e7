"""Linear modes of the motion: structures, their modal bases, held coordinates, forced response."""
