// Colours: the colour scale of a map, its ends and its legend, and a scene painted in it.
import { element, show } from "./elements.js";
import { explorer } from "./data.js";
import { members, PING } from "./agents.js";

const UNIT_RANGE = { low: 0, high: 1, hasLower: false, hasHigher: false };
export const INDIFFERENT = "#e4e7ea"; // of a cell in which no action is better than another
const ranges = new Map(); // of every agent that was shown, by kind of map and, of differences, by block

// A value as a kind of map shows it: the value itself, or its difference from the optimum.
const shownValue = (agent, kind, map, state, action) =>
  agent.valueAt(map, state, action) - (kind === "difference" ? agent.optimumAt(state)[action] : 0);

const statesOf = (room, block) => Array.from({ length: room.nCells }, (_, cell) => block * room.nCells + cell);

// All values of all maps of one kind, in rising order: those of all observations, or differences in a block.
function sortedValues(agent, kind, block) {
  const { room, sight } = agent;
  const seen = new Map(); // a state of each observation in which there is something to do
  if (kind === "difference") for (const state of statesOf(room, block)) seen.set(state, state);
  else room.kind.forEach((_, state) => room.isOver(state) || seen.set(sight.of[state], state));
  const shown = kind === "ping" ? [PING] : explorer.actions.map((_, a) => a);
  const values = [];
  for (const state of seen.values()) {
    if (room.isOver(state)) continue;
    agent.steps.forEach((_, map) => values.push(...shown.map((a) => shownValue(agent, kind, map, state, a))));
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
function rangeOf(agent, kind, block) {
  if (!agent.hasValues) return UNIT_RANGE;
  if (agent.kind === "probability" && kind !== "difference") return UNIT_RANGE;
  if (!ranges.has(agent)) ranges.set(agent, {});
  const key = kind === "difference" ? block : kind;
  return (ranges.get(agent)[key] ??= measured(sortedValues(agent, kind, block)));
}

function measured(sorted) {
  if (!sorted.length) return UNIT_RANGE;
  const [low, high] = [explorer.clipped_share, 1 - explorer.clipped_share].map((share) => quantile(sorted, share));
  return { low, high, hasLower: sorted[0] < low, hasHigher: sorted.at(-1) > high };
}

// One colour scale for the agents of two panels if their values are of the same kind; that of differences has
// zero in its middle.
export function sharedRange(panel, other, kind) {
  const { agent, block } = panel;
  const all = [rangeOf(agent, kind, block)];
  if (agent.kind === other.agent.kind && other.agent.hasValues) all.push(rangeOf(other.agent, kind, other.block));
  let [low, high] = [Math.min(...all.map((range) => range.low)), Math.max(...all.map((range) => range.high))];
  if (kind === "difference") [low, high] = [-1, 1].map((sign) => sign * Math.max(-low, high, 0.01));
  const scale = kind === "difference" ? explorer.diverging : explorer.colours;
  return { low, high, scale, hasLower: all.some((range) => range.hasLower), hasHigher: all.some((range) => range.hasHigher) };
}

function colourOf(value, { low, high, scale }) {
  if (Number.isNaN(value)) return explorer.palette["no value"];
  const share = high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0.5;
  return scale[Math.round(share * (scale.length - 1))];
}

const agreement = (isOptimal) => explorer.colours.at(isOptimal ? -1 : 0);

// Whether black can be seen better on a colour than white.
function isBright(colour) {
  const [red, green, blue] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  return 0.3 * red + 0.59 * green + 0.11 * blue > 140;
}

// What a map of an agent can show of what is asked for: without values, only the greedy policy.
export const kindFor = (agent, kind) => (agent.hasValues ? kind : "policy");

// Paints a map of an agent on a scene: `kind` is an option of the page's "Show" menu.
export function paint(view, { agent, block }, map, kind, range) {
  const { room } = agent;
  const hasShapes = kind === "values" || kind === "difference";
  const states = statesOf(room, block);
  const over = states.map((state) => room.isOver(state));
  const indifferent = states.map((state, cell) => !over[cell] && agent.isIndifferent(map, state));
  view.showBlock(block);
  view.showHatch(indifferent);
  view.cells.forEach(({ whole, shapes, arrows, dot }, cell) => {
    const state = states[cell];
    const isOver = over[cell];
    const isIndifferent = indifferent[cell];
    const greedy = agent.greedyAt(map, state);
    const colours = shapes.map((_, a) => (agent.hasValues ? colourOf(shownValue(agent, kind, map, state, a), range) : ""));
    shapes.forEach((shape, a) => {
      shape.setAttribute("visibility", hasShapes && !isOver && !isIndifferent ? "visible" : "hidden");
      shape.setAttribute("fill", colours[a]);
    });
    const isOptimal = members(greedy).every((a) => agent.bestAt(state).includes(a));
    const background = isIndifferent ? INDIFFERENT : { ping: colours[PING], policy: agreement(isOptimal) }[kind];
    const closed = explorer.palette[room.walls.includes(cell) ? "wall" : "over"];
    whole.setAttribute("fill", isOver ? closed : background ?? "#000");

    const isMarked = !isOver && !isIndifferent;
    const moves = members(greedy).filter((a) => a < explorer.moves.length);
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
  ramp.style.background = `linear-gradient(to right, ${range.scale.join(",")})`;
  low.textContent = (range.hasLower ? "\u2264 " : "") + show(range.low, 2);
  high.textContent = (range.hasHigher ? "\u2265 " : "") + show(range.high, 2);
  const zero = -range.low / (range.high - range.low);
  const mark = element("span", { class: "zero", style: `left:${100 * zero}%`, title: "0" });
  ramp.replaceChildren(...(zero > 0.01 && zero < 0.99 ? [mark] : []));
}
