// The controls: the slider through training, what is shown, both players, and the walk's buttons.
import { byId, grouped } from "./elements.js";
import { agents, learnerOf } from "./agents.js";
import { Panel } from "./panel.js";
import { Walk } from "./walk.js";
import { addressOf, asked } from "./address.js";

const slider = byId("step");
const kinds = byId("shown");
const shown = { step: 0, kind: "values" };
const panels = [];
let hasAddress = false; // whether the address follows what is shown
let addressTimer;

// All steps at which one of the two agents has a map.
const allSteps = () => [...new Set(panels.flatMap((panel) => panel.agent.timeline))].sort((a, b) => a - b);

function refresh() {
  const steps = allSteps();
  const place = Math.max(steps.findLastIndex((step) => step <= shown.step), 0);
  shown.step = steps[place];
  slider.max = steps.length - 1;
  slider.disabled = byId("learn").disabled = steps.length === 1;
  slider.value = place;
  const text = slider.disabled ? `only step ${grouped(shown.step)} is published` : `${grouped(shown.step)} of ${grouped(steps.at(-1))}`;
  byId("step-text").textContent = text;
  const hasValues = panels.some((panel) => panel.agent.hasValues);
  for (const option of kinds.options) option.disabled = !hasValues && option.value !== "policy";
  kinds.value = hasValues ? shown.kind : "policy";
  byId("shown-why").textContent = hasValues ? "" : "Of these agents, only the policy is published.";
  slider.setAttribute("aria-valuetext", text);
  byId("step-label").textContent = `Training ${[...new Set(panels.map((panel) => panel.agent.unitName))].join(" or ")}`;
  panels[0].draw(shown, panels[1]);
  panels[1].draw(shown, panels[0]);
  clearTimeout(addressTimer); // browsers allow few changes of the address a second
  const address = addressOf(panels, shown);
  if (hasAddress) addressTimer = setTimeout(() => history.replaceState(null, "", address), 150);
}

// The first agent that walks to success and whose training can be played, and beside it the first such agent
// of the same scenario and experiment; one of the two is a net, if an experiment has one. Success outranks training.
function firstPair() {
  const isNet = (agent) => agent.family === "deep";
  const walked = (agent) => new Walk(agent, agent.steps.length - 1, agent.room.starts[0]).finish().at(-1)?.event;
  const ranks = new Map(agents.map((agent) => [agent, 2 * (walked(agent) === "target_ping") + (agent.timeline.length > 1)]));
  const best = (among) => among.reduce((found, agent) => (ranks.get(agent) > ranks.get(found) ? agent : found), among[0]);
  const withNets = new Set(agents.filter(isNet).map(({ experiment }) => experiment));
  const paired = agents.filter(({ experiment }) => withNets.has(experiment));
  const left = best(paired.length ? paired : agents);
  const there = agents.filter(({ scenario, experiment }) => scenario === left.scenario && experiment === left.experiment);
  return [left, best(there.filter((agent) => isNet(agent) !== isNet(left))) ?? there.at(-1)];
}

// Shows what an address asks for, as far as it exists.
function follow({ wishes, step, kind }) {
  panels.forEach((panel, i) => {
    const there = agents.filter((agent) => learnerOf(agent) === learnerOf(wishes[i]));
    const agent = there.find(({ experiment }) => experiment === wishes[i].experiment) ?? there[0];
    panel.choose({ learner: agent?.learner, ...wishes[i] });
  });
  shown.step = step >= 0 ? step : allSteps().at(-1);
  if ([...kinds.options].some((option) => option.value === kind)) shown.kind = kind;
  kinds.value = shown.kind;
}

// A button that starts and stops `tick`, which returns whether there is more to come; returns what stops it.
function player(button, pause, tick) {
  const label = button.textContent;
  let timer = 0;
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    button.setAttribute("aria-pressed", "false");
    button.textContent = label;
  };
  button.addEventListener("click", () => {
    if (timer) return stop();
    button.setAttribute("aria-pressed", "true");
    button.textContent = "Pause";
    timer = setInterval(() => tick() || stop(), pause);
  });
  return stop;
}

function toPlace(place) {
  shown.step = allSteps()[place];
  refresh();
}

function nextMap() {
  const [place, last] = [Number(slider.value), Number(slider.max)];
  toPlace(place >= last ? 0 : place + 1);
  return Number(slider.value) < last;
}

// Finished walks begin again; ties and chance may then go another way.
function nextStep() {
  if (panels.every(({ walk }) => walk.end)) for (const panel of panels) panel.startWalk(panel.walk.start, panel.walk.number + 1);
  const going = panels.map((panel) => panel.walk.step());
  for (const panel of panels) panel.drawWalk();
  return going.some(Boolean);
}

export function start() {
  const stopTraining = player(byId("learn"), 450, nextMap);
  const stopWalking = player(byId("walk-all"), 250, nextStep);
  byId("walk-one").addEventListener("click", () => {
    stopWalking();
    nextStep();
  });
  byId("walk-again").addEventListener("click", () => {
    stopWalking();
    for (const panel of panels) panel.startWalk(panel.agent.room.startOf(panel.agent.room.blockOf(panel.walk.start)));
  });
  slider.addEventListener("input", () => {
    stopTraining();
    stopWalking();
    toPlace(Number(slider.value));
  });
  kinds.addEventListener("change", () => {
    shown.kind = kinds.value;
    refresh();
  });
  addEventListener("hashchange", () => {
    const wanted = asked();
    if (!wanted) return;
    stopTraining();
    stopWalking();
    follow(wanted);
    refresh();
    byId("explorer").scrollIntoView();
  });

  const point = (cell, room) => panels.forEach((panel) => panel.follow(cell, room));
  const situate = (change, room) => {
    stopWalking();
    if (panels.map((panel) => panel.change(change, room)).some(Boolean)) refresh();
  };
  const callbacks = { refresh, point, situate };
  panels.push(...["left", "right"].map((side) => new Panel(document.querySelector(`[data-side="${side}"]`), callbacks)));
  follow({ wishes: firstPair() });
  if (asked()) follow(asked());
  refresh();
  if (!asked()) for (const panel of panels) panel.finishWalk(); // so that the outcome can be seen at once
  hasAddress = true;
}
