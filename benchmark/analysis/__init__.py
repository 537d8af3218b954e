"""Populations of agents, intervals and snapshots."""
