"""DQN and PPO as Stable-Baselines3 has them, compiled, one agent at a time."""
