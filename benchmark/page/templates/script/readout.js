// The readout: what an agent is about, and the numbers of the cell under the cursor.
import { element, grouped, show, sourced } from "./elements.js";
import { explorer } from "./data.js";
import { placeOf } from "./agents.js";

const ZONES = {
  outside: "outside the regions",
  target: "in the target region",
  uncomfortable: "in the uncomfortable region",
  issuer: "the issuer's cell",
};

const VALUES = {
  q: (agent) => `Q-values, discount ${agent.discount}.`,
  probability: () => "Probabilities of the stochastic policy.",
};

// What the map shows, and how good the agent and all runs of its learner are at this time.
export function described(agent, map, step) {
  const { curve, scene } = agent;
  const shown = agent.steps[map];
  const time = shown === step ? "" : `Shown: ${agent.unitName} ${grouped(shown)}. `;
  const values = agent.hasValues ? VALUES[agent.kind](agent) : "Of this agent only the final greedy policy is published.";
  const hasDiverged = agent.hasValues && Number.isNaN(agent.valueAt(map, scene.start, 0));
  const note = hasDiverged ? " This net has diverged: it has no values, and its policy counts as the random one." : "";
  const place = curve ? curve.step.indexOf(shown) : -1;
  const mean = place < 0 ? [] : [
    ". Mean score of all runs: ", sourced(curve.file, curve.line[place], show(curve.mean[place])),
    ` [${show(curve.low[place])}, ${show(curve.high[place])}]`,
  ];
  const result = `score ${show(agent.score[map])}, success probability ${show(agent.success[map])}`;
  const around = scene.origin ? " Rows and columns are counted from the issuer." : "";
  return [`${time}${values}${around}${note} This agent (seed ${agent.seed}): ${result}`, ...mean, "."];
}

export function readoutOf(agent, map, cell) {
  const place = placeOf(agent.scene, cell).replace("row", "Row");
  const zone = agent.scene.zone[cell];
  const title = element("p", {}, element("strong", {}, place), `, ${ZONES[zone] ?? zone}`);
  if (agent.isOver(cell)) {
    return [title, element("p", {}, "The episode ends when the agent gets here: there are no actions.")];
  }
  const { optimum } = agent;
  const best = agent.optimumAt(cell);
  const isIn = (mask, action) => (mask >> action) & 1;
  const number = (...content) => element("td", { class: "number" }, ...content);
  const lines = explorer.actions.map((action, a) => {
    const value = agent.valueAt(map, cell, a);
    const optimal = number(show(best[a]));
    const words = [isIn(agent.greedyAt(map, cell), a) && "greedy", isIn(optimum.optimal[cell], a) && "optimal"];
    return element("tr", {},
      element("th", { scope: "row" }, action),
      ...(agent.hasValues
        ? [number(show(value)), optimal, number(show(value - best[a]))]
        : [optimal]),
      element("td", {}, words.filter(Boolean).join(", ")));
  });
  const head = (text, isNumber) => element("th", { scope: "col", ...(isNumber ? { class: "number" } : {}) }, text);
  const value = agent.kind === "q" ? "Q" : "probability";
  const numbers = agent.hasValues ? [value, "optimum", element("abbr", { title: "difference" }, "diff.")] : ["optimum"];
  const heads = element("tr", {}, head("action"), ...numbers.map((name) => head(name, true)), head("is"));
  return [title, element("table", {}, element("thead", {}, heads), element("tbody", {}, ...lines))];
}
