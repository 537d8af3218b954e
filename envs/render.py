"""Paints a scene as text or as an image, and shows images in a window (which requires pygame-ce)."""

from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envs.inputs import InputError, needed_by
from envs.scene import COLOURS, NOSE, SYMBOLS, Colour, Scene

MODES: Final = ("ansi", "rgb_array", "human")
FRAMES_PER_SECOND: Final = 8
CELL_PIXELS: Final = 40


def working_modes() -> list[str]:
    """Returns the modes for which all packages are installed; a window needs pygame-ce."""
    return [mode for mode in MODES if mode != "human" or find_spec("pygame") is not None]


def to_text(scene: Scene, agent: int, event: str) -> str:
    """Returns the scene as text: A the agent, I a person, + target, x uncomfortable, # a wall, . elsewhere.

    If the scenario has several phases, a line names that of the scene.

    Args:
      scene: Map of the scenario.
      agent: The agent's cell.
      event: Name of the last event.
    """
    kinds = _kinds(scene)
    symbols = [SYMBOLS[kind] for kind in kinds]
    symbols[agent] = "A"
    rows = [" ".join(symbols[i : i + scene.columns]) for i in range(0, scene.n_cells, scene.columns)]
    phase = [f"phase: {scene.phase}"] if scene.phase else []
    return "\n".join([*rows, *phase, f"event: {event}"]) + "\n"


def to_image(scene: Scene, agent: int) -> NDArray[np.uint8]:
    """Returns the scene as an image, (rows * 40, columns * 40, 3) uint8.

    A person is a ring, with a nose if it matters where that person looks. The agent is a disc that fits
    inside the ring, so that both are visible in one cell.

    Args:
      scene: Map of the scenario.
      agent: The agent's cell.
    """
    cells = np.array([COLOURS[kind] for kind in _kinds(scene)], dtype=np.uint8)
    image = cells.reshape(scene.rows, scene.columns, 3)
    image = image.repeat(CELL_PIXELS, axis=0).repeat(CELL_PIXELS, axis=1)
    image[::CELL_PIXELS] = COLOURS["line"]
    image[:, ::CELL_PIXELS] = COLOURS["line"]
    offset = (np.arange(CELL_PIXELS) - CELL_PIXELS / 2) / CELL_PIXELS  # from a cell's centre, in cells

    def paint(cell: int, inside: NDArray[np.bool_], colour: Colour) -> None:
        top, left = scene.position[cell] * CELL_PIXELS
        image[top : top + CELL_PIXELS, left : left + CELL_PIXELS][inside] = colour

    distance = np.hypot(offset[:, None], offset)
    for glyph in scene.glyphs:
        if glyph.kind == "issuer":
            outer, inner = 0.42, 0.30
            if glyph.heading is not None:
                outer, inner = 0.36, 0.27  # leaves room for the nose
                (down, right), (tip, base, half) = glyph.heading, NOSE
                ahead = offset[:, None] * down + offset * right
                aside = abs(offset[:, None] * right + offset * down)
                is_nose = (ahead >= base) & (aside <= half * (tip - ahead) / (tip - base))
                paint(glyph.cell, is_nose, COLOURS["person"])
            paint(glyph.cell, distance <= outer, COLOURS["person"])
            paint(glyph.cell, distance <= inner, COLOURS[scene.zone[glyph.cell]])
    paint(agent, distance <= 0.26, COLOURS["agent"])
    return image


def _kinds(scene: Scene) -> list[str]:
    """Returns what every cell is, (C,): its zone, or "wall"."""
    walls = scene.is_wall.tolist()
    return ["wall" if is_wall else zone for zone, is_wall in zip(scene.zone, walls, strict=True)]


class Window:
    """A window that shows one image after another."""

    def __init__(self, image: NDArray[np.uint8], title: str) -> None:
        """Opens a window of the image's size.

        Raises:
          MissingPackageError: pygame-ce is not installed.
          InputError: SDL cannot open a window.
        """
        with needed_by('render_mode = "human" (unlike "ansi" and "rgb_array")'):
            import pygame
        self._pygame: Any = pygame
        try:
            pygame.display.init()
            pygame.display.set_caption(title)
            self._screen = pygame.display.set_mode((image.shape[1], image.shape[0]))
        except pygame.error as error:
            raise InputError(f"no window can be opened: {error}.") from error
        self._clock = pygame.time.Clock()

    @property
    def has_screen(self) -> bool:
        """Whether the window is on a screen. If there is none, SDL paints into memory and nobody sees it."""
        return bool(self._pygame.display.get_driver() != "offscreen")

    def show(self, image: NDArray[np.uint8], frames_per_second: int) -> None:
        """Shows an image, (H, W, 3) uint8, and waits as long as the frame rate requires."""
        surface = self._pygame.surfarray.make_surface(image.swapaxes(0, 1))
        self._screen.blit(surface, (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(frames_per_second)

    def pressed(self) -> list[str]:
        """Returns the keys pressed since the last call, by pygame's names: "space", "left", "q".

        Escape and a click on the window's close button count as "q".
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
