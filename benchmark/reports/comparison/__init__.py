"""The comparison of tabular and deep learners."""
