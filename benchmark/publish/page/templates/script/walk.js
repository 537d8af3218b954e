// The walk: an agent takes greedy actions, and the room says what follows. `benchmark/drawing/film.py` has the rule.
//
// It ends when the episode ends, at the horizon, or when the agent returns to a state in which it has been since
// it last had a choice between several greedy actions or outcomes: from there it would go in circles.
import { element, show } from "./elements.js";
import { explorer } from "./data.js";
import { members, placeOf } from "./agents.js";

const SEED = 2021; // of the first walk: ties are broken, and outcomes drawn, the same way
const ENDS = {
  target_ping: "PING in the target region: success.",
  issuer_reached: "The agent ran into the person, and the episode ended.",
  last_wrong_ping: "One wrong PING too many, and the episode ended.",
};

// Random numbers in [0, 1) by the generator mulberry32.
function mulberry32(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

export class Walk {
  // Of the walks that start in a state, `number` 0 is the one that Python takes.
  constructor(agent, map, start, number = 0) {
    Object.assign(this, { agent, map, start, number });
    this.state = start;
    this.steps = [];
    this.end = agent.room.isOver(start) ? "The episode has ended in this cell." : ""; // why the walk is over
    this.visits = new Map(); // number of steps when a state was left, since the last choice
    this.random = mulberry32(SEED + number);
  }
  get path() {
    return [...this.steps.map((step) => step.cell), this.state % this.agent.room.nCells];
  }
  // Takes a step; returns whether the walk goes on.
  step() {
    if (this.end) return false;
    const { state } = this;
    const { room, horizon } = this.agent;
    const choice = members(this.agent.greedyAt(this.map, state));
    const action = choice[Math.floor(this.random() * choice.length)];
    const { next, probability, isEnd, grid, issuer, ...effect } = room.effect(state, action);
    if (choice.length > 1 || probability[0] < 1) this.visits.clear();
    else this.visits.set(state, this.steps.length);
    const outcome = next.length > 1 ? outcomeAt(probability, this.random()) : 0;
    const event = explorer.events[effect.event];
    this.steps.push({ cell: state % room.nCells, phase: room.phaseOf(room.blockOf(state)), action, choice: choice.length, event, grid, issuer });
    this.state = next[outcome];
    if (isEnd) this.end = ENDS[event] ?? "The episode ended.";
    else if (this.visits.has(this.state)) {
      const length = this.steps.length - this.visits.get(this.state);
      const circle = length > 1 ? `goes in circles of ${length} steps` : "stays where it is";
      this.end = `The agent ${circle}, and would do so until the limit of ${horizon} steps.`;
    } else if (this.steps.length >= horizon) this.end = `The limit of ${horizon} steps is reached.`;
    return !this.end;
  }
  finish() {
    while (this.step());
    return this.steps;
  }
  // What has happened so far, in sentences.
  get summary() {
    const start = placeOf(this.agent.room, this.start % this.agent.room.nCells);
    if (!this.steps.length) return `The agent is at ${start}. ${this.end}`.trim();
    const total = (key) => show(this.steps.reduce((sum, step) => sum + step[key], 0));
    const count = `${this.steps.length} step${this.steps.length > 1 ? "s" : ""}`;
    return `${count} from ${start}. Total reward: ${total("grid")} from the grid, ${total("issuer")} from the person. ${this.end}`;
  }
  // The steps so far as a table, the last one first.
  get table() {
    if (!this.steps.length) return [];
    const { room } = this.agent;
    const [phaseHead, phaseCell] = room.hasNamedPhases ? [["phase"], (phase) => [room.phases[phase]]] : [[], () => []];
    const line = (kind, attributes, cells) => element("tr", {}, ...cells.map((text) => element(kind, attributes, text)));
    const lines = this.steps.map(({ cell, phase, action, choice, event, grid, issuer }, i) => {
      const chosen = explorer.actions[action] + (choice > 1 ? ` (tie of ${choice})` : "");
      return line("td", {}, [String(i + 1), placeOf(room, cell), ...phaseCell(phase), chosen, event.replaceAll("_", " ").replace("issuer", "person"), show(grid), show(issuer)]);
    });
    const head = line("th", { scope: "col" }, ["#", "from", ...phaseHead, "action", "event", "grid", "person"]);
    const note = `The person's rewards are means: each PING adds noise of up to \u00b1${show(room.issuer_noise)}.`;
    return [
      element("table", {}, element("thead", {}, head), element("tbody", {}, ...lines.reverse())),
      ...(room.issuer_noise ? [element("p", { class: "note" }, note)] : []),
    ];
  }
}

// The number of the outcome that a number from [0, 1) chooses.
function outcomeAt(probability, uniform) {
  let [outcome, sum] = [0, probability[0]];
  while (outcome < probability.length - 1 && uniform >= sum) sum += probability[++outcome];
  return outcome;
}
