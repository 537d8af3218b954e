// A room: a compiled scenario. It says what follows an action, and holds the exact optimum; it knows no rules.
//
// A state's number combines place, tick of the clock, whether feedback is to come, wrong PINGs and the agent's
// cell, in this order. A block is all states that differ by the cell alone: what one map shows.
export class Room {
  constructor(packed) {
    Object.assign(this, packed);
    this.nCells = this.rows * this.columns;
    this.nActions = this.kinds.event.length / this.kinds.over.length;
    this.nOutcomes = this.kinds.change.length / this.kinds.event.length;
    this.optima = new Map();
    // The cells of the issuer and its group, by place; if they walk, also by phase.
    this.places = [...new Map(this.views.map((view) => [String(this.groupOn(view)), this.groupOn(view)])).values()].sort((a, b) => a[0] - b[0]);
    // A person who walks is in another phase in every cell, and each cell of a map tells which.
    this.hasNamedPhases = this.phases.length > 1 && this.views.length > this.places.length;
  }
  groupOn(view) {
    return view.glyphs.slice(0, this.group ?? 1).map(({ cell }) => cell);
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
  // The block with a person in a cell, the group in its cells, a phase or a number of wrong PINGs, and little else
  // changed; null if there is none.
  changed(block, { person, group, phase, pings }) {
    const [now, before] = [this.partsOf(block), this.groupOn(this.viewOf(block))];
    let [found, least] = [null, Infinity];
    for (let place = 0; place < this.shape[0]; place++) {
      for (let tick = 0; tick < this.ticks.length; tick++) {
        const other = this.blockWith({ place, tick, pings: pings ?? now.pings });
        const cells = this.groupOn(this.viewOf(other));
        const cost = cells.filter((cell) => !before.includes(cell)).length + (tick !== now.tick);
        const fits = (person === undefined || cells.includes(person))
          && (group === undefined || String(cells) === group)
          && (phase === undefined || this.phaseOf(other) === phase);
        if (fits && cost < least) [found, least] = [other, cost];
      }
    }
    return found;
  }
  // The state of a block with the agent in a cell in which episodes start, there if any do.
  startOf(block) {
    const { place, tick } = this.partsOf(block);
    const near = (state) => {
      const start = this.partsOf(this.blockOf(state));
      return 2 * (start.place === place) + (start.tick === tick);
    };
    const best = this.starts.reduce((found, state) => (near(state) > near(found) ? state : found));
    return block * this.nCells + (best % this.nCells);
  }
  blockOf(state) {
    return Math.floor(state / this.nCells);
  }
  isOver(state) {
    return Boolean(this.kinds.over[this.kind[state]]);
  }
  // What an action does: its event and rewards, and the outcomes with their probabilities.
  effect(state, action) {
    const effect = this.kind[state] * this.nActions + action;
    const { change, probability, event, grid_reward, issuer_reward, terminated } = this.kinds;
    const outcomes = Array.from({ length: this.nOutcomes }, (_, k) => effect * this.nOutcomes + k);
    return {
      event: event[effect],
      grid: grid_reward[effect],
      issuer: issuer_reward[effect],
      isEnd: Boolean(terminated[effect]),
      next: outcomes.map((outcome) => state + change[outcome]),
      probability: outcomes.map((outcome) => probability[outcome]),
    };
  }
  // The optimal values of a state's actions, if the state is known; within a horizon if undiscounted.
  optimumAt(state, discount, horizon) {
    const nStates = this.kind.length / this.shape[0]; // of a place, which an episode never leaves
    const place = Math.floor(state / nStates);
    const key = `${place} ${discount} ${horizon}`;
    if (!this.optima.has(key)) this.optima.set(key, this.solved(place * nStates, nStates, discount, discount < 1 ? Infinity : horizon));
    const first = (state - place * nStates) * this.nActions;
    return this.optima.get(key).subarray(first, first + this.nActions);
  }
  // Iterates the Bellman optimality operator, as `agents/dynamic_programming.py` does.
  solved(first, nStates, discount, horizon) {
    const { nActions, nOutcomes, kind } = this;
    const [change, ended] = [Int32Array, Uint8Array].map((type, i) => type.from(this.kinds[["change", "terminated"][i]]));
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
