"""The page's script: all of its modules, put together in the order in which they need each other."""

import re
from pathlib import Path

from benchmark.page import script

MODULES = Path(script.__file__).parent / "templates" / "script"


def test_script_has_all_modules_each_after_its_imports() -> None:
    text = script.read()
    places = {}
    for path in MODULES.glob("*.js"):
        first = path.read_text(encoding="utf-8").splitlines()[0]
        assert first.startswith("// "), f"{path.name} does not say what it is for"
        assert text.count(first) == 1
        places[path.name] = text.index(first)
    for name, place in places.items():
        for needed in re.findall(r'"\./(\w+\.js)"', (MODULES / name).read_text(encoding="utf-8")):
            assert places[needed] < place, f"{name} stands before {needed}"
    assert not re.findall(r"^(?:import|export)\b", text, re.MULTILINE)


def test_names_that_modules_share_are_exported_and_differ() -> None:
    exported: dict[str, str] = {}
    for path in MODULES.glob("*.js"):
        text = path.read_text(encoding="utf-8")
        for names in re.findall(r"^export (?:const|class|function) (?:\{ )?([\w, ]+)", text, re.MULTILINE):
            exported |= dict.fromkeys(re.findall(r"\w+", names), path.name)
    for path in MODULES.glob("*.js"):
        for names, source in re.findall(r'import \{ ([\w, ]+) \} from "\./(\w+\.js)"', path.read_text()):
            for name in names.split(", "):
                assert exported.get(name) == source, f"{path.name} imports {name} from {source}"
