"""The dynamics a second time: plain Python over a scenario's TOML, without the model."""

from collections.abc import Iterable
from functools import cache
from itertools import combinations
from math import gcd, hypot, lcm
from typing import Any

Tables = dict[str, Any]
Cell = tuple[int, int]
Place = tuple[Cell, ...]  # of the issuer and its group
State = tuple[
    int, int, bool, int, Cell
]  # place, tick, whether feedback is late, wrong PINGs, the agent's cell

WAYS = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}
NEARER = ["outside", "target", "uncomfortable", "issuer"]


class Reference:
    """A scenario's starts and steps."""

    def __init__(self, tables: Tables, drawn_places: Iterable[Place] = ()) -> None:
        """Reads a scenario's tables; if not all places are drawn, those that are must be given."""
        self.tables, self.grid = tables, tables["grid"]
        self.everybody = [tables["issuer"], *tables.get("others", [])]
        self.others = range(1, len(self.everybody))
        self.zone = cache(self.zone_among_people)
        self.people = cache(self.people_in)
        self.at_start = cache(self.distance_at_start)
        self.cells = [(r, c) for r in range(self.grid["rows"]) for c in range(self.grid["columns"])]
        drawn = self.grid.get("walls", "").split()
        self.walls = {
            (r, c) for r, line in enumerate(drawn) for c, sign in enumerate(line) if sign == "#"
        }
        self.phases = self._phases()
        self.clock = [
            i for i, phase in enumerate(self.phases) for _ in range(phase.get("steps", 1))
        ]
        feedback = [person.get("feedback", {"kind": ""}) for person in self.everybody]
        self.is_delayed = any(each["kind"] == "delayed" for each in feedback)
        first_ticks = range(len(self.clock)) if tables.get("first_phase") == "any" else [0]
        self.places: list[Place] = []
        self.starts: list[State] = []
        for place in self.placed():
            if "places" in tables["issuer"] and place not in drawn_places:
                continue
            floor = [cell for cell in self.cells if cell not in self.walls]
            stages = range(len(self.phases))
            zones = {cell: {self.zone(place, p, cell) for p in stages} for cell in floor}
            open_to = {
                cell for cell in floor if "target" in zones[cell]
            }  # the target region, at some time
            passable = {cell for cell in floor if zones[cell] != {"issuer"}}
            for _ in floor:
                open_to |= {(r + i, c + k) for r, c in open_to for i, k in WAYS.values()} & passable
            free = [
                (tick, cell)
                for tick in first_ticks
                for cell in sorted(self._cells(self.grid["start"]))
                if cell in open_to and self.zone(place, self.clock[tick], cell) == "outside"
            ]
            if free:
                self.starts += [(len(self.places), tick, False, 0, cell) for tick, cell in free]
                self.places.append(place)

    def _cells(self, place: Any) -> list[Cell]:
        if place == "anywhere":
            return self.cells
        return (
            [tuple(place)] if isinstance(place[0], int) else list(dict.fromkeys(map(tuple, place)))
        )

    def placed(self) -> list[Place]:
        """Lists all ways for the issuer and its group to stand where nobody else ever does."""
        stages = range(len(self.phases))
        taken = {tuple(self.other(i, p)["position"]) for i in self.others for p in stages}
        position, group = self.tables["issuer"]["position"], self.tables.get("group")
        cells = [cell for cell in self._cells(position) if cell not in self.walls | taken]
        if group is None:
            return [(cell,) for cell in cells]
        (low, high), unit = group["apart"], self.unit(self.tables["regions"])
        return [
            place
            for place in combinations(sorted(cells), group["people"])
            if all(low - 1e-9 <= far(a, b) * unit <= high + 1e-9 for a, b in combinations(place, 2))
        ]

    def unit(self, regions: Tables) -> float:
        """Returns the width of a cell, as regions measure it."""
        return self.grid.get("metres_per_cell", 1) if regions.get("unit") == "metres" else 1

    def _phases(self) -> list[Tables]:
        """Lists the phases; where people walk, their cells and headings until everybody is back."""
        walkers = {i: person for i, person in enumerate(self.everybody) if "walk" in person}
        if not walkers:
            return self.tables.get("phases") or [{"name": "always"}]
        routes = {i: route(person) for i, person in walkers.items()}
        beat = gcd(*(person["walk"].get("steps", 1) for person in walkers.values()))
        times = range(0, lcm(*map(len, routes.values())), beat)
        return [{"steps": beat, "at": {i: r[t % len(r)] for i, r in routes.items()}} for t in times]

    def other(self, i: int, phase: int) -> Tables:
        table: Tables = {"heading": "up"} | self.everybody[i]
        return table | dict(self.phases[phase].get("at", {}).get(i, {}))

    def people_in(self, place: Place, phase: int) -> list[Tables]:
        """Lists issuer, group and others, in the order in which equally near ones answer."""
        now = self.phases[phase] | self.phases[phase].get("at", {}).get(0, {})
        issuer = {"heading": "up"} | self.tables["issuer"] | {"regions": self.tables["regions"]}
        drawn = [issuer | {"position": cell} | now for cell in place]
        return [*drawn, *(self.other(i, phase) for i in self.others)]

    def zone_among_people(self, place: Place, phase: int, cell: Cell) -> str:
        if cell in self.walls:
            return "outside"
        people = self.people(place, phase)
        zones = [self.zone_of(person, cell) for person in people]
        return max(*zones, self.zone_of_ring(people[: len(place)], cell), key=NEARER.index)

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
        regions = person.get("regions", {})  # a bystander has none
        for name in ("uncomfortable", "target") if regions else ():
            shape = regions.get(name) or {"kind": "square", "radius": regions[f"{name}_radius"]}
            unit = self.unit(regions)
            if is_inside(shape, ahead * unit, aside * unit):
                return name
        return "outside"

    def zone_of_ring(self, group: list[Tables], cell: Cell) -> str:
        ring = group[0]["regions"].get("target", {})
        if ring.get("kind") != "ring":
            return "outside"
        cells = [person["position"] for person in group]
        centre = sum(r for r, _ in cells) / len(cells), sum(c for _, c in cells) / len(cells)
        radius = sum(far(one, centre) for one in cells) / len(cells)
        beyond = (far(cell, centre) - radius) * self.unit(group[0]["regions"])
        if abs(beyond) <= ring["width"] / 2 + 1e-9:
            return "target"
        return "uncomfortable" if beyond < 0 else "outside"

    def step(self, state: State, action: int) -> tuple[dict[State, float], tuple[Any, ...]]:
        """Returns next states' chances; grid's reward, mean, noise, end, event, wrong PINGs."""
        place, tick, is_late, pings, cell = state
        issuer, rewards = self.places[place], self.tables["rewards"]
        zone, event, comes_late = self.zone(issuer, self.clock[tick], cell), "", False
        # for the PING before, in the same cell
        mean = self.answer(place, tick, cell)[0] if is_late else 0.0
        noise = 0.0
        if action < 4:
            way = list(WAYS.values())[action]
            moved = cell[0] + way[0], cell[1] + way[1]
            cell = moved if moved in self.cells and moved not in self.walls else cell
            entered = self.zone(issuer, self.clock[tick], cell)
            event = {"issuer": "issuer_reached", "uncomfortable": "uncomfortable"}.get(
                entered, "move"
            )
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
        people = self.answering(place, tick)
        distances = [distance(person["position"], cell) for person in people]
        k = distances.index(min(distances))
        feedback = people[k]["feedback"]
        match feedback["kind"]:
            case "none":
                return 0.0, 0.0, False
            case "uniform":
                low, high = feedback["low"], feedback["high"]
                return (low + high) / 2, (high - low) / 2, False
            case "binary":
                is_right = self.zone(self.places[place], self.clock[tick], cell) == "target"
                return feedback["high" if is_right else "low"], 0.0, False
            case kind:
                return (-distances[k] / self.at_start(place, k), 0.0, kind == "delayed")

    def answering(self, place: int, tick: int) -> list[Tables]:
        people = self.people(self.places[place], self.clock[tick])
        return [person for person in people if "feedback" in person]  # no bystanders

    def distance_at_start(self, place: int, k: int) -> int:
        return max(
            distance(self.answering(place, tick)[k]["position"], cell)
            for j, tick, *_, cell in self.starts
            if j == place
        )


