"""What any kind of report declared, until each study has its own table."""

from benchmark.experiments.schema import Reporting
from benchmark.studies.study import Declared


class Interim(Reporting, Declared):
    """All keys."""
