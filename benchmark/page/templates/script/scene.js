// The scene: paints cells, the outlines of the regions, glyphs and axes. The data say where everything is.
import { bordered, drawn } from "./elements.js";
import { explorer } from "./data.js";

const UNIT = 30; // side of a cell
const MARGIN = 20; // for the numbers of rows and columns

function star(x, y, radius) {
  const points = Array.from({ length: 10 }, (_, i) => {
    const r = i % 2 ? radius * 0.42 : radius;
    return `${x + r * Math.sin((Math.PI * i) / 5)},${y - r * Math.cos((Math.PI * i) / 5)}`;
  });
  return drawn("polygon", { points: points.join(" "), fill: "#fff", stroke: "#000", "stroke-width": 1.4, "pointer-events": "none" });
}

function square(x, y, radius) {
  return bordered("rect", { x: x - radius, y: y - radius, width: 2 * radius, height: 2 * radius }, 1.6, 3.4);
}

export const GLYPHS = {
  issuer: (x, y, size) => [star(x, y, 11 * size)],
  start: (x, y, size) => square(x, y, 10 * size),
};

export const outlined = (name, attributes, dashed) => bordered(name, { ...attributes, ...(dashed ? { "stroke-dasharray": "5 4" } : {}) }, 2, 4);

export const walker = (x, y) => drawn("circle", { cx: x, cy: y, r: 8, fill: explorer.palette.path, stroke: "#fff", "stroke-width": 2, "pointer-events": "none" });

export class SceneView {
  // `look` is called with the number of the cell that the pointer enters or touches.
  constructor(scene, look) {
    this.scene = scene;
    const [width, height] = [UNIT * scene.columns, UNIT * scene.rows];
    this.image = drawn("svg", { viewBox: `0 0 ${MARGIN + width + 2} ${height + MARGIN}`, "aria-hidden": "true", style: `min-width:${12 * scene.columns}px` });
    this.cells = scene.zone.map((_, cell) => this.paintCell(cell, look));
    const line = (stroke, strokeWidth) => drawn("polyline", { fill: "none", stroke, "stroke-width": strokeWidth, "stroke-linejoin": "round", "pointer-events": "none" });
    this.trail = [line("#fff", 3.4), line(explorer.palette.path, 1.8)];
    this.walker = walker(0, 0);
    this.cursor = drawn("rect", { class: "cursor", width: UNIT, height: UNIT, "pointer-events": "none" });
    this.image.append(
      drawn("g", {}, ...this.cells.map((cell) => cell.group)),
      ...scene.outlines.flatMap((outline) => outlined("path", { d: this.pathOf(outline.loops) }, outline.dashed)),
      ...scene.glyphs.flatMap((glyph) => GLYPHS[glyph.kind](...this.centre(glyph.cell), 1)),
      drawn("g", { "pointer-events": "none" }, ...this.cells.flatMap(({ arrows, dot }) => [arrows, dot])),
      ...this.trail, this.walker, this.cursor, ...this.axes(),
    );
  }
  centre(cell) {
    return this.at(Math.floor(cell / this.scene.columns) + 0.5, (cell % this.scene.columns) + 0.5);
  }
  at(row, column) {
    return [MARGIN + UNIT * column, UNIT * row];
  }
  pathOf(loops) {
    return loops.map((loop) => `M${loop.map((corner) => this.at(...corner).join(",")).join("L")}Z`).join("");
  }
  // A cell's square, a shape for every action, arrows for its greedy moves and a dot for a greedy PING.
  paintCell(cell, look) {
    const [x, y] = this.centre(cell);
    const shapes = explorer.actions.map((_, a) =>
      this.scene.triangles[a]
        ? drawn("polygon", { points: this.scene.triangles[a].map(([row, column]) => `${x + UNIT * column},${y + UNIT * row}`).join(" ") })
        : drawn("circle", { cx: x, cy: y, r: UNIT * 0.2, stroke: "#fff", "stroke-width": 0.8, "stroke-opacity": 0.7 }));
    const whole = drawn("rect", { x: x - UNIT / 2, y: y - UNIT / 2, width: UNIT, height: UNIT });
    const group = drawn("g", {}, whole, ...shapes);
    for (const event of ["pointerenter", "pointerdown"]) group.addEventListener(event, () => look(cell));
    const arrows = drawn("path", { fill: "none" });
    const dot = drawn("circle", { cx: x, cy: y, r: 3.2, fill: "#fff", stroke: "#000", "stroke-width": 1 });
    return { group, whole, shapes, arrows, dot };
  }
  arrow(cell, action) {
    const [x, y] = this.centre(cell);
    const [dy, dx] = this.scene.moves[action];
    const to = (along, across) => `${x + dx * along - dy * across},${y + dy * along + dx * across}`;
    return `M${to(6.5, 0)}L${to(13, 0)}M${to(10, 2.6)}L${to(13, 0)}L${to(10, -2.6)}`;
  }
  axes() {
    const even = (count) => Array.from({ length: Math.ceil(count / 2) }, (_, i) => 2 * i);
    const rows = even(this.scene.rows).map((row) => drawn("text", { x: MARGIN - 5, y: this.at(row + 0.5, 0)[1] + 4, "text-anchor": "end" }, String(row)));
    const bottom = this.at(this.scene.rows, 0)[1] + 14;
    const columns = even(this.scene.columns).map((column) => drawn("text", { x: this.at(0, column + 0.5)[0], y: bottom, "text-anchor": "middle" }, String(column)));
    return [...rows, ...columns];
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
