"""Stable-Baselines3's DQN and PPO."""
