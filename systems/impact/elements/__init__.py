"""What acts on a structure: stops, soft stops, dry friction."""
