"""A folder of published results, as its files have it: the source of all sentences, README and page.

Its manifest lists the digest of each of its files but README, which is made from them, and ends with its own
digest. So a file that was changed is refused.
"""

import gzip
import hashlib
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import pandas as pd

from benchmark.drawing.tables import read_csv
from benchmark.experiments import experiment_names, title_of
from benchmark.sealed import sealed, unsealed
from envs import InputError
from envs.inputs import check_all

MANIFEST: Final = "manifest.json"
README: Final = "README.md"
SPEED: Final = "speed"  # the folder of measured speed, which is no experiment's
SCORES: Final = "scores.csv.gz"  # every run of a comparison


@dataclass(eq=False)
class Folder:
    """A folder of results: its manifest, and its tables as read back from the CSV files."""

    path: Path

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        """What made the results; raises an InputError if it is missing, damaged or of other results."""
        if not (self.path / MANIFEST).is_file():
            raise InputError(f"{self.path}: there are no results; run the experiment with --report first.")
        with self.reading(MANIFEST):
            manifest = unsealed((self.path / MANIFEST).read_bytes())
            manifest["report"]["kind"], manifest["scenarios"].items(), manifest["files"].items()
            if self.path.name in experiment_names() and manifest["experiment"] != self.path.name:
                raise ValueError(f"it belongs to {manifest['experiment']}")
            if any(Path(file).name != file for file in manifest["files"]):
                raise ValueError("it lists files outside its folder")
        return manifest

    @cached_property
    def titles(self) -> dict[str, str]:
        """What readers call the learners, by their names in files."""
        return {
            f"{name}, {form}": title_of(variant.get("title") or name, form, variant.get("family", ""))
            for name, variant in self.manifest.get("algorithms", {}).items()
            for form in variant["settings"]
        }

    def title(self, learner: str) -> str:
        """Returns what readers call a learner."""
        return self.titles.get(learner, learner)

    def phrase(self, learner: str) -> str:
        """Returns the title for a sentence, in which a table gets an article."""
        title = self.title(learner)
        return f"the {title}" if re.search(r"\btable\b", title) else title

    def __contains__(self, file: str) -> bool:
        """Returns whether the manifest lists a file of this name."""
        return self.is_there and file in self.manifest["files"]

    @property
    def is_there(self) -> bool:
        """Whether there are results; their manifest may be missing, which raises an InputError when read."""
        return any((self.path / file).exists() for file in (MANIFEST, README))

    def content(self, file: str) -> bytes:
        """Returns a file's content; raises an InputError if it is not listed, missing or changed."""
        with self.reading(file):
            if (path := self.path / file).exists() and not path.is_file():
                raise ValueError("it is not a regular file")  # it may be a pipe that never ends
            content = path.read_bytes()
            if hashlib.sha256(content).hexdigest() != self.manifest["files"][file]:
                raise ValueError(f"{MANIFEST} lists another digest")
        return content

    def check(self) -> None:
        """Reads all files; an InputError names those that are missing or changed."""
        check_all(*(partial(self.content, file) for file in self.manifest["files"]))

    def figure(self, name: str) -> str:
        """Returns the name of the file with an item's figure; empty if there is none."""
        return file if (file := f"{name}.svg") in self else ""

    def frame(self, name: str) -> pd.DataFrame:
        """Returns a table by the name of its file, from which the ending `.csv` may be left out."""
        content = self.content(name if "." in name else f"{name}.csv")
        return read_csv(BytesIO(gzip.decompress(content) if name.endswith(".gz") else content))

    @contextmanager
    def reading(self, file: str = "") -> Iterator[None]:
        """Turns an error while files of this folder are read into an `InputError`."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # of whatever kind: files can come from anywhere
            fault = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            if isinstance(error, FileNotFoundError):
                fault = f"{Path(error.filename).name} is missing"
            what = f"damaged, or made by another version of this project ({fault})"
            raise InputError(f"{self.path / file}: {what}; make these results again.") from error


def write_manifest(path: Path, content: Mapping[str, Any]) -> None:
    """Writes the manifest of a folder, whose other files are there."""
    text = sealed({**content, "files": digests(path, but=(MANIFEST, README))}, indent=2)
    (path / MANIFEST).write_text(text, encoding="utf-8")


def digests(path: Path, but: Collection[str] = ()) -> dict[str, str]:
    """Returns the SHA-256 digest of each file of a folder, by name, but pages and hidden files."""
    names = sorted(file.name for file in path.iterdir() if file.is_file())
    return {
        name: hashlib.sha256((path / name).read_bytes()).hexdigest()
        for name in names
        if name not in (*but, "index.html") and not name.startswith(".")
    }


def with_titles(frame: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Returns a table with a column of learners, if it can have one, and with their titles."""
    frame = frame.copy()
    if {"variant", "observation"} <= {*frame} and "learner" not in frame:
        learners = frame["variant"] + ", " + frame["observation"]
        frame.insert([*frame].index("variant"), "learner", learners)
    for column in {"learner", "reference", "x", "y"} & {*frame}:
        frame[column] = frame[column].map(lambda name: titles.get(name, name), na_action="ignore")
    return frame
