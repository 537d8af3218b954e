"""Settings of the batched algorithms: those of Stable-Baselines3's, and where the nets are computed."""

from typing import Literal

from agents.sb3.settings import DqnSettings, PpoSettings

Device = Literal["cpu", "cuda"]


class BatchedDqnSettings(DqnSettings):
    """Arguments and defaults of SB3's DQN."""

    device: Device = "cpu"


class BatchedPpoSettings(PpoSettings):
    """Arguments and defaults of SB3's PPO."""

    device: Device = "cpu"
