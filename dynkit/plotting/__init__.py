"""Style of figures, and drawings that several results share."""
