"""Linear modes of the motion: structures, modal bases, held coordinates, steady response."""
