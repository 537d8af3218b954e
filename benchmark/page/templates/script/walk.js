// The walk: an agent takes greedy actions, and tables of the compiled scenario say what follows.
//
// It ends when the episode ends, at the horizon, or when the agent returns to a state in which it has been since
// it last had a choice between several greedy actions: from there it would go in circles.
import { element, show } from "./elements.js";
import { explorer } from "./data.js";
import { members, placeOf } from "./agents.js";

const SEED = 2021; // ties are broken the same way in every walk
const ENDS = {
  target_ping: "PING in the target region: success.",
  issuer_reached: "The agent ran into the issuer, and the episode ended.",
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
  constructor(agent, map, start) {
    this.agent = agent;
    this.map = map;
    this.start = start;
    this.state = agent.scene.fresh[start];
    this.steps = [];
    this.end = ""; // why the walk is over
    this.visits = new Map(); // number of steps taken when a state was left, since the last choice
    this.random = mulberry32(SEED);
  }
  get cell() {
    return this.agent.scene.observation[this.state];
  }
  get path() {
    return [...this.steps.map((step) => step.cell), this.cell];
  }
  // Takes a step; returns whether the walk goes on.
  step() {
    if (this.end) return false;
    const { scene, horizon } = this.agent;
    const { cell } = this;
    const choice = members(this.agent.greedyAt(this.map, cell));
    const action = choice[Math.floor(this.random() * choice.length)];
    if (choice.length > 1) this.visits.clear();
    else this.visits.set(this.state, this.steps.length);
    const taken = this.state * explorer.actions.length + action;
    const event = explorer.events[scene.event[taken]];
    const [grid, issuer] = [scene.grid_reward[taken], scene.issuer_reward[taken]];
    this.steps.push({ cell, action, choice: choice.length, event, grid, issuer });
    this.state = scene.next[taken];
    if (scene.terminated[taken]) this.end = ENDS[event] ?? "The episode ended.";
    else if (this.visits.has(this.state)) {
      const length = this.steps.length - this.visits.get(this.state);
      const circle = length > 1 ? `goes in circles of ${length} steps` : "stays where it is";
      this.end = `The agent ${circle}, and would do so until the limit of ${horizon} steps.`;
    } else if (this.steps.length >= horizon) this.end = `The limit of ${horizon} steps is reached.`;
    return !this.end;
  }
  // What has happened so far, in sentences.
  get summary() {
    const start = placeOf(this.agent.scene, this.start);
    if (!this.steps.length) return `The agent is at ${start}.`;
    const total = (key) => show(this.steps.reduce((sum, step) => sum + step[key], 0));
    const count = `${this.steps.length} step${this.steps.length > 1 ? "s" : ""}`;
    return `${count} from ${start}. Total reward: ${total("grid")} from the grid, ${total("issuer")} from the issuer. ${this.end}`;
  }
  // The steps so far as a table, the last one first.
  get table() {
    if (!this.steps.length) return [];
    const { scene } = this.agent;
    const line = (kind, attributes, cells) => element("tr", {}, ...cells.map((text) => element(kind, attributes, text)));
    const lines = this.steps.map(({ cell, action, choice, event, grid, issuer }, i) => {
      const taken = explorer.actions[action] + (choice > 1 ? ` (tie of ${choice})` : "");
      return line("td", {}, [String(i + 1), placeOf(scene, cell), taken, event.replaceAll("_", " "), show(grid), show(issuer)]);
    });
    const head = line("th", { scope: "col" }, ["#", "from", "action", "event", "grid", "issuer"]);
    const note = `The issuer's rewards are means: each PING adds noise of up to \u00b1${show(scene.issuer_noise)}.`;
    return [
      element("table", {}, element("thead", {}, head), element("tbody", {}, ...lines.reverse())),
      ...(scene.issuer_noise ? [element("p", { class: "note" }, note)] : []),
    ];
  }
}
