"""What is measured on attractors."""
