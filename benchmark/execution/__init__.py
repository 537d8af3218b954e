"""Plans runs, executes them and stores their records."""
