// The agents of the explorer and the optima beside them: values and actions by map, cell and action.
import { rowsOf, holds } from "./csv.js";
import { bytes, explorer } from "./data.js";
import { show } from "./elements.js";

const CURVES = ["curves.csv", "learning.csv"]; // files with the mean score over training
export const PING = explorer?.actions.indexOf("PING");

// The numbers of the actions in a mask.
export const members = (mask) => explorer.actions.map((_, a) => a).filter((a) => (mask >> a) & 1);

// Values from integers, each of which is less that of the map before.
function unpacked(changes, nMaps) {
  const integers = Float64Array.from(changes);
  for (let i = integers.length / nMaps; i < integers.length; i++) integers[i] += integers[i - integers.length / nMaps];
  return integers.map((value) => (value === explorer.no_number ? NaN : value / 10 ** explorer.decimals));
}

for (const optimum of explorer?.optima ?? []) {
  optimum.values = unpacked(optimum.values, 1);
  optimum.optimal = bytes(optimum.optimal);
}

// The mean score of a learner's runs over training, from a file that the page holds; null if there is none.
function meanScoreOf(agent) {
  const file = CURVES.map((name) => agent.folder + name).find(holds);
  if (!file) return null;
  const [names, ...rows] = rowsOf(file);
  const wanted = { condition: "default", ...agent };
  const keys = ["scenario", "condition", "algorithm", "observation"].filter((name) => names.includes(name));
  const found = rows.map((row, i) => ({ line: i + 2, ...Object.fromEntries(names.map((name, j) => [name, row[j]])) }))
    .filter((row) => keys.every((key) => row[key] === wanted[key]) && row.score);
  const column = (name) => found.map((row) => Number(row[name]));
  if (!found.length) return null;
  return { file, line: column("line"), step: column("step"), mean: column("score"), low: column("score_low"), high: column("score_high") };
}

// An agent: its values and actions at every map, or only its last actions.
class Agent {
  constructor(packed) {
    Object.assign(this, packed);
    this.nCells = this.scene.zone.length;
    this.values = unpacked(packed.values, packed.steps.length);
    this.greedy = bytes(packed.greedy);
    this.hasValues = true;
    this.timeline = this.steps; // of its learner
    this.curve = meanScoreOf(packed);
    this.seeds = packed.seeds.map(String);
    this.seed = this.seeds[0];
    this.unitName = packed.unit === "episodes" ? "episode" : "step";
  }
  // The last map that is not later than a step.
  mapAt(step) {
    return Math.max(this.steps.findLastIndex((mapped) => mapped <= step), 0);
  }
  valueAt(map, cell, action) {
    return this.values[(map * this.nCells + cell) * explorer.actions.length + action];
  }
  greedyAt(map, cell) {
    return this.greedy[map * this.nCells + cell];
  }
  // Whether all actions are equally good to the agent in a cell, as where it has learned nothing.
  isIndifferent(map, cell) {
    const hasDiverged = this.hasValues && Number.isNaN(this.valueAt(map, cell, 0));
    return members(this.greedyAt(map, cell)).length === explorer.actions.length && !hasDiverged;
  }
  // Whether the episode is over in a cell.
  isOver(cell) {
    return Boolean(this.scene.over[cell]);
  }
  // The optimum of every action in a cell: values, or an even choice among the optimal actions.
  optimumAt(cell) {
    const { values, optimal } = this.optimum;
    const best = members(optimal[cell]);
    if (this.kind === "q") return explorer.actions.map((_, a) => values[cell * explorer.actions.length + a]);
    return explorer.actions.map((_, a) => (best.includes(a) ? 1 / best.length : 0));
  }
  // The agent of the same learner with another seed, of which there is only the greedy policy after training.
  ofSeed(seed) {
    const place = this.seeds.indexOf(seed);
    if (place === 0) return this;
    return Object.assign(Object.create(Agent.prototype), this, {
      seed,
      hasValues: false,
      greedy: bytes(this.final.greedy).slice(place * this.nCells, (place + 1) * this.nCells),
      steps: [this.timeline.at(-1)],
      score: [this.final.score[place]],
      success: [this.final.success[place]],
    });
  }
}

export const agents = (explorer?.agents ?? []).map((packed) => new Agent(packed));

export const rowAndColumn = (scene, cell) => ({ row: Math.floor(cell / scene.columns), column: cell % scene.columns });

// The cell from which rows and columns are counted: the issuer's on an egocentric map.
export const originOf = (scene) => scene.origin ?? [0, 0];

export function placeOf(scene, cell) {
  const { row, column } = rowAndColumn(scene, cell);
  const [firstRow, firstColumn] = originOf(scene);
  return `row ${show(row - firstRow)}, column ${show(column - firstColumn)}`;
}
