"""The dynamics a second time: plain Python over a scenario's tables as read from TOML, without the model."""

from functools import cache
from math import hypot
from typing import Any

Tables = dict[str, Any]
Cell = tuple[int, int]
State = tuple[
    int, int, bool, int, Cell
]  # place, tick, whether feedback is late, wrong PINGs, the agent's cell

WAYS = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}
NEARER = ["outside", "target", "uncomfortable", "issuer"]


class Reference:
    """A scenario's starts and steps."""

    def __init__(self, tables: Tables) -> None:
        self.tables, self.grid = tables, tables["grid"]
        self.zone = cache(self.zone_among_people)
        self.people = cache(self.people_in)
        self.at_start = cache(self.distance_at_start)
        self.cells = [(r, c) for r in range(self.grid["rows"]) for c in range(self.grid["columns"])]
        drawn = self.grid.get("walls", "").split()
        self.walls = {(r, c) for r, line in enumerate(drawn) for c, sign in enumerate(line) if sign == "#"}
        self.phases = self._phases()
        self.clock = [i for i, phase in enumerate(self.phases) for _ in range(phase.get("steps", 1))]
        feedback = [tables["issuer"], *tables.get("others", [])]
        self.is_delayed = any(person["feedback"]["kind"] == "delayed" for person in feedback)
        position, others = (
            tables["issuer"]["position"],
            {tuple(p["position"]) for p in tables.get("others", [])},
        )
        first_ticks = range(len(self.clock)) if tables.get("first_phase") == "any" else [0]
        self.places: list[Cell] = []
        self.starts: list[State] = []
        for place in self._cells(position):
            if place in self.walls | others:
                continue
            floor = [cell for cell in self.cells if cell not in self.walls]
            stages = range(len(self.phases))
            has_target = any(self.zone(place, p, cell) == "target" for p in stages for cell in floor)
            free = [
                (tick, cell)
                for tick in first_ticks
                for cell in sorted(self._cells(self.grid["start"]))
                if cell in floor and self.zone(place, self.clock[tick], cell) == "outside"
            ]
            if free and has_target:
                self.starts += [(len(self.places), tick, False, 0, cell) for tick, cell in free]
                self.places.append(place)

    def _cells(self, place: Any) -> list[Cell]:
        if place == "anywhere":
            return self.cells
        return [tuple(place)] if isinstance(place[0], int) else list(dict.fromkeys(map(tuple, place)))

    def _phases(self) -> list[Tables]:
        walk = self.tables["issuer"].get("walk")
        if walk is None:
            return self.tables.get("phases") or [{"name": "always"}]
        at, phases = tuple(self.tables["issuer"]["position"]), []
        for corner in [*map(tuple, walk["corners"]), at]:
            while at != corner:
                heading = next(
                    name
                    for name, (r, c) in WAYS.items()
                    if (corner[0] - at[0]) * r + (corner[1] - at[1]) * c > 0
                )
                phases.append({"position": at, "heading": heading, "steps": walk.get("steps", 1)})
                at = at[0] + WAYS[heading][0], at[1] + WAYS[heading][1]
        return phases

    def people_in(self, place: Cell, phase: int) -> list[Tables]:
        issuer = (
            {"heading": "up"} | self.tables["issuer"] | {"position": place, "regions": self.tables["regions"]}
        )
        return [issuer | self.phases[phase], *({"heading": "up"} | p for p in self.tables.get("others", []))]

    def zone_among_people(self, place: Cell, phase: int, cell: Cell) -> str:
        if cell in self.walls:
            return "outside"
        return max((self.zone_of(person, cell) for person in self.people(place, phase)), key=NEARER.index)

    def zone_of(self, person: Tables, cell: Cell) -> str:
        down, right = cell[0] - person["position"][0], cell[1] - person["position"][1]
        if (down, right) == (0, 0):
            return "issuer"
        ahead, aside = {
            "up": (-down, right),
            "down": (down, -right),
            "left": (-right, -down),
            "right": (right, down),
        }[person["heading"]]
        regions = person["regions"]
        for name in ("uncomfortable", "target"):
            shape = regions.get(name) or {"kind": "square", "radius": regions[f"{name}_radius"]}
            width = self.grid["metres_per_cell"] if regions.get("unit") == "metres" else 1
            if is_inside(shape, ahead * width, aside * width):
                return name
        return "outside"

    def step(self, state: State, action: int) -> tuple[dict[State, float], tuple[Any, ...]]:
        """Returns the next states' probabilities; and grid's reward, mean, noise, end, event, wrong PINGs."""
        place, tick, is_late, pings, cell = state
        issuer, rewards = self.places[place], self.tables["rewards"]
        zone, event, comes_late = self.zone(issuer, self.clock[tick], cell), "", False
        mean = self.answer(place, tick, cell)[0] if is_late else 0.0  # for the PING before, in the same cell
        noise = 0.0
        if action < 4:
            way = list(WAYS.values())[action]
            moved = cell[0] + way[0], cell[1] + way[1]
            cell = moved if moved in self.cells and moved not in self.walls else cell
            entered = self.zone(issuer, self.clock[tick], cell)
            event = {"issuer": "issuer_reached", "uncomfortable": "uncomfortable"}.get(entered, "move")
            reward = rewards["other" if event == "move" else event]
        else:
            answer, noise, comes_late = self.answer(place, tick, cell)
            mean += 0.0 if comes_late else answer
            last = "last_wrong_ping" if pings + 1 == self.tables["ping_limit"] else "wrong_ping"
            event = "target_ping" if zone == "target" else last
            is_near = event == "wrong_ping" and zone == "uncomfortable"
            reward = rewards["wrong_ping_uncomfortable" if is_near else event]
        after = pings + event.endswith("wrong_ping")
        is_end = event in ("issuer_reached", "target_ping", "last_wrong_ping")
        facts = reward, mean, noise, is_end, event, after
        if is_end:
            after = min(after, self.tables["ping_limit"] - 1)
            return {(place, tick, is_late, after, cell): 1.0}, facts
        following: dict[State, float] = {}
        for next_tick, chance in self.ticks_after(tick).items():
            stands = [tuple(p["position"]) for p in self.people(issuer, self.clock[next_tick])]
            goes = tick if cell in stands else next_tick  # waits for the agent
            next_state = (place, goes, comes_late, after, cell)
            following[next_state] = following.get(next_state, 0.0) + chance
        return following, facts

    def ticks_after(self, tick: int) -> dict[int, float]:
        chances = self.phases[self.clock[tick]].get("next")
        if chances is None:
            return {(tick + 1) % len(self.clock): 1.0}
        names = [phase["name"] for phase in self.phases]
        others = {names.index(name): chance for name, chance in chances.items()}
        return others | {tick: 1.0 - sum(others.values())}

    def answer(self, place: int, tick: int, cell: Cell) -> tuple[float, float, bool]:
        """Returns mean, noise and lateness of the nearest person's feedback."""
        people = self.people(self.places[place], self.clock[tick])
        far = [distance(person["position"], cell) for person in people]
        k = far.index(min(far))
        feedback = people[k]["feedback"]
        match feedback["kind"]:
            case "none":
                return 0.0, 0.0, False
            case "uniform":
                return (
                    (feedback["low"] + feedback["high"]) / 2,
                    (feedback["high"] - feedback["low"]) / 2,
                    False,
                )
            case "binary":
                is_right = self.zone(self.places[place], self.clock[tick], cell) == "target"
                return feedback["high" if is_right else "low"], 0.0, False
            case kind:
                return -far[k] / self.at_start(place, k), feedback.get("noise", 0.0), kind == "delayed"

    def distance_at_start(self, place: int, k: int) -> int:
        return max(
            distance(self.people(self.places[place], self.clock[tick])[k]["position"], cell)
            for j, tick, *_, cell in self.starts
            if j == place
        )


def is_inside(shape: Tables, ahead: float, aside: float) -> bool:
    match shape["kind"]:
        case "square":
            return bool(max(abs(ahead), abs(aside)) <= shape["radius"] + 1e-9)
        case "circle":
            return bool(hypot(ahead, aside) <= shape["radius"] + 1e-9)
        case _:
            length = shape["front"] if ahead >= 0 else shape["front"] / 2
            width = shape["front"] * 2 / 3
    return hypot(ahead / length, aside / width) <= 1 + 1e-9


def distance(a: Any, b: Any) -> int:
    return int(abs(a[0] - b[0]) + abs(a[1] - b[1]))
