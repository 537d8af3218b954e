// The map: lines of what learners take against places, and how contrasts ended at the chosen point.
import { byId, drawn, element, grouped, sourced } from "./elements.js";
import { holds, rowsOf } from "./csv.js";

const box = byId("map");

if (box) {
  const [WIDE, HIGH, LEFT, BOTTOM] = [800, 300, 90, 42];
  const [PLOT, TOP] = [560, 12]; // right of it are the names
  const UNITS = { steps: "steps", disagreements: "wrong PINGs", cpu_time_s: "seconds of CPU time" };
  const NEVER = "never learns"; // most of a learner's runs
  const looks = JSON.parse(box.dataset.looks); // name, colour and dash of every learner

  // The rows of a table as objects, each with its line in the file.
  function table(name) {
    const file = `${box.dataset.folder}${name}.csv`;
    if (!holds(file)) return [];
    const [keys, ...rows] = rowsOf(file);
    return rows.map((row, i) => ({ ...Object.fromEntries(keys.map((key, k) => [key, row[k]])), file, line: i + 2 }));
  }

  const learner = (row) => `${row.variant}, ${row.observation}`;
  const room = (row) => `${row.rows} × ${row.columns}`;
  const numbers = (texts) => [...new Set(texts)].map(Number).sort((a, b) => a - b);
  // The sliders do not choose the feedback.
  const isPlain = (row, first) => row.feedback === first.feedback && row.noise === first.noise;

  // A point may be in several grids: the first row of each key.
  const distinct = (rows, key) => rows.filter((row, i) => rows.findIndex((other) => key(other) === key(row)) === i);

  // Below 10, two digits are enough.
  function short(value) {
    if (!Number.isFinite(value)) return NEVER;
    return value < 10 ? String(Number(value.toPrecision(2))) : grouped(Math.round(value));
  }

  const whereOf = (row) => `${room(row)} cells${Number(row.permuted) ? `, ${100 * row.permuted} % of coordinates permuted` : ""}`;

  function begin() {
    const [first, ...others] = table("cells");
    if (!first) return;
    const at = (row) => `${whereOf(row)}/${row.places}`;
    const cells = distinct([first, ...others].filter((row) => isPlain(row, first) && learner(row) in looks), (row) => `${learner(row)}/${at(row)}`);
    const seconds = new Map(table("cpu").map((row) => [`${row.grid}/${row.point}/${learner(row)}`, row]));
    const contrasts = distinct(table("contrasts").filter((row) => isPlain(row, first) && row.x in looks && row.y in looks), (row) => `${row.x}/${row.y}/${at(row)}`);
    const names = [...new Set(cells.map(learner))];
    const [menu, slider] = [byId("map-where"), byId("map-places")];
    menu.append(...[...new Set(cells.map(whereOf))].map((value) => element("option", { value }, value)));
    let [places, note] = [16, ""];
    const currency = () => box.querySelector("input[name=currency]:checked").value;
    const value = (row, kind) => {
      const from = kind === "cpu_time_s" ? seconds.get(`${row.grid}/${row.point}/${learner(row)}`) : row;
      return from ? Number(from[kind] === "inf" ? Infinity : from[kind]) : NaN;
    };
    const isShown = (row) => whereOf(row) === menu.value;
    const offered = () => numbers(cells.filter(isShown).map((row) => row.places));

    // Where nothing was trained with so many places, it is the nearest number, and the page says so.
    function settle() {
      const wanted = places;
      const distance = (n) => Math.abs(Math.log(n / wanted));
      places = offered().reduce((best, n) => (distance(n) < distance(best) ? n : best));
      note = places === wanted ? "" : ` (${wanted} was not trained here)`;
    }

    function show() {
      const numbersHere = offered();
      slider.max = numbersHere.length - 1;
      slider.value = numbersHere.indexOf(places);
      slider.disabled = numbersHere.length === 1;
      const text = places + (slider.disabled ? ", the only number here" : note);
      slider.nextElementSibling.textContent = text;
      slider.setAttribute("aria-valuetext", text);
      box.querySelector(".chart").replaceChildren(chart(cells.filter(isShown), names, value, currency(), places));
      byId("map-verdicts").replaceChildren(...verdicts());
      byId("map-table").replaceChildren(...learned());
    }

    const isChosen = (row) => isShown(row) && Number(row.places) === places;

    // How the contrasts ended here, if there are any.
    function verdicts() {
      const where = `With ${places} ${places === 1 ? "place" : "places"} in a room of ${menu.value}:`;
      const own = contrasts.filter(isChosen);
      if (!own.length) return [`${where} no declared contrast.`];
      const lines = own.map((row) => {
        const [x, y] = [row.x, row.y].map((name) => looks[name].name);
        const words = { faster: `${x}: fewer steps than ${y}`, slower: `${x}: more steps than ${y}`,
          "equally fast": `${x}: about as many steps as ${y}`, "neither learns": `${x}: ${NEVER}, nor does ${y}`,
          undecided: `${x}: undecided against ${y}` };
        return element("li", {}, `${words[row.verdict]} (`, sourced(row.file, row.line, row.n), " pairs of runs)");
      });
      return [where, element("ul", {}, ...lines)];
    }

    // The runs of every learner here; those of a contrast may be more than of others.
    function learned() {
      const parts = cells.filter(isChosen)
        .map((row) => ({ name: learner(row), row, solved: row.n_solved, n: row.n, cost: value(row, currency()) }));
      parts.sort((a, b) => b.solved / b.n - a.solved / a.n || a.cost - b.cost);
      const line = (kind, texts) => element("tr", {}, ...texts.map((text, i) => element(kind, i ? { class: "number" } : {}, ...[text].flat())));
      const body = parts.map(({ name, row, solved, n, cost }) =>
        line("td", [looks[name].name, sourced(row.file, row.line, `${solved} of ${n}`), short(cost)]));
      const head = line("th", ["learner", `runs that learned within ${grouped(Number(first.budget))} steps`, `median ${UNITS[currency()]}`]);
      return [element("thead", {}, head), element("tbody", {}, ...body)];
    }

    slider.addEventListener("input", () => {
      [places, note] = [offered()[slider.value], ""];
      show();
    });
    menu.addEventListener("change", () => {
      settle();
      show();
    });
    for (const button of box.querySelectorAll("input[name=currency]")) button.addEventListener("change", show);
    settle();
    note = "";
    show();
  }

  // Lines of medians against places on logarithmic axes. A learner that never learns is a hollow mark on the line at
  // the top, which is at the budget if steps are counted.
  function chart(rows, names, value, kind, marked) {
    const places = numbers(rows.map((row) => row.places));
    const known = rows.map((row) => value(row, kind)).filter((each) => Number.isFinite(each) && each > 0);
    if (!known.length) known.push(1, 10); // nobody learns, or all at once
    const low = Math.floor(Math.log10(Math.min(...known)));
    const high = kind === "steps" ? Math.log10(rows[0].budget) : Math.ceil(Math.log10(Math.max(...known)) + 0.01);
    const x = (n) => LEFT + (places.length > 1 ? (PLOT - LEFT) * Math.log(n / places[0]) / Math.log(places.at(-1) / places[0]) : 0);
    const y = (v) => TOP + (HIGH - TOP - BOTTOM) * (1 - (Math.log10(v) - low) / (high - low));
    const title = `Median ${UNITS[kind]} until a run has learned, against places, by learner. Lower is better.`;
    const image = drawn("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "aria-label": title });
    for (let power = low; power < high + 1; power += 1) {
      const [height, text] = power < high ? [y(10 ** power), short(10 ** power)] : [TOP, NEVER];
      image.append(drawn("line", { class: "anchor", x1: LEFT, x2: PLOT, y1: height, y2: height }));
      image.append(drawn("text", { x: LEFT - 6, y: height + 4, "text-anchor": "end" }, text));
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
    return element("figure", {}, image, element("figcaption", {}, `${title} Hollow, at the top: at least half of the runs never learn within the budget${kind === "steps" ? `, ${grouped(Number(rows[0].budget))} steps` : ""}.`));
  }

  begin();
}
