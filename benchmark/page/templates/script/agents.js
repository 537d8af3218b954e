// The agents of the explorer and the optima beside them: values and actions by map, cell and action.
import { bytes, explorer } from "./data.js";

export const PING = explorer?.actions.indexOf("PING");

// The numbers of the actions in a mask.
export const members = (mask) => explorer.actions.map((_, a) => a).filter((a) => (mask >> a) & 1);
const named = (mask) => members(mask).map((a) => explorer.actions[a]).join("|");

function unpacked(base64) {
  const view = new DataView(bytes(base64).buffer);
  return Float64Array.from({ length: view.byteLength / 4 }, (_, i) => {
    const value = view.getInt32(4 * i, true);
    return value === explorer.no_number ? NaN : value / 10 ** explorer.decimals;
  });
}

class Agent {
  constructor(packed) {
    Object.assign(this, packed);
    this.scene = explorer.scenes[packed.scene];
    this.nCells = this.scene.zone.length;
    this.optimum = optima[packed.optimum];
    this.values = unpacked(packed.values);
    this.greedy = bytes(packed.greedy);
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
  lineOf(map, cell) {
    return this.map.line + map * this.nCells + cell;
  }
  // Whether the episode is over in a cell.
  isOver(cell) {
    return Boolean(this.scene.over[cell]);
  }
  // The optimum of every action in a cell: values, or an even choice among the optimal actions.
  optimumAt(cell) {
    const { values, optimal } = this.optimum;
    return explorer.actions.map((_, a) =>
      this.kind === "q" ? values[cell * explorer.actions.length + a] : ((optimal[cell] >> a) & 1) / members(optimal[cell]).length);
  }
}

const optima = (explorer?.optima ?? []).map((packed) => ({ ...packed, values: unpacked(packed.values), optimal: bytes(packed.optimal) }));
export const agents = (explorer?.agents ?? []).map((packed) => new Agent(packed));

// The columns and the cells of a line of a file that the page holds packed, as in the file; null for other files.
export function packedLine(file, line) {
  const agent = agents.find(({ map, greedy }) => map.file === file && line >= map.line && line < map.line + greedy.length);
  if (agent) {
    const place = line - agent.map.line;
    const cell = place % agent.nCells;
    const map = (place - cell) / agent.nCells;
    const record = { algorithm: agent.algorithm, observation: agent.observation, step: agent.steps[map], greedy: named(agent.greedy[place]) };
    return asWritten(agent.map.columns, { ...record, ...rowAndColumn(agent.scene, cell) }, (a) => agent.valueAt(map, cell, a));
  }
  const optimum = optima.find((each) => each.file === file && line >= each.line && line < each.line + each.optimal.length);
  if (!optimum) return null;
  const { scene } = agents.find((each) => each.optimum === optimum);
  const cell = line - optimum.line;
  const record = { scenario: optimum.scenario, discount: optimum.discount, optimal: named(optimum.optimal[cell]) };
  return asWritten(optimum.columns, { ...record, ...rowAndColumn(scene, cell) }, (a) => optimum.values[cell * explorer.actions.length + a]);
}

export const rowAndColumn = (scene, cell) => ({ row: Math.floor(cell / scene.columns), column: cell % scene.columns });

function asWritten(columns, record, value) {
  const written = (number) => (Number.isNaN(number) ? "" : +number.toFixed(explorer.decimals));
  const values = Object.fromEntries(explorer.actions.map((action, a) => [action, written(value(a))]));
  return [columns, columns.map((name) => String({ ...record, ...values }[name]))];
}
