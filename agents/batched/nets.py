"""Multilayer perceptrons of many agents as stacked arrays, with gradients written by hand.

Every layer is one call over all agents. On the CPU, an agent's numbers do not depend on the others: matrices
are multiplied separately, sums and norms run within an agent, and the rest is element by element. A test
checks it for batches of two agents and more.

Axis letters: N agents, O observations, B rows of a mini-batch.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import torch
from torch import Tensor

Activation = Literal["relu", "tanh"]

_BETAS: Final = (0.9, 0.999)
MANY: Final = 2000  # observations that are too many for one call: some layers would take 100 MB and more
_CHUNK: Final = 256  # rows of a call if there are many
_LANES: Final = 64  # of the flat arrays; a remainder that fills no vector register might be rounded otherwise


class Parameters:
    """The parameters of N agents, their gradients, and Adam (Kingma & Ba 2015) with PyTorch's defaults.

    All lie in one flat array, parameter after parameter, each (N, ...), so that a step of Adam is one call.

    Attributes:
      values: The parameters, (N, rows, columns) each.
      gradients: The same for their gradients.
      n_steps: (N,) int64, steps that each agent has made.
    """

    def __init__(
        self,
        n_agents: int,
        shapes: Sequence[tuple[int, int]],
        learning_rate: float,
        epsilon: float,
        max_grad_norm: float,
        device: torch.device,
        *,
        stops_early: bool = False,
    ) -> None:
        """Makes parameters that are zero.

        Args:
          n_agents: N.
          shapes: Of every parameter of an agent.
          learning_rate: Adam's.
          epsilon: Adam's.
          max_grad_norm: The norm to which an agent's gradient is clipped.
          device: Where to compute.
          stops_early: Whether some agents may leave out steps that others make.
        """
        sizes = [n_agents * rows * columns for rows, columns in shapes]
        n_padded = math.ceil(sum(sizes) / _LANES) * _LANES

        def views(flat: Tensor) -> list[Tensor]:
            parts = torch.split(flat[: sum(sizes)], sizes)
            return [part.view(n_agents, *shape) for part, shape in zip(parts, shapes, strict=True)]

        flat, gradient, *moments = (torch.zeros(n_padded, device=device) for _ in range(4))
        self.values, self.gradients = views(flat), views(gradient)
        self.n_steps = np.zeros(n_agents, dtype=np.int64)
        flat.grad = gradient
        self._optimizer = torch.optim.Adam([flat], lr=learning_rate, betas=_BETAS, eps=epsilon, fused=True)
        self._moments = [views(moment) for moment in moments] if stops_early else []
        self._learning_rate = learning_rate
        self._epsilon = epsilon
        self._max_grad_norm = max_grad_norm

    def step(self, is_learning: Tensor | None = None) -> None:
        """Clips the gradient of every agent by its norm, and makes a step of Adam.

        Args:
          is_learning: (N,) which agents make the step, if some may leave it out.
        """
        norms = torch.stack([torch.linalg.vector_norm(g.flatten(1), dim=1) for g in self.gradients])
        scale = (self._max_grad_norm / (torch.linalg.vector_norm(norms, dim=0) + 1e-6)).clamp_(max=1.0)
        if not bool((scale == 1.0).all()):
            for gradient in self.gradients:
                gradient.mul_(scale[:, None, None])
        if self._moments and is_learning is not None:
            self._step_of_some(is_learning)
        else:
            self._optimizer.step()
            self.n_steps += 1

    def _step_of_some(self, is_learning: Tensor) -> None:
        """Makes a step of Adam for some agents, whose counts of steps differ."""
        self.n_steps += is_learning.cpu().numpy()
        n_steps = np.maximum(self.n_steps, 1)
        corrections = [
            torch.from_numpy((1.0 - beta**n_steps).astype(np.float32)).to(is_learning.device)[:, None, None]
            for beta in _BETAS
        ]
        weights = [((1.0 - beta) * is_learning)[:, None, None] for beta in _BETAS]
        rate = (self._learning_rate * is_learning)[:, None, None] / corrections[0]
        for gradient in self.gradients:  # that of others may be infinite, which zero times does not undo
            gradient.masked_fill_(~is_learning[:, None, None], 0.0)
        for value, gradient, first, second in zip(self.values, self.gradients, *self._moments, strict=True):
            first.lerp_(gradient, weights[0])
            second.lerp_(gradient.square(), weights[1])
            value -= rate * first / ((second / corrections[1]).sqrt_() + self._epsilon)


class Nets:
    """One multilayer perceptron per agent over one-hot observations or rows of a table.

    The first layer does not multiply one-hot observations by its weights: it adds up the rows of weights that
    belong to the inputs that are 1, a row for each part of the observation.
    """

    def __init__(
        self,
        values: Sequence[Tensor],
        gradients: Sequence[Tensor],
        activation: Activation,
        table: Tensor,
    ) -> None:
        """Takes the parameters.

        Args:
          values: Weights (N, inputs, outputs) and biases (N, 1, outputs) of each layer in turn.
          gradients: Where to write the gradients of the same.
          activation: After each layer but the last.
          table: (O, inputs) float32 observations; or, if all inputs are 0 or 1, (O, parts) int64, which of
            them are 1.
        """
        self._weights, self._biases = values[::2], values[1::2]
        self._weight_gradients, self._bias_gradients = gradients[::2], gradients[1::2]
        self._is_relu = activation == "relu"
        n_agents, n_inputs, _ = self._weights[0].shape
        self._table: Tensor | None = None
        self._places: list[Tensor] = []  # (N * O,) of each part, agent * inputs + input
        if table.is_floating_point():
            self._table = table.repeat(n_agents, 1)  # (N * O, inputs)
        else:
            first = torch.arange(n_agents, device=table.device)[:, None] * n_inputs
            self._places = [(first + part).view(-1) for part in table.T]
        self._outputs: dict[int, list[Tensor]] = {}  # by B: of each layer
        self._output_gradients: dict[int, list[Tensor]] = {}  # by B: of each layer but the last
        self._inputs: Tensor | None = None
        self._chosen: list[Tensor] = []  # (N * B,) of each part
        self._hidden: list[Tensor] = []  # of the last call

    def forward(self, observed: Tensor) -> Tensor:
        """Returns the outputs for mini-batches, (N, B, outputs); they are overwritten by the next call.

        Args:
          observed: (N, B) int64, agent * O + observation.
        """
        n_agents, n_rows = observed.shape
        self._hidden = _buffers(self._outputs, n_rows, self._weights)
        hidden = self._hidden[0]
        observed = observed.reshape(-1)
        if self._table is None:
            self._chosen = [places.index_select(0, observed) for places in self._places]
            weights, total = self._weights[0].flatten(0, 1), hidden.flatten(0, 1)
            torch.index_select(weights, 0, self._chosen[0], out=total)
            for chosen in self._chosen[1:]:
                total.add_(weights.index_select(0, chosen))
            hidden.add_(self._biases[0])
        else:
            self._inputs = self._table.index_select(0, observed).view(n_agents, n_rows, -1)
            torch.baddbmm(self._biases[0], self._inputs, self._weights[0], out=hidden)
        for layer in range(1, len(self._weights)):
            torch.relu_(hidden) if self._is_relu else torch.tanh_(hidden)
            output = self._hidden[layer]
            torch.baddbmm(self._biases[layer], hidden, self._weights[layer], out=output)
            hidden = output
        return hidden

    def read(self, observed: Tensor) -> Tensor:
        """Returns what `forward` does, by several calls if there are many observations, so arrays stay small.

        No `backward` may follow.

        Args:
          observed: (N, B) int64, agent * O + observation.
        """
        n_rows = observed.shape[1]
        if n_rows <= MANY:
            return self.forward(observed)
        outputs = self._biases[-1].new_empty(*observed.shape, self._biases[-1].shape[2])
        for start in range(0, n_rows, _CHUNK):
            rows = slice(min(start, n_rows - _CHUNK), min(start + _CHUNK, n_rows))
            outputs[:, rows] = self.forward(observed[:, rows])
        return outputs

    def backward(self, gradient: Tensor) -> None:
        """Writes the gradients of all parameters.

        Args:
          gradient: (N, B, outputs) of the loss by the outputs of the last `forward`.
        """
        gradients = _buffers(self._output_gradients, gradient.shape[1], self._weights[:-1])
        for layer in range(len(self._weights) - 1, 0, -1):
            hidden, backward = self._hidden[layer - 1], gradients[layer - 1]
            torch.sum(gradient, 1, keepdim=True, out=self._bias_gradients[layer])
            torch.bmm(hidden.transpose(1, 2), gradient, out=self._weight_gradients[layer])
            torch.bmm(gradient, self._weights[layer].transpose(1, 2), out=backward)
            if self._is_relu:
                torch.ops.aten.threshold_backward.grad_input(backward, hidden, 0, grad_input=backward)
            else:
                torch.ops.aten.tanh_backward.grad_input(backward, hidden, grad_input=backward)
            gradient = backward
        torch.sum(gradient, 1, keepdim=True, out=self._bias_gradients[0])
        first = self._weight_gradients[0]
        if self._inputs is None:
            first.zero_()
            for chosen in self._chosen:
                first.flatten(0, 1).index_add_(0, chosen, gradient.flatten(0, 1))
        else:
            torch.bmm(self._inputs.transpose(1, 2), gradient, out=first)


def _buffers(known: dict[int, list[Tensor]], n_rows: int, weights: Sequence[Tensor]) -> list[Tensor]:
    """Returns arrays for the outputs of layers, (N, B, outputs) each, and keeps them by B."""
    if n_rows not in known:
        known[n_rows] = [each.new_empty(len(each), n_rows, each.shape[2]) for each in weights]
    return known[n_rows]


def layer_shapes(inputs: int, hidden: Sequence[int], outputs: int) -> Iterator[tuple[int, int]]:
    """Returns the shapes of the weights and biases of each layer in turn."""
    sizes = [inputs, *hidden, outputs]
    for n_in, n_out in pairwise(sizes):
        yield n_in, n_out
        yield 1, n_out
