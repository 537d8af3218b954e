"""Old names, until nothing imports them."""

from benchmark.experiment import digest_of_search as digest_of_search
