"""Draws a scene: as text, as an image, or in a window (which alone needs pygame-ce)."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envs.inputs import InputError
from envs.model import Model
from envs.regions import ZONES

MODES: Final = ("ansi", "rgb_array", "human")
CELL_PIXELS: Final = 40
SYMBOLS: Final = {"outside": ".", "target": "+", "uncomfortable": "x", "issuer": "I"}
# Okabe and Ito's colour-blind-safe palette, the regions lightened; distinct in grey, too.
COLOURS: Final = {
    "outside": (250, 250, 250),
    "target": (150, 215, 195),
    "uncomfortable": (225, 150, 95),
    "issuer": (225, 150, 95),
    "line": (200, 200, 200),
    "person": (60, 60, 60),
    "agent": (0, 114, 178),
}


def to_text(model: Model, state: int, event: str) -> str:
    """Returns the grid as text: A the agent, I the issuer, + target, x uncomfortable, . elsewhere."""
    columns = model.scenario.grid.columns
    symbols = [SYMBOLS[ZONES[zone]] for zone in model.zone_of_cell]
    symbols[model.observation[state]] = "A"
    rows = [" ".join(symbols[i : i + columns]) for i in range(0, len(symbols), columns)]
    return "\n".join([*rows, f"event: {event}"]) + "\n"


def to_image(model: Model, state: int) -> NDArray[np.uint8]:
    """Returns the grid as an image, (rows * 40, columns * 40, 3) uint8.

    The issuer is the ring, the agent the disc; where they meet both are seen.
    """
    grid = model.scenario.grid
    palette = np.array([COLOURS[zone] for zone in ZONES], dtype=np.uint8)
    cells = palette[model.zone_of_cell].reshape(grid.rows, grid.columns, 3)
    image = cells.repeat(CELL_PIXELS, axis=0).repeat(CELL_PIXELS, axis=1)
    image[::CELL_PIXELS] = COLOURS["line"]
    image[:, ::CELL_PIXELS] = COLOURS["line"]
    issuer = model.scenario.issuer.position
    agent = divmod(int(model.observation[state]), grid.columns)
    _disc(image, issuer, 0.42, COLOURS["person"])
    _disc(image, issuer, 0.30, COLOURS["issuer"])
    _disc(image, agent, 0.26, COLOURS["agent"])
    return image


def _disc(
    image: NDArray[np.uint8], cell: tuple[int, int], radius: float, colour: tuple[int, int, int]
) -> None:
    """Fills a disc in the middle of a cell; `radius` is in cells."""
    offset = np.arange(CELL_PIXELS) - CELL_PIXELS / 2
    inside = offset[:, None] ** 2 + offset**2 <= (radius * CELL_PIXELS) ** 2
    top, left = cell[0] * CELL_PIXELS, cell[1] * CELL_PIXELS
    image[top : top + CELL_PIXELS, left : left + CELL_PIXELS][inside] = colour


class Window:
    """A window that shows images one after the other."""

    def __init__(self, image: NDArray[np.uint8], title: str) -> None:
        """Opens a window of the image's size.

        Raises:
          InputError: pygame-ce is not installed, or there is no screen.
        """
        try:
            import pygame
        except ModuleNotFoundError as error:
            raise InputError(
                'render_mode = "human" needs pygame-ce: install it, or use "ansi" or "rgb_array".'
            ) from error
        self._pygame: Any = pygame
        try:
            pygame.display.init()
            pygame.display.set_caption(title)
            self._screen = pygame.display.set_mode((image.shape[1], image.shape[0]))
        except pygame.error as error:
            raise InputError(f"no window can be opened: {error}.") from error
        if pygame.display.get_driver() == "offscreen":  # what SDL falls back to where there is no screen
            pygame.display.quit()
            raise InputError("no window can be opened: there is no screen.")
        self._clock = pygame.time.Clock()

    def show(self, image: NDArray[np.uint8], frames_per_second: int) -> None:
        """Shows an image, (H, W, 3) uint8, and waits so as not to exceed the frame rate."""
        surface = self._pygame.surfarray.make_surface(image.swapaxes(0, 1))
        self._screen.blit(surface, (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(frames_per_second)

    def pressed(self) -> list[str]:
        """Returns the keys pressed since the last call, by pygame's names: "space", "left", "q".

        Escape and closing the window count as "q".
        """
        names = []
        for event in self._pygame.event.get():
            if event.type == self._pygame.QUIT:
                names.append("q")
            elif event.type == self._pygame.KEYDOWN:
                name = self._pygame.key.name(event.key)
                names.append("q" if name == "escape" else name)
        return names

    def close(self) -> None:
        """Closes the window."""
        self._pygame.display.quit()
