// The curve: an agent's scores over training, with the mean score of all runs of its learner.
import { drawn, show } from "./elements.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [360, 110, 34, 8, 8, 22];
const HIGHEST = 1.1;
const LOWEST = -4; // scores below are drawn there

export function curveOf(agent, map) {
  const mean = agent.curve?.mean ?? [];
  const floor = Math.max(LOWEST, Math.min(-0.2, ...mean.filter((score) => score !== null), ...agent.score));
  const last = agent.steps.at(-1) || 1;
  const x = (step) => LEFT + ((WIDTH - LEFT - RIGHT) * step) / last;
  const y = (score) => TOP + ((HEIGHT - TOP - BOTTOM) * (HIGHEST - Math.max(score, floor))) / (HIGHEST - floor);
  const points = (scores) => scores.map((score, i) => `${x(agent.curve.step[i])},${y(score)}`);
  const label = (score) => drawn("text", { x: LEFT - 5, y: y(score) + 4, "text-anchor": "end" }, show(score, 1));
  const what = agent.curve ? "Line: mean score of all runs. Circles: this agent." : "Circles: score of this agent.";
  const title = `Score over training. ${what} Scores below ${show(floor, 1)} are drawn at ${show(floor, 1)}.`;
  const image = drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": title });
  for (const anchor of [0, 1]) {
    image.append(drawn("line", { class: "anchor", x1: LEFT, x2: WIDTH - RIGHT, y1: y(anchor), y2: y(anchor) }), label(anchor));
  }
  if (floor < -0.7) image.append(label(floor)); // else it would touch the label of 0
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
  image.append(drawn("text", { x: LEFT, y: HEIGHT - 6 }, what));
  return image;
}
