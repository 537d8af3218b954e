"""Features extractors of Stable-Baselines3's agents: what their hidden layers are given.

The setting `policy_kwargs.features_extractor_class` names one, for example
`"agents.sb3.extractors:PeopleExtractor"`.

Axis letters: B observations of a batch.
"""

import math

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from envs import InputError


class PeopleExtractor(BaseFeaturesExtractor):
    """Embeds people by one net, and adds the embeddings (Zaheer et al. 2017, "Deep sets").

    So the order of people does not matter, except who comes first, if that is marked. The net is
    given coordinates of the agent's cell, if it is seen, with those of each person. In training,
    `agents.people.check_people` makes sure that observations hold nothing else.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        width: int = 64,
        per_person: int = 2,
        *,
        marks_first: bool = True,
        sees_agent: bool = True,
    ) -> None:
        """Makes the net.

        Args:
          observation_space: That of coordinates, centred or not.
          width: Units of each of the net's two layers.
          per_person: Numbers for each person: row and column, and a third one with badges.
          marks_first: Whether the net is told who is the first person.
          sees_agent: Whether row and column of the agent's cell come before people.

        Raises:
          InputError: Observations do not have two numbers for an agent that is seen and
            `per_person` for each person.
        """
        self.n_first = 2 * sees_agent
        n_people, rest = divmod(math.prod(observation_space.shape) - self.n_first, per_person)
        if len(observation_space.shape) != 1 or n_people < 1 or rest:
            raise InputError(
                f"PeopleExtractor: observations of shape {observation_space.shape}; accepted: "
                f"coordinates, {self.n_first} of the agent and per_person = {per_person} of each "
                "person."
            )
        super().__init__(observation_space, width)
        self.marks: torch.Tensor  # (people, 0 or 1)
        self.register_buffer("marks", torch.eye(n_people)[:, : int(marks_first)], persistent=False)
        self.net = nn.Sequential(
            nn.Linear(self.n_first + per_person + marks_first, width),
            nn.ReLU(),
            nn.Linear(width, width),
            nn.ReLU(),
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Returns the features (B, width) of observations."""
        shape = len(observations), len(self.marks), -1  # (B, people, numbers)
        agent, people = observations.tensor_split([self.n_first], dim=1)
        parts = agent[:, None].expand(shape), people.reshape(shape), self.marks.expand(shape)
        features: torch.Tensor = self.net(torch.cat(parts, dim=2)).sum(dim=1)
        return features


class PlanesExtractor(BaseFeaturesExtractor):
    """Two layers of convolutions, for small images: SB3's own net needs 36 x 36 pixels."""

    def __init__(self, observation_space: spaces.Box, n_features: int = 128) -> None:
        """Makes the net for a space of images, as "planes" has; others raise an InputError."""
        if len(observation_space.shape) != 3:
            raise InputError(
                f"PlanesExtractor: observations of shape {observation_space.shape}; accepted: "
                "images, such as those of the form planes."
            )
        super().__init__(observation_space, n_features)
        n_planes, rows, columns = observation_space.shape
        self.net = nn.Sequential(
            nn.Conv2d(n_planes, 16, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(16, 32, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(32 * math.ceil(rows / 2) * math.ceil(columns / 2), n_features),
            nn.ReLU(),
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Returns features (B, n_features) of images (B, planes, rows, columns), 0 to 1."""
        features: torch.Tensor = self.net(observations)
        return features
