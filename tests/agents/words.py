"""The words of a tabular agent's stream, and what they decide, in plain Python."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.random import SeedSequence

WORD = 2**64


def xoshiro(state: Sequence[int]) -> Iterator[int]:
    """Yields the words of xoshiro256++ as its authors print it, in Python's integers."""
    s = list(state)

    def rotate(x: int, k: int) -> int:
        return (x << k | x >> (64 - k)) % WORD

    while True:
        yield (rotate((s[0] + s[3]) % WORD, 23) + s[0]) % WORD
        shifted = (s[1] << 17) % WORD
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= shifted
        s[3] = rotate(s[3], 45)


def words(seed: SeedSequence) -> Iterator[int]:
    """Yields the words of the agent of a seed."""
    return xoshiro([int(word) for word in seed.generate_state(4, np.uint64)])


def choose(word: int, epsilon: float, greedy: Sequence[int]) -> int:
    """Returns a random one of five actions with probability epsilon, else one of the greedy actions."""
    upper, lower = divmod(word, 2**32)
    candidates = range(5) if upper < round(epsilon * 2**32) else greedy
    # A draw from 0..59 picks one of one to five candidates, each equally often.
    return candidates[(lower * 60 >> 32) * len(candidates) // 60]


def uniform(word: int) -> float:
    """Returns a number from [0, 1)."""
    return (word >> 11) / 2**53
