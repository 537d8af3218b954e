// A panel: menus that choose an agent, its map with a cursor, its readout, curve and walk.
import { element } from "./elements.js";
import { agents, rowAndColumn } from "./agents.js";
import { SceneView } from "./scene.js";
import { kindFor, paint, paintLegend, sharedRange } from "./colours.js";
import { curveOf } from "./curve.js";
import { described, readoutOf } from "./readout.js";
import { Walk } from "./walk.js";

const LEARNER = ["scenario", "algorithm", "observation", "experiment"];
export const KEYS = [...LEARNER, "seed"]; // of an agent
const sameSize = (scene, other) => scene.rows === other?.rows && scene.columns === other?.columns;

export class Panel {
  // `refresh` is called after the reader has chosen another agent, `point` with a cell that they
  // point at and its scene.
  constructor(root, refresh, point) {
    this.find = (selector) => root.querySelector(selector);
    this.root = root;
    this.point = (cell) => point(cell, this.agent.scene);
    this.menus = Object.fromEntries(KEYS.map((key) => [key, this.find(`[name=${key}]`)]));
    for (const [key, menu] of Object.entries(this.menus)) {
      menu.parentElement.hidden = key === "experiment" && new Set(agents.map((agent) => agent[key])).size === 1
        || key === "seed" && agents.every((agent) => agent.seeds.length === 1);
      menu.addEventListener("change", () => {
        this.choose({ ...Object.fromEntries(KEYS.map((name) => [name, this.agent[name]])), [key]: menu.value });
        refresh();
      });
    }
    this.find(".map").addEventListener("keydown", (event) => this.key(event));
  }
  // Chooses the agent that has what is wished for, as far as there is one.
  choose(wish) {
    const choose = (key, names) => {
      const name = names.includes(wish[key]) ? wish[key] : names[0];
      this.menus[key].replaceChildren(...names.map((value) => element("option", { value }, value)));
      this.menus[key].value = name;
      return name;
    };
    let left = agents;
    for (const key of LEARNER) {
      const name = choose(key, [...new Set(left.map((agent) => agent[key]))]);
      left = left.filter((agent) => agent[key] === name);
    }
    const seed = choose("seed", left[0].seeds);
    const before = this.agent;
    if (before && KEYS.every((key) => before[key] === { ...left[0], seed }[key])) return;
    this.agent = left[0].ofSeed(seed);
    const { scene } = this.agent;
    if (before?.scene !== scene) {
      this.view = new SceneView(scene, (cell) => this.point(cell));
      this.find(".map").replaceChildren(this.view.image);
      if (!sameSize(scene, before?.scene)) this.cursor = scene.start;
    }
    this.map = 0;
    this.startWalk(scene.start);
  }
  key(event) {
    const { rows, columns } = this.agent.scene;
    const { row, column } = rowAndColumn(this.agent.scene, this.cursor);
    const moves = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
    if (event.key === "Enter") this.startWalk(this.cursor);
    else if (event.key in moves) {
      const [toRow, toColumn] = [row + moves[event.key][0], column + moves[event.key][1]];
      if (toRow >= 0 && toRow < rows && toColumn >= 0 && toColumn < columns) this.point(toRow * columns + toColumn);
    } else return;
    event.preventDefault();
  }
  // Shows the numbers of a cell that the reader points at in a scene, if this one has the same size.
  follow(cell, scene) {
    if (sameSize(this.agent.scene, scene)) this.look(cell);
  }
  look(cell) {
    this.cursor = cell;
    this.view.showCursor(cell);
    this.find(".readout").replaceChildren(...readoutOf(this.agent, this.map, cell));
  }
  // Starts the walk in a cell, unless the episode is over there.
  startWalk(cell = this.walk.start) {
    if (this.agent.isOver(cell)) return;
    this.walk = new Walk(this.agent, this.map, cell);
    this.drawWalk();
  }
  // Draws what the agent knows at a step; a walk starts again if that is another map.
  draw({ step, kind, marks }, other) {
    const map = this.agent.mapAt(step);
    if (map !== this.map) {
      this.map = map;
      this.startWalk();
    }
    const painted = kindFor(this.agent, kind);
    const range = sharedRange(this.agent, other.agent, painted);
    paint(this.view, this.agent, map, painted, range, marks);
    paintLegend(this.root, painted, range);
    this.find(".about").replaceChildren(...described(this.agent, map, step));
    this.find(".curve").replaceChildren(...curveOf(this.agent, map));
    const { algorithm, observation, scenario, seed, unitName, steps } = this.agent;
    const title = `Map of ${algorithm}, ${observation}, in ${scenario}, ${unitName} ${steps[map]}, seed ${seed}.`;
    this.find(".map").setAttribute("aria-label", `${title} Arrow keys choose a cell, Enter starts the walk there.`);
    this.look(this.cursor);
  }
  drawWalk() {
    this.view.showPath(this.walk.path);
    this.find(".walked").textContent = this.walk.summary;
    this.find(".walk").replaceChildren(...this.walk.table);
  }
}
