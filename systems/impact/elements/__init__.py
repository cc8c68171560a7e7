"""Elements that act on a structure: hard stops, soft stops, dry friction, Jenkins elements."""
