"""Scenarios: grid, issuer, regions and rewards, read from TOML and checked.

`envs.model` computes a scenario's dynamics. The shipped scenarios are in `envs/scenarios/*.toml`; comments
there name the paper's term for each value.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from envs.inputs import InputError, Table, override, parse, read_toml, unknown_name

SCENARIO_DIRECTORY = Path(__file__).parent / "scenarios"
MAX_STATES = 100_000

Reward = Annotated[float, Field(ge=-1e6, le=1e6)]
Cell = tuple[int, int]  # (row, column), (0, 0) top left


class Grid(Table):
    """Size of the floor, and the cell in which every episode starts."""

    rows: Annotated[int, Field(ge=1, le=1000)]
    columns: Annotated[int, Field(ge=1, le=1000)]
    start: Cell


class NoFeedback(Table):
    """The issuer gives no reward."""

    label: ClassVar[str] = "no feedback"
    kind: Literal["none"]


class UniformFeedback(Table):
    """The issuer's reward is drawn at each PING, uniformly between two bounds."""

    label: ClassVar[str] = "random feedback"
    kind: Literal["uniform"]
    low: Reward
    high: Reward

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low >= self.high:
            raise ValueError(f"low = {self.low} must be less than high = {self.high}")
        return self


class DistanceFeedback(Table):
    """The issuer's reward is minus its L1 distance from the agent, relative to that from the start cell."""

    label: ClassVar[str] = "feedback by distance"
    kind: Literal["distance"]


class Issuer(Table):
    """The person whose personal space matters, and the reward that this person adds to every PING."""

    position: Cell
    feedback: Annotated[NoFeedback | UniformFeedback | DistanceFeedback, Field(discriminator="kind")]


class Regions(Table):
    """Square regions around the issuer, by Chebyshev distance in cells.

    Uncomfortable: distance 1 to `uncomfortable_radius`. Target: beyond it, up to `target_radius`.
    """

    uncomfortable_radius: Annotated[int, Field(ge=0)]
    target_radius: Annotated[int, Field(ge=1)]

    @model_validator(mode="after")
    def _nested(self) -> Self:
        if self.target_radius <= self.uncomfortable_radius:
            raise ValueError(
                f"target_radius = {self.target_radius} must be larger than "
                f"uncomfortable_radius = {self.uncomfortable_radius}"
            )
        return self


class Rewards(Table):
    """The grid's rewards, by event."""

    issuer_reached: Reward
    target_ping: Reward
    last_wrong_ping: Reward
    wrong_ping: Reward
    wrong_ping_uncomfortable: Reward
    uncomfortable: Reward
    other: Reward


class Scenario(Table):
    """A checked scenario, named after its file."""

    name: str
    description: str
    grid: Grid
    issuer: Issuer
    regions: Regions
    ping_limit: Annotated[int, Field(ge=1)]  # the wrong PING that ends the episode
    rewards: Rewards

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        rows, columns = self.grid.rows, self.grid.columns
        for key, (row, column) in (
            ("grid.start", self.grid.start),
            ("issuer.position", self.issuer.position),
        ):
            if not (0 <= row < rows and 0 <= column < columns):
                raise ValueError(
                    f"{key} = [{row}, {column}] is off the grid; accepted: rows 0 to {rows - 1}, "
                    f"columns 0 to {columns - 1}"
                )
        distance = max(abs(a - b) for a, b in zip(self.grid.start, self.issuer.position, strict=True))
        if distance <= self.regions.target_radius:
            raise ValueError(
                f"grid.start = {list(self.grid.start)} lies inside a region of the issuer at "
                f"{list(self.issuer.position)}; accepted: a Chebyshev distance above "
                f"regions.target_radius = {self.regions.target_radius}"
            )
        states = rows * columns * self.ping_limit
        if states > MAX_STATES:
            raise ValueError(
                f"grid.rows x grid.columns x ping_limit = {states} states; accepted: at most {MAX_STATES}"
            )
        return self


ScenarioLike = str | Path | Scenario | Mapping[str, Any]


def is_name(text: str) -> bool:
    """Returns whether a text can be a scenario's name, and thus part of a Gymnasium id."""
    return re.fullmatch(r"[A-Za-z0-9_]+", text) is not None


def scenario_names() -> list[str]:
    """Returns the names of the shipped scenarios, which are those of their TOML files."""
    return sorted(path.stem for path in SCENARIO_DIRECTORY.glob("*.toml"))


def load_scenario(scenario: ScenarioLike, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Reads a scenario and checks it.

    Args:
      scenario: The name of a shipped scenario (`"S1"`), the path of a TOML file, a `Scenario`, or a
        mapping of its values as from `Scenario.model_dump`.
      overrides: New values by dotted key, for example `{"issuer.position": [8, 6]}`.

    Raises:
      InputError: One sentence that names the file, the key, its value and what is accepted.

    >>> load_scenario("S1").issuer.position
    (6, 8)
    """
    if isinstance(scenario, Scenario):
        if not overrides:
            return scenario
        scenario = scenario.model_dump(mode="json")
    if isinstance(scenario, Mapping):
        source = str(scenario.get("name", "scenario"))
        return parse(Scenario, override(scenario, overrides or {}, source), source)
    path = Path(scenario)
    if path.suffix != ".toml":
        path = SCENARIO_DIRECTORY / f"{scenario}.toml"
        if str(scenario) not in scenario_names():
            unknown_name("scenarios", "scenario", str(scenario), scenario_names())
    if not is_name(path.stem):
        raise InputError(
            f"{path}: the scenario is named after the file; accepted: a name of letters, digits and _."
        )
    return parse(Scenario, override(read_toml(path), overrides or {}, str(path)), str(path), name=path.stem)
