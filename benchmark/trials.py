"""What a search draws and what it has chosen."""

from benchmark.experiments.search import Choice as Choice
from benchmark.experiments.search import Choices as Choices
from benchmark.experiments.search import Chosen as Chosen
from benchmark.experiments.search import Finalist as Finalist
from benchmark.experiments.search import Search as Search
from benchmark.experiments.search import Span as Span
from benchmark.experiments.search import chosen_file as chosen_file
from benchmark.experiments.search import read_chosen as read_chosen
from benchmark.experiments.search import trials as trials
