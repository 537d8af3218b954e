"""References in Markdown: every key of scenario and experiment files, and every column of published tables.

All of it is generated: keys, accepted values and defaults from the classes that check a file, meanings from
the docstrings below their fields, columns from the published files, and what they mean from
`benchmark.reports.columns`.
"""

import csv
import gzip
import inspect
import json
import re
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, Final, get_args

from pdoc.doc_ast import walk_tree

from agents import ALGORITHMS, load_algorithm
from benchmark.experiments.schema import Experiment, Extension
from benchmark.reports import REPORTS, load_report, sameness
from benchmark.reports.columns import meaning
from benchmark.reports.folder import MANIFEST, Folder
from envs import Scenario, load_scenario, scenario_names
from envs.inputs import Table
from envs.observations import OBSERVATIONS
from envs.words import listed

_ENDS: Final = re.compile(r"(.+?)(?:_low|_high)?")  # a column, and those of its interval


def meanings(table: type[Table]) -> dict[str, str]:
    """Returns what each key of a table means, from the docstrings of its fields and those it inherits."""
    found: dict[str, str] = {}
    for base in table.__mro__[::-1]:
        if issubclass(base, Table):
            found |= walk_tree(base).var_docstrings
    return {key: " ".join(found.get(key, "").split()) for key in table.model_fields}


def tables_in(root: type[Table], at: str = "") -> dict[type[Table], list[str]]:
    """Returns a table and all tables inside it, each with the keys under which it stands."""
    found: dict[type[Table], list[str]] = {root: [at]}
    todo = [(root, at)]
    while todo:
        table, where = todo.pop(0)
        schemas = table.model_json_schema()["properties"]
        for key, field in table.model_fields.items():
            place = f"{where}.{key}{_kind(schemas[key])}".removeprefix(".")
            for inner in dict.fromkeys(_inside(field.annotation)):
                if inner not in found:
                    todo.append((inner, place))
                found.setdefault(inner, []).append(place)
    return found


def _inside(annotation: Any) -> Iterator[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        yield annotation
    for each in get_args(annotation):
        yield from _inside(each)


def _kind(schema: Mapping[str, Any]) -> str:
    """Returns what follows a key if it holds several tables: a name, or a place in a list."""
    inner = schema.get("additionalProperties")
    if isinstance(inner, dict):
        return f".NAME{_kind(inner)}"
    return "[]" if schema.get("type") == "array" else ""


def section(table: type[Table], places: list[str], level: int = 2) -> str:
    """Returns the section on a table: where it stands, what it is, and its keys."""
    schemas = table.model_json_schema()["properties"]
    names = [key for key in table.model_fields if not (key == "name" and places == [""])]
    kinds = schemas.get("kind", {}).get("enum") or [schemas.get("kind", {}).get("const")]
    title = ", ".join(f"`{place}`" for place in places if place) or "The file"
    rows = [
        [f"`{key}`", _accepted(schemas[key]), _default(table, key), meanings(table)[key]] for key in names
    ]
    heading = f"{'#' * level} {': '.join(filter(None, [title, ' or '.join(filter(None, kinds))]))}"
    anchor = f'<a id="table-{table.__name__.lower()}"></a>'
    keys = grid(["key", "accepted", "default", "meaning"], rows)
    return "\n\n".join([anchor, heading, inspect.cleandoc(str(table.__doc__)), keys])


def _accepted(schema: Mapping[str, Any]) -> str:
    """Returns in words what a JSON schema accepts."""
    if "$ref" in schema:
        return f"[a table](#table-{schema['$ref'].rpartition('/')[2].lower()})"
    if several := schema.get("anyOf", schema.get("oneOf")):
        each = (_accepted(one) for one in several if one.get("type") != "null")
        return " or ".join(dict.fromkeys(each))
    if values := schema.get("enum", [schema["const"]] if "const" in schema else []):
        return " or ".join(json.dumps(value) for value in values)
    match schema.get("type"):
        case "array" if "prefixItems" in schema:
            kinds = [_accepted(each) for each in schema["prefixItems"]]
            return "[ROW, COLUMN]" if kinds == ["whole number"] * 2 else f"[{', '.join(kinds)}]"
        case "array":
            n = _range(schema, "minItems", "maxItems", " item")
            items = _accepted(schema["items"]).replace("[a table]", "[tables]")
            return f"list of {items}{n and f' ({n[2:]})'}"
        case "object" if isinstance(schema.get("additionalProperties"), dict):
            return f"{_accepted(schema['additionalProperties'])} for each name"
        case "object":
            return "a table"
        case "integer" | "number" as kind:
            word = "whole number" if kind == "integer" else "number"
            return word + _range(schema, "minimum", "maximum")
        case "boolean":
            return "true or false"
        case "string":
            return "text"
    return "anything"


def _range(schema: Mapping[str, Any], least: str, most: str, unit: str = "") -> str:
    """Returns the bounds of a number in words, after a comma; empty if there are none."""
    low, high, above, below = (
        f"{schema[key]:,.10g}" if key in schema else ""
        for key in (least, most, "exclusiveMinimum", "exclusiveMaximum")
    )
    if low and high:
        return f", {low} to {high}{unit and f'{unit}s'}"
    named = {"at least ": low, "above ": above, "at most ": high, "below ": below}
    parts = [
        f"{word}{value}{unit}{'s' * (unit != '' != value != '1')}" for word, value in named.items() if value
    ]
    return ", ".join(["", *parts])


def _default(table: type[Table], key: str) -> str:
    field = table.model_fields[key]
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, Table):
        return "its defaults"
    if value in (None, "", ()) or isinstance(value, dict):
        return "-"
    return f"`{json.dumps(value)}`"


