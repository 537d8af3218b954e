// A room: a compiled scenario. It says what follows an action, and holds the exact optimum; it knows no rules.
//
// A state's number combines place, tick of the clock, whether feedback is to come, wrong PINGs and the agent's
// cell, in this order. A block is all states that differ by the cell alone: what one map shows.
class Room {
  constructor(packed) {
    Object.assign(this, packed);
    this.nCells = this.rows * this.columns;
    this.nActions = this.kinds.event.length / this.kinds.over.length;
    this.nOutcomes = this.kinds.change.length / this.kinds.event.length;
    this.optima = new Map();
  }
  cellName(cell) {
    return `row ${Math.floor(cell / this.columns)}, column ${cell % this.columns}`;
  }
  // The cells of the person and their group.
  peopleIn(block) {
    return this.viewOf(block).glyphs.slice(0, this.group ?? 1).map(({ cell }) => cell);
  }
  partsOf(block) {
    const [, nTicks, nDelayed, nPings] = this.shape;
    const rest = Math.floor(block / nPings / nDelayed);
    return { place: Math.floor(rest / nTicks), tick: rest % nTicks, pings: block % nPings };
  }
  blockWith({ place, tick, pings }) {
    const [, nTicks, nDelayed, nPings] = this.shape;
    return (place * nTicks + tick) * nDelayed * nPings + pings;
  }
  phaseOf(block) {
    return this.ticks[this.partsOf(block).tick];
  }
  viewOf(block) {
    return this.views[this.partsOf(block).place * this.phases.length + this.phaseOf(block)];
  }
  blockOf(state) {
    return Math.floor(state / this.nCells);
  }
  // The state of a block with the agent in a cell in which episodes start, there if any do.
  startOf(block) {
    const start = this.starts.find((state) => this.partsOf(this.blockOf(state)).place === this.partsOf(block).place);
    return block * this.nCells + ((start ?? this.starts[0]) % this.nCells);
  }
  isOver(state) {
    return Boolean(this.kinds.over[this.kind[state]]);
  }
  // What an action does: its event and rewards, and the outcomes with their probabilities.
  effect(state, action) {
    const effect = this.kind[state] * this.nActions + action;
    const { change, probability, event, grid_reward, issuer_reward, terminated } = this.kinds;
    const outcomes = range(this.nOutcomes).map((k) => effect * this.nOutcomes + k);
    return {
      event: event[effect],
      reward: grid_reward[effect] + issuer_reward[effect],
      isEnd: Boolean(terminated[effect]),
      next: outcomes.map((outcome) => state + change[outcome]),
      probability: outcomes.map((outcome) => probability[outcome]),
    };
  }
  // The optimal values of a state's actions, if the state is known; within a horizon if undiscounted.
  optimumAt(state, discount, horizon) {
    const nStates = this.kind.length / this.shape[0]; // of a place, which an episode never leaves
    const first = Math.floor(state / nStates) * nStates;
    const key = `${first} ${discount} ${horizon}`;
    if (!this.optima.has(key)) this.optima.set(key, this.solved(first, nStates, discount, discount < 1 ? Infinity : horizon));
    return this.optima.get(key).subarray((state - first) * this.nActions, (state - first + 1) * this.nActions);
  }
  // Iterates the Bellman optimality operator, as `agents/dynamic_programming.py` does.
  solved(first, nStates, discount, horizon) {
    const { nActions, nOutcomes, kind } = this;
    const [change, ended] = [Int32Array.from(this.kinds.change), Uint8Array.from(this.kinds.terminated)];
    const probability = Float64Array.from(this.kinds.probability);
    const reward = Float64Array.from(this.kinds.grid_reward, (grid, i) => grid + this.kinds.issuer_reward[i]);
    const q = new Float64Array(nStates * nActions);
    let [value, following] = [new Float64Array(nStates), new Float64Array(nStates)];
    for (let step = 0; step < horizon; step++) {
      let [farthest, largest] = [0, 1];
      for (let state = 0; state < nStates; state++) {
        let best = -Infinity;
        for (let a = 0; a < nActions; a++) {
          const effect = kind[first + state] * nActions + a;
          let expected = 0;
          for (let k = effect * nOutcomes; !ended[effect] && k < (effect + 1) * nOutcomes; k++) {
            expected += value[state + change[k]] * probability[k];
          }
          best = Math.max(best, q[state * nActions + a] = reward[effect] + discount * expected);
        }
        following[state] = best;
        farthest = Math.max(farthest, Math.abs(best - value[state]));
        largest = Math.max(largest, Math.abs(best));
      }
      [value, following] = [following, value];
      if (farthest === 0 || (discount < 1 && farthest <= 1e-15 * largest)) break;
    }
    return q;
  }
}
