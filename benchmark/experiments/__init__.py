"""Experiments: declared sets of runs."""
