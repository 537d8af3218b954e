"""A multilayer perceptron of one agent in flat arrays, its gradient by hand, and Adam, in compiled code.

The numbers of an agent stay in the caches of a core from one update to the next, so agents are trained one
after the other. Rows of weights are padded with zeros to a multiple of `LANES`. Zeros they stay, since their
gradients are zero.

Axis letters: O observations, P parameters with padding, L layers, B rows of a call, W the widest layer.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.nets.arithmetic import LANES, Numbers, inlined, like, log, multiply, tanh
from agents.nets.walk import draw
from envs import Model
from envs.observations import observation_blocks, observation_table

_BETAS: Final = (0.9, 0.999)  # PyTorch's, which Stable-Baselines3 leaves
_LEAST: Final = 1e-30  # smaller moments count as zero: denormal numbers would slow every step down
_SUMS: Final = 256  # partial sums of a norm, so that they fill vector registers


class Layers(NamedTuple):
    """The shape of a net, and where its parameters lie; activation follows each layer but the last."""

    n_inputs: int
    n_outputs: NDArray[np.int64]  # (L,)
    width: NDArray[np.int64]  # (L,) of the outputs, with padding
    weights_at: NDArray[
        np.int64
    ]  # (L,) of the (inputs, width) weights; those of inputs that are padding are zero
    biases_at: NDArray[np.int64]  # (L,)
    is_relu: bool  # else tanh


class Inputs(NamedTuple):
    """What nets read of each observation: one of the two arrays, while the other has no columns."""

    places: NDArray[np.int32]  # (O, parts) which inputs are 1, if all others are 0
    rows: Numbers  # (O, inputs)


class Scratch(NamedTuple):
    """What `forward` leaves and `backward` reads; rows are W apart."""

    observed: NDArray[np.int32]  # (B,)
    rows: Numbers  # (B * inputs,)
    hidden: Numbers  # (L * B * W,) outputs of each layer after activation
    slopes: Numbers  # (L * B * W,) of the loss by the outputs of each layer before activation
    transposed: Numbers  # (W * W,) weights
    zeros: Numbers  # (W,)
    n_rows: int  # B
    stride: int  # W


class Merged(NamedTuple):
    """The observations of a mini-batch, each once."""

    distinct: NDArray[np.int32]  # (B,)
    place: NDArray[np.int64]  # (O,) where an observation is among them
    met_at: NDArray[np.int64]  # (O,) the last call in which it was
    n_calls: NDArray[np.int64]  # (1,)


class Parameters(NamedTuple):
    """The parameters of an agent's nets, and Adam's memory (Kingma & Ba 2015)."""

    values: Numbers  # (P,)
    gradient: Numbers  # (P,)
    first: Numbers  # (P,) moments
    second: Numbers  # (P,)
    sums: Numbers  # (256,) room for a norm
    betas: NDArray[np.float64]  # (2,) powers of Adam's betas
    n_steps: NDArray[np.int64]  # (1,)


def layers_of(n_inputs: int, hidden: Sequence[int], n_outputs: int, first: int, *, is_relu: bool) -> Layers:
    """Returns the shape of a net whose parameters begin at a place of the flat arrays."""
    sizes = [n_inputs, *hidden, n_outputs]
    weights_at, biases_at, n_in = [], [], n_inputs
    for n_out in sizes[1:]:
        width = _padded(n_out)
        weights_at.append(first)
        biases_at.append(first + n_in * width)
        first, n_in = biases_at[-1] + width, width
    return Layers(
        n_inputs=n_inputs,
        n_outputs=np.array(sizes[1:]),
        width=np.array([_padded(n) for n in sizes[1:]]),
        weights_at=np.array(weights_at),
        biases_at=np.array(biases_at),
        is_relu=is_relu,
    )


def end_of(layers: Layers) -> int:
    """Returns where the parameters of a net end."""
    return int(layers.biases_at[-1] + layers.width[-1])


def inputs_of(model: Model, observation: str, kind: type[np.floating[Any]]) -> tuple[Inputs, int]:
    """Returns what nets read of each observation, and the number of their inputs."""
    none = (model.n_observations, 0)
    if observation == "one_hot":
        places = observation_blocks(model).astype(np.int32)
        return Inputs(places, np.empty(none, kind)), sum(part.size for part in model.parts)
    rows = observation_table(model, observation).astype(kind)
    return Inputs(np.empty(none, np.int32), rows), rows.shape[1]


def scratch_of(layers: Layers, n_rows: int, kind: type[np.floating[Any]]) -> Scratch:
    """Returns arrays for calls with at most so many rows."""
    stride = int(layers.width.max())
    outputs = len(layers.width) * n_rows * stride
    sizes = n_rows * layers.n_inputs, outputs, outputs, stride * stride, stride
    rows, hidden, slopes, transposed, zeros = (np.zeros(size, kind) for size in sizes)
    observed = np.zeros(n_rows, np.int32)
    return Scratch(observed, rows, hidden, slopes, transposed, zeros, n_rows, stride)


def parameters_of(n_parameters: int, kind: type[np.floating[Any]]) -> Parameters:
    """Returns parameters that are zero."""
    values, gradient, first, second = (np.zeros(n_parameters, kind) for _ in range(4))
    return Parameters(
        values, gradient, first, second, np.zeros(_SUMS, kind), np.ones(2), np.zeros(1, np.int64)
    )


def merged_of(n_observations: int, n_rows: int) -> Merged:
    """Returns room for `merge`."""
    place, met_at = np.zeros(n_observations, np.int64), np.zeros(n_observations, np.int64)
    return Merged(np.zeros(n_rows, np.int32), place, met_at, np.zeros(1, np.int64))


def unpadded(layers: Layers, values: Numbers) -> Iterator[Numbers]:
    """Returns weights (inputs, outputs) and biases (outputs,) of each layer in turn, as views."""
    n_ins = [layers.n_inputs, *layers.n_outputs[:-1]]
    for n_in, n_out, width, w, b in zip(n_ins, *layers[1:5], strict=True):
        yield values[w : w + n_in * width].reshape(n_in, width)[:, :n_out]
        yield values[b : b + n_out]


def _padded(n: int) -> int:
    return math.ceil(n / LANES) * LANES


@inlined
def merge(observed: NDArray[np.int32], merged: Merged) -> int:
    """Lists the observations of a mini-batch (B,), each once, and returns how many there are."""
    n_distinct = 0
    merged.n_calls[0] += 1
    for o in observed:
        if merged.met_at[o] != merged.n_calls[0]:
            merged.met_at[o], merged.place[o], merged.distinct[n_distinct] = merged.n_calls[0], n_distinct, o
            n_distinct += 1
    return n_distinct


@inlined
def forward(
    layers: Layers,
    inputs: Inputs,
    values: Numbers,
    observed: NDArray[np.int32],
    n_rows: int,
    scratch: Scratch,
) -> int:
    """Computes the outputs for some observations.

    Args:
      layers: The net.
      inputs: What it reads.
      values: Its parameters.
      observed: The observations, at least `n_rows`.
      n_rows: Their number, at most B.
      scratch: Where to write.

    Returns:
      Where the first row of the outputs is in `scratch.hidden`; rows are W apart.
    """
    hidden, stride, size = scratch.hidden, scratch.stride, scratch.n_rows * scratch.stride
    width, n_inputs = layers.width[0], layers.n_inputs
    weights_at, biases_at = layers.weights_at[0], layers.biases_at[0]
    if inputs.places.shape[1] > 0:
        biases = values[biases_at : biases_at + width]
        for r in range(n_rows):
            total = hidden[r * stride : r * stride + width]
            copy(total, biases)
            for part in range(inputs.places.shape[1]):
                at = weights_at + inputs.places[observed[r], part] * width
                _add(total, values[at : at + width])
    else:
        for r in range(n_rows):
            copy(scratch.rows[r * n_inputs : (r + 1) * n_inputs], inputs.rows[observed[r]])
        rows, weights = (scratch.rows, 0, n_inputs, 1), (values, weights_at, width, 1)
        multiply((n_rows, width, n_inputs), (values, biases_at), rows, weights, (hidden, 0, stride, 1))
    for i in range(1, len(layers.width)):
        before, here = (i - 1) * size, i * size
        for r in range(n_rows):
            _activate(hidden[before + r * stride : before + r * stride + width], layers.is_relu)
        n_in, width = width, layers.width[i]
        start, weights = (values, layers.biases_at[i]), (values, layers.weights_at[i], width, 1)
        activated, output = (hidden, before, stride, 1), (hidden, here, stride, 1)
        multiply((n_rows, width, n_in), start, activated, weights, output)
    return (len(layers.width) - 1) * size


@inlined
def backward(
    layers: Layers,
    inputs: Inputs,
    parameters: Parameters,
    observed: NDArray[np.int32],
    n_rows: int,
    scratch: Scratch,
) -> None:
    """Computes the gradient of a loss, after `forward` for the same observations.

    Args:
      layers: The net.
      inputs: What it reads.
      parameters: Its parameters; their gradient is written.
      observed: The observations, at least `n_rows`.
      n_rows: Their number, at most B.
      scratch: As `forward` left it; its `slopes` have those of the last layer where its outputs are.
    """
    values, gradient = parameters.values, parameters.gradient
    hidden, slopes, transposed = scratch.hidden, scratch.slopes, scratch.transposed
    stride, size, zeros = scratch.stride, scratch.n_rows * scratch.stride, (scratch.zeros, 0)
    for i in range(len(layers.width) - 1, 0, -1):
        width, n_in, n_out = layers.width[i], layers.width[i - 1], layers.n_outputs[i]
        weights_at, here, before = layers.weights_at[i], i * size, (i - 1) * size
        _sum_rows(slopes, here, stride, n_rows, gradient[layers.biases_at[i] : layers.biases_at[i] + width])
        activated, slope = (hidden, before, 1, stride), (slopes, here, stride, 1)
        multiply((n_in, width, n_rows), zeros, activated, slope, (gradient, weights_at, width, 1))
        for k in range(n_in):
            for j in range(n_out):
                transposed[j * n_in + k] = values[weights_at + k * width + j]
        weights = (transposed, 0, n_in, 1)
        multiply((n_rows, n_in, n_out), zeros, slope, weights, (slopes, before, stride, 1))
        for r in range(n_rows):
            at = before + r * stride
            _slope_of_activation(slopes[at : at + n_in], hidden[at : at + n_in], layers.is_relu)
    width, n_inputs = layers.width[0], layers.n_inputs
    weights_at, biases_at = layers.weights_at[0], layers.biases_at[0]
    _sum_rows(slopes, 0, stride, n_rows, gradient[biases_at : biases_at + width])
    if inputs.places.shape[1] > 0:
        clear(gradient[weights_at:biases_at])
        for r in range(n_rows):
            for part in range(inputs.places.shape[1]):
                at = weights_at + inputs.places[observed[r], part] * width
                _add(gradient[at : at + width], slopes[r * stride : r * stride + width])
    else:
        rows, slope = (scratch.rows, 0, 1, n_inputs), (slopes, 0, stride, 1)
        multiply((n_inputs, width, n_rows), zeros, rows, slope, (gradient, weights_at, width, 1))


@inlined
def learn(parameters: Parameters, learning_rate: float, epsilon: float, max_norm: float) -> None:
    """Clips the gradient to a norm, and makes a step of Adam."""
    values, gradient, first, second, sums, betas, n_steps = parameters
    n_steps[0] += 1
    betas[0] *= _BETAS[0]
    betas[1] *= _BETAS[1]
    scale = like(values, min(max_norm / (_norm(gradient, sums) + 1e-6), 1.0))
    rate = like(values, learning_rate / (1.0 - betas[0]))
    correction = like(values, 1.0 / math.sqrt(1.0 - betas[1]))
    new, new_square = like(values, 1.0 - _BETAS[0]), like(values, 1.0 - _BETAS[1])
    old_square, offset = like(values, _BETAS[1]), like(values, epsilon)
    least, zero = like(values, _LEAST), like(values, 0)
    for i in range(len(values)):
        slope = gradient[i] * scale
        moment = first[i] + (slope - first[i]) * new
        square = second[i] * old_square + slope * slope * new_square
        moment = zero if abs(moment) < least else moment
        square = zero if square < least else square
        first[i], second[i] = moment, square
        values[i] -= rate * moment / (math.sqrt(square) * correction + offset)


@inlined
def _norm(numbers: Numbers, sums: Numbers) -> float:
    """Returns the Euclidean norm, by partial sums that fill vector registers."""
    clear(sums)
    for start in range(0, len(numbers), len(sums)):
        some = numbers[start : start + len(sums)]
        for i in range(len(some)):
            sums[i] += some[i] * some[i]
    total = 0.0
    for i in range(len(sums)):
        total += sums[i]
    return math.sqrt(total)


@inlined
def copy(target: Numbers, source: Numbers) -> None:
    """Copies numbers; compiled far faster than by a slice."""
    for i in range(len(target)):
        target[i] = source[i]


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
    zero, one = like(slopes, 0), like(slopes, 1)
    if is_relu:
        for i in range(len(slopes)):
            slopes[i] = zero if activated[i] <= zero else slopes[i]
    else:
        for i in range(len(slopes)):
            slopes[i] *= one - activated[i] * activated[i]


@compiled(nogil=True)
def read(layers: Layers, inputs: Inputs, values: Numbers, scratch: Scratch, outputs: Numbers) -> None:
    """Computes the outputs for all observations, (O, outputs)."""
    n_observations, n_outputs = outputs.shape
    for start in range(0, n_observations, scratch.n_rows):
        n_rows = min(scratch.n_rows, n_observations - start)
        for r in range(n_rows):
            scratch.observed[r] = start + r
        at = forward(layers, inputs, values, scratch.observed, n_rows, scratch)
        for r in range(n_rows):
            row = at + r * scratch.stride
            copy(outputs[start + r], scratch.hidden[row : row + n_outputs])


@compiled()
def draw_uniform(layers: Layers, values: Numbers, stream: NDArray[np.uint64]) -> None:
    """Draws weights and biases as PyTorch's linear layers do: uniform, bounded by 1 / sqrt(inputs)."""
    n_in = layers.n_inputs
    for i in range(len(layers.width)):
        bound = 1.0 / math.sqrt(n_in)
        for row in range(n_in + 1):
            at = layers.biases_at[i] if row == n_in else layers.weights_at[i] + row * layers.width[i]
            for j in range(layers.n_outputs[i]):
                values[at + j] = (2.0 * draw(stream) - 1.0) * bound
        n_in = layers.n_outputs[i]


