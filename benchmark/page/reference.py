"""References in Markdown: every key of scenario and experiment files, and every column of published tables.

All of it is generated: keys, accepted values, defaults and meanings from the JSON schemas of the classes that
check a file, columns from the published files, and what they mean from the items of reports.
"""

import json
import re
from pathlib import Path
from typing import Any, Final, TypeAlias

import pandas as pd

from agents import ALGORITHMS, load_algorithm
from benchmark.experiments.schema import Declaration, Extension
from benchmark.page.build import published
from benchmark.reports import REPORTS, load_report
from benchmark.reports.folder import Folder
from benchmark.reports.item import Item
from envs import Scenario, load_scenario, scenario_names
from envs.inputs import Table
from envs.observations import OBSERVATIONS
from envs.words import listed

Schema: TypeAlias = dict[str, Any]
_REFERENCE: Final = re.compile(r'"\$ref": "#/\$defs/(\w+)"')


def sections(root: type[Table], at: str = "", level: int = 2) -> dict[str, str]:
    """Returns a section on a table and one on each table inside it, by the names of their classes.

    Args:
      root: The table.
      at: The key under which it stands; empty if it is a whole file.
      level: Of the headings.
    """
    schema = root.model_json_schema()
    tables: dict[str, Schema] = {root.__name__: schema} | schema.get("$defs", {})
    keys = {root.__name__: [at]}
    todo = [root.__name__]
    for name in todo:
        for key, value in tables[name]["properties"].items():
            full_key = f"{keys[name][0]}.{key}{_suffix(value)}".removeprefix(".")
            for inner in dict.fromkeys(_REFERENCE.findall(json.dumps(value))):
                value.setdefault("description", tables[inner]["description"])  # left out if it is the same
                if inner not in keys:
                    todo.append(inner)
                keys.setdefault(inner, []).append(full_key)
    return {name: _section(name, tables[name], keys[name], level) for name in todo}


def _suffix(schema: Schema) -> str:
    """Returns what follows a key that holds several tables: `.NAME`, or `[]` for a list."""
    inner = schema.get("additionalProperties")
    if isinstance(inner, dict):
        return f".NAME{_suffix(inner)}"
    return "[]" if schema.get("type") == "array" else ""


def _section(name: str, table: Schema, at: list[str], level: int) -> str:
    fields = {key: field for key, field in table["properties"].items() if key != "name" or at != [""]}
    kinds = _values(fields.get("kind", {}))
    title = ", ".join(f"`{key}`" for key in at if key) or "The file"
    rows = []
    for key, field in fields.items():
        default = "required" if key in table.get("required", ()) else _default(field)
        rows.append([f"`{key}`", _accepted(field), default, " ".join(field["description"].split())])
    parts = [
        f'<a id="table-{name.lower()}"></a>',
        f"{'#' * level} {': '.join(filter(None, [title, ' or '.join(map(str, kinds))]))}",
        table["description"],
        grid(["key", "accepted", "default", "meaning"], rows),
    ]
    return "\n\n".join(parts)


def _values(schema: Schema) -> list[object]:
    return [*schema.get("enum", [schema["const"]] if "const" in schema else [])]


def _accepted(schema: Schema) -> str:
    """Returns in words what a JSON schema accepts."""
    if "$ref" in schema:
        return f"[a table](#table-{schema['$ref'].rpartition('/')[2].lower()})"
    if alternatives := schema.get("anyOf", schema.get("oneOf")):
        words = (_accepted(schema) for schema in alternatives if schema.get("type") != "null")
        return " or ".join(dict.fromkeys(words))
    if values := _values(schema):
        return " or ".join(json.dumps(value) for value in values)
    match schema.get("type", ""):
        case "array":
            return _accepted_list(schema)
        case "object" if isinstance(schema.get("additionalProperties"), dict):
            return f"{_accepted(schema['additionalProperties'])} for each name"
        case "integer" | "number" as kind:
            word = "whole number" if kind == "integer" else "number"
            return word + _range(schema, "minimum", "maximum")
        case other:
            return {"object": "a table", "boolean": "true or false", "string": "text"}.get(other, "anything")


def _accepted_list(schema: Schema) -> str:
    if "prefixItems" in schema:
        items = [_accepted(item) for item in schema["prefixItems"]]
        return "[ROW, COLUMN]" if items == ["whole number"] * 2 else f"[{', '.join(items)}]"
    number = _range(schema, "minItems", "maxItems", " item").removeprefix(", ")
    inner = _accepted(schema["items"]).replace("[a table]", "[tables]")
    return f"list of {inner}{number and f' ({number})'}"


