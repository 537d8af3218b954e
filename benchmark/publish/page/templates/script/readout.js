// The readout: what an agent is about, and the numbers of the cell under the cursor.
import { element, grouped, show, sourced } from "./elements.js";
import { explorer } from "./data.js";
import { placeOf } from "./agents.js";

const ZONES = {
  outside: "outside the regions",
  target: "in the target region",
  uncomfortable: "in the uncomfortable region",
  issuer: "the person's cell",
  wall: "a wall",
};

const VALUES = {
  q: (agent) => `Q-values, discount ${agent.discount}.`,
  probability: () => "Probabilities of the stochastic policy.",
};

const SITUATED = ["issuer", "offset", "nearest", "two_nearest", "centre", "phase"]; // say where people are

// What the map shows, and how good the agent and all runs of its learner are at this time.
export function described(agent, map, step) {
  const { curve, room, sight } = agent;
  const shown = agent.steps[map];
  const time = shown === step ? "" : `Shown: ${agent.unitName} ${grouped(shown)}. `;
  const values = agent.hasValues ? VALUES[agent.kind](agent) : "Only this agent's final greedy policy is published, so its map shows that.";
  const isHidden = (name) => !sight.observed.includes(name);
  const hidden = [
    room.places.length > 1 && SITUATED.every(isHidden) && "where the person is",
    room.hasNamedPhases && isHidden("phase") && "the phase",
  ].filter(Boolean);
  const few = room.of_places ? ` ${grouped(room.shape[0])} of ${grouped(room.of_places)} places are shown.` : "";
  const blind = hidden.length ? ` It does not see ${hidden.join(" or ")}.` : "";
  const hasDiverged = agent.hasValues && Number.isNaN(agent.valueAt(map, room.starts[0], 0));
  const note = hasDiverged ? " This net has diverged: it has no values, and its policy counts as the random one." : "";
  const place = curve ? curve.step.indexOf(shown) : -1;
  const mean = place < 0 ? [] : [
    `. Mean score of all runs${curve.isStochastic ? " (stochastic policy)" : ""}: `, sourced(curve.file, curve.line[place], show(curve.mean[place])),
    ` [${show(curve.low[place])}, ${show(curve.high[place])}]`,
  ];
  const result = `unbounded score ${show(agent.score[map])}, success probability ${show(agent.success[map])}`;
  return [`${time}${values}${blind}${note}${few} This agent (seed ${agent.seed}): ${result}`, ...mean, "."];
}

export function readoutOf(agent, map, block, cell) {
  const { room } = agent;
  const state = block * room.nCells + cell;
  const place = placeOf(room, cell).replace("row", "Row");
  const isWall = room.walls.includes(cell);
  const zone = isWall ? "wall" : explorer.zones[room.viewOf(block).zone[cell]];
  const title = element("p", {}, element("strong", {}, place), `, ${ZONES[zone] ?? zone}`);
  if (room.isOver(state)) {
    return [title, ...(isWall ? [] : [element("p", {}, "The episode ends when the agent gets here: there are no actions.")])];
  }
  const best = agent.optimumAt(state);
  const optimalActions = agent.bestAt(state);
  const isIn = (mask, action) => (mask >> action) & 1;
  const number = (...content) => element("td", { class: "number" }, ...content);
  const lines = explorer.actions.map((action, a) => {
    const value = agent.hasValues ? agent.valueAt(map, state, a) : NaN;
    const optimal = number(show(best[a]));
    const words = [isIn(agent.greedyAt(map, state), a) && "greedy", optimalActions.includes(a) && "optimal"];
    return element("tr", {},
      element("th", { scope: "row" }, action),
      ...(agent.hasValues
        ? [number(show(value)), optimal, number(show(value - best[a]))]
        : [optimal]),
      element("td", {}, words.filter(Boolean).join(", ")));
  });
  const head = (text, isNumber) => element("th", { scope: "col", ...(isNumber ? { class: "number" } : {}) }, text);
  const value = agent.kind === "q" ? "Q" : element("abbr", { title: "probability" }, "prob.");
  const numbers = agent.hasValues ? [value, "optimum", element("abbr", { title: "difference" }, "diff.")] : ["optimum"];
  const heads = element("tr", {}, head("action"), ...numbers.map((name) => head(name, true)), head("is"));
  return [title, element("table", {}, element("thead", {}, heads), element("tbody", {}, ...lines))];
}
