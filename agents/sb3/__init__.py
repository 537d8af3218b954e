"""Algorithms of Stable-Baselines3 (Raffin et al. 2021), and of any package with classes like its own."""