def _range(schema: Schema, least: str, most: str, unit: str = "") -> str:
    """Returns the bounds of a number in words, after a comma; empty if there are none."""
    words = {least: "at least", "exclusiveMinimum": "above", most: "at most", "exclusiveMaximum": "below"}
    bounds = {key: f"{schema[key]:,.10g}" for key in words if key in schema}
    if {*bounds} >= {least, most}:
        return f", {bounds[least]} to {bounds[most]}{unit and f'{unit}s'}"
    units = {key: unit if bound == "1" else unit and f"{unit}s" for key, bound in bounds.items()}
    return "".join(f", {words[key]} {bound}{units[key]}" for key, bound in bounds.items())


def _default(schema: Schema) -> str:
    value = schema.get("default")
    if isinstance(value, dict) and "$ref" in schema:
        return "its defaults"
    return "-" if value in (None, "", []) or isinstance(value, dict) else f"`{json.dumps(value)}`"


def grid(head: list[str], rows: list[list[str]]) -> str:
    """Returns a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '&#124;') for cell in line)} |" for line in lines)


def scenarios() -> str:
    """Returns the reference of scenario files."""
    shipped = [[f"`{name}`", load_scenario(name).description] for name in scenario_names()]
    parts = ["## Shipped scenarios", grid(["scenario", "what it is about"], shipped), "## Every key"]
    return "\n\n".join([*parts, *sections(Scenario, level=3).values()])


def experiments() -> str:
    """Returns the reference of experiment files, with the settings of every algorithm."""
    extension = sections(Extension)["Extension"].replace("## The file", "## A file that extends another")
    rows, users = [], dict[type[Table], list[str]]()
    for name in ALGORITHMS:
        algorithm = load_algorithm(name)
        table: type[Table] = algorithm.settings
        users.setdefault(table, []).append(f"`{name}`")
        forms = ", ".join(f"`{form}`" for form in OBSERVATIONS if form in algorithm.observations)
        link = f"[{table.__name__}](#table-{table.__name__.lower()})"
        rows.append([f"`{name}`", algorithm.family, forms, link])
    settings: dict[str, str] = {}
    for table, names in users.items():
        inner = sections(table, "settings")
        heading = f"## `settings` of {', '.join(names)}"
        inner[table.__name__] = inner[table.__name__].replace("## `settings`", heading, 1)
        settings |= {key: text for key, text in inner.items() if key not in settings}
    parts = [
        *sections(Declaration).values(),
        extension,
        "## Algorithms",
        grid(["algorithm", "family", "observations", "settings"], rows),
        *settings.values(),
        "## Kinds of report",
        grid(["kind", "question"], [[f"`{name}`", load_report(name).question] for name in REPORTS]),
    ]
    return "\n\n".join(parts)


def columns(results: Path) -> str:
    """Returns the reference of all columns of the published tables in a folder of results."""
    by_kind: dict[str, list[Path]] = {}
    for folder in published(results):
        by_kind.setdefault(Folder(folder).manifest["report"]["kind"], []).append(folder)
    parts = [
        "# Columns of the tables",
        "Tables of results are CSV files with six significant digits. `NAME_low` and `NAME_high` are the "
        "ends of the 95 % interval of `NAME`. An empty field means that there is no number, and inf that it "
        "never happens.",
    ]
    for kind, folders in by_kind.items():
        report = load_report(kind)
        parts += [f"## {report.name.capitalize()}", f"In {listed(f'`{folder.name}`' for folder in folders)}."]
        for item in report.items:
            file = item.file or f"{item.name}.csv"
            paths = [path for folder in folders if (path := folder / file).exists() and ".csv" in file]
            if paths:
                names = dict.fromkeys(column for path in paths for column in header(path))
                table = grid(["column", "meaning"], _described(item, [*names]))
                parts += [f"### `{file}`", item.description, table]
    return "\n\n".join(parts)


def _described(item: Item, names: list[str]) -> list[list[str]]:
    """Returns the columns of a table, each together with those of its interval, and what they mean."""
    rows: dict[str, list[str]] = {}
    for column in names:
        base = re.sub("_(low|high)$", "", column)
        if base in rows:
            rows[base][0] += f", `{column}`"
        else:
            rows[column] = [f"`{column}`", item.meaning(column) or ""]
    return [*rows.values()]


def header(file: Path) -> list[str]:
    """Returns the names of the columns of a CSV file, which may be compressed."""
    return [*pd.read_csv(file, nrows=0)]
