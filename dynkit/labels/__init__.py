"""Labels of orbits, from the recurrence of states."""
