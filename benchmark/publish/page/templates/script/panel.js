// A panel: menus that choose an agent and where people are, its map with a cursor, its readout, curve and walk.
import { element } from "./elements.js";
import { agents, placeOf, rowAndColumn } from "./agents.js";
import { SceneView } from "./scene.js";
import { kindFor, paint, paintLegend, sharedRange } from "./colours.js";
import { curveOf } from "./curve.js";
import { described, readoutOf } from "./readout.js";
import { Walk } from "./walk.js";

const CHOSEN = ["scenario", "learner", "experiment"]; // what names an agent, but for its seed
const sameSize = (room, other) => room.rows === other?.rows && room.columns === other?.columns;
const alike = (room, other) => sameSize(room, other) && String([room.shape, room.places]) === String([other.shape, other.places]);
const MOVES = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };

export class Panel {
  // `refresh` is called after the reader has chosen another agent, `point` with a cell that they point at and
  // its room, and `situate` with a change of where people are, see `Room.changed`, and its room.
  constructor(root, { refresh, point, situate }) {
    this.find = (selector) => root.querySelector(selector);
    this.root = root;
    this.point = (cell) => point(cell, this.agent.room);
    this.situate = (change) => situate(change, this.agent.room);
    const menu = (name) => this.find(`[name=${name}]`);
    this.menus = Object.fromEntries([...CHOSEN, "seed"].map((key) => [key, menu(key)]));
    for (const [key, select] of Object.entries(this.menus)) {
      select.addEventListener("change", () => {
        const { agent, block } = this;
        this.choose({ ...agent, [key]: select.value, block }, agent.room);
        refresh();
      });
    }
    this.situation = Object.fromEntries(["person", "phase", "pings"].map((key) => [key, menu(key)]));
    for (const [key, select] of Object.entries(this.situation)) {
      select.addEventListener("change", () => this.situate(key === "person" ? { group: select.value } : { [key]: Number(select.value) }));
    }
    this.find(".map").addEventListener("keydown", (event) => this.key(event));
  }
  // Chooses the agent that fits a wish best; its block is one of `roomOfBlock`, or else of the agent's room.
  choose(wish, roomOfBlock) {
    const changed = [];
    const choose = (key, names) => {
      const name = names.includes(wish[key]) ? wish[key] : names[0];
      if (wish[key] && name !== wish[key]) changed.push(`The ${key} is now ${name}: there is no ${wish[key]} here.`);
      this.menus[key].replaceChildren(...names.map((value) => element("option", { value }, value)));
      this.menus[key].value = name;
      this.menus[key].parentElement.hidden = names.length === 1 && ["experiment", "seed"].includes(key);
      return name;
    };
    let left = agents;
    for (const key of CHOSEN) {
      const name = choose(key, [...new Set(left.map((agent) => agent[key]))]);
      left = left.filter((agent) => agent[key] === name);
    }
    const seed = choose("seed", left[0].seeds);
    this.find(".changed").textContent = changed.join(" ");
    const before = this.agent;
    this.agent = left[0].ofSeed(seed);
    const { room } = this.agent;
    if (before?.room !== room) {
      this.view = new SceneView(room, (cell) => this.point(cell), (person) => this.situate({ person }));
      this.find(".map").replaceChildren(this.view.image);
      if (!sameSize(room, before?.room)) this.cursor = room.starts[0] % room.nCells;
    }
    const nBlocks = room.kind.length / room.nCells;
    // People stand as wished for, or else as on the other map.
    const wanted = alike(room, roomOfBlock ?? room) ? wish.block : alike(room, this.other?.agent.room) ? this.other.block : NaN;
    const block = Math.trunc(Number(wanted));
    this.block = block >= 0 && block < nBlocks ? block : room.blockOf(room.starts[0]);
    this.fillSituation();
    this.map = 0;
    this.startWalk(room.startOf(this.block));
  }
  // Offers what there is a choice of: where people are, the phase, and the wrong PINGs if they are observed.
  fillSituation() {
    const { room, sight } = this.agent;
    const count = (length) => Array.from({ length }, (_, i) => i);
    const offered = {
      person: room.places.length > 1 ? room.places.map((cells) => [cells, cells.map((cell) => placeOf(room, cell)).join("; ")]) : [],
      phase: room.hasNamedPhases ? room.phases.map((name, i) => [i, name]) : [],
      pings: sight.observed.includes("wrong_pings") ? count(room.shape[3]).map((n) => [n, n]) : [],
    };
    for (const [key, select] of Object.entries(this.situation)) {
      select.replaceChildren(...offered[key].map(([value, text]) => element("option", { value }, text)));
      select.parentElement.hidden = !offered[key].length;
    }
  }
  // Shows another block: that of a walk, where wrong PINGs count only if they are observed.
  showBlock(block) {
    const { room, sight } = this.agent;
    const parts = room.partsOf(block);
    this.block = room.blockWith({ ...parts, pings: sight.observed.includes("wrong_pings") ? parts.pings : 0 });
    const { person, phase, pings } = this.situation;
    [person.value, phase.value, pings.value] = [room.groupOn(room.viewOf(this.block)), room.phaseOf(this.block), parts.pings];
  }
  key(event) {
    const { room } = this.agent;
    if (event.key === "Enter") this.startWalk(this.block * room.nCells + this.cursor);
    else if (event.key in MOVES) {
      const moved = event.shiftKey ? room.groupOn(room.viewOf(this.block))[0] : this.cursor;
      const { row, column } = rowAndColumn(room, moved);
      const [toRow, toColumn] = [row + MOVES[event.key][0], column + MOVES[event.key][1]];
      const cell = toRow * room.columns + toColumn;
      if (toRow >= 0 && toRow < room.rows && toColumn >= 0 && toColumn < room.columns) {
        if (event.shiftKey) this.situate({ person: cell });
        else this.point(cell);
      }
    } else return;
    event.preventDefault();
  }
  // Shows the numbers of a cell that the reader points at in a room, if this one has the same size.
  follow(cell, room) {
    if (sameSize(this.agent.room, room)) this.look(cell);
  }
  // Changes where people are as the reader did in a room like this; returns whether that is possible.
  change(change, room) {
    const block = alike(this.agent.room, room) ? this.agent.room.changed(this.block, change) : null;
    if (block === null || block === this.block) return false;
    this.startWalk(this.agent.room.startOf(block));
    return true;
  }
  look(cell) {
    this.cursor = cell;
    this.view.showCursor(cell);
    this.find(".readout").replaceChildren(...readoutOf(this.agent, this.map, this.block, cell));
  }
  // Starts the walk in a state; with another number, ties and chance may go another way.
  startWalk(state = this.walk.start, number = 0) {
    this.walk = new Walk(this.agent, this.map, state, number);
    this.drawWalk();
  }
  finishWalk() {
    this.walk.finish();
    this.drawWalk();
  }
  // Draws what the agent knows at a step; a walk starts again if that is another map.
  draw(shown, other) {
    this.shown = shown;
    this.other = other;
    const map = this.agent.mapAt(shown.step);
    if (map !== this.map) {
      this.map = map;
      this.startWalk();
    }
    this.paint();
    this.find(".about").replaceChildren(...described(this.agent, map, shown.step));
    this.find(".curve").replaceChildren(...curveOf(this.agent, map));
    const { label, scenario, seed, unitName, steps } = this.agent;
    const title = `Map of ${label} in ${scenario}, ${unitName} ${steps[map]}, seed ${seed}.`;
    const shift = this.agent.room.places.length > 1 ? ", with Shift they move the person" : "";
    this.find(".map").setAttribute("aria-label", `${title} Arrow keys choose a cell${shift}, Enter starts the walk there.`);
  }
  paint() {
    const painted = kindFor(this.agent, this.shown.kind);
    const range = sharedRange(this, this.other, painted);
    paint(this.view, this, this.map, painted, range);
    paintLegend(this.root, painted, range);
    this.look(this.cursor);
  }
  drawWalk() {
    const { block } = this;
    this.showBlock(this.agent.room.blockOf(this.walk.state));
    if (this.shown && this.block !== block) this.paint();
    this.view.showPath(this.walk.path);
    this.find(".walked").textContent = this.walk.summary;
    this.find(".walk").replaceChildren(...this.walk.table);
  }
}