def route(person: Tables) -> list[Tables]:
    """Lists cell and heading of somebody who walks, for every step of the agent in a round."""
    start, walk, steps = tuple(person["position"]), person["walk"], []
    at = start
    for corner in [*map(tuple, walk["corners"]), start]:
        while at != corner:
            ahead = [
                (corner[0] - at[0]) * r + (corner[1] - at[1]) * c > 0 for r, c in WAYS.values()
            ]
            heading = [*WAYS][ahead.index(True)]
            steps += [{"position": at, "heading": heading}] * walk.get("steps", 1)
            at = at[0] + WAYS[heading][0], at[1] + WAYS[heading][1]
    return steps


def is_inside(shape: Tables, ahead: float, aside: float) -> bool:
    match shape["kind"]:
        case "square":
            return bool(max(abs(ahead), abs(aside)) <= shape["radius"] + 1e-9)
        case "circle":
            return bool(hypot(ahead, aside) <= shape["radius"] + 1e-9)
        case "ring":  # around a group, not around a person
            return False
        case _:
            length = shape["front"] if ahead >= 0 else shape["front"] / 2
            width = shape["front"] * 2 / 3
    return hypot(ahead / length, aside / width) <= 1 + 1e-9


def distance(a: Any, b: Any) -> int:
    return int(abs(a[0] - b[0]) + abs(a[1] - b[1]))


def far(a: Any, b: Any) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])
