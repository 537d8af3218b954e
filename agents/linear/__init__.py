"""Linear learners over tile coding."""
