"""A callback for Stable-Baselines3 that evaluates a model exactly while it learns."""

from pathlib import Path

from stable_baselines3.common.callbacks import BaseCallback

from benchmark.assess import assess
from envs import InputError, load_scenario


class ExactEvalCallback(BaseCallback):
    """Logs exact success and score, `eval/success` and `eval/score`, in the env that is learned.

    Unlike `EvalCallback` of Stable-Baselines3, it plays no episodes, so there is no noise:

        PPO("MlpPolicy", env).learn(10_000, callback=ExactEvalCallback(1_000, stochastic=True))
    """

    def __init__(
        self,
        every: int,
        *,
        stochastic: bool = False,
        stop_at: float | None = None,
        best_model: str | Path | None = None,
    ) -> None:
        """Sets when and what is evaluated.

        Args:
          every: Environment steps from one evaluation to the next.
          stochastic: Whether the evaluated policy samples its actions; otherwise it is greedy.
          stop_at: Training ends once success is this or more.
          best_model: Where the model with the highest success, then score, is saved.
        """
        super().__init__()
        self.every, self.stochastic = every, stochastic
        self.stop_at, self.best_model = stop_at, best_model
        self.best = (-1.0, -1.0)
        self._next = every

    def _on_training_start(self) -> None:
        spec = self.training_env.get_attr("spec")[0]
        if spec is None:
            raise InputError("ExactEvalCallback: accepted: a model whose env gymnasium.make made.")
        given = spec.kwargs
        self._scenario = load_scenario(given.get("scenario", "S1"), given.get("overrides"))
        self._observation = given.get("observation", "index")

    def _on_step(self) -> bool:
        if self.num_timesteps < self._next:
            return True
        self._next = self.num_timesteps + self.every
        found = assess(
            self.model,
            scenario=self._scenario,
            observation=self._observation,
            stochastic=self.stochastic,
        )
        self.logger.record("eval/success", found.success)
        self.logger.record("eval/score", found.score)
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.num_timesteps)
        if self.best_model is not None and (found.success, found.score) > self.best:
            self.best = found.success, found.score
            self.model.save(self.best_model)
        return self.stop_at is None or found.success < self.stop_at