@compiled()
def draw_orthogonal(
    layers: Layers, values: Numbers, stream: NDArray[np.uint64], gains: Any, room: NDArray[np.float64]
) -> None:
    """Draws orthogonal weights as PyTorch does, with the gains of hidden layers and the last; no biases.

    The rows or columns, whichever are fewer, are orthogonal and as long as the gain: normal numbers, made
    orthogonal by Gram and Schmidt's method (Golub & Van Loan 2013, section 5.2.8).
    """
    n_in = layers.n_inputs
    for i in range(len(layers.width)):
        n_out, width, at = layers.n_outputs[i], layers.width[i], layers.weights_at[i]
        vectors = room[: min(n_in, n_out), : max(n_in, n_out)]
        for v in range(len(vectors)):
            vector = vectors[v]
            for j in range(len(vector)):
                vector[j] = _draw_normal(stream)
            for w in range(v):
                _add_times(vector, vectors[w], -_product(vectors[w], vector))
            _add_times(vector, vector, 1.0 / math.sqrt(_product(vector, vector)) - 1.0)
        gain = gains[1] if i == len(layers.width) - 1 else gains[0]
        for row in range(n_in):
            for j in range(n_out):
                values[at + row * width + j] = gain * (vectors[j, row] if n_out <= n_in else vectors[row, j])
        n_in = n_out


@inlined
def _draw_normal(stream: NDArray[np.uint64]) -> float:
    """Draws a standard normal number by Marsaglia's polar method, one of the two."""
    while True:
        x, y = 2.0 * draw(stream) - 1.0, 2.0 * draw(stream) - 1.0
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
