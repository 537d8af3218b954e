// The scene: cells, walls, regions, people, what an agent knows and where it walks. The data say where everything is.
const UNIT = 30; // side of a cell
const MARGIN = 24; // for the numbers of rows and columns
const INDIFFERENT = "#e4e7ea"; // of a cell in which no action is better than another

function star(x, y, radius) {
  const points = range(10).map((i) => {
    const r = i % 2 ? radius * 0.42 : radius;
    return `${x + r * Math.sin((Math.PI * i) / 5)},${y - r * Math.cos((Math.PI * i) / 5)}`;
  });
  return drawn("polygon", { points: points.join(" "), fill: "#fff", stroke: "#000", "stroke-width": 1.4 });
}

const ring = (x, y, radius) => drawn("circle", { cx: x, cy: y, r: radius, fill: "#fff", stroke: "#000", "stroke-width": 2 });

// Signs; the nose of a person is a triangle that says where they look.
const GLYPHS = {
  issuer: (x, y, nose = []) => [
    drawn("polygon", { points: nose.map(([row, column]) => `${x + UNIT * column},${y + UNIT * row}`).join(" "), stroke: "#fff" }),
    star(x, y, 11),
  ],
  bystander: (x, y) => [ring(x, y, 8)],
  onlooker: (x, y) => [ring(x, y, 4)],
  start: (x, y) => bordered("rect", { x: x - 10, y: y - 10, width: 20, height: 20 }, 1.6, 3.4),
};
const dashes = (isDashed) => (isDashed ? { "stroke-dasharray": "5 4" } : {});

// The path of three diagonals that fill a cell.
function hatched([x, y], radius = UNIT / 2) {
  const [left, right, top, bottom] = [x - radius, x + radius, y - radius, y + radius];
  return `M${left},${y}L${x},${top}M${left},${bottom}L${right},${top}M${x},${bottom}L${right},${y}`;
}

function colourOf(value, [low, high]) {
  if (Number.isNaN(value)) return explorer.palette["no value"];
  const share = high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0.5;
  return explorer.colours[Math.round(share * (explorer.colours.length - 1))];
}

