// The page: tables that can be sorted, and the explorer's controls.
document.documentElement.classList.add("js");

// The number that a cell begins with; without one, it comes last.
const numberOf = (cell) => parseFloat(cell.textContent.replace("never", "Infinity").replaceAll("\u2212", "-").replaceAll(",", ""));

function compared(a, b) {
  const [x, y] = [numberOf(a), numberOf(b)];
  if (!a.matches(".number")) return a.textContent.localeCompare(b.textContent);
  return Number.isNaN(x) || Number.isNaN(y) ? Number.isNaN(x) - Number.isNaN(y) : x < y ? -1 : Number(x > y);
}

// A click on a column's header sorts by it, another one the other way round.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = element("button", { type: "button" }, ...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const order = head.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", order);
      const rows = [...table.tBodies[0].rows].sort((a, b) => compared(a.cells[column], b.cells[column]));
      table.tBodies[0].append(...(order === "ascending" ? rows : rows.reverse()));
    });
  });
}

// The first net that walks to success, and a table beside it that does so in the same scenario.
function firstPair() {
  const succeeds = (agent) =>
    agent.hasValues && new Walk(agent, agent.steps.length - 1, agent.room.starts[0]).finish().end === ENDS.target_ping;
  const good = agents.filter(succeeds);
  const net = good.find((agent) => agent.family === "deep") ?? good.at(-1) ?? agents.at(-1);
  const isBeside = ({ experiment, scenario, family }) => experiment === net.experiment && scenario === net.scenario && family !== "deep";
  return [good.find(isBeside) ?? agents[0], net];
}

// A button that starts and stops `tick`, which returns whether there is more to come; returns what stops it.
function player(button, pause, tick) {
  const label = button.textContent;
  let timer = 0;
  const play = (isOn) => {
    clearInterval(timer);
    timer = isOn ? setInterval(() => tick() || play(false), pause) : 0;
    button.setAttribute("aria-pressed", isOn);
    button.textContent = isOn ? "Pause" : label;
  };
  button.addEventListener("click", () => play(!timer));
  return () => play(false);
}

function startExplorer() {
  const [slider, kinds] = [byId("step"), byId("shown")];
  let shown = Infinity; // the step
  const panels = [];
  // All steps at which one of the two agents has a map.
  const allSteps = () => [...new Set(panels.flatMap((panel) => panel.agent.timeline))].sort((a, b) => a - b);

  function refresh() {
    const steps = allSteps();
    const place = Math.max(steps.findLastIndex((step) => step <= shown), 0);
    shown = steps[place];
    slider.max = steps.length - 1;
    slider.value = place;
    slider.disabled = byId("learn").disabled = steps.length === 1;
    byId("step-text").textContent = `${grouped(shown)} of ${grouped(steps.at(-1))}`;
    slider.setAttribute("aria-valuetext", byId("step-text").textContent);
    // Values of the same kind have the same colours on both maps.
    const limits = panels.map(({ agent }) => agent.limits);
    const isShared = panels.every(({ agent }) => agent.hasValues && agent.kind === panels[0].agent.kind);
    const both = [Math.min(limits[0][0], limits[1][0]), Math.max(limits[0][1], limits[1][1])];
    panels.forEach((panel, i) => panel.draw(shown, kinds.value, isShared ? both : limits[i]));
  }
  function toPlace(place) {
    shown = allSteps()[place];
    refresh();
  }
  function nextMap() {
    const [place, last] = [Number(slider.value), Number(slider.max)];
    toPlace(place >= last ? 0 : place + 1);
    return Number(slider.value) < last;
  }
  function nextStep() {
    if (panels.every(({ walk }) => walk.end)) for (const panel of panels) panel.startWalk();
    const going = panels.map((panel) => panel.walk.step());
    for (const panel of panels) panel.drawWalk();
    return going.some(Boolean);
  }
  const stopTraining = player(byId("learn"), 450, nextMap);
  const stopWalking = player(byId("walk-all"), 250, nextStep);
  const stop = () => [stopTraining, stopWalking].forEach((each) => each());
  byId("walk-one").addEventListener("click", () => [stop(), nextStep()]);
  byId("walk-again").addEventListener("click", () => [stop(), ...panels.map((panel) => panel.startWalk())]);
  slider.addEventListener("input", () => [stop(), toPlace(Number(slider.value))]);
  kinds.addEventListener("change", refresh);

  // What is chosen on one map is chosen on the other, too, if its room is alike.
  const withOthers = (panel) => panels.filter(({ agent }) => alike(agent.room, panel.agent.room));
  const look = (panel, cell) => withOthers(panel).forEach((each) => each.showCell(cell));
  const situate = (panel, situation) => [stop(), ...withOthers(panel).map((each) => each.change(situation))];
  for (const root of document.querySelectorAll(".panel")) panels.push(new Panel(root, { refresh, look, situate }));
  firstPair().forEach((agent, i) => panels[i].choose(agent));
  refresh();
  for (const panel of panels) panel.finishWalk(); // so that the outcome can be seen at once
  paintKey();
  byId("wait").remove();
  byId("explore").hidden = false;
}

if (explorer) startExplorer();
