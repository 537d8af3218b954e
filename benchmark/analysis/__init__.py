"""Populations of agents, and intervals."""
