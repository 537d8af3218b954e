"""DQN and PPO with the updates of Stable-Baselines3, compiled, one agent at a time."""
