"""The commands of the command line: one module each, whose `main` takes the parsed options."""

from typing import Final

from envs import InputError

MOST_SEEDS: Final = 1_000_000


def parse_seeds(text: str | None) -> range | None:
    """Returns the seeds that `--seeds` names; None if the option is not given.

    >>> list(parse_seeds("7-9"))
    [7, 8, 9]

    Raises:
      InputError: Other text, or too many or too large seeds.
    """
    if text is None:
        return None
    first, dash, last = text.partition("-")
    if not first.isdecimal() or (dash and not last.isdecimal()) or (dash and int(last) < int(first)):
        raise InputError(f"--seeds {text}: accepted: A-B with A at most B, as in 0-29, or one seed, as in 7.")
    seeds = range(int(first), int(last if dash else first) + 1)
    if seeds.stop > MOST_SEEDS or len(seeds) > 100_000:
        raise InputError(f"--seeds {text}: accepted: seeds below {MOST_SEEDS:,}, at most 100,000 of them.")
    return seeds


def seeds_text(seeds: range) -> str:
    """Returns seeds as `--seeds` takes them.

    >>> seeds_text(range(7, 10)), seeds_text(range(7, 8))
    ('7-9', '7')
    """
    return str(seeds[0]) if len(seeds) == 1 else f"{seeds[0]}-{seeds[-1]}"
