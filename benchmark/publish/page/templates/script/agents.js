// The agents of the explorer: values and actions by map, state and action.
import { rowsOf, holds } from "./csv.js";
import { explorer } from "./data.js";

const CURVES = ["curves.csv", "learning.csv", "summary.csv"]; // files with mean scores, the last after training
export const PING = explorer?.actions.indexOf("PING");
const LEARNER = ["variant", "observation"];
export const learnerOf = (named) => LEARNER.map((key) => named[key]).join(", ");

// The numbers of the actions in a mask.
export const members = (mask) => explorer.actions.map((_, a) => a).filter((a) => (mask >> a) & 1);

// Values from integers, which are differences from the map before.
function unpacked(changes, nMaps) {
  const integers = Float64Array.from(changes);
  for (let i = integers.length / nMaps; i < integers.length; i++) integers[i] += integers[i - integers.length / nMaps];
  return integers.map((value) => (value === explorer.no_number ? NaN : value / 10 ** explorer.decimals));
}

const masksOf = (text) => Uint8Array.from(text, (letter) => letter.charCodeAt(0) - explorer.first_mask);

// The mean score of a learner's runs over training, from a file that the page holds; null if there is none.
function meanScoreOf(agent) {
  const file = CURVES.map((name) => agent.folder + name).find(holds);
  if (!file) return null;
  const [names, ...rows] = rowsOf(file);
  const wanted = { condition: "default", ...agent };
  const keys = ["scenario", "condition", ...LEARNER].filter((name) => names.includes(name));
  const found = rows.map((row, i) => ({ line: i + 2, ...Object.fromEntries(names.map((name, j) => [name, row[j]])) }))
    .filter((row) => keys.every((key) => row[key] === wanted[key]) && row.score);
  const column = (name) => found.map((row) => Number(row[name]));
  if (!found.length) return null;
  const step = names.includes("step") ? column("step") : [agent.steps.at(-1)];
  const isStochastic = found[0].policy === "stochastic";
  return { file, isStochastic, line: column("line"), step, mean: column("score"), low: column("score_low"), high: column("score_high") };
}

// An agent: its values and actions at every map, or only its last actions.
class Agent {
  constructor(packed) {
    Object.assign(this, packed);
    this.learner = packed.label; // variants of two experiments may have the same name
    this.hasValues = packed.values !== null;
    if (this.hasValues) this.values = unpacked(packed.values, packed.steps.length);
    this.greedy = masksOf(packed.greedy);
    this.nObservations = this.greedy.length / this.steps.length;
    this.timeline = this.steps; // of its learner
    this.seeds = packed.seeds.map(String);
    this.seed = this.seeds[0];
    this.unitName = packed.unit === "episodes" ? "episode" : "step";
  }
  get curve() {
    return (this.learnerCurve ??= { found: meanScoreOf(this) }).found;
  }
  // The last map that is not later than a step.
  mapAt(step) {
    return Math.max(this.steps.findLastIndex((mapped) => mapped <= step), 0);
  }
  valueAt(map, state, action) {
    return this.values[(map * this.nObservations + this.sight.of[state]) * explorer.actions.length + action];
  }
  greedyAt(map, state) {
    return this.greedy[map * this.nObservations + this.sight.of[state]];
  }
  // Whether all actions are equally good to the agent in a state, as where it has learned nothing.
  isIndifferent(map, state) {
    const hasDiverged = this.hasValues && Number.isNaN(this.valueAt(map, state, 0));
    return members(this.greedyAt(map, state)).length === explorer.actions.length && !hasDiverged;
  }
  // The actions that are optimal in a state.
  bestAt(state) {
    const optimum = this.room.optimumAt(state, this.discount, this.horizon);
    const best = Math.max(...optimum) - explorer.tolerance;
    return explorer.actions.map((_, a) => a).filter((a) => optimum[a] >= best);
  }
  // The optimum of every action in a state: values, or an even choice among the optimal actions.
  optimumAt(state) {
    if (this.kind === "q" || !this.hasValues) return this.room.optimumAt(state, this.discount, this.horizon);
    const best = this.bestAt(state);
    return explorer.actions.map((_, a) => (best.includes(a) ? 1 / best.length : 0));
  }
  // The agent of the same learner with another seed, of which there is only the greedy policy after training.
  ofSeed(seed) {
    const place = this.seeds.indexOf(seed);
    if (place === 0) return this;
    const { nObservations, others } = this;
    return Object.assign(Object.create(Agent.prototype), this, {
      seed,
      hasValues: false,
      greedy: masksOf(others.greedy).slice((place - 1) * nObservations, place * nObservations),
      steps: [this.timeline.at(-1)],
      score: [others.score[place - 1]],
      success: [others.success[place - 1]],
    });
  }
}

export const agents = (explorer?.agents ?? []).map((packed) => new Agent(packed));

export const rowAndColumn = (room, cell) => ({ row: Math.floor(cell / room.columns), column: cell % room.columns });

export function placeOf(room, cell) {
  const { row, column } = rowAndColumn(room, cell);
  return `row ${row}, column ${column}`;
}
