// Sorts tables, shows the CSV row behind a number, and draws the explorer. It looks up what the file holds and
// computes no dynamics: where a step leads and what it pays is a table of the compiled scenario.
"use strict";
(async () => {
  document.documentElement.classList.add("js");
  const byId = (id) => document.getElementById(id);
  const SVG = "http://www.w3.org/2000/svg";

  function element(name, attributes = {}, ...children) {
    const node = document.createElement(name);
    return fill(node, attributes, children);
  }
  function drawn(name, attributes = {}, ...children) {
    const node = document.createElementNS(SVG, name);
    return fill(node, attributes, children);
  }
  function fill(node, attributes, children) {
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...children);
    return node;
  }
  const show = (value, digits = 3) => (value === null || Number.isNaN(value) ? "none" : (+value.toFixed(digits)).toString().replace("-", "\u2212"));
  const grouped = (value) => value.toLocaleString("en-GB");

  // Tables: a header sorts.

  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0];
    const written = [...body.rows];
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = element("button", { type: "button" }, head.textContent);
      head.replaceChildren(button);
      button.addEventListener("click", () => {
        const next = { ascending: "descending", descending: "none" }[head.getAttribute("aria-sort")] ?? "ascending";
        for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
        if (next === "none") return body.append(...written);
        head.setAttribute("aria-sort", next);
        const sign = next === "ascending" ? 1 : -1;
        body.append(...[...written].sort((a, b) => compare(a.cells[column], b.cells[column], sign)));
      });
    });
  }
  function compare(a, b, sign) {
    if (a.dataset.order === undefined) return sign * a.textContent.localeCompare(b.textContent);
    const x = Number(a.dataset.order);
    const y = Number(b.dataset.order);
    if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y); // no number comes last
    return x === y ? 0 : sign * (x < y ? -1 : 1);
  }

  // What is folded is printed, too.

  addEventListener("beforeprint", () => {
    for (const one of document.querySelectorAll("details:not([open])")) fill(one, { open: "", "data-folded": "" }, []);
  });
  addEventListener("afterprint", () => {
    for (const one of document.querySelectorAll("[data-folded]")) {
      one.removeAttribute("open");
      one.removeAttribute("data-folded");
    }
  });

  // All that follows needs the data: JSON, compressed.

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes(byId("data").textContent)]).stream().pipeThrough(new DecompressionStream("gzip"));
  const { explorer, csv } = await new Response(stream).json();
  const data = { ...explorer, csv };

  // Sources: a number shows its row.

  const parsed = new Map();
  function table(file) {
    if (!parsed.has(file)) parsed.set(file, rows(data.csv[file]));
    return parsed.get(file);
  }
  function rows(text) {
    const out = [[]];
    for (const [, quoted, plain, end] of text.matchAll(/(?:"((?:[^"]|"")*)"|([^",\n]*))(,|\n|$)/g)) {
      out.at(-1).push(quoted === undefined ? plain : quoted.replaceAll('""', '"'));
      if (end === "\n") out.push([]);
      if (end === "") break;
    }
    return out.filter((row) => row.length > 1 || row[0] !== "");
  }
  function wanted(file, selection) {
    const all = file in data.csv ? table(file) : null;
    const out = [];
    for (const part of selection.split(";")) {
      const [first, last = first] = part.split("-").map(Number);
      for (let place = first; place <= last; place++) out.push(all ? all[place - 1] : mapRow(file, place));
    }
    const keys = file.endsWith("optimum.csv") ? ["scenario", "discount", "row", "column", "optimal"] : ["algorithm", "observation", "step", "row", "column", "greedy"];
    return [all ? all[0] : [...keys, ...data.actions], out];
  }
  document.addEventListener("click", (event) => {
    const link = event.target.closest("a.n");
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
    const [file, selection] = link.getAttribute("href").split("#row=");
    if (!selection || !(file in data.csv || (explorer && (file.includes("agent_") || file.endsWith("optimum.csv"))))) return;
    event.preventDefault();
    const [head, found] = wanted(file, selection);
    byId("source-title").textContent = `${file}, line${found.length > 1 ? "s" : ""} ${selection.replaceAll(";", ", ")}`;
    const meant = cited(link.textContent, head, found);
    const mark = (i) => (meant.includes(i) ? { class: "cited" } : {});
    let shown;
    if (found.length === 1) {
      const lines = head.map((name, i) => element("tr", {}, element("th", { scope: "row", ...mark(i) }, name), element("td", mark(i), found[0][i])));
      shown = element("table", {}, element("tbody", {}, ...lines));
    } else {
      const line = (kind, cells) => element("tr", {}, ...cells.map((cell, i) => element(kind, mark(i), cell)));
      shown = element("table", { class: "many" }, element("thead", {}, line("th", head)), element("tbody", {}, ...found.map((row) => line("td", row))));
    }
    const over = found.length === 1 ? "" : meant.length ? `, the mean of ${head[meant[0]]} over these lines` : ", from these lines";
    const told = element("p", {}, `Shown as ${link.textContent}${over}.`);
    byId("source-rows").replaceChildren(told, element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Rows of the file" }, shown));
    byId("source-file").href = link.getAttribute("href");
    byId("source").showModal();
    byId("source").querySelector("td.cited")?.scrollIntoView({ block: "nearest", inline: "center" });
  });
  // The columns that hold the number, or whose mean it is.
  function cited(text, head, found) {
    const [number] = text.replaceAll("\u2212", "-").replaceAll(",", "").split(" ");
    const decimals = number.replace("%", "").split(".")[1]?.length ?? 0;
    const same = (value) => [value.toFixed(decimals), String(+value.toPrecision(3)), `${Math.round(100 * value)}%`].includes(number);
    return head.map((_, i) => i).filter((i) => {
      const cells = found.map((row) => row[i]).filter((cell) => cell !== "");
      return cells.length && (cells.every((cell) => !Number.isNaN(Number(cell)))
        ? same(cells.reduce((sum, cell) => sum + Number(cell), 0) / cells.length)
        : found.length === 1 && cells[0] === text);
    });
  }

  if (!explorer) return;

  // What the explorer shows.

  const N_ACTIONS = data.actions.length;
  const PING = data.actions.indexOf("PING");
  const UNIT = 30; // a cell's side in the drawing
  const MARGIN = 20;
  function unpacked(text) {
    const view = new DataView(bytes(text).buffer);
    return Float64Array.from({ length: view.byteLength / 4 }, (_, i) => {
      const value = view.getInt32(4 * i, true);
      return value === data.no_number ? NaN : value / 10 ** data.decimals;
    });
  }
  for (const block of data.blocks) {
    block.values = unpacked(block.values);
    block.greedy = bytes(block.greedy);
  }
  for (const optimum of Object.values(data.optima)) {
    optimum.values = unpacked(optimum.values);
    optimum.optimal = bytes(optimum.optimal);
  }
  const members = (mask) => data.actions.map((_, a) => a).filter((a) => (mask >> a) & 1);
  const names = (mask) => members(mask).map((a) => data.actions[a]).join("|");
  const optimumOf = (block) => data.optima[`${block.scenario} ${block.discount}`];
  const cellsOf = (block) => data.scenarios[block.scenario].zone.length;
  const best = (block, o) => {
    const mask = optimumOf(block).optimal[o];
    return block.kind === "q"
      ? [...optimumOf(block).values.subarray(o * N_ACTIONS, (o + 1) * N_ACTIONS)]
      : data.actions.map((_, a) => ((mask >> a) & 1) / members(mask).length);
  };
  const isOver = (block, o) => data.scenarios[block.scenario].terminated.slice(o * N_ACTIONS, (o + 1) * N_ACTIONS).every(Boolean);
  const valueAt = (block, k, o, a) => block.values[(k * cellsOf(block) + o) * N_ACTIONS + a];
  const placeOf = (block, k, o) => block.map_row + k * cellsOf(block) + o;

  // The row of a file whose maps the page holds packed, as it is in the file.
  const filed = (value) => (Number.isNaN(value) ? "" : +value.toFixed(data.decimals));
  function mapRow(file, place) {
    if (file.endsWith("optimum.csv")) {
      for (const [key, optimum] of Object.entries(data.optima)) {
        const o = place - optimum.row;
        if (o < 0 || o >= optimum.optimal.length) continue;
        const [scenario, discount] = key.split(" ");
        const { columns } = data.scenarios[scenario];
        return [scenario, discount, Math.floor(o / columns), o % columns, names(optimum.optimal[o]), ...data.actions.map((_, a) => filed(optimum.values[o * N_ACTIONS + a]))].map(String);
      }
    }
    const block = data.blocks.find((one) => file === `${data.prefix}agent_${one.scenario}.csv` && place >= one.map_row && place < one.map_row + one.greedy.length);
    const [k, o] = [Math.floor((place - block.map_row) / cellsOf(block)), (place - block.map_row) % cellsOf(block)];
    const { columns } = data.scenarios[block.scenario];
    return [block.algorithm, block.observation, block.steps[k], Math.floor(o / columns), o % columns, names(block.greedy[k * cellsOf(block) + o]), ...data.actions.map((_, a) => filed(valueAt(block, k, o, a)))].map(String);
  }

  function colour(value, [low, high]) {
    if (value === null || Number.isNaN(value)) return NO_NUMBER;
    const share = high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0.5;
    return data.colours[Math.round(share * (data.colours.length - 1))];
  }
  function generator(seed) { // mulberry32: the same ties are broken the same way each time
    return () => {
      seed = (seed + 0x6d2b79f5) | 0;
      let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
      t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
      return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
  }

  const state = { step: 0, shown: "values", marks: true };
  const AGREES = "#ffe945"; // the ends of the scale
  const DIFFERS = "#00224e";
  const NO_NUMBER = "#ffffff"; // nowhere on the scale
  const sourced = (file, row, text) => element("a", { class: "n", href: `${data.prefix}${file}#row=${row}` }, text);

  class Panel {
    constructor(root, wish) {
      this.root = root;
      this.find = (selector) => root.querySelector(selector);
      this.selects = Object.fromEntries(["scenario", "algorithm", "observation"].map((key) => [key, this.find(`[name=${key}]`)]));
      for (const [key, select] of Object.entries(this.selects)) {
        select.addEventListener("change", () => {
          this.choose({ ...this.wish(), [key]: select.value });
          refresh();
        });
      }
      this.map = this.find(".map");
      this.map.addEventListener("keydown", (event) => this.key(event));
      this.cursor = null;
      this.choose(wish);
    }
    wish() {
      return Object.fromEntries(Object.entries(this.selects).map(([key, select]) => [key, select.value]));
    }
    // Takes what is wished for as far as there is such a block.
    choose(wish) {
      const before = this.block;
      let left = data.blocks;
      for (const [key, select] of Object.entries(this.selects)) {
        const there = [...new Set(left.map((one) => one[key]))];
        const value = there.includes(wish[key]) ? wish[key] : there[0];
        select.replaceChildren(...there.map((name) => element("option", { value: name }, name)));
        select.value = value;
        left = left.filter((one) => one[key] === value);
      }
      this.block = left[0];
      if (this.block === before) return;
      this.scene = data.scenarios[this.block.scenario];
      this.ranges = {};
      if (this.cursor === null || before?.scenario !== this.block.scenario) this.cursor = this.scene.start;
      this.from = this.scene.start;
      this.build();
    }
    // The last map that is not later than the step that is looked at.
    get k() {
      return Math.max(this.block.steps.findLastIndex((step) => step <= state.step), 0);
    }
    centre(o) {
      return [MARGIN + UNIT * ((o % this.scene.columns) + 0.5), UNIT * (Math.floor(o / this.scene.columns) + 0.5)];
    }
    build() {
      const { rows: nRows, columns, issuer, radii } = this.scene;
      const image = drawn("svg", { viewBox: `0 0 ${MARGIN + UNIT * columns + 2} ${UNIT * nRows + MARGIN}`, "aria-hidden": "true", style: `min-width:${12 * columns}px` });
      this.shapes = [];
      this.marks = [];
      const h = UNIT / 2;
      const corners = [[[-h, -h], [h, -h]], [[-h, h], [h, h]], [[-h, -h], [-h, h]], [[h, -h], [h, h]]];
      const cells = drawn("g");
      const marks = drawn("g", { "pointer-events": "none" });
      for (let o = 0; o < nRows * columns; o++) {
        const [x, y] = this.centre(o);
        const shapes = corners.map((pair) => drawn("polygon", { points: [...pair, [0, 0]].map(([dx, dy]) => `${x + dx},${y + dy}`).join(" ") }));
        shapes.push(drawn("circle", { cx: x, cy: y, r: UNIT * 0.2, stroke: "#fff", "stroke-width": 0.8, "stroke-opacity": 0.7 }));
        const whole = drawn("rect", { x: x - h, y: y - h, width: UNIT, height: UNIT });
        const cell = drawn("g", {}, whole, ...shapes);
        cell.addEventListener("pointerenter", () => this.look(o));
        cell.addEventListener("pointerdown", () => this.look(o));
        cells.append(cell);
        this.shapes.push([...shapes, whole]);
        const mark = drawn("path", { fill: "none" });
        const dot = drawn("circle", { cx: x, cy: y, r: 3.2, fill: "#fff", stroke: "#000", "stroke-width": 1 });
        marks.append(mark, dot);
        this.marks.push([mark, dot]);
      }
      image.append(cells);
      const box = (radius, dash) => {
        const top = Math.max(issuer[0] - radius, 0) * UNIT;
        const left = Math.max(issuer[1] - radius, 0) * UNIT;
        const size = {
          x: left + MARGIN, y: top, fill: "none", "pointer-events": "none",
          width: (Math.min(issuer[1] + radius, columns - 1) + 1) * UNIT - left,
          height: (Math.min(issuer[0] + radius, nRows - 1) + 1) * UNIT - top,
        };
        image.append(drawn("rect", { ...size, stroke: "#000", "stroke-width": 4 }));
        image.append(drawn("rect", { ...size, stroke: "#fff", "stroke-width": 2, ...(dash ? { "stroke-dasharray": "5 4" } : {}) }));
      };
      box(radii[1], false);
      box(radii[0], true);
      const [sx, sy] = this.centre(this.scene.start);
      image.append(drawn("rect", { x: sx - 10, y: sy - 10, width: 20, height: 20, fill: "none", stroke: "#000", "stroke-width": 3.4, "pointer-events": "none" }));
      image.append(drawn("rect", { x: sx - 10, y: sy - 10, width: 20, height: 20, fill: "none", stroke: "#fff", "stroke-width": 1.6, "pointer-events": "none" }));
      image.append(star(...this.centre(issuer[0] * columns + issuer[1]), 11));
      image.append(marks);
      this.trail = drawn("polyline", { fill: "none", stroke: "#fff", "stroke-width": 3.4, "stroke-linejoin": "round", "pointer-events": "none" });
      this.trailTop = drawn("polyline", { fill: "none", stroke: "#d55e00", "stroke-width": 1.8, "stroke-linejoin": "round", "pointer-events": "none" });
      this.agent = drawn("circle", { r: 8, fill: "#d55e00", stroke: "#fff", "stroke-width": 2, "pointer-events": "none" });
      this.box = drawn("rect", { class: "cursor", width: UNIT, height: UNIT, "pointer-events": "none" });
      image.append(this.trail, this.trailTop, this.agent, this.box);
      for (let row = 0; row < nRows; row += 2) image.append(drawn("text", { x: MARGIN - 5, y: UNIT * (row + 0.5) + 4, "text-anchor": "end" }, String(row)));
      for (let column = 0; column < columns; column += 2) image.append(drawn("text", { x: MARGIN + UNIT * (column + 0.5), y: UNIT * nRows + 14, "text-anchor": "middle" }, String(column)));
      this.map.replaceChildren(image);
      this.restart(this.scene.start);
    }
    key(event) {
      const { rows: nRows, columns } = this.scene;
      const [row, column] = [Math.floor(this.cursor / columns), this.cursor % columns];
      const moved = { ArrowUp: [row - 1, column], ArrowDown: [row + 1, column], ArrowLeft: [row, column - 1], ArrowRight: [row, column + 1] }[event.key];
      if (event.key === "Enter") this.begin(this.cursor);
      else if (!moved) return;
      else if (moved[0] >= 0 && moved[0] < nRows && moved[1] >= 0 && moved[1] < columns) this.look(moved[0] * columns + moved[1]);
      event.preventDefault();
    }
    look(o) {
      this.cursor = o;
      this.read();
    }
    begin(o) {
      if (isOver(this.block, o)) return;
      this.restart(o);
      this.draw();
    }
    // The ends of the colour scale: all of training but the lowest and the highest hundredth, which would take
    // the colours from the rest; and whether there are such.
    range(kind) {
      if (!this.ranges[kind]) {
        const all = [];
        const n = cellsOf(this.block);
        for (let o = 0; o < n; o++) {
          if (isOver(this.block, o)) continue;
          const optimal = best(this.block, o);
          for (let k = 0; k < this.block.steps.length; k++) {
            for (let a = kind === "ping" ? PING : 0; a < N_ACTIONS; a++) {
              all.push(valueAt(this.block, k, o, a) - (kind === "difference" ? optimal[a] : 0));
            }
          }
        }
        const sorted = Float32Array.from(all.filter((value) => !Number.isNaN(value))).sort();
        const at = (share) => sorted[Math.floor(share * (sorted.length - 1))];
        this.ranges[kind] = sorted.length ? [at(0.01), at(0.99), sorted[0] < at(0.01), sorted.at(-1) > at(0.99)] : [0, 1];
      }
      return this.ranges[kind];
    }
    draw() {
      const { block, scene } = this;
      const kind = state.shown;
      const other = panels.find((one) => one !== this);
      let range = this.range(kind);
      if (other && other.block.kind === block.kind) {
        const theirs = other.range(kind);
        range = [Math.min(range[0], theirs[0]), Math.max(range[1], theirs[1]), range[2] || theirs[2], range[3] || theirs[3]];
      }
      if (block.kind === "probability" && kind !== "difference") range = [0, 1];
      this.shapes.forEach((shapes, o) => {
        const over = isOver(block, o);
        const greedy = block.greedy[this.k * cellsOf(block) + o];
        const optimal = optimumOf(block).optimal[o];
        const whole = shapes[N_ACTIONS];
        const split = kind === "values" || kind === "difference";
        const base = best(block, o);
        shapes.slice(0, N_ACTIONS).forEach((shape, a) => {
          const value = valueAt(block, this.k, o, a) - (kind === "difference" ? base[a] : 0);
          shape.setAttribute("visibility", split && !over ? "visible" : "hidden");
          if (split) shape.setAttribute("fill", colour(value, range));
        });
        if (over) whole.setAttribute("fill", "#8a8a8a");
        else if (kind === "ping") whole.setAttribute("fill", colour(valueAt(block, this.k, o, PING), range));
        else whole.setAttribute("fill", kind === "policy" ? ((greedy & ~optimal) === 0 ? AGREES : DIFFERS) : "#000");
        const [mark, dot] = this.marks[o];
        const indifferent = greedy === 2 ** N_ACTIONS - 1; // where it never was, mostly: marks would say nothing
        const visible = (state.marks || kind === "policy") && !over && !indifferent;
        const moves = members(greedy).filter((a) => a !== PING);
        const [x, y] = this.centre(o);
        const arrow = (a) => {
          const [dx, dy] = [[0, -1], [0, 1], [-1, 0], [1, 0]][a];
          const at = (along, across) => `${x + dx * along - dy * across},${y + dy * along + dx * across}`;
          return `M${at(6.5, 0)}L${at(13, 0)}M${at(10, 2.6)}L${at(13, 0)}L${at(10, -2.6)}`;
        };
        mark.setAttribute("d", visible ? moves.map(arrow).join("") : "");
        // Black on what is bright, white on the rest.
        const under = kind === "policy" ? ((greedy & ~optimal) === 0 ? AGREES : DIFFERS) : kind === "ping" ? whole.getAttribute("fill") : shapes[moves[0] ?? 0].getAttribute("fill");
        mark.setAttribute("class", data.colours.indexOf(under) > data.colours.length * 0.6 || under === AGREES ? "mark on-bright" : "mark");
        dot.setAttribute("visibility", visible && (greedy >> PING) & 1 ? "visible" : "hidden");
      });
      this.legend(kind, range);
      this.tell();
      this.read();
      this.drawWalk();
    }
    legend(kind, range) {
      const [low, ramp, high] = [".low", ".ramp", ".high"].map((one) => this.find(one));
      ramp.hidden = kind === "policy";
      if (kind === "policy") {
        low.replaceChildren(element("span", { class: "swatch", style: `display:inline-block;vertical-align:-3px;background:${AGREES}` }), " every greedy action is optimal");
        high.replaceChildren(element("span", { class: "swatch", style: `display:inline-block;vertical-align:-3px;background:${DIFFERS}` }), " some greedy action is not");
        return;
      }
      low.textContent = (range[2] ? "\u2264 " : "") + show(range[0], 2);
      high.textContent = (range[3] ? "\u2265 " : "") + show(range[1], 2);
      const zero = -range[0] / (range[1] - range[0]);
      ramp.replaceChildren(...(zero > 0.01 && zero < 0.99 ? [element("span", { class: "zero", style: `left:${100 * zero}%`, title: "0" })] : []));
    }
    tell() {
      const { block } = this;
      const row = block.agent_row + this.k;
      const curve = block.curve;
      const at = curve.step.indexOf(block.steps[this.k]);
      const all = [sourced(data.curves_file, curve.row + at, show(curve[""][at])), ` [${show(curve._low[at])}, ${show(curve._high[at])}]`];
      const what = block.kind === "q" ? `Q-values, discount ${block.discount}` : "Probabilities of the stochastic policy";
      const late = block.steps[this.k] === state.step ? "" : `At ${block.unit === "episodes" ? "episode" : "step"} ${grouped(block.steps[this.k])}: `;
      const diverged = Number.isNaN(valueAt(block, this.k, this.scene.start, 0)) ? " This net has diverged: it counts as the random policy, and has no values." : "";
      this.find(".told").replaceChildren(
        `${late}${what}.${diverged} This agent (seed ${block.seed}): score `, sourced("agent.csv", row, show(block.score[this.k])),
        ", success ", sourced("agent.csv", row, show(block.success[this.k])), ". Mean score of all runs: ", ...all, ".",
      );
      this.map.setAttribute("aria-label", `Map of ${block.algorithm}, ${block.observation}, in ${block.scenario}, ${block.unit} so far: ${block.steps[this.k]}. Arrow keys choose a cell, Enter starts the walk there.`);
      this.drawCurve();
    }
    drawCurve() {
      const { block } = this;
      const [width, height, left, top, bottom] = [360, 110, 34, 8, 22];
      const last = block.steps.at(-1) || 1;
      const floor = Math.max(-4, Math.min(-0.2, ...block.curve[""].filter((v) => v !== null), ...block.score));
      const x = (step) => left + ((width - left - 8) * step) / last;
      const y = (score) => top + ((height - top - bottom) * (1.1 - Math.max(score, floor))) / (1.1 - floor);
      const line = (values) => block.curve.step.map((step, i) => `${x(step)},${y(values[i])}`);
      const image = drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Score over training: mean of all runs with its interval, and this agent's; scores below ${show(floor, 1)} are drawn there` });
      for (const anchor of [0, 1]) {
        image.append(drawn("line", { class: "anchor", x1: left, x2: width - 8, y1: y(anchor), y2: y(anchor) }));
        image.append(drawn("text", { x: left - 5, y: y(anchor) + 4, "text-anchor": "end" }, String(anchor)));
      }
      if (floor < -0.7) image.append(drawn("text", { x: left - 5, y: y(floor) + 4, "text-anchor": "end" }, show(floor, 1)));
      image.append(drawn("polygon", { class: "band", points: [...line(block.curve._low), ...line(block.curve._high).reverse()].join(" ") }));
      image.append(drawn("polyline", { class: "mean", points: line(block.curve[""]).join(" ") }));
      block.score.forEach((score, k) => image.append(drawn("circle", { class: "own", cx: x(block.steps[k]), cy: y(score), r: k === this.k ? 4 : 2 })));
      image.append(drawn("line", { class: "now", x1: x(block.steps[this.k]), x2: x(block.steps[this.k]), y1: top, y2: height - bottom }));
      image.append(drawn("text", { x: left, y: height - 6 }, "score. Line: mean of all runs. Rings: this agent."));
      this.find(".curve").replaceChildren(image);
    }
    read() {
      const { block, scene, cursor } = this;
      const [x, y] = this.centre(cursor);
      this.box.setAttribute("x", x - UNIT / 2);
      this.box.setAttribute("y", y - UNIT / 2);
      const zone = { outside: "outside the regions", target: "in the target region", uncomfortable: "in the uncomfortable region", issuer: "where the issuer stands" }[data.zones[scene.zone[cursor]]];
      const title = element("p", {}, element("strong", {}, `Row ${Math.floor(cursor / scene.columns)}, column ${cursor % scene.columns}`), `, ${zone}`);
      if (isOver(block, cursor)) return this.find(".readout").replaceChildren(title, element("p", {}, "Whoever gets here has ended the episode: there is nothing to choose."));
      const greedy = block.greedy[this.k * cellsOf(block) + cursor];
      const optimum = optimumOf(block);
      const base = best(block, cursor);
      const lines = data.actions.map((action, a) => {
        const value = valueAt(block, this.k, cursor, a);
        const cells = [
          element("td", { class: "number" }, sourced(`agent_${block.scenario}.csv`, placeOf(block, this.k, cursor), show(value))),
          element("td", { class: "number" }, sourced("optimum.csv", optimum.row + cursor, show(base[a]))),
          element("td", { class: "number" }, show(value - base[a])),
          element("td", {}, [(greedy >> a) & 1 ? "greedy" : "", (optimum.optimal[cursor] >> a) & 1 ? "optimal" : ""].filter(Boolean).join(", ")),
        ];
        return element("tr", {}, element("th", { scope: "row" }, action), ...cells);
      });
      const head = ["action", block.kind === "q" ? "Q" : "probability", "optimum", "difference", "is"].map((text, i) => element("th", { scope: "col", ...(i > 0 && i < 4 ? { class: "number" } : {}) }, text));
      this.find(".readout").replaceChildren(title, element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...lines)));
    }

    // The walk: the greedy action, and what the compiled scenario says comes of it.

    restart(o = this.from) {
      this.from = o;
      this.state = o;
      this.path = [o];
      this.log = [];
      this.over = "";
      this.seen = new Map(); // when it was where, since it last had a choice
      this.random = generator(2021);
    }
    step() {
      if (this.over) return false;
      const n = cellsOf(this.block);
      const o = this.state % n; // states are numbered cell by cell, once for each count of wrong PINGs
      const choice = members(this.block.greedy[this.k * n + o]);
      const a = choice[Math.floor(this.random() * choice.length)];
      if (choice.length > 1) this.seen.clear();
      else this.seen.set(this.state, this.log.length);
      const taken = this.state * N_ACTIONS + a;
      const { scene } = this;
      this.log.push({ o, a, choice: choice.length, event: data.events[scene.event[taken]], grid: scene.grid_reward[taken], issuer: scene.issuer_reward[taken] });
      this.state = scene.next[taken];
      this.path.push(this.state % n);
      if (scene.terminated[taken]) {
        this.over = { target_ping: "PING in the target region: success.", issuer_reached: "The agent has run into the issuer: the episode is over.", last_wrong_ping: "One wrong PING too many: the episode is over." }[data.events[scene.event[taken]]];
      } else if (this.seen.has(this.state)) {
        const length = this.log.length - this.seen.get(this.state);
        this.over = `${length > 1 ? `It goes in circles of ${length} steps` : "It does not get on"}, and would until the limit of ${data.horizon} steps.`;
      } else if (this.log.length >= data.horizon) this.over = `Stopped at the limit of ${data.horizon} steps.`;
      return !this.over;
    }
    drawWalk() {
      const points = this.path.map((o) => this.centre(o).join(",")).join(" ");
      this.trail.setAttribute("points", points);
      this.trailTop.setAttribute("points", points);
      const [x, y] = this.centre(this.path.at(-1));
      this.agent.setAttribute("cx", x);
      this.agent.setAttribute("cy", y);
      const total = (key) => this.log.reduce((sum, one) => sum + one[key], 0);
      const where = (o) => `row ${Math.floor(o / this.scene.columns)}, column ${o % this.scene.columns}`;
      const told = this.log.length
        ? `${this.log.length} step${this.log.length > 1 ? "s" : ""} from ${where(this.from)}: rewards of the grid ${show(total("grid"))}, of the issuer ${show(total("issuer"))}. ${this.over}`
        : `The agent stands at ${where(this.from)}.`;
      const noise = this.scene.issuer_noise ? [element("p", { class: "note" }, `The issuer's reward is its mean; at each PING it adds at random up to \u00b1${show(this.scene.issuer_noise)}.`)] : [];
      const head = ["", "from", "action", "event", "grid", "issuer"].map((text) => element("th", { scope: "col" }, text));
      const lines = [...this.log.entries()].reverse().map(([i, one]) =>
        element("tr", {}, ...[String(i + 1), where(one.o), data.actions[one.a] + (one.choice > 1 ? `, one of ${one.choice} as good` : ""), one.event.replaceAll("_", " "), show(one.grid), show(one.issuer)].map((text) => element("td", {}, text))));
      const table = this.log.length ? [element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...lines))] : [];
      this.find(".walked").textContent = told;
      this.find(".walk").replaceChildren(...table, ...(this.log.length ? noise : []));
    }
  }

  function star(x, y, radius) {
    const points = Array.from({ length: 10 }, (_, i) => {
      const r = i % 2 ? radius * 0.42 : radius;
      return `${x + r * Math.sin((Math.PI * i) / 5)},${y - r * Math.cos((Math.PI * i) / 5)}`;
    });
    return drawn("polygon", { points: points.join(" "), fill: "#fff", stroke: "#000", "stroke-width": 1.4, "pointer-events": "none" });
  }

  // Controls.

  const slider = byId("step");
  const shownSelect = byId("shown");
  const timers = {};
  function play(name, button, words, tick, pause) {
    const stop = () => {
      clearInterval(timers[name]);
      delete timers[name];
      button.setAttribute("aria-pressed", "false");
      button.textContent = words[0];
    };
    button.addEventListener("click", () => {
      if (timers[name]) return stop();
      button.setAttribute("aria-pressed", "true");
      button.textContent = words[1];
      timers[name] = setInterval(() => tick() || stop(), pause);
    });
    return stop;
  }
  // All steps at which one of the two has a map.
  function steps() {
    return [...new Set(panels.flatMap((panel) => panel.block.steps))].sort((a, b) => a - b);
  }
  function toPlace(place) {
    state.step = steps()[place];
    for (const panel of panels) panel.restart();
    refresh();
  }
  function refresh() {
    const all = steps();
    const place = Math.max(all.findLastIndex((step) => step <= state.step), 0);
    state.step = all[place];
    slider.max = all.length - 1;
    slider.value = place;
    const text = `${grouped(state.step)} of ${grouped(all.at(-1))}`;
    byId("step-told").textContent = text;
    byId("step-label").textContent = panels[0].block.unit === "episodes" ? "Training episode" : "Training step";
    slider.setAttribute("aria-valuetext", text);
    for (const panel of panels) panel.draw();
    const named = panels.map(({ block }) => [block.scenario, block.algorithm, block.observation].map(escaped).join("."));
    state.hash = `#explorer=${[...named, state.step, state.shown].join("~")}`;
    clearTimeout(timers.address);
    if (state.live) timers.address = setTimeout(() => history.replaceState(null, "", state.hash), 150); // browsers allow few a second
  }
  const escaped = (text) => encodeURIComponent(text).replaceAll(".", "%2E").replaceAll("~", "%7E");
  function unescaped(text) {
    try {
      return decodeURIComponent(text);
    } catch {
      return ""; // an address that somebody has mistyped asks for nothing
    }
  }
  const wishOf = (text = "") => Object.fromEntries(["scenario", "algorithm", "observation"].map((key, i) => [key, unescaped(text.split(".")[i] ?? "")]));
  function fromHash() {
    const [left, right, step, shown] = (location.hash.startsWith("#explorer=") ? location.hash.slice(10) : "").split("~");
    return { left, right, step: Number(step), shown };
  }
  // Takes what an address asks for, as far as there is such a thing.
  function follow(asked) {
    panels[0].choose(wishOf(asked.left));
    panels[1].choose(wishOf(asked.right));
    state.step = asked.step >= 0 ? asked.step : steps().at(-1);
    if ([...shownSelect.options].some((option) => option.value === asked.shown)) state.shown = asked.shown;
    shownSelect.value = state.shown;
  }
  const asked = fromHash();
  const first = data.blocks[0];
  const net = data.blocks.find((one) => one.algorithm === "dqn");
  const second = net ? { ...net, scenario: first.scenario } : data.blocks.at(-1); // something else, if there is
  const panels = [];
  panels.push(new Panel(document.querySelector('[data-side="left"]'), first));
  panels.push(new Panel(document.querySelector('[data-side="right"]'), second));
  state.step = steps().at(-1);
  if (asked.left) follow(asked);
  addEventListener("hashchange", () => {
    if (!location.hash.startsWith("#explorer=")) return;
    stopLearning();
    stopWalking();
    follow(fromHash());
    refresh();
    byId("explorer").scrollIntoView();
  });

  const stopLearning = play("learn", byId("learn"), ["Play training", "Pause"], () => {
    toPlace(Number(slider.value) >= Number(slider.max) ? 0 : Number(slider.value) + 1);
    return Number(slider.value) < Number(slider.max);
  }, 450);
  const walkOn = () => {
    const going = panels.map((panel) => panel.step());
    for (const panel of panels) panel.drawWalk();
    return going.some(Boolean);
  };
  const stopWalking = play("walk", byId("walk-all"), ["Walk on", "Pause"], walkOn, 250);
  byId("walk-one").addEventListener("click", () => {
    stopWalking();
    walkOn();
  });
  byId("walk-again").addEventListener("click", () => {
    stopWalking();
    for (const panel of panels) {
      panel.restart(panel.scene.start);
      panel.drawWalk();
    }
  });
  slider.addEventListener("input", () => {
    stopLearning();
    stopWalking();
    toPlace(Number(slider.value));
  });
  shownSelect.addEventListener("change", () => {
    state.shown = shownSelect.value;
    refresh();
  });
  byId("marks").addEventListener("change", (event) => {
    state.marks = event.target.checked;
    refresh();
  });

  const sign = (...shapes) => drawn("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, ...shapes);
  const frame = (dash) => [drawn("rect", { x: 3, y: 3, width: 18, height: 18, fill: "none", stroke: "#000", "stroke-width": 4 }), drawn("rect", { x: 3, y: 3, width: 18, height: 18, fill: "none", stroke: "#fff", "stroke-width": 2, ...(dash ? { "stroke-dasharray": "4 3" } : {}) })];
  const key = [
    [[star(12, 12, 10)], "issuer"],
    [[drawn("rect", { x: 5, y: 5, width: 14, height: 14, fill: "none", stroke: "#000", "stroke-width": 3.4 }), drawn("rect", { x: 5, y: 5, width: 14, height: 14, fill: "none", stroke: "#fff", "stroke-width": 1.6 })], "start"],
    [frame(false), "target region's outer edge"],
    [frame(true), "uncomfortable region's edge"],
    [[drawn("rect", { width: 24, height: 24, fill: "#575d6d" }), drawn("path", { d: "M4,12L19,12M14,7L19,12L14,17", stroke: "#fff", "stroke-width": 2.4, fill: "none" })], "greedy move"],
    [[drawn("rect", { width: 24, height: 24, fill: "#575d6d" }), drawn("circle", { cx: 12, cy: 12, r: 5, fill: "#fff", stroke: "#000" })], "greedy PING"],
    [[drawn("circle", { cx: 12, cy: 12, r: 8, fill: "#d55e00", stroke: "#fff", "stroke-width": 2 })], "agent and its way"],
    [[drawn("rect", { x: 3, y: 3, width: 18, height: 18, class: "cursor" })], "cell whose numbers are shown"],
  ];
  if (data.blocks.some((block) => block.values.some(Number.isNaN))) key.push([[drawn("rect", { x: 3, y: 3, width: 18, height: 18, fill: NO_NUMBER, stroke: "#000" })], "no number: the net has diverged"]);
  byId("key").replaceChildren(...key.map(([shapes, text]) => element("li", {}, sign(...shapes), text)));
  refresh();
  byId("wait").remove();
  byId("explore").hidden = false;
  state.live = true; // from now on what is looked at is in the address, to be cited
  if (asked.left) byId("explorer").scrollIntoView();
})();
