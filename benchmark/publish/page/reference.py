"""References in Markdown: every key of scenario and experiment files, every column of published tables."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

from tabulate import tabulate

from agents import ALGORITHMS, load_algorithm
from benchmark.experiments.schema import Declaration, Extension
from benchmark.publish.document import Document
from benchmark.publish.page.build import published
from benchmark.studies import STUDIES, load_study
from envs import Scenario
from envs.inputs import Table

Schema: TypeAlias = Mapping[str, Any]
_TYPES: Final = {"integer": "whole number", "string": "text", "boolean": "true or false", "object": "table"}
_BOUNDS: Final = {
    "minimum": "at least {:,}",
    "exclusiveMinimum": "above {:,}",
    "maximum": "at most {:,}",
    "exclusiveMaximum": "below {:,}",
    "minItems": "length at least {}",
    "maxItems": "length at most {:,}",
}


def keys(*roots: type[Table]) -> str:
    """Returns a section on each of these tables and on every table inside them, from their JSON schemas."""
    tables: dict[str, Schema] = {}
    for root in roots:
        schema = root.model_json_schema()
        tables |= {root.__name__: schema} | schema.get("$defs", {})
    sections = []
    for name, table in tables.items():
        rows = []
        for key, field in table["properties"].items():
            if (key, field.get("description")) != ("name", "The stem of the file."):
                default = field.get("default")
                shown = "-" if default in (None, "", [], {}) else f"`{json.dumps(default)}`"
                shown = "required" if key in table.get("required", ()) else shown
                inner = tables.get(str(field.get("$ref")).rpartition("/")[2], field)
                about = field.get("description") or inner["description"].partition("\n")[0]
                rows.append([f"`{key}`", accepted(field), shown, " ".join(about.split())])
        grid = tabulate(rows, ["key", "accepted", "default", "meaning"], "github")
        sections += [f'<a id="table-{name}"></a>', f"### {name}", table["description"], grid]
    return "\n\n".join(sections)


def accepted(schema: Schema) -> str:
    """Returns in words what a JSON schema accepts."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#table-{name})"
    if alternatives := schema.get("anyOf", schema.get("oneOf")):
        kinds = [accepted(kind) for kind in alternatives if kind.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if values := schema.get("enum", [schema["const"]] if "const" in schema else []):
        return " or ".join(map(json.dumps, values))
    if "prefixItems" in schema:
        return f"[{', '.join(map(accepted, schema['prefixItems']))}]"
    kind = str(schema.get("type", "anything"))
    words = f"list of {accepted(schema['items'])}" if kind == "array" else _TYPES.get(kind, kind)
    if isinstance(inner := schema.get("additionalProperties"), dict):
        words = f"for each name: {accepted(inner)}"
    return ", ".join([words, *(text.format(schema[key]) for key, text in _BOUNDS.items() if key in schema)])


def scenarios() -> str:
    """Returns the reference of scenario files."""
    return f"## Every key\n\n{keys(Scenario)}"


def experiments() -> str:
    """Returns the reference of experiment files, with the settings of every algorithm."""
    rows, settings = [], dict[type[Table], str]()
    for name in ALGORITHMS:
        algorithm = load_algorithm(name)
        settings[algorithm.settings] = link = algorithm.settings.__name__
        forms = ", ".join(f"`{form}`" for form in sorted(algorithm.observations))
        rows.append((f"`{name}`", algorithm.family, forms, f"[{link}](#table-{link})"))
    algorithms = tabulate(rows, ["algorithm", "family", "observations", "settings"], "github")
    kinds = [(f"`{name}`", load_study(name).question) for name in STUDIES]
    parts = ["## Every key", keys(Declaration, Extension), "## Algorithms", algorithms, keys(*settings)]
    return "\n\n".join([*parts, "## Kinds of report", tabulate(kinds, ["kind", "question"], "github")])


def columns(results: Path) -> str:
    """Returns the reference of all columns of the published tables in a folder of results."""
    parts = [
        "# Columns of the tables",
        "Tables of results are CSV files with six significant digits. `NAME_low` and `NAME_high` are the "
        "ends of the 95 % interval of `NAME`. An empty field means that there is no number, and inf that it "
        "never happens.",
    ]
    tables = dict[tuple[str, str, str], dict[str, str | None]]()
    for folder in published(results):
        document = Document(folder)
        for item in document.items:
            file = item.file or f"{item.name}.csv"
            if ".csv" in file and file in document.folder:
                names, study = document.folder.frame(file), document.study.name
                meanings = {f"`{name}`": item.meaning(str(name), study) for name in names}
                tables.setdefault((document.study.name, file, item.description), {}).update(meanings)
    for (report, name, description), meanings in tables.items():
        grid = tabulate(meanings.items(), ["column", "meaning"], "github")
        parts += [f"## `{name}` ({report})", description, grid]
    return "\n\n".join(parts)
