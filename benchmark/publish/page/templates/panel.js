// A panel: menus that choose an agent and where people are, its map with a cursor, its numbers, curve and walk.
const MOVES = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
const alike = (room, other) => String([room.shape, room.rows, room.columns]) === String([other?.shape, other?.rows, other?.columns]);

class Panel {
  // `refresh` is called after the reader has chosen another agent, `look` with a cell that they point at, and
  // `situate` with a block that they choose.
  constructor(root, { refresh, look, situate }) {
    this.find = (selector) => root.querySelector(selector);
    Object.assign(this, { look, situate });
    this.menus = Object.fromEntries([...root.querySelectorAll("select")].map((menu) => [menu.name, menu]));
    for (const [name, menu] of Object.entries(this.menus)) {
      menu.addEventListener("change", () => {
        if (["place", "tick", "pings"].includes(name)) return situate(this, { [name]: Number(menu.value) });
        this.choose({ ...this.agent, [name]: menu.value });
        return refresh();
      });
    }
    this.find(".map").addEventListener("keydown", (event) => this.key(event));
  }
  // Chooses the agent that fits a wish best. People stand as before if the room is alike.
  choose(wish) {
    let left = agents;
    for (const key of ["experiment", "scenario", "learner"]) {
      const names = [...new Set(left.map((agent) => agent[key]))];
      const name = names.includes(wish[key]) ? wish[key] : names[0];
      select(this.menus[key], names.map((each) => [each, each]), name);
      left = left.filter((agent) => agent[key] === name);
    }
    const { seeds } = left[0];
    select(this.menus.seed, seeds.map((each) => [each, each]), seeds.includes(wish.seed) ? wish.seed : seeds[0]);
    const before = this.agent?.room;
    this.agent = left[0].ofSeed(this.menus.seed.value);
    const { room } = this.agent;
    if (room !== before) {
      this.view = new SceneView(room, (cell) => this.look(this, cell), (cell) => this.movePerson(cell));
      this.find(".map").replaceChildren(this.view.image);
    }
    if (!alike(room, before)) [this.block, this.cursor] = [room.blockOf(room.starts[0]), room.starts[0] % room.nCells];
    this.map = 0;
    this.fillSituation();
    this.startWalk(room.startOf(this.block));
  }
  // Offers what there is a choice of: where people are, the phase, and the wrong PINGs if they are observed.
  fillSituation() {
    const { room } = this.agent;
    const [nPlaces, , , nPings] = room.shape;
    const people = (place) => room.peopleIn(room.blockWith({ place, tick: 0, pings: 0 }));
    const offered = {
      place: range(nPlaces).map((i) => [i, `${i + 1}: ${people(i).map((cell) => room.cellName(cell)).join("; ")}`]),
      tick: room.phases.map((name, i) => [room.ticks.indexOf(i), `${i + 1}: ${name}`]), // the first of each phase
      pings: this.seesPings ? range(nPings).map((i) => [i, i]) : [],
    };
    for (const [key, options] of Object.entries(offered)) {
      select(this.menus[key], options);
      this.menus[key].parentElement.hidden = options.length < 2;
    }
  }
  get seesPings() {
    return this.agent.sight.observed.includes("wrong_pings");
  }
  movePerson(cell) {
    const { room } = this.agent;
    const { tick } = room.partsOf(this.block);
    const place = range(room.shape[0]).find((each) => room.peopleIn(room.blockWith({ place: each, tick, pings: 0 })).includes(cell));
    if (place !== undefined) this.situate(this, { place });
  }
  // Changes where people are, the tick or the wrong PINGs.
  change(situation) {
    const { room } = this.agent;
    this.startWalk(room.startOf(room.blockWith({ ...room.partsOf(this.block), ...situation })));
  }
  key(event) {
    const { rows, columns, nCells } = this.agent.room;
    if (event.key === "Enter") this.startWalk(this.block * nCells + this.cursor).finishWalk();
    else if (event.key in MOVES) {
      const row = Math.floor(this.cursor / columns) + MOVES[event.key][0];
      const column = (this.cursor % columns) + MOVES[event.key][1];
      if (row >= 0 && row < rows && column >= 0 && column < columns) this.look(this, row * columns + column);
    } else return;
    event.preventDefault();
  }
  startWalk(state = this.walk.start) {
    this.walk = new Walk(this.agent, this.map, state);
    this.drawWalk();
    return this;
  }
  finishWalk() {
    this.walk.finish();
    this.drawWalk();
  }
  // Draws what the agent knows at a step; a walk starts again if that is another map.
  draw(step, kind, limits) {
    [this.kind, this.limits] = [this.agent.hasValues ? kind : "policy", limits];
    const map = this.agent.mapAt(step);
    if (map !== this.map) {
      this.map = map;
      this.startWalk();
    }
    this.paint();
    const { agent } = this;
    this.find(".about").textContent = described(agent, map);
    this.find(".curve").replaceChildren(...curveOf(agent, map));
    this.find(".map").setAttribute("aria-label", `Map of ${agent.learner} in ${agent.scenario}, step ${agent.steps[map]}, seed ${agent.seed}. `
      + "Arrow keys choose a cell, Enter walks from there.");
  }
  paint() {
    this.view.paint(this.agent, this.map, this.block, this.kind, this.limits);
    this.find(".ramp").style.background = `linear-gradient(to right, ${explorer.colours.join(",")})`;
    const ends = this.kind === "policy" ? ["not optimal", "optimal"] : this.limits.map((limit) => show(limit, 2));
    [this.find(".low").textContent, this.find(".high").textContent] = ends;
    this.showCell(this.cursor);
  }
  showCell(cell) {
    this.cursor = cell;
    this.view.showCursor(cell);
    this.find(".readout").replaceChildren(...readoutOf(this.agent, this.map, this.block, cell));
  }
  // People are shown as they are at this time of the walk; wrong PINGs count only if they are observed.
  drawWalk() {
    const { room } = this.agent;
    const parts = room.partsOf(room.blockOf(this.walk.state));
    const block = room.blockWith({ ...parts, pings: this.seesPings ? parts.pings : 0 });
    const isNew = block !== this.block;
    this.block = block;
    const firstTick = room.ticks.indexOf(room.phaseOf(block));
    for (const [key, value] of Object.entries({ ...parts, tick: firstTick })) this.menus[key].value = value;
    if (isNew && this.kind) this.paint();
    this.view.showPath(this.walk.path);
    this.find(".walked").textContent = this.walk.summary;
  }
}

