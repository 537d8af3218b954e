"""Runs experiments, stores their records and publishes reports; see `python -m benchmark --help`."""
