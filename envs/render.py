"""Renders a scene as text or as an image."""

import numpy as np

from envs.arrays import Bools, Bytes
from envs.scene import COLOURS, NOSE, SYMBOLS, Colour, Scene

MODES = ("ansi", "rgb_array")
FRAMES_PER_SECOND = 8
CELL_PIXELS = 40


def to_text(scene: Scene, agent: int, event: str) -> str:
    """Returns the scene as text, with the phase if there are several, and the last event.

    A is the agent in its cell, I a person, B a bystander, o an onlooker, + target, x uncomfortable,
    # a wall, and . elsewhere.
    """
    symbols = [SYMBOLS[kind] for kind in _kinds(scene)]
    for kind in ("onlooker", "bystander", "issuer"):
        for cell in scene.cells_of(kind):
            symbols[cell] = SYMBOLS[kind]
    symbols[agent] = "A"
    rows = [" ".join(symbols[i : i + scene.columns]) for i in range(0, len(symbols), scene.columns)]
    phase = [f"phase: {scene.phase}"] if scene.phase else []
    return "\n".join([*rows, *phase, f"event: {event}"]) + "\n"


def to_image(scene: Scene, agent: int) -> Bytes:
    """Returns the scene as an image, (rows * 40, columns * 40, 3) uint8.

    A person is a ring, with a nose if it matters where that person looks; a bystander is a thin
    ring, an onlooker a small one. The agent, in its cell, is a disc that fits inside the ring.
    """
    cells = np.array([COLOURS[kind] for kind in _kinds(scene)], dtype=np.uint8)
    image = cells.reshape(scene.rows, scene.columns, 3)
    image = image.repeat(CELL_PIXELS, axis=0).repeat(CELL_PIXELS, axis=1)
    image[::CELL_PIXELS] = COLOURS["line"]
    image[:, ::CELL_PIXELS] = COLOURS["line"]
    offset = (
        np.arange(CELL_PIXELS) - CELL_PIXELS / 2
    ) / CELL_PIXELS  # from a cell's centre, in cells

    def paint(cell: int, inside: Bools, colour: Colour) -> None:
        top, left = scene.position[cell] * CELL_PIXELS
        image[top : top + CELL_PIXELS, left : left + CELL_PIXELS][inside] = colour

    distance = np.hypot(offset[:, None], offset)
    for glyph in scene.glyphs:
        if glyph.kind == "start":
            continue
        outer, inner = {"issuer": (0.42, 0.30), "onlooker": (0.25, 0.2)}.get(
            glyph.kind, (0.42, 0.37)
        )
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
    walls = scene.is_wall.tolist()
    return ["wall" if is_wall else zone for zone, is_wall in zip(scene.zone, walls, strict=True)]
