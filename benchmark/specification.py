"""A run: everything that its result depends on, and when it is evaluated."""

from benchmark.experiments.run import RunSpecification as RunSpecification
from benchmark.experiments.run import evaluation_steps as evaluation_steps
from benchmark.experiments.run import given_up as given_up
from benchmark.experiments.run import solved as solved
