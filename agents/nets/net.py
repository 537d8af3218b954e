"""A multilayer perceptron in flat arrays, its gradient by hand, and Adam, in compiled code.

Its first layers may be applied to each person apart: their outputs are added, see `agents.people`.

Agents are trained one after the other, so that the numbers of an agent stay in the caches of a
core. Rows of weights are padded to a multiple of `LANES` with zeros, which stay zeros since their
gradients are.

Axis letters: O observations, P parameters with padding, L layers, B rows of a call, K people in an
observation (1 without layers for each), W the widest layer.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from agents.compiled import compiled
from agents.nets.arithmetic import LANES, Kind, Numbers, inlined, like, log, multiply, tanh
from agents.nets.stepping import draw
from agents.people import PeopleArguments, people_table
from envs import Model
from envs.arrays import Bools, Floats, Indices, Ints, Words
from envs.observations import ENCODINGS, SPARSE, observation_ones, observation_table

_BETAS = (0.9, 0.999)  # PyTorch's, which Stable-Baselines3 leaves
_MIN_MOMENT = 1e-30  # smaller moments count as zero: denormal numbers would slow every step down


class Net(NamedTuple):
    """A net's shape, parameters, what it reads, and room for calls; rows have W numbers."""

    n_inputs: int
    n_outputs: Ints  # (L,)
    width: Ints  # (L,) of the outputs, with padding
    weights_at: Ints  # (L,) of weights (inputs with padding, width)
    biases_at: Ints  # (L,)
    end: int  # the index after its last parameter
    is_relu: bool  # whether each layer but the last is followed by ReLU, else by tanh
    n_people: int  # K
    n_shared: int  # how many layers are applied to each person, before their outputs are added
    ones: Indices  # (O, ones) which inputs are 1, in sparse forms; else (O, 0)
    table: Numbers  # (O, K * inputs) in other forms; else (O, 0)
    n_rows: int  # B
    stride: int  # W
    observed: Indices  # (B,)
    rows: Numbers  # (B * K * inputs,)
    hidden: Numbers  # (L * B * K * W,) outputs of each layer after activation
    slopes: Numbers  # (L * B * K * W,) of the loss by the outputs of each layer before activation
    sums: Numbers  # (B * W,) of the outputs for people
    transposed: Numbers  # (W * W,) weights
    zeros: Numbers  # (W,)


class Values(NamedTuple):
    """The largest outputs of a net, as far as they are computed."""

    largest: Numbers  # (O,)
    is_known: Bools  # (O,)


class Batch(NamedTuple):
    """The observations of a mini-batch, and each of them once."""

    observed: Indices  # (B,)
    distinct: Indices  # (B,)
    row: Ints  # (O,) the index of an observation among the distinct ones


class Parameters(NamedTuple):
    """The parameters of an agent's nets, and Adam's memory and settings (Kingma & Ba 2015)."""

    values: Numbers  # (P,)
    gradient: Numbers  # (P,)
    first: Numbers  # (P,) moments
    second: Numbers  # (P,)
    sums: Numbers  # (256,) partial sums of a norm, which fill vector registers
    betas: Floats  # (2,) powers of Adam's betas
    n_steps: Ints  # (1,)
    learning_rate: float
    epsilon: float
    max_norm: float  # of gradients; longer ones are cut


def room_for_values(n_observations: int, kind: Kind) -> Values:
    """Returns room for the largest outputs of a net."""
    return Values(np.zeros(n_observations, kind), np.zeros(n_observations, np.bool_))


def room_for_batch(n_rows: int, n_observations: int) -> Batch:
    """Returns room for a mini-batch."""
    observed, distinct = np.zeros((2, n_rows), np.int32)
    return Batch(observed, distinct, np.zeros(n_observations, np.int64))


Inputs = tuple[int, Indices, Numbers]  # how many, and the fields `ones` and `table` of `Net`


def inputs_of(model: Model, observation: str, kind: Kind, people: PeopleArguments | None) -> Inputs:
    """Returns what nets read of a model."""
    n = model.n_observations
    if people:
        seen = people_table(model, observation, people).astype(kind)
    elif ENCODINGS[observation] in SPARSE:
        ones, n_inputs = observation_ones(model, observation)
        return n_inputs, ones.astype(np.int32), np.empty((n, 0), kind)
    else:
        seen = observation_table(model, observation).astype(kind)
    return seen.shape[-1], np.empty((n, 0), np.int32), seen.reshape(n, -1)


