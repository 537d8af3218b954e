"""DQN and PPO as Stable-Baselines3 has them, for many agents at once."""