function described(agent, map) {
  const values = { q: `Action values, discount ${agent.discount}.`, probability: "Probabilities of the stochastic policy." }[agent.kind];
  const what = agent.hasValues ? values : "Only the final greedy policy of this agent is published.";
  const diverged = agent.hasDiverged(map, agent.room.starts[0]) ? " This net has diverged: its policy counts as the random one." : "";
  return `${what}${diverged} At step ${grouped(agent.steps[map])}: score ${show(agent.score[map])}, success ${show(agent.success[map])}.`;
}

// The numbers of a cell.
function readoutOf(agent, map, block, cell) {
  const { room } = agent;
  const state = block * room.nCells + cell;
  const zone = room.walls.includes(cell) ? "wall" : explorer.zones[room.viewOf(block).zone[cell]].replace("issuer", "person");
  const title = element("p", {}, element("strong", {}, room.cellName(cell)), `: ${zone}`);
  if (room.isOver(state)) return [title, element("p", {}, "There are no actions here.")];
  const [optimum, best, greedy] = [agent.optimumAt(state), agent.bestAt(state), members(agent.greedyAt(map, state))];
  const line = (kind, ...cells) => element("tr", {}, ...cells.map((text) => element(kind, {}, text)));
  const lines = explorer.actions.map((action, a) => {
    const words = [greedy.includes(a) && "greedy", best.includes(a) && "optimal"].filter(Boolean).join(", ");
    return line("td", action, agent.hasValues ? show(agent.valueAt(map, state, a)) : "", show(optimum[a]), words);
  });
  const head = line("th", "action", agent.kind === "q" ? "value" : "probability", "optimal value", "is");
  return [title, element("table", {}, element("thead", {}, head), element("tbody", {}, ...lines))];
}

// An agent's scores over training. Those below 0, which have no bound, are drawn at 0.
function curveOf(agent, map) {
  if (agent.timeline.length === 1) return [];
  const [width, height, left] = [360, 84, 22];
  const last = agent.timeline.at(-1) || 1;
  const x = (step) => left + ((width - left - 8) * step) / last;
  const y = (score) => 8 + (height - 16) * (1 - Math.min(Math.max(score, 0), 1));
  const title = "Score of this agent over training.";
  const image = drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
  for (const anchor of [0, 1]) {
    image.append(drawn("line", { class: "anchor", x1: left, x2: width - 8, y1: y(anchor), y2: y(anchor) }));
    image.append(drawn("text", { x: left - 5, y: y(anchor) + 4, "text-anchor": "end" }, anchor));
  }
  agent.score.forEach((score, i) => {
    image.append(drawn("circle", { class: "scored", cx: x(agent.steps[i]), cy: y(score), r: i === map ? 4 : 2 }));
  });
  return [image, element("p", {}, title)];
}
