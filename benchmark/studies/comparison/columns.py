"""What readers call the columns of a comparison's tables, and what these mean."""

from functools import partial
from typing import Final

from benchmark.analysis.contrasts import NEITHER, VERDICTS
from benchmark.studies.item import COLUMNS, labelled_columns

ENDPOINTS: Final = ("success", "score")  # in the order in which they count
CELL: Final = "scenario condition learner"
DIFFERENCES: Final = "success_difference score_difference wrong_pings_difference"
EFFORT: Final = "settings_tried search_steps search_cpu_s"
WORDS: Final = {verdict: verdict for verdict in VERDICTS} | {NEITHER: "neither is shown to beat random"}
columns: Final = partial(labelled_columns, COLUMNS["comparison_labels"])
MEANINGS: Final = dict(COLUMNS["comparison"])
