// The agents of the explorer: values and actions by map, state and action.
function unzipped(node) {
  const zipped = new Blob([Uint8Array.from(atob(node.textContent), (letter) => letter.charCodeAt(0))]);
  return new Response(zipped.stream().pipeThrough(new DecompressionStream("gzip"))).json();
}

// The running sums of changes.
function summed(changes) {
  let sum = 0;
  return Int32Array.from(changes, (change) => (sum += change));
}

const parts = await Promise.all([...document.querySelectorAll("script.agents")].map(unzipped));
const explorer = parts[0]; // all are alike but for agents and rooms
const PING = explorer?.actions.indexOf("PING");

// The numbers of the actions in a mask.
const members = (mask) => range(explorer.actions.length).filter((a) => (mask >> a) & 1);

// Values from integers, which are differences from the map before.
function unpacked(changes, nMaps) {
  const integers = Float64Array.from(changes);
  for (let i = integers.length / nMaps; i < integers.length; i++) integers[i] += integers[i - integers.length / nMaps];
  return integers.map((value) => (value === explorer.no_number ? NaN : value / 10 ** explorer.decimals));
}

const masksOf = (text) => Uint8Array.from(text, (letter) => letter.charCodeAt(0) - explorer.first_mask);

// An agent: its values and actions at every map, or only its last actions.
class Agent {
  constructor(packed, room, sight) {
    Object.assign(this, packed, { room, sight });
    this.hasValues = packed.values !== null;
    this.values = this.hasValues && unpacked(packed.values, packed.steps.length);
    this.greedy = masksOf(packed.greedy);
    this.nObservations = this.greedy.length / this.steps.length;
    this.timeline = this.steps; // of its learner
    this.seeds = packed.seeds.map(String);
    this.seed = this.seeds[0];
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
    return members(this.greedyAt(map, state)).length === explorer.actions.length && !this.hasDiverged(map, state);
  }
  hasDiverged(map, state) {
    return this.hasValues && Number.isNaN(this.valueAt(map, state, 0));
  }
  optimumAt(state) {
    return this.room.optimumAt(state, this.discount, this.horizon);
  }
  // The actions that are optimal in a state.
  bestAt(state) {
    const optimum = this.optimumAt(state);
    const best = Math.max(...optimum) - explorer.tolerance;
    return range(optimum.length).filter((a) => optimum[a] >= best);
  }
  // The ends of the colour scale of its values, over all of training, without outliers.
  get limits() {
    if (!this.hasValues || this.kind === "probability") return [0, 1];
    const sorted = this.values.filter((value) => !Number.isNaN(value)).sort();
    const at = (share) => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
    return (this.found ??= [at(explorer.clipped_share), at(1 - explorer.clipped_share)]);
  }
  // The agent of the same learner with another seed, of which there is only the greedy policy after training.
  ofSeed(seed) {
    const i = this.seeds.indexOf(seed) - 1;
    if (i < 0) return this;
    const { nObservations, others, timeline } = this;
    return Object.assign(Object.create(Agent.prototype), this, {
      seed,
      hasValues: false,
      greedy: masksOf(others.greedy).slice(i * nObservations, (i + 1) * nObservations),
      steps: [timeline.at(-1)],
      score: [others.score[i]],
      success: [others.success[i]],
    });
  }
}

const agents = parts.flatMap((part) => {
  const rooms = part.scenes.map((packed) => new Room(packed));
  const sights = part.sights.map(({ observed, changes }) => ({ observed, of: summed(changes) }));
  return part.agents.map((packed) => new Agent(packed, rooms[packed.scene], sights[packed.sight]));
});
