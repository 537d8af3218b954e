// The map: lines of what learners take against places, and how contrasts ended at the chosen point.
import { byId, drawn, element, grouped, sourced } from "./elements.js";
import { holds, rowsOf } from "./csv.js";

const box = byId("map");

if (box) {
  const [WIDE, HIGH, LEFT, BOTTOM] = [760, 300, 70, 42];
  const [PLOT, TOP] = [540, 12]; // right of it are the names
  const BUDGETS = [1000, 2000, 5000, 10000, 20000, 50000, 100000, 200000, 500000, 1000000];
  const UNITS = { steps: "steps", disagreements: "wrong PINGs", cpu_time_s: "seconds of CPU time" };
  const looks = JSON.parse(box.dataset.looks); // name, colour and dash of every learner

  // The rows of a table as objects, each with its line in the file.
  function table(name) {
    const file = `${box.dataset.folder}${name}.csv`;
    if (!holds(file)) return [];
    const [keys, ...rows] = rowsOf(file);
    return rows.map((row, i) => ({ ...Object.fromEntries(keys.map((key, k) => [key, row[k]])), file, line: i + 2 }));
  }

  const learner = (row) => `${row.algorithm}, ${row.observation}`;
  const room = (row) => `${row.rows} × ${row.columns}`;
  const numbers = (texts) => [...new Set(texts)].map(Number).sort((a, b) => a - b);
  // The sliders do not choose the feedback.
  const isPlain = (row, first) => row.feedback === first.feedback && row.noise === first.noise;

  // A point may be in several grids: the first row of each key.
  const distinct = (rows, key) => rows.filter((row, i) => rows.findIndex((other) => key(other) === key(row)) === i);

  // Two digits are enough.
  function short(value) {
    if (!Number.isFinite(value)) return "never";
    return value < 10 ? String(Number(value.toPrecision(2))) : grouped(Number(value.toPrecision(3)));
  }

  function begin() {
    const [first, ...others] = table("cells");
    if (!first) return;
    const at = (row) => `${room(row)}/${row.places}/${row.permuted}`;
    const cells = distinct([first, ...others].filter((row) => isPlain(row, first) && learner(row) in looks), (row) => `${learner(row)}/${at(row)}`);
    const seconds = new Map(table("cpu").map((row) => [`${row.grid}/${row.point}/${learner(row)}`, row]));
    const runs = new Map();
    for (const run of table("runs")) {
      const key = `${run.grid}/${run.point}/${run.learner}`;
      runs.set(key, [...(runs.get(key) ?? []), run.steps === "" ? Infinity : Number(run.steps)]);
    }
    const contrasts = distinct(table("contrasts").filter((row) => isPlain(row, first) && row.x in looks && row.y in looks), (row) => `${row.x}/${row.y}/${at(row)}`);
    const names = [...new Set(cells.map(learner))];
    const most = Math.max(...cells.map((row) => Number(row.budget)));
    const choices = {
      places: numbers(cells.map((row) => row.places)),
      room: [...new Set(cells.map(room))].sort((a, b) => parseFloat(a) - parseFloat(b)),
      permuted: numbers(cells.map((row) => row.permuted)),
      budget: [...BUDGETS.filter((each) => each < most), most],
    };
    const usual = room(cells[0]);
    const chosen = { places: 16, room: usual, permuted: 0, budget: most };
    const sliders = Object.keys(choices).map((name) => [name, byId(`map-${name}`)]);
    const currency = () => box.querySelector("input[name=currency]:checked").value;
    const value = (row, kind) => {
      const from = kind === "cpu_time_s" ? seconds.get(`${row.grid}/${row.point}/${learner(row)}`) : row;
      return from ? Number(from[kind] === "inf" ? Infinity : from[kind]) : NaN;
    };
    const here = (row) => room(row) === chosen.room && Number(row.permuted) === chosen.permuted;

    // Where nothing was trained, the other sliders move to the nearest cell that was.
    function settle(moved) {
      const distance = (row) =>
        1e6 * (moved === "places" ? Number(row.places) !== chosen.places : moved === "room" ? room(row) !== chosen.room : Number(row.permuted) !== chosen.permuted)
        + 1e3 * (room(row) !== chosen.room) + 1e3 * 10 * Math.abs(Number(row.permuted) - chosen.permuted)
        + Math.abs(Math.log(Number(row.places) / chosen.places));
      const nearest = cells.reduce((best, row) => (distance(row) < distance(best) ? row : best));
      Object.assign(chosen, { places: Number(nearest.places), room: room(nearest), permuted: Number(nearest.permuted) });
    }

    function show() {
      for (const [name, slider] of sliders) {
        slider.max = choices[name].length - 1;
        slider.value = choices[name].indexOf(chosen[name]);
        const shown = { room: chosen.room, permuted: `${100 * chosen.permuted} %`, budget: `${grouped(chosen.budget)} steps` };
        const text = shown[name] ?? String(chosen[name]);
        slider.nextElementSibling.textContent = text;
        slider.setAttribute("aria-valuetext", text);
      }
      box.querySelector(".chart").replaceChildren(chart(cells.filter(here), names, value, currency(), chosen.places));
      byId("map-verdicts").replaceChildren(...verdicts());
      byId("map-table").replaceChildren(...learned());
    }

    const isChosen = (row) => here(row) && Number(row.places) === chosen.places;

    // How the contrasts ended here, if there are any.
    function verdicts() {
      const where = `${chosen.places} ${chosen.places === 1 ? "place" : "places"} in a room of ${chosen.room} cells`;
      const code = chosen.permuted ? `, the coordinates of ${100 * chosen.permuted} % of the places permuted` : "";
      const own = contrasts.filter(isChosen);
      if (!own.length) return [`With ${where}${code}: no declared contrast.`];
      const lines = own.map((row) => {
        const [x, y] = [row.x, row.y].map((name) => looks[name].name);
        const words = { faster: `${x}: fewer steps than ${y}`, slower: `${x}: more steps than ${y}`,
          "equally fast": `${x}: about as many steps as ${y}`, "neither learns": `${x}: does not learn, nor does ${y}`,
          undecided: `${x}: undecided against ${y}` };
        return element("li", {}, `${words[row.verdict]} (`, sourced(row.file, row.line, row.n), " pairs of runs)");
      });
      return [`With ${where}${code}:`, element("ul", {}, ...lines)];
    }

    // The runs of every learner here; those of a contrast may be more than of others.
    function learned() {
      const parts = cells.filter(isChosen).map((row) => {
        const name = learner(row);
        const steps = runs.get(`${row.grid}/${row.point}/${name}`) ?? [];
        const solved = steps.filter((each) => each <= chosen.budget).length;
        return { name, row, solved, n: steps.length, took: value(row, currency()) };
      });
      parts.sort((a, b) => b.solved / b.n - a.solved / a.n || a.took - b.took);
      const line = (kind, texts) => element("tr", {}, ...texts.map((text, i) => element(kind, i ? { class: "number" } : {}, ...[text].flat())));
      const body = parts.map(({ name, row, solved, n, took }) =>
        line("td", [looks[name].name, sourced(row.file, row.line, `${solved} of ${n}`), Number.isFinite(took) ? short(took) : "most never learn"]));
      const head = line("th", ["learner", `runs that learned within ${grouped(chosen.budget)} steps`, `median ${UNITS[currency()]}`]);
      return [element("thead", {}, head), element("tbody", {}, ...body)];
    }

    for (const [name, slider] of sliders) {
      slider.addEventListener("input", () => {
        chosen[name] = choices[name][slider.value];
        if (name !== "budget") settle(name);
        show();
      });
    }
    for (const button of box.querySelectorAll("input[name=currency]")) button.addEventListener("change", show);
    settle("room");
    show();
  }

  // Lines of medians against places on logarithmic axes; a hollow mark is a learner most of whose runs never learn.
  function chart(rows, names, value, kind, marked) {
    const places = numbers(rows.map((row) => row.places));
    const known = rows.map((row) => value(row, kind)).filter((each) => Number.isFinite(each) && each > 0);
    if (!known.length) known.push(1, 10); // nobody learns, or all at once
    const [low, high] = [Math.floor(Math.log10(Math.min(...known))), Math.ceil(Math.log10(Math.max(...known)) + 0.01)];
    const x = (n) => LEFT + (places.length > 1 ? (PLOT - LEFT) * Math.log(n / places[0]) / Math.log(places.at(-1) / places[0]) : 0);
    const y = (v) => TOP + (HIGH - TOP - BOTTOM) * (1 - (Math.log10(v) - low) / (high - low));
    const title = `Median ${UNITS[kind]} until a run has learned, against places, by learner. Lower is better.`;
    const image = drawn("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "aria-label": title });
    for (let power = low; power <= high; power += 1) {
      image.append(drawn("line", { class: "anchor", x1: LEFT, x2: PLOT, y1: y(10 ** power), y2: y(10 ** power) }));
      image.append(drawn("text", { x: LEFT - 6, y: y(10 ** power) + 4, "text-anchor": "end" }, short(10 ** power)));
    }
    for (const n of places) image.append(drawn("text", { x: x(n), y: HIGH - BOTTOM + 16, "text-anchor": "middle" }, String(n)));
    image.append(drawn("text", { x: (LEFT + PLOT) / 2, y: HIGH - 6, "text-anchor": "middle" }, "number of places"));
    image.append(drawn("line", { class: "now", x1: x(marked), x2: x(marked), y1: TOP, y2: HIGH - BOTTOM }));
    const ends = [];
    names.forEach((name) => {
      const own = new Map(rows.filter((row) => learner(row) === name).map((row) => [Number(row.places), value(row, kind)]));
      const points = [...own].sort(([a], [b]) => a - b).filter(([, v]) => !Number.isNaN(v))
        .map(([n, v]) => [x(n), Number.isFinite(v) ? y(Math.max(v, 10 ** low)) : TOP, Number.isFinite(v)]);
      if (!points.length) return;
      const { colour, dash } = looks[name];
      image.append(drawn("polyline", { points: points.map(([a, b]) => `${a},${b}`).join(" "), fill: "none",
        style: `stroke: ${colour}`, "stroke-width": 2, "stroke-dasharray": dash }));
      for (const [a, b, isKnown] of points) {
        image.append(drawn("circle", { cx: a, cy: b, r: 4, style: `stroke: ${colour}; fill: ${isKnown ? colour : "var(--paper)"}`, "stroke-width": 1.5 }));
      }
      ends.push({ name, colour, y: points.at(-1)[1] });
    });
    let last = -Infinity;
    for (const end of ends.sort((a, b) => a.y - b.y)) {
      last = Math.max(end.y, last + 15);
      image.append(drawn("text", { x: PLOT + 10, y: last + 4, style: "fill: var(--ink)" }, looks[end.name].name));
    }
    return element("figure", {}, image, element("figcaption", {}, `${title} Hollow, at the top: most runs never learn within the budget.`));
  }

  begin();
}
