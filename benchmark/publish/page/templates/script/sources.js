// Sources: a click on a number opens a dialog with the lines of the CSV file that it comes from.
import { byId, element } from "./elements.js";
import { csv } from "./data.js";
import { holds, rowsOf } from "./csv.js";

// The line numbers of a selection such as "3;7-9".
function selected(selection) {
  return selection.split(";").flatMap((part) => {
    const [first, last = first] = part.split("-").map(Number);
    return Array.from({ length: last - first + 1 }, (_, i) => first + i);
  });
}

// The columns that hold the number shown, or whose mean it is.
function cited(text, columns, rows) {
  const [number] = text.replaceAll("\u2212", "-").replaceAll(",", "").split(" ");
  const decimals = number.replace("%", "").split(".")[1]?.length ?? 0;
  const written = (value) => [value.toFixed(decimals), String(+value.toPrecision(3)), `${Math.round(100 * value)}%`];
  return columns.map((_, i) => i).filter((i) => {
    const cells = rows.map((row) => row[i]).filter((cell) => cell !== "");
    if (!cells.length) return false;
    if (cells.some((cell) => Number.isNaN(Number(cell)))) return rows.length === 1 && cells[0] === text;
    return written(cells.reduce((sum, cell) => sum + Number(cell), 0) / cells.length).includes(number);
  });
}

// One line is shown as a table of names and cells, several as they are in the file.
function tableOf(columns, rows, marked) {
  const mark = (i) => (marked.includes(i) ? { class: "cited" } : {});
  if (rows.length === 1) {
    const lines = columns.map((name, i) =>
      element("tr", {}, element("th", { scope: "row", ...mark(i) }, name), element("td", mark(i), rows[0][i])));
    return element("table", {}, element("tbody", {}, ...lines));
  }
  const line = (kind, cells) => element("tr", {}, ...cells.map((cell, i) => element(kind, mark(i), cell)));
  const lines = rows.map((row) => line("td", row));
  return element("table", { class: "many" }, element("thead", {}, line("th", columns)), element("tbody", {}, ...lines));
}

function showSource(text, file, selection) {
  if (!holds(file)) return false;
  const columns = rowsOf(file)[0];
  const rows = selected(selection).map((line) => rowsOf(file)[line - 1]);
  const marked = cited(text, columns, rows);
  const mean = marked.length ? `, the mean of ${columns[marked[0]]} over these lines` : ", computed from these lines";
  const box = { class: "scroll", tabindex: "0", role: "region", "aria-label": "Lines of the file" };
  byId("source-title").textContent = `${file}, line${rows.length > 1 ? "s" : ""} ${selection.replaceAll(";", ", ")}`;
  byId("source-rows").replaceChildren(
    element("p", {}, `Shown as ${text}${rows.length > 1 ? mean : ""}.`),
    element("div", box, tableOf(columns, rows, marked)),
  );
  byId("source-file").href = `${file}#row=${selection}`;
  byId("source").showModal();
  byId("source").querySelector("td.cited")?.scrollIntoView({ block: "nearest", inline: "center" });
  return true;
}

// A file that the page holds is saved from the page, which may be alone.
function save(name) {
  const address = URL.createObjectURL(new Blob([csv[name]], { type: "text/csv" }));
  element("a", { href: address, download: name.replaceAll("/", "_") }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60000);
}

document.addEventListener("click", (event) => {
  const name = event.target.closest("a.file")?.getAttribute("href").split("#")[0];
  if (name && holds(name)) {
    save(name);
    event.preventDefault();
    return;
  }
  const link = event.target.closest("a.n");
  if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
  const [file, selection] = link.getAttribute("href").split("#row=");
  if (selection && showSource(link.textContent, file, selection)) event.preventDefault();
});