def grid(head: list[str], rows: list[list[str]]) -> str:
    """Returns a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(each.replace('|', '&#124;') for each in line)} |" for line in lines)


def scenarios() -> str:
    """Returns the reference of scenario files."""
    shipped = [[f"`{name}`", load_scenario(name).description] for name in scenario_names()]
    parts = ["## Shipped scenarios", grid(["scenario", "what it is about"], shipped), "## Every key"]
    found = tables_in(Scenario)
    return "\n\n".join([*parts, *(section(table, places, 3) for table, places in found.items())])


def experiments() -> str:
    """Returns the reference of experiment files, with the settings of every algorithm."""
    parts = [
        "# Experiment files",
        "An experiment is a TOML file, named after it. `python -m benchmark run` takes the name of a shipped "
        "one, from `benchmark/experiments/`, or a path. It declares which variants learn in which scenarios, "
        "under which conditions, from how many seeds, and what is reported. A dotted key, such as "
        '`"issuer.position"`, changes a value inside a table.',
    ]
    found = tables_in(Experiment)
    parts += [section(table, places) for table, places in found.items()]
    parts += [section(Extension, [""]).replace("## The file", "## A file that extends another")]
    rows, settings = [], dict[type[Table], list[str]]()
    for name in ALGORITHMS:
        algorithm = load_algorithm(name)
        table: type[Table] = algorithm.settings
        settings.setdefault(table, []).append(name)
        forms = ", ".join(f"`{form}`" for form in OBSERVATIONS if form in algorithm.observations)
        link = f"[{table.__name__}](#table-{table.__name__.lower()})"
        rows.append([f"`{name}`", algorithm.family, forms, link])
    parts += ["## Algorithms", grid(["algorithm", "family", "observations", "settings"], rows)]
    done: set[type[Table]] = set()
    for own, names in settings.items():
        for each, places in tables_in(own, "settings").items():
            if each not in done:
                of = f" of {', '.join(f'`{name}`' for name in names)}" if each is own else ""
                heading = ", ".join(f"`{place}`" for place in places)
                parts.append(section(each, places).replace(heading, heading + of, 1))
                done.add(each)
    kinds = [[f"`{name}`", load_report(name).question] for name in REPORTS]
    return "\n\n".join([*parts, "## Kinds of report", grid(["kind", "question"], kinds)])


def columns(results: Path) -> str:
    """Returns the reference of all columns of the published tables in a folder of results."""
    tables: dict[tuple[str, str], dict[str, None]] = {}
    folders: dict[str, list[str]] = {}
    descriptions: dict[tuple[str, str], str] = {}
    for path in sameness.published_folders(results):
        if not (path / MANIFEST).exists():
            continue
        report = load_report(Folder(path).manifest["report"]["kind"])
        folders.setdefault(report.name, []).append(f"`{path.name}`")
        for file in sorted(path.glob("*.csv*")):
            key = report.name, file.name
            tables.setdefault(key, {}).update(dict.fromkeys(header(file)))
            for item in report.items:
                if item.name == file.name.partition(".")[0] or file.name in item.files:
                    descriptions[key] = item.description
    parts = [
        "# Columns of the tables",
        "Tables of results are CSV files with six significant digits. `NAME_low` and `NAME_high` are the "
        "ends of the 95 % interval of `NAME`. An empty field means that there is no number, and inf that it "
        "never happens.",
    ]
    for report_name, keys in groupby(sorted(tables), key=lambda key: key[0]):
        parts += [f"## {report_name.capitalize()}", f"In {listed(folders[report_name])}."]
        for key in keys:
            table = key[1].partition(".")[0]
            rows: dict[str, list[str]] = {}
            for column in tables[key]:
                base = str(_ENDS.fullmatch(column)[1])  # type: ignore[index]
                base = base if base in tables[key] else column
                if base in rows:
                    rows[base][0] += f", `{column}`"
                else:
                    rows[base] = [f"`{column}`", meaning(report_name, table, column) or ""]
            parts += [
                f"### `{key[1]}`",
                descriptions.get(key, ""),
                grid(["column", "meaning"], [*rows.values()]),
            ]
    return "\n\n".join(parts)


def header(file: Path) -> list[str]:
    """Returns the names of the columns of a CSV file, which may be compressed."""
    data = gzip.decompress(file.read_bytes()) if file.suffix == ".gz" else file.read_bytes()
    return next(csv.reader(data.decode().splitlines()[:1]))
