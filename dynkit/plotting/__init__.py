"""Style of figures, and drawings shared by several results."""
