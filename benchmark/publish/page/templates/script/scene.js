// The scene: paints cells, walls, the outlines of the regions, people and axes. The data say where everything is.
import { bordered, drawn, show } from "./elements.js";
import { explorer } from "./data.js";

const UNIT = 30; // side of a cell
const MARGIN = 20; // for the numbers of rows and columns, of maps with up to so many columns
const FEW = 12;
const [WIDE, NARROW, MANY] = [28, 8, 40]; // smallest cells in pixels, with arrows, and of maps with more columns, without
const UNTOUCHED = { "pointer-events": "none" };

function star(x, y, radius) {
  const points = Array.from({ length: 10 }, (_, i) => {
    const r = i % 2 ? radius * 0.42 : radius;
    return `${x + r * Math.sin((Math.PI * i) / 5)},${y - r * Math.cos((Math.PI * i) / 5)}`;
  });
  return drawn("polygon", { points: points.join(" "), fill: "#fff", stroke: "#000", "stroke-width": 1.4, ...UNTOUCHED });
}

function ring(x, y, radius) {
  return drawn("circle", { cx: x, cy: y, r: radius, fill: "#fff", stroke: "#000", "stroke-width": 2, ...UNTOUCHED });
}

function square(x, y, radius) {
  return bordered("rect", { x: x - radius, y: y - radius, width: 2 * radius, height: 2 * radius }, 1.6, 3.4);
}

// The path of three diagonals that fill a square.
export function hatched(x, y, radius) {
  const [left, right, top, bottom] = [x - radius, x + radius, y - radius, y + radius];
  return `M${left},${y}L${x},${top}M${left},${bottom}L${right},${top}M${x},${bottom}L${right},${y}`;
}

// A sign, whose nose, if it has one, is a triangle that says where a person looks.
export const GLYPHS = {
  issuer: (x, y, size, nose = []) => [
    ...(nose.length ? [drawn("polygon", { points: nose.map(([row, column]) => `${x + UNIT * column},${y + UNIT * row}`).join(" "), fill: "#000", stroke: "#fff", ...UNTOUCHED })] : []),
    star(x, y, 11 * size),
  ],
  bystander: (x, y, size) => [ring(x, y, 8 * size)],
  onlooker: (x, y, size) => [ring(x, y, 4 * size)],
  start: (x, y, size) => square(x, y, 10 * size),
};

// The line around a region.
export function outlined(name, attributes, isDashed) {
  return bordered(name, isDashed ? { ...attributes, "stroke-dasharray": "5 4" } : attributes, 2, 4);
}

// The circle on which people talk.
export function dotted(x, y, radius) {
  const shared = { cx: x, cy: y, r: radius, fill: "none", ...UNTOUCHED };
  return [
    drawn("circle", { ...shared, stroke: "#fff", "stroke-width": 3.2 }),
    drawn("circle", { ...shared, stroke: "#000", "stroke-width": 1.7, "stroke-dasharray": "2 2.4" }),
  ];
}

// The agent on its walk.
export function walker(x, y) {
  return drawn("circle", { cx: x, cy: y, r: 8, fill: explorer.palette.path, stroke: "#fff", "stroke-width": 2, ...UNTOUCHED });
}

const trail = (stroke, width) =>
  drawn("polyline", { fill: "none", stroke, "stroke-width": width, "stroke-linejoin": "round", ...UNTOUCHED });