def net_of(
    inputs: Inputs,
    n_outputs: Sequence[int],
    first: int,
    n_rows: int,
    *,
    is_relu: bool,
    n_shared: int,
) -> Net:
    """Returns a net whose parameters begin at the index `first`, for calls with at most B rows."""
    n_inputs, ones, table = inputs
    outputs = np.array(n_outputs)
    width = -(-outputs // LANES) * LANES
    sizes = np.array([n_inputs, *width[:-1]]) * width
    biases_at = first + np.cumsum(sizes + width) - width
    stride = int(width.max())
    n_people = table.shape[1] // n_inputs if n_shared else 1
    n_hidden = width.size * n_rows * n_people * stride
    n_read = n_rows * n_people * n_inputs
    rooms = n_read, n_hidden, n_hidden, n_rows * stride, stride**2, stride
    return Net(
        n_inputs,
        outputs,
        width,
        biases_at - sizes,
        biases_at,
        int(biases_at[-1] + width[-1]),
        is_relu,
        n_people,
        n_shared,
        ones,
        table,
        n_rows,
        stride,
        np.zeros(n_rows, np.int32),
        *(np.zeros(n, table.dtype) for n in rooms),
    )


def unpadded(net: Net, values: Numbers) -> Iterator[Numbers]:
    """Returns weights (inputs, outputs) and biases (outputs,) of each layer in turn, as views."""
    n_ins = [net.n_inputs, *net.n_outputs[:-1]]
    for n_in, n_out, width, w, b in zip(n_ins, *net[1:5], strict=True):
        yield values[w : w + n_in * width].reshape(n_in, width)[:, :n_out]
        yield values[b : b + n_out]


@inlined
def list_distinct(batch: Batch, n_rows: int) -> int:
    """Lists the first observations of a mini-batch, each once, and returns how many there are."""
    observed = batch.observed[:n_rows]
    for o in observed:
        batch.row[o] = -1
    n_distinct = 0
    for o in observed:
        if batch.row[o] < 0:
            batch.row[o], batch.distinct[n_distinct] = n_distinct, o
            n_distinct += 1
    return n_distinct


@inlined
def forward(net: Net, values: Numbers, observed: Indices, n_rows: int) -> int:
    """Computes the outputs for some observations; returns where they begin in `net.hidden`."""
    hidden = net.hidden
    stride = net.stride
    size = net.n_rows * net.n_people * net.stride
    n_here = n_rows * net.n_people
    n_in = net.n_inputs
    n_read = net.table.shape[1]
    source = net.rows
    source_at = 0
    row = n_in
    for r in range(n_rows):
        _copy(net.rows[r * n_read : (r + 1) * n_read], net.table[observed[r]])
    for i in range(len(net.width)):
        width = net.width[i]
        weights_at = net.weights_at[i]
        biases_at = net.biases_at[i]
        if i > 0:
            source = hidden
            source_at = (i - 1) * size
            row = stride
            for r in range(n_here):
                _activate(hidden[source_at + r * row : source_at + r * row + n_in], net.is_relu)
            if i == net.n_shared:
                n_here = n_rows
                source = net.sums
                source_at = 0
                for r in range(n_rows):
                    first = (i - 1) * size + r * net.n_people * stride
                    total = net.sums[r * stride : (r + 1) * stride]
                    _sum_rows(hidden, first, stride, net.n_people, total)
        if i == 0 and net.ones.shape[1] > 0:
            for r in range(n_rows):
                total = hidden[r * stride : r * stride + width]
                _copy(total, values[biases_at : biases_at + width])
                for block in range(net.ones.shape[1]):
                    at = weights_at + net.ones[observed[r], block] * width
                    _add(total, values[at : at + width])
        else:
            inputs = (source, source_at, row, 1)
            weights = (values, weights_at, width, 1)
            output = hidden, i * size, stride, 1
            multiply((n_here, width, n_in), (values, biases_at), inputs, weights, output)
        n_in = width
    return (len(net.width) - 1) * size


@inlined
def _repeat_for_people(net: Net, at: int, n_rows: int) -> None:
    """Copies the slopes by a sum to all people in it, from the last: sums are in earlier rows."""
    stride = net.stride
    slopes = net.slopes
    for r in range(n_rows - 1, -1, -1):
        person_at = at + r * stride
        sum_at = at + r // net.n_people * stride
        _copy(slopes[person_at : person_at + stride], slopes[sum_at : sum_at + stride])


@inlined
def best_output(net: Net, at: int) -> int:
    """Returns the first of the largest outputs, of those that begin at an index of `net.hidden`."""
    best = 0
    for j in range(1, net.n_outputs[-1]):
        if net.hidden[at + j] > net.hidden[at + best]:
            best = j
    return best


@inlined
def compute_values(net: Net, parameters: Numbers, observed: Indices, values: Values) -> None:
    """Fills missing values; index O (terminal) is skipped."""
    lacking = net.observed
    n_lacking = 0
    for i in range(len(observed) + 1):
        if n_lacking == len(lacking) or (i == len(observed) and n_lacking):
            at = forward(net, parameters, lacking, n_lacking)
            for r in range(n_lacking):
                row = at + r * net.stride
                values.largest[lacking[r]] = net.hidden[row + best_output(net, row)]
            n_lacking = 0
        if (
            i < len(observed)
            and observed[i] < len(values.largest)
            and not values.is_known[observed[i]]
        ):
            lacking[n_lacking], values.is_known[observed[i]] = observed[i], True
            n_lacking += 1


@inlined
def backward(net: Net, parameters: Parameters, observed: Indices, n_rows: int) -> None:
    """Computes a loss's gradient, after `forward`, from its slopes by the outputs."""
    values = parameters.values
    gradient = parameters.gradient
    hidden = net.hidden
    slopes = net.slopes
    transposed = net.transposed
    stride = net.stride
    zeros = (net.zeros, 0)
    n_here = n_rows
    size = net.n_rows * net.n_people * stride
    for i in range(len(net.width) - 1, 0, -1):
        width = net.width[i]
        n_in = net.width[i - 1]
        n_out = net.n_outputs[i]
        weights_at = net.weights_at[i]
        output_at = i * size
        input_at = (i - 1) * size
        _sum_rows(
            slopes, output_at, stride, n_here, gradient[net.biases_at[i] : net.biases_at[i] + width]
        )
        source = hidden
        source_at = input_at
        if i == net.n_shared:
            source = net.sums
            source_at = 0
        activated = (source, source_at, 1, stride)
        slope = (slopes, output_at, stride, 1)
        multiply((n_in, width, n_here), zeros, activated, slope, (gradient, weights_at, width, 1))
        for k in range(n_in):
            for j in range(n_out):
                transposed[j * n_in + k] = values[weights_at + k * width + j]
        weights = (transposed, 0, n_in, 1)
        multiply((n_here, n_in, n_out), zeros, slope, weights, (slopes, input_at, stride, 1))
        if i == net.n_shared:
            n_here = n_rows * net.n_people
            _repeat_for_people(net, input_at, n_here)
        for r in range(n_here):
            at = input_at + r * stride
            _slope_of_activation(slopes[at : at + n_in], hidden[at : at + n_in], net.is_relu)
    width = net.width[0]
    n_inputs = net.n_inputs
    weights_at = net.weights_at[0]
    biases_at = net.biases_at[0]
    _sum_rows(slopes, 0, stride, n_here, gradient[biases_at : biases_at + width])
    if net.ones.shape[1] > 0:
        clear(gradient[weights_at:biases_at])
        for r in range(n_rows):
            for block in range(net.ones.shape[1]):
                at = weights_at + net.ones[observed[r], block] * width
                _add(gradient[at : at + width], slopes[r * stride : r * stride + width])
    else:
        rows = (net.rows, 0, 1, n_inputs)
        slope = (slopes, 0, stride, 1)
        multiply((n_inputs, width, n_here), zeros, rows, slope, (gradient, weights_at, width, 1))


@inlined
def learn(parameters: Parameters) -> None:
    """Clips the gradient to a norm, and makes a step of Adam."""
    values, gradient, first, second, sums, betas, n_steps, learning_rate, epsilon, max_norm = (
        parameters
    )
    n_steps[0] += 1
    betas[0] *= _BETAS[0]
    betas[1] *= _BETAS[1]
    clear(sums)
    for start in range(0, len(gradient), len(sums)):
        some = gradient[start : start + len(sums)]
        for i in range(len(some)):
            sums[i] += some[i] * some[i]
    square_norm = 0.0
    for partial_sum in sums:
        square_norm += partial_sum
    scale = like(values, min(max_norm / (math.sqrt(square_norm) + 1e-6), 1.0))
    rate = like(values, learning_rate / (1.0 - betas[0]))
    correction = like(values, 1.0 / math.sqrt(1.0 - betas[1]))
    new = like(values, 1.0 - _BETAS[0])
    new_square = like(values, 1.0 - _BETAS[1])
    old_square = like(values, _BETAS[1])
    offset = like(values, epsilon)
    least = like(values, _MIN_MOMENT)
    zero = like(values, 0)
    for i in range(len(values)):
        slope = gradient[i] * scale
        moment = first[i] + (slope - first[i]) * new
        square = second[i] * old_square + slope * slope * new_square
        moment = zero if abs(moment) < least else moment
        square = zero if square < least else square
        first[i], second[i] = moment, square
        values[i] -= rate * moment / (math.sqrt(square) * correction + offset)


@inlined
def _copy(target: Numbers, source: Numbers) -> None:
    for i in range(len(target)):
        target[i] = source[i]


# numba compiles the following loops faster than slices.
@inlined
def clear(numbers: Numbers) -> None:
    """Sets numbers to zero."""
    zero = like(numbers, 0)
    for i in range(len(numbers)):
        numbers[i] = zero


@inlined
def _add(total: Numbers, numbers: Numbers) -> None:
    for i in range(len(total)):
        total[i] += numbers[i]


@inlined
def _sum_rows(rows: Numbers, first: int, stride: int, n_rows: int, total: Numbers) -> None:
    clear(total)
    for r in range(n_rows):
        _add(total, rows[first + r * stride : first + r * stride + len(total)])


@inlined
def _activate(row: Numbers, is_relu: bool) -> None:
    if is_relu:
        zero = like(row, 0)
        for i in range(len(row)):
            row[i] = zero if row[i] < zero else row[i]
    else:
        tanh(row)


@inlined
def _slope_of_activation(slopes: Numbers, activated: Numbers, is_relu: bool) -> None:
    """Multiplies slopes by the derivative of the activation, given its values."""
    zero = like(slopes, 0)
    one = like(slopes, 1)
    if is_relu:
        for i in range(len(slopes)):
            slopes[i] = zero if activated[i] <= zero else slopes[i]
    else:
        for i in range(len(slopes)):
            slopes[i] *= one - activated[i] * activated[i]


@compiled
def read(net: Net, values: Numbers, outputs: Numbers) -> None:
    """Computes the outputs for all observations, (O, outputs)."""
    n_observations, n_outputs = outputs.shape
    for start in range(0, n_observations, net.n_rows):
        n_rows = min(net.n_rows, n_observations - start)
        for r in range(n_rows):
            net.observed[r] = start + r
        at = forward(net, values, net.observed, n_rows)
        for r in range(n_rows):
            _copy(
                outputs[start + r],
                net.hidden[at + r * net.stride : at + r * net.stride + n_outputs],
            )


@compiled
def draw_uniform(net: Net, values: Numbers, stream: Words) -> None:
    """Draws weights and biases as PyTorch does: uniform, bounded by 1 / sqrt(inputs)."""
    n_in = net.n_inputs
    for i in range(len(net.width)):
        bound = 1.0 / math.sqrt(n_in)
        for row in range(n_in + 1):
            at = net.biases_at[i] if row == n_in else net.weights_at[i] + row * net.width[i]
            for j in range(net.n_outputs[i]):
                values[at + j] = (2.0 * draw(stream) - 1.0) * bound
        n_in = net.n_outputs[i]


@compiled
def draw_orthogonal(net: Net, values: Numbers, stream: Words, gains: tuple[float, float]) -> None:
    """Draws orthogonal weights as PyTorch does, with gains; biases are 0.

    The rows or columns, whichever are fewer, are normal numbers, made orthogonal by Gram and
    Schmidt's method (Golub & Van Loan 2013, section 5.2.8) and as long as the gain.
    """
    n_in = net.n_inputs
    for i in range(len(net.width)):
        n_out = net.n_outputs[i]
        width = net.width[i]
        at = net.weights_at[i]
        vectors = np.empty((min(n_in, n_out), max(n_in, n_out)))
        for v in range(len(vectors)):
            vector = vectors[v]
            for j in range(len(vector)):
                vector[j] = _draw_normal(stream)
            for w in range(v):
                _add_times(vector, vectors[w], -_product(vectors[w], vector))
            _add_times(vector, vector, 1.0 / math.sqrt(_product(vector, vector)) - 1.0)
        gain = gains[1] if i == len(net.width) - 1 else gains[0]
        for row in range(n_in):
            for j in range(n_out):
                values[at + row * width + j] = gain * (
                    vectors[j, row] if n_out <= n_in else vectors[row, j]
                )
        n_in = n_out


@inlined
def _draw_normal(stream: Words) -> float:
    """Draws a standard normal number by Marsaglia's polar method, one of the two."""
    while True:
        x = 2.0 * draw(stream) - 1.0
        y = 2.0 * draw(stream) - 1.0
        square = x * x + y * y
        if 0.0 < square < 1.0:
            return float(x * math.sqrt(-2.0 * log(square) / square))


@inlined
def _product(one: Numbers, other: Numbers) -> float:
    total = 0.0
    for i in range(len(one)):
        total += one[i] * other[i]
    return total


@inlined
def _add_times(total: Numbers, numbers: Numbers, factor: float) -> None:
    for i in range(len(total)):
        total[i] += factor * numbers[i]
