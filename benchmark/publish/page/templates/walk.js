// The walk: an agent takes greedy actions, and the room says what follows. `benchmark/drawing/film.py` has the rule.
//
// It ends when the episode ends, at the horizon, or when the agent returns to a state in which it has been since
// it last had a choice between several greedy actions or outcomes: from there it would go in circles.
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

class Walk {
  constructor(agent, map, start) {
    Object.assign(this, { agent, map, start, state: start, reward: 0 });
    this.path = [start % agent.room.nCells]; // the agent's cells
    this.end = agent.room.isOver(start) ? "The episode has ended in this cell." : ""; // why the walk is over
    this.seen = new Set(); // states since the last choice
    this.random = mulberry32(2021);
  }
  // Takes a step; returns whether the walk goes on.
  step() {
    if (this.end) return false;
    const { room, horizon } = this.agent;
    const choice = members(this.agent.greedyAt(this.map, this.state));
    const action = choice[Math.floor(this.random() * choice.length)];
    const { next, probability, isEnd, reward, event } = room.effect(this.state, action);
    if (choice.length > 1 || probability[0] < 1) this.seen.clear();
    else this.seen.add(this.state);
    this.state = next[next.length > 1 ? outcomeAt(probability, this.random()) : 0];
    this.reward += reward;
    this.path.push(this.state % room.nCells);
    if (isEnd) this.end = ENDS[explorer.events[event]] ?? "The episode ended.";
    else if (this.seen.has(this.state)) this.end = "The agent goes in circles, or stays where it is.";
    else if (this.path.length > horizon) this.end = `The limit of ${horizon} steps is reached.`;
    return !this.end;
  }
  finish() {
    while (this.step());
    return this;
  }
  // What has happened so far, in sentences.
  get summary() {
    const steps = this.path.length - 1;
    if (!steps) return `The agent is at ${this.agent.room.cellName(this.path[0])}. ${this.end}`;
    return `${steps} step${steps > 1 ? "s" : ""} from ${this.agent.room.cellName(this.path[0])}, total reward ${show(this.reward)}. ${this.end}`;
  }
}

// The number of the outcome that a number from [0, 1) chooses.
function outcomeAt(probability, uniform) {
  let [outcome, sum] = [0, probability[0]];
  while (outcome < probability.length - 1 && uniform >= sum) sum += probability[++outcome];
  return outcome;
}