export class SceneView {
  // `look` is called with the number of the cell that the pointer enters or touches, `move` with that to which
  // the person is dragged.
  constructor(room, look, move) {
    this.room = room;
    this.scale = Math.max(1, room.columns / FEW); // of the numbers, so that they can be read on wide maps
    this.margin = MARGIN * this.scale;
    const [width, height] = [this.margin + UNIT * room.columns + 2, UNIT * room.rows + this.margin];
    const side = room.columns > MANY ? NARROW : WIDE;
    const style = `min-width:${side * room.columns}px; max-height:max(100svh - 10.5rem, ${side * room.rows}px)`;
    this.image = drawn("svg", { viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true", class: `cells-of-${side}`, style });
    this.cells = Array.from({ length: room.nCells }, (_, cell) => this.paintCell(cell, look));
    this.listenForDrags(move);
    this.hatch = drawn("path", { class: "hatch" });
    this.things = drawn("g", { class: "things", ...UNTOUCHED });
    this.trail = [trail("#fff", 3.4), trail(explorer.palette.path, 1.8)];
    this.walker = walker(0, 0);
    this.cursor = drawn("rect", { class: "cursor", width: UNIT, height: UNIT, ...UNTOUCHED });
    this.image.append(
      drawn("g", {}, ...this.cells.map((cell) => cell.group)),
      drawn("g", UNTOUCHED, this.hatch),
      this.things,
      drawn("g", UNTOUCHED, ...this.cells.flatMap(({ arrows, dot }) => [arrows, dot])),
      ...this.trail, this.walker, this.cursor, ...this.axes(),
    );
  }
  // Shows regions and people as they are in a block.
  showBlock(block) {
    const view = this.room.viewOf(block);
    if (this.view === view) return;
    this.view = view;
    this.things.replaceChildren(
      ...view.outlines.flatMap((loops, i) => outlined("path", { d: this.pathOf(loops) }, this.room.outlines[i][1])),
      ...(view.circle ? [this.circled(...view.circle)] : []),
      ...view.glyphs.flatMap(({ kind, cell, nose }) => GLYPHS[kind](...this.centre(cell), 1, nose)),
    );
    const isHere = (cell) => this.room.places.length > 1 && this.room.groupOn(view).includes(cell);
    this.cells.forEach(({ group }, cell) => group.classList.toggle("person", isHere(cell)));
  }
  // Where there is a choice of places, people can be dragged: a pointer that is pressed on their cell moves them.
  listenForDrags(move) {
    let isDragging = false;
    const cellAt = ({ clientX, clientY }) =>
      this.cells.findIndex(({ group }) => group === document.elementFromPoint(clientX, clientY)?.parentNode);
    const isPerson = (event) => event.target.parentNode.classList.contains("person");
    this.image.addEventListener("pointerdown", (event) => (isDragging = isPerson(event)));
    // A finger would scroll the page.
    this.image.addEventListener("touchstart", (event) => isPerson(event) && event.preventDefault(), { passive: false });
    this.image.addEventListener("pointermove", (event) => {
      if (isDragging && cellAt(event) >= 0) move(cellAt(event));
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) {
      this.image.addEventListener(end, () => (isDragging = false));
    }
  }
  // The circle on which people talk, as far as it lies in the room.
  circled(row, column, radius) {
    const room = { x: this.margin, y: 0, width: UNIT * this.room.columns, height: UNIT * this.room.rows };
    return drawn("svg", room, ...dotted(UNIT * column, UNIT * row, UNIT * radius));
  }
  centre(cell) {
    return this.at(Math.floor(cell / this.room.columns) + 0.5, (cell % this.room.columns) + 0.5);
  }
  at(row, column) {
    return [this.margin + UNIT * column, UNIT * row];
  }
  pathOf(loops) {
    return loops.map((loop) => `M${loop.map((corner) => this.at(...corner).join(",")).join("L")}Z`).join("");
  }
  // A cell's square, a shape for every action, arrows for its greedy moves and a dot for a greedy PING.
  paintCell(cell, look) {
    const [x, y] = this.centre(cell);
    const shapes = explorer.actions.map((_, a) => {
      if (a >= explorer.triangles.length) {
        return drawn("circle", { cx: x, cy: y, r: UNIT * 0.2, stroke: "#fff", "stroke-width": 0.8, "stroke-opacity": 0.7 });
      }
      const corners = explorer.triangles[a].map(([row, column]) => `${x + UNIT * column},${y + UNIT * row}`);
      return drawn("polygon", { points: corners.join(" ") });
    });
    const whole = drawn("rect", { x: x - UNIT / 2, y: y - UNIT / 2, width: UNIT, height: UNIT });
    const group = drawn("g", {}, whole, ...shapes);
    for (const event of ["pointerenter", "pointerdown"]) group.addEventListener(event, () => look(cell));
    const arrows = drawn("path", { fill: "none" });
    const dot = drawn("circle", { cx: x, cy: y, r: 3.2, fill: "#fff", stroke: "#000", "stroke-width": 1 });
    return { group, whole, shapes, arrows, dot };
  }
  arrow(cell, action) {
    const [x, y] = this.centre(cell);
    const [dy, dx] = explorer.moves[action];
    const to = (along, across) => `${x + dx * along - dy * across},${y + dy * along + dx * across}`;
    return `M${to(4.5, 0)}L${to(14, 0)}M${to(10, 3.4)}L${to(14, 0)}L${to(10, -3.4)}`;
  }
  // Hatches the cells for which there is a true value.
  showHatch(isHatched) {
    this.hatch.setAttribute("d", isHatched.map((is, cell) => (is ? hatched(...this.centre(cell), UNIT / 2) : "")).join(""));
  }
  axes() {
    const everySecond = (count) => Array.from({ length: Math.ceil(count / 2) }, (_, i) => 2 * i);
    const text = (x, y, anchor, number) => drawn("text", { x, y, "text-anchor": anchor, style: `font-size:${11 * this.scale}px` }, show(number));
    const bottom = this.at(this.room.rows, 0)[1] + 14 * this.scale;
    return [
      ...everySecond(this.room.rows).map((row) => text(this.margin - 5, this.at(row + 0.5, 0)[1] + 4 * this.scale, "end", row)),
      ...everySecond(this.room.columns).map((column) => text(this.at(0, column + 0.5)[0], bottom, "middle", column)),
    ];
  }
  showCursor(cell) {
    const [x, y] = this.centre(cell);
    this.cursor.setAttribute("x", x - UNIT / 2);
    this.cursor.setAttribute("y", y - UNIT / 2);
  }
  showPath(cells) {
    const points = cells.map((cell) => this.centre(cell).join(",")).join(" ");
    for (const line of this.trail) line.setAttribute("points", points);
    const [x, y] = this.centre(cells.at(-1));
    this.walker.setAttribute("cx", x);
    this.walker.setAttribute("cy", y);
  }
}
