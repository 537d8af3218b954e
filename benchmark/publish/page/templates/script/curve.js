// The curve: an agent's scores over training, with the mean score of all runs of its learner.
import { drawn, element, show } from "./elements.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [360, 84, 22, 8, 2, 2];
const [LOWEST, HIGHEST] = [-0.1, 1.1]; // of the axis

// No score is above 1. Those below 0 have no bound, and would make the rest of the curve flat.
const clipped = (score) => Math.min(Math.max(score, 0), 1);

export function curveOf(agent, map) {
  if (agent.timeline.length === 1 && !(agent.curve?.step.length > 1)) return [];
  const { mean, low } = agent.curve ?? { mean: [], low: [] };
  const last = agent.timeline.at(-1) || 1;
  const x = (step) => LEFT + ((WIDTH - LEFT - RIGHT) * step) / last;
  const y = (score) => TOP + ((HEIGHT - TOP - BOTTOM) * (HIGHEST - clipped(score))) / (HIGHEST - LOWEST);
  const points = (scores) => scores.map((score, i) => `${x(agent.curve.step[i])},${y(score)}`);
  const label = (score) => drawn("text", { x: LEFT - 5, y: y(score) + 4, "text-anchor": "end" }, show(score, 1));
  const circles = agent.hasValues ? "Circles" : "Circle";
  const what = agent.curve ? `Line: mean score of all runs. ${circles}: this agent.` : `${circles}: score of this agent.`;
  const isBelow = [...low, ...mean, ...agent.score].some((score) => score !== null && score < 0);
  const note = isBelow ? " Scores below 0 are drawn at 0." : "";
  const title = `Score over training. ${what}${note}`;
  const image = drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": title });
  for (const anchor of [0, 1]) {
    image.append(drawn("line", { class: "anchor", x1: LEFT, x2: WIDTH - RIGHT, y1: y(anchor), y2: y(anchor) }), label(anchor));
  }
  if (agent.curve) {
    const band = [...points(agent.curve.low), ...points(agent.curve.high).reverse()];
    image.append(drawn("polygon", { class: "band", points: band.join(" ") }));
    image.append(drawn("polyline", { class: "mean", points: points(mean).join(" ") }));
  }
  agent.score.forEach((score, i) => {
    image.append(drawn("circle", { class: "scored", cx: x(agent.steps[i]), cy: y(score), r: i === map ? 4 : 2 }));
  });
  const now = x(agent.steps[map]);
  image.append(drawn("line", { class: "now", x1: now, x2: now, y1: TOP, y2: HEIGHT - BOTTOM }));
  return [image, element("p", {}, what + note)];
}
