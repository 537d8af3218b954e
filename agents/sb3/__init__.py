"""Algorithms of Stable-Baselines3 (Raffin et al. 2021)."""
