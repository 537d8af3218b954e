"""What is run, kept, aggregated and shown; `python -m benchmark --help` says how."""
