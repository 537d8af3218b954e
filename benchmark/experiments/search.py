"""Old names, until nothing imports them."""

from benchmark.trials import Choice as Choice
from benchmark.trials import Choices as Choices
from benchmark.trials import Chosen as Chosen
from benchmark.trials import Finalist as Finalist
from benchmark.trials import Search as Search
from benchmark.trials import Space as Space
from benchmark.trials import Span as Span
from benchmark.trials import chosen_file as chosen_file
from benchmark.trials import read_chosen as read_chosen
from benchmark.trials import trials as trials
