// Tables: a click on a column's header sorts by it, upwards, downwards, then as written. Long ones are made of
// their CSV file when they are unfolded.
import { element } from "./elements.js";
import { holds, rowsOf } from "./csv.js";

function sortable(table) {
  const body = table.tBodies[0];
  const written = [...body.rows];
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = element("button", { type: "button" }, head.textContent);
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: "none" }[head.getAttribute("aria-sort")] ?? "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      if (next === "none") return body.append(...written);
      head.setAttribute("aria-sort", next);
      const sign = next === "ascending" ? 1 : -1;
      body.append(...[...written].sort((a, b) => compared(a.cells[column], b.cells[column], sign)));
    });
  });
}

// A CSV file as a table; a column of numbers is one whose entries all are, or are missing.
function tableOfFile(file) {
  const [names, ...rows] = rowsOf(file);
  const kinds = names.map((_, i) => (rows.every((row) => row[i] === "" || !Number.isNaN(Number(row[i].replace("inf", "Infinity")))) ? "number" : ""));
  const cell = (kind, text, i) => element(kind, kinds[i] ? { class: kinds[i] } : {}, text);
  const line = (kind, texts) => element("tr", {}, ...texts.map((text, i) => cell(kind, text, i)));
  return element("table", {}, element("thead", {}, line("th", names)), element("tbody", {}, ...rows.map((row) => line("td", row))));
}

for (const table of document.querySelectorAll("table.sortable")) sortable(table);
for (const folded of document.querySelectorAll("details[data-csv]")) {
  folded.addEventListener("toggle", () => {
    const { csv } = folded.dataset;
    if (!holds(csv) || folded.querySelector("table")) return;
    const table = tableOfFile(csv);
    folded.append(element("div", { class: "scroll long", tabindex: "0", role: "region", "aria-label": csv }, table));
    sortable(table);
  });
}

// The number that a cell begins with, NaN without one.
function numberOf(cell) {
  const text = cell.textContent.trim().replaceAll("\u2212", "-").replaceAll(",", "");
  return text === "never" ? Infinity : parseFloat(text);
}

function compared(a, b, sign) {
  if (!a.matches(".number")) return sign * a.textContent.localeCompare(b.textContent);
  const [x, y] = [numberOf(a), numberOf(b)];
  if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y); // missing numbers come last
  return x === y ? 0 : sign * (x < y ? -1 : 1);
}
