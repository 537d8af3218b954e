// The agents of the explorer and the optima beside them: values and actions by map, cell and action.
import { rowsOf } from "./csv.js";
import { bytes, explorer } from "./data.js";

export const PING = explorer?.actions.indexOf("PING");

// The numbers of the actions in a mask.
export const members = (mask) => explorer.actions.map((_, a) => a).filter((a) => (mask >> a) & 1);
const named = (mask) => members(mask).map((a) => explorer.actions[a]).join("|");

// Values from integers, each of which is less that of the map before.
function unpacked(changes, nMaps) {
  const integers = Float64Array.from(changes);
  for (let i = integers.length / nMaps; i < integers.length; i++) integers[i] += integers[i - integers.length / nMaps];
  return integers.map((value) => (value === explorer.no_number ? NaN : value / 10 ** explorer.decimals));
}

// An agent: its values and actions at every map, or only its last actions.
class Agent {
  constructor(packed) {
    Object.assign(this, packed);
    this.scene = explorer.scenes[packed.scene];
    this.nCells = this.scene.zone.length;
    this.optimum = optima[packed.optimum];
    this.values = unpacked(packed.values, packed.steps.length);
    this.greedy = bytes(packed.greedy);
    this.hasValues = true;
    this.timeline = this.steps; // of its learner
    this.seed = String(packed.seed);
    this.seeds = packed.seeds.map(String);
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
  lineOf(map, cell) {
    return this.maps.line + map * this.nCells + cell;
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
  // The agent of the same learner with another seed: only its greedy policy after training is published, in a
  // line of a file.
  ofSeed(seed) {
    if (seed === this.seed) return this;
    const { file, line: first } = this.others;
    const line = first + this.seeds.indexOf(seed);
    const rows = rowsOf(file);
    const cell = (name) => rows[line - 1][rows[0].indexOf(name)];
    return Object.assign(Object.create(Agent.prototype), this, {
      seed,
      hasValues: false,
      greedy: Uint8Array.from(cell("greedy"), (letter) => explorer.letters.indexOf(letter)),
      steps: [this.timeline.at(-1)],
      score: [Number(cell("score"))],
      success: [Number(cell("success"))],
      evaluation: { file, line },
    });
  }
}

const optima = (explorer?.optima ?? []).map((packed) => (
  { ...packed, values: unpacked(packed.values, 1), optimal: bytes(packed.optimal) }
));
export const agents = (explorer?.agents ?? []).map((packed) => new Agent(packed));

export const rowAndColumn = (scene, cell) => ({ row: Math.floor(cell / scene.columns), column: cell % scene.columns });

const contains = (place, count, file, line) => place.file === file && line >= place.line && line < place.line + count;

// The columns and the cells of a line of a file that the page holds packed, as in the file; null for other files.
export function packedLine(file, line) {
  const agent = agents.find(({ maps, greedy }) => contains(maps, greedy.length, file, line));
  if (agent) return mapLine(agent, line - agent.maps.line);
  const optimum = optima.find((each) => contains(each, each.optimal.length, file, line));
  return optimum ? optimumLine(optimum, line - optimum.line) : null;
}

function mapLine(agent, place) {
  const { scene, algorithm, observation } = agent;
  const cell = place % agent.nCells;
  const step = agent.steps[(place - cell) / agent.nCells];
  const record = { algorithm, observation, step, ...rowAndColumn(scene, cell), greedy: named(agent.greedy[place]) };
  return asWritten(agent.maps.columns, record, agent.values, place);
}

function optimumLine(optimum, cell) {
  const { scene } = agents.find((agent) => agent.optimum === optimum);
  const { scenario, discount } = optimum;
  const record = { scenario, discount, ...rowAndColumn(scene, cell), optimal: named(optimum.optimal[cell]) };
  return asWritten(optimum.columns, record, optimum.values, cell);
}

// A float in a file has six significant digits, and a point or an exponent of two digits: 1.0, 2.5e+06.
function asWritten(columns, record, values, place) {
  const text = (value) => {
    if (Number.isNaN(value)) return "";
    if (Math.abs(value) >= 1e6) return value.toExponential().replace("e+", "e+0");
    return Number.isInteger(value) ? `${value}.0` : String(value);
  };
  const cells = new Map(Object.entries(record));
  explorer.actions.forEach((action, a) => {
    const value = +values[place * explorer.actions.length + a].toFixed(explorer.decimals);
    cells.set(action, text(+value.toPrecision(6)));
  });
  return [columns, columns.map((name) => String(cells.get(name)))];
}
