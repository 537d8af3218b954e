"""Studies: what is computed, drawn and said of an experiment. `STUDIES` maps a name to a study.

A study is imported when it is asked for. Studies, and further items of one, can live in any module that
Python can import.
"""

from benchmark.studies.data import Data as Data
from benchmark.studies.item import Item as Item
from benchmark.studies.item import item as item
from benchmark.studies.study import STUDIES as STUDIES
from benchmark.studies.study import Declared as Declared
from benchmark.studies.study import Report as Report
from benchmark.studies.study import Study as Study
from benchmark.studies.study import load_study as load_study
from benchmark.studies.study import report_of as report_of
from benchmark.studies.study import runs_of as runs_of
