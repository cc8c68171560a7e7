"""The `dynkit` command: the one place that knows toolkit, systems and analysis."""
