"""Old names, until nothing imports them."""

from benchmark.specification import RunSpecification as RunSpecification
from benchmark.specification import evaluation_steps as evaluation_steps
from benchmark.specification import given_up as given_up
from benchmark.specification import solved as solved
