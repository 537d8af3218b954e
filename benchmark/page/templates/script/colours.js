// Colours: the colour scale of a map, its ends and its legend, and a scene painted in it.
import { element, show } from "./elements.js";
import { explorer } from "./data.js";
import { members, PING } from "./agents.js";

const UNIT_RANGE = { low: 0, high: 1, hasLower: false, hasHigher: false };
export const INDIFFERENT = "#e4e7ea"; // of a cell in which no action is better than another
const ranges = new Map(); // of every agent that was shown, by kind of map

// A value as a kind of map shows it: the value itself, or its difference from the optimum.
const shownValue = (agent, kind, map, cell, action) =>
  agent.valueAt(map, cell, action) - (kind === "difference" ? agent.optimumAt(cell)[action] : 0);

// All values of all maps of one kind, in rising order.
function sortedValues(agent, kind) {
  const shown = kind === "ping" ? [PING] : explorer.actions.map((_, a) => a);
  const values = [];
  for (let cell = 0; cell < agent.nCells; cell++) {
    if (agent.isOver(cell)) continue;
    agent.steps.forEach((_, map) => values.push(...shown.map((a) => shownValue(agent, kind, map, cell, a))));
  }
  return Float64Array.from(values.filter((value) => !Number.isNaN(value))).sort();
}

// A quantile of sorted values, interpolated between the two nearest.
function quantile(sorted, share) {
  const place = share * (sorted.length - 1);
  const below = Math.floor(place);
  return sorted[below] + (place - below) * (sorted[Math.min(below + 1, sorted.length - 1)] - sorted[below]);
}

// The ends of an agent's colour scale over all of training, and whether there are values beyond them.
function rangeOf(agent, kind) {
  if (!agent.hasValues) return UNIT_RANGE;
  if (agent.kind === "probability" && kind !== "difference") return UNIT_RANGE;
  if (!ranges.has(agent)) ranges.set(agent, {});
  ranges.get(agent)[kind] ??= measured(sortedValues(agent, kind));
  return ranges.get(agent)[kind];
}

function measured(sorted) {
  if (!sorted.length) return UNIT_RANGE;
  const [low, high] = [explorer.clipped_share, 1 - explorer.clipped_share].map((share) => quantile(sorted, share));
  return { low, high, hasLower: sorted[0] < low, hasHigher: sorted.at(-1) > high };
}

// One colour scale for two agents if their values are of the same kind.
export function sharedRange(agent, other, kind) {
  const range = rangeOf(agent, kind);
  if (agent.kind !== other.kind || !other.hasValues) return range;
  const theirs = rangeOf(other, kind);
  return {
    low: Math.min(range.low, theirs.low),
    high: Math.max(range.high, theirs.high),
    hasLower: range.hasLower || theirs.hasLower,
    hasHigher: range.hasHigher || theirs.hasHigher,
  };
}

function colourOf(value, { low, high }) {
  if (Number.isNaN(value)) return explorer.palette["no value"];
  const share = high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0.5;
  return explorer.colours[Math.round(share * (explorer.colours.length - 1))];
}

const agreement = (isOptimal) => explorer.colours.at(isOptimal ? -1 : 0);
const isBright = (colour) => explorer.colours.indexOf(colour) > explorer.colours.length * 0.6;

// What a map of an agent can show of what is asked for: without values, only the greedy policy.
export const kindFor = (agent, kind) => (agent.hasValues ? kind : "policy");

// Paints a map of an agent on a scene: `kind` is an option of the page's "Show" menu.
export function paint(view, agent, map, kind, range, withMarks) {
  const hasShapes = kind === "values" || kind === "difference";
  const indifferent = view.cells.map((_, cell) => !agent.isOver(cell) && agent.isIndifferent(map, cell));
  view.showHatch(indifferent);
  view.cells.forEach(({ whole, shapes, arrows, dot }, cell) => {
    const isOver = agent.isOver(cell);
    const isIndifferent = indifferent[cell];
    const greedy = agent.greedyAt(map, cell);
    const colours = shapes.map((_, a) => colourOf(shownValue(agent, kind, map, cell, a), range));
    shapes.forEach((shape, a) => {
      shape.setAttribute("visibility", hasShapes && !isOver && !isIndifferent ? "visible" : "hidden");
      shape.setAttribute("fill", colours[a]);
    });
    const isOptimal = (greedy & ~agent.optimum.optimal[cell]) === 0;
    const background = isIndifferent ? INDIFFERENT : { ping: colours[PING], policy: agreement(isOptimal) }[kind];
    whole.setAttribute("fill", isOver ? explorer.palette.over : background ?? "#000");

    const isMarked = (withMarks || kind === "policy") && !isOver && !isIndifferent;
    const moves = members(greedy).filter((a) => a < agent.scene.moves.length);
    arrows.setAttribute("d", isMarked ? moves.map((a) => view.arrow(cell, a)).join("") : "");
    arrows.setAttribute("class", isBright(background ?? colours[moves[0] ?? 0]) ? "mark on-bright" : "mark");
    dot.setAttribute("visibility", isMarked && (greedy >> PING) & 1 ? "visible" : "hidden");
  });
}

export function paintLegend(root, kind, range) {
  const [low, ramp, high] = [".low", ".ramp", ".high"].map((selector) => root.querySelector(selector));
  ramp.hidden = kind === "policy";
  if (kind === "policy") {
    const swatch = (isOptimal) => element("span", { class: "swatch", style: `background:${agreement(isOptimal)}` });
    low.replaceChildren(swatch(true), " all greedy actions are optimal");
    high.replaceChildren(swatch(false), " some greedy action is not optimal");
    return;
  }
  low.textContent = (range.hasLower ? "\u2264 " : "") + show(range.low, 2);
  high.textContent = (range.hasHigher ? "\u2265 " : "") + show(range.high, 2);
  const zero = -range.low / (range.high - range.low);
  const mark = element("span", { class: "zero", style: `left:${100 * zero}%`, title: "0" });
  ramp.replaceChildren(...(zero > 0.01 && zero < 0.99 ? [mark] : []));
}