class SceneView {
  // `look` is called with the cell that the pointer enters or touches, `move` with one that is clicked twice.
  constructor(room, look, move) {
    this.room = room;
    this.image = drawn("svg", { viewBox: `${-MARGIN} 0 ${MARGIN + UNIT * room.columns + 2} ${UNIT * room.rows + MARGIN}` });
    this.image.setAttribute("style", `max-height:max(80svh, ${12 * room.rows}px)`);
    this.image.setAttribute("aria-hidden", "true");
    this.cells = range(room.nCells).map((cell) => this.cell(cell, look, move));
    this.hatch = drawn("path", { class: "hatch" });
    this.things = drawn("g");
    this.arrows = bordered("path", {}, 1.7, 3.6);
    this.dots = drawn("path", { fill: "#fff", stroke: "#000" });
    const trail = { "stroke-linejoin": "round", fill: "none" };
    this.trail = [["#fff", 3.4], [explorer.palette.path, 1.8]].map(([stroke, width]) =>
      drawn("polyline", { ...trail, stroke, "stroke-width": width }));
    this.walker = drawn("circle", { r: 8, fill: explorer.palette.path, stroke: "#fff", "stroke-width": 2 });
    this.cursor = drawn("rect", { class: "cursor", width: UNIT, height: UNIT });
    const above = [this.hatch, this.things, ...this.arrows, this.dots, ...this.trail, this.walker, this.cursor];
    this.image.append(...this.cells.map(({ group }) => group), drawn("g", { "pointer-events": "none" }, ...above, ...this.axes()));
  }
  centre(cell) {
    return [UNIT * ((cell % this.room.columns) + 0.5), UNIT * (Math.floor(cell / this.room.columns) + 0.5)];
  }
  // A cell's square, and a shape for every action.
  cell(cell, look, move) {
    const [x, y] = this.centre(cell);
    const shapes = explorer.actions.map((_, a) => {
      if (a === PING) return drawn("circle", { cx: x, cy: y, r: UNIT * 0.2, stroke: "#fff", "stroke-width": 0.8, "stroke-opacity": 0.7 });
      return drawn("polygon", { points: explorer.triangles[a].map(([row, column]) => `${x + UNIT * column},${y + UNIT * row}`).join(" ") });
    });
    const whole = drawn("rect", { x: x - UNIT / 2, y: y - UNIT / 2, width: UNIT, height: UNIT });
    const group = drawn("g", {}, whole, ...shapes);
    for (const event of ["pointerenter", "pointerdown"]) group.addEventListener(event, () => look(cell));
    group.addEventListener("dblclick", () => move(cell));
    return { group, whole, shapes };
  }
  axes() {
    const size = Math.max(11, this.room.columns); // so that numbers can be read on wide maps
    const text = (x, y, anchor, number) => drawn("text", { x, y, "text-anchor": anchor, "font-size": size }, number);
    const every = (count) => range(count).filter((i) => i % Math.ceil(count / 7) === 0);
    return [
      ...every(this.room.rows).map((row) => text(-5, UNIT * (row + 0.5) + 4, "end", row)),
      ...every(this.room.columns).map((column) => text(UNIT * (column + 0.5), UNIT * this.room.rows + size + 3, "middle", column)),
    ];
  }
  // Shows regions and people as they are in a block.
  showBlock(block) {
    const view = this.room.viewOf(block);
    const path = (loops) => loops.map((loop) => `M${loop.map(([row, column]) => [UNIT * column, UNIT * row]).join("L")}Z`).join("");
    const circle = view.circle?.map((length) => UNIT * length);
    this.things.replaceChildren(
      ...view.outlines.flatMap((loops, i) => bordered("path", { d: path(loops), ...dashes(this.room.outlines[i][1]) }, 2, 4)),
      ...(circle ? [drawn("circle", { class: "talk", cx: circle[1], cy: circle[0], r: circle[2] })] : []),
      ...view.glyphs.flatMap(({ kind, cell, nose }) => GLYPHS[kind](...this.centre(cell), nose)),
    );
  }
  // Paints what an agent knows in a block: the `kind` of the page's "Show" menu, in colours between two limits.
  paint(agent, map, block, kind, limits) {
    this.showBlock(block);
    let [hatch, arrows, dots] = ["", "", ""];
    this.cells.forEach(({ whole, shapes }, cell) => {
      const state = block * this.room.nCells + cell;
      const [isOver, greedy] = [this.room.isOver(state), members(agent.greedyAt(map, state))];
      const isIndifferent = !isOver && agent.isIndifferent(map, state);
      const hasShapes = kind === "values" && !isOver && !isIndifferent;
      shapes.forEach((shape, a) => {
        shape.setAttribute("visibility", hasShapes ? "visible" : "hidden");
        if (hasShapes) shape.setAttribute("fill", colourOf(agent.valueAt(map, state, a), limits));
      });
      let fill = INDIFFERENT;
      if (isOver) fill = explorer.palette[this.room.walls.includes(cell) ? "wall" : "over"];
      else if (hasShapes) fill = "#555";
      else if (!isIndifferent) fill = explorer.colours.at(greedy.every((a) => agent.bestAt(state).includes(a)) ? -1 : 0);
      whole.setAttribute("fill", fill);
      if (isIndifferent) hatch += hatched(this.centre(cell));
      if (isOver || isIndifferent) return;
      arrows += greedy.filter((a) => a !== PING).map((a) => this.arrow(cell, a)).join("");
      const [x, y] = this.centre(cell);
      if (greedy.includes(PING)) dots += `M${x - 3.2},${y}a3.2,3.2 0 1 0 6.4,0a3.2,3.2 0 1 0 -6.4,0`;
    });
    this.hatch.setAttribute("d", hatch);
    this.dots.setAttribute("d", dots);
    for (const line of this.arrows) line.setAttribute("d", arrows);
  }
  arrow(cell, action) {
    const [x, y] = this.centre(cell);
    const [dy, dx] = explorer.moves[action];
    const to = (along, across) => `${x + dx * along - dy * across},${y + dy * along + dx * across}`;
    return `M${to(4.5, 0)}L${to(14, 0)}M${to(10, 3.4)}L${to(14, 0)}L${to(10, -3.4)}`;
  }
  showCursor(cell) {
    const [x, y] = this.centre(cell);
    filled(this.cursor, { x: x - UNIT / 2, y: y - UNIT / 2 }, []);
  }
  showPath(cells) {
    for (const line of this.trail) line.setAttribute("points", cells.map((cell) => this.centre(cell)).join(" "));
    const [cx, cy] = this.centre(cells.at(-1));
    filled(this.walker, { cx, cy }, []);
  }
}

// What the signs on the maps mean.
function paintKey() {
  const used = new Set(agents.flatMap(({ room }) => room.views[0].glyphs.map(({ kind }) => kind)));
  const names = { issuer: "person", bystander: "bystander", onlooker: "onlooker (does not matter)", start: "start" };
  const square = { x: 3, y: 3, width: 18, height: 18 };
  const signs = [
    ...Object.entries(names).filter(([kind]) => used.has(kind)).map(([kind, name]) => [GLYPHS[kind](12, 12), name]),
    ...explorer.scenes[0].outlines.map(([label, isDashed]) => [bordered("rect", { ...square, ...dashes(isDashed) }, 2, 4), label]),
    [bordered("path", { d: "M4,12L19,12M14,7L19,12L14,17" }, 2, 5), "greedy move"],
    [[ring(12, 12, 5)], "greedy PING"],
    [[drawn("rect", { ...square, fill: INDIFFERENT }), drawn("path", { class: "hatch", d: hatched([12, 12], 9) })], "no action is preferred, as where nothing was learned"],
    [[drawn("circle", { cx: 12, cy: 12, r: 8, fill: explorer.palette.path })], "agent and its path"],
  ];
  const sign = (shapes) => drawn("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, ...shapes);
  byId("key").replaceChildren(...signs.map(([shapes, text]) => element("li", {}, sign(shapes), text)));
}
